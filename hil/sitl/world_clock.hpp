#pragma once
#include <array>
#include <cstdint>

#include "common/rt/clock.hpp"

namespace ledgerline::hil {

/// The clocks of a simulated world, and what was done to them.
class WorldClock {
 public:
  enum class Host : std::uint8_t { mocap, drones };

  void advance(TimeNs by_ns);
  TimeNs now() const { return now_; }
  /// Real time minus now().
  TimeNs real_offset(Host host) const;
  /// CLOCK_MONOTONIC of the drones' host, and real time less it.
  TimeNs host_now() const { return now_ - host_slept_ns_; }
  TimeNs host_real_offset() const { return real_offset(Host::drones) + host_slept_ns_; }
  TimeNs host_slept_ns() const { return host_slept_ns_; }

  /// Real time, of all hosts or of one. What a drift has made of it stays.
  void jump(TimeNs by_ns) { jump_ns_ += by_ns; }
  void jump(Host host, TimeNs by_ns) { host_jump_ns_[static_cast<std::size_t>(host)] += by_ns; }
  void drift(Host host, double share) { host_drift_[static_cast<std::size_t>(host)] = share; }
  /// The drones' host, link and agent, sleeps: its clock stands still meanwhile.
  void suspend_host(bool suspended) { host_suspended_ = suspended; }
  bool host_suspended() const { return host_suspended_; }

 private:
  TimeNs now_ = 0, jump_ns_ = 0, host_slept_ns_ = 0;
  std::array<TimeNs, 2> host_jump_ns_{};
  std::array<double, 2> host_drift_{};
  bool host_suspended_ = false;
};

}  // namespace ledgerline::hil
