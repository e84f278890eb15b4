#pragma once
#include <algorithm>
#include <functional>
#include <optional>
#include <utility>

#include "common/rt/clock.hpp"

namespace ledgerline::agent {

/// Mocap stamps are real time, decisions are made on CLOCK_MONOTONIC: this turns one into the other, and accepts no
/// stamp that lies more than 20 ms in the future or 1 s in the past. None comes out as newer than its arrival: link
/// refuses poses of the future. Real time may jump (NTP, a person), be it by less than those bounds: so the clocks are
/// read for every pose, and a jump costs at most the poses that were in flight. One thread.
class MocapClock {
 public:
  static constexpr TimeNs max_delay_ns = 1 * ns_per_s;
  static constexpr TimeNs max_ahead_ns = 20 * ns_per_ms;
  using ReadOffset = std::function<TimeNs()>;

  /// `read`: real time minus CLOCK_MONOTONIC, now.
  explicit MocapClock(ReadOffset read) : read_(std::move(read)), offset_ns_(read_()) {}

  void refresh() { offset_ns_ = read_(); }
  TimeNs offset_ns() const { return offset_ns_; }

  static bool plausible(TimeNs stamp_ns, TimeNs arrived_ns) {
    return stamp_ns - arrived_ns <= max_ahead_ns && arrived_ns - stamp_ns <= max_delay_ns;
  }
  /// The stamp on CLOCK_MONOTONIC; nothing where it is not accepted.
  std::optional<TimeNs> stamp(TimeNs source_real_ns, TimeNs arrived_ns) {
    refresh();
    const TimeNs stamp_ns = source_real_ns - offset_ns_;
    if (!plausible(stamp_ns, arrived_ns)) return std::nullopt;
    return std::min(stamp_ns, arrived_ns);
  }

 private:
  ReadOffset read_;
  TimeNs offset_ns_;
};

}  // namespace ledgerline::agent
