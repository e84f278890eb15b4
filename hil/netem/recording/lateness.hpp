#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "hil/netem/recording/link_recording.hpp"

// What a capture at the client shows of a link's delay and loss. The drone's clock is not in it, so neither is the
// least delay there is: all delays of states are beyond that.
namespace ledgerline::hil {

/// A Tello says its state ten times a second.
inline constexpr TimeNs state_period_ns = 100 * ns_per_ms;
/// After so long without a state the drone may have been switched off: a new schedule begins.
inline constexpr TimeNs states_end_after_ns = 5 * ns_per_s;

struct MeasuredLink {
  std::vector<RecordedDelay> moments;  ///< its times from 0 on
  std::size_t came = 0, missing = 0;
  double period_s = 0;  ///< of states: as fitted, of the stretch with the most arrivals; of answers 0
};

/// Of state texts, by when they arrived (ascending), from the drone to the client.
///
/// Method: the drone says one every 100 ms by a clock of its own. Its schedule is the straight line below all arrivals
/// that is nearest to them (as Moon, Skelly and Towsley, Estimation and removal of clock skew from network delay
/// measurements, 1999), found while the stretch that is looked at grows. Each text has the newest place in the schedule
/// that it can have: after a pause a heap of texts is what was late, and places that stay empty are lost texts. A text
/// stands for half a period before and behind its place.
///
/// Limits: unevenness of the drone itself is taken for the link's delay. Texts are not numbered: one that is later than
/// three quarters of a period, with no text behind it in a heap, is taken for the next one, and a lost one before it. A
/// lasting change of delay by more than that looks the same.
///
/// An error where there are fewer than two texts, or where they do not come every 100 ms (within 5 %).
Result<MeasuredLink> recording_of_states(std::span<const TimeNs> arrivals);

/// A command that the drone answers at once (hil/netem/sdk/calls.hpp), and when its answer came; nothing: never.
struct RequestTime {
  TimeNs at_ns = 0;
  std::optional<TimeNs> answered_ns{};
};

/// Of commands and their answers: half of the time between is the delay of each way. Limits: whether the way there or
/// the way back was slow, or the drone, cannot be determined; of a command without an answer neither which of both was
/// lost; and a client says few commands but rc, so that much is guessed between. An error where there are
/// fewer than two.
Result<MeasuredLink> recording_of_answers(std::span<const RequestTime> asked);

}  // namespace ledgerline::hil
