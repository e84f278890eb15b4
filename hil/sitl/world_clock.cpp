#include "hil/sitl/world_clock.hpp"

#include "hil/sitl/ledger/simulated_ledger.hpp"

namespace ledgerline::hil {

void WorldClock::advance(TimeNs by_ns) {
  now_ += by_ns;
  for (std::size_t host = 0; host < host_drift_.size(); ++host)
    host_jump_ns_[host] += static_cast<TimeNs>(host_drift_[host] * static_cast<double>(by_ns));
  if (host_suspended_) host_slept_ns_ += by_ns;
}

TimeNs WorldClock::real_offset(Host host) const {
  return SimulatedLedger::real(0) + jump_ns_ + host_jump_ns_[static_cast<std::size_t>(host)];
}

}  // namespace ledgerline::hil
