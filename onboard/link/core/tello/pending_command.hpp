#pragma once
#include <cstdint>

#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// The one command to a connected drone whose answer is waited for, or that is sent again until the drone is down.
/// Core: no I/O, no allocation; one thread.
class PendingCommand {
 public:
  enum class Kind : std::uint8_t { nothing, takeoff, land, emergency };

  explicit PendingCommand(const SessionSettings& settings) noexcept : settings_(settings) {}

  /// In place of what was pending. `height_m`: the drone's now.
  void begin(TimeNs now, Kind kind, float height_m) noexcept;
  void end() noexcept { kind_ = Kind::nothing; }
  Kind kind() const noexcept { return kind_; }
  bool is_pending() const noexcept { return kind_ != Kind::nothing; }
  /// It was sent, so that an answer may be to it.
  bool awaits_answer() const noexcept { return is_pending() && !must_send_; }

  /// At every step of a landing: sent again while the drone does not come down, `emergency` in any case. `is_fresh`:
  /// its height is of now.
  void repeat(TimeNs now, bool is_fresh, float height_m) noexcept;
  /// True when it is to be sent now.
  bool next_send(TimeNs now, CommandText& out) noexcept;

 private:
  SessionSettings settings_;
  Kind kind_ = Kind::nothing;
  bool must_send_ = false;
  TimeNs at_ns_ = 0;         ///< asked for, or sent
  TimeNs cut_since_ns_ = 0;  ///< `emergency` was asked for first
  float lowest_m_ = 0;       ///< since the last `land` was sent
};

/// When `mon`, which makes a drone look for mission pads, is sent: until the state text shows that it looks, since an
/// answer is not needed. Core: no I/O, no allocation; one thread.
class PadRequest {
 public:
  explicit PadRequest(bool wanted) noexcept : left_(wanted ? max_requests : 0) {}

  /// True when it is to be sent now, to a drone that stands and owes no answer. `pad`: of the newest state text.
  bool due(TimeNs now, int pad) noexcept;
  /// Its late refusal would be taken for another command's.
  bool may_be_answered(TimeNs now, TimeNs timeout_ns) const noexcept {
    return requested_ns_ != 0 && now - requested_ns_ < timeout_ns;
  }

 private:
  /// A firmware that knows no pads goes on saying that it does not look for them.
  static constexpr int max_requests = 5;

  int left_;
  TimeNs requested_ns_ = 0;  ///< the newest; 0: none yet
};

}  // namespace ledgerline::link
