#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/random.hpp"
#include "common/fabric/sending/outcome.hpp"
#include "common/rt/retry.hpp"
#include "onboard/agent/core/integrity_monitor.hpp"
#include "onboard/agent/core/outbox/batcher.hpp"

namespace ledgerline::agent {

/// Brings agent's integrity violations onto the ledger, beside the failsafe's transitions and as they never behind
/// states: when it begins, when it is over, and between the two at most each gap_ns that there are more reasons. One
/// call in flight, of all drones; made again behind a back-off with jitter, with what is true then: the newest wins, so
/// that nothing queues. From a call that the contract refused on each drone goes by itself, and one that is refused by
/// itself waits gap_ns: another's drone by now must not silence the rest. One thread; the same inputs and seed give the
/// same calls.
class AlarmSender {
 public:
  /// Between two calls while one lasts: transactions of two organisations' endorsements, which report only a count.
  static constexpr TimeNs gap_ns = 60 * ns_per_s;

  struct Counters {
    std::uint64_t on_ledger = 0, repeated = 0, refused = 0;
  };
  struct Sending {
    std::uint64_t number = 0;  ///< never that of a frame, of transitions, apply_stops or evictions
    std::vector<const DroneName*> drones;
  };

  AlarmSender(const BatchConfig& config, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// A call to make now, if any; it is then in flight.
  std::optional<Sending> next(TimeNs now, const IntegrityMonitor& integrity);
  /// How call `number` ended; false if it is none of ours.
  bool finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  bool in_flight() const { return call_ != 0; }
  const Counters& counters() const { return counters_; }

 private:
  struct ReportedAlarm {
    bool stands = false;
    std::uint64_t count = 0;
  };
  struct Slot {
    DroneName drone{};
    ReportedAlarm said{};
    TimeNs rest_until_ns = INT64_MIN;  ///< no call for its sake before, unless the ledger becomes trusted or untrusted
    bool refused = false;              ///< by itself: not even then
    bool sending = false;
  };
  bool due(const Slot& slot, TimeNs now, const ReportedAlarm& truth) const;

  std::vector<Slot> slots_;
  BackOff pause_;
  Random random_;
  Counters counters_;
  ReportedAlarm sending_{};  ///< what the call in flight says
  std::uint64_t call_ = 0;   ///< in flight; 0: none
  bool alone_ = false;
  std::uint64_t last_call_ = std::uint64_t{5} << 61;  // between transitions and apply_stops
};

/// The call, with an asset `<drone>/alarm` for each drone. `real_offset_ns`: as for encode_frame.
fabric::Call encode_alarm(const AlarmSender::Sending& sending, const IntegrityMonitor& integrity, TimeNs now,
                          TimeNs real_offset_ns);

}  // namespace ledgerline::agent
