#pragma once
#include <string>

#include "hil/shim/scripted/plan_script.hpp"
#include "hil/shim/wires.hpp"
#include "sim/core/parameters.hpp"

namespace ledgerline::hil::shim {

/// A script flown by the real link, with simulated drones, and this program in agent's place.
struct FlightOptions {
  std::string memory;  ///< file of the shim; empty: UDP, from `first_address` on
  std::string first_address = "127.0.0.2";
  sim::Parameters parameters;
  PlanScript script;
  std::string faults_socket;   ///< empty: none
  std::string datagrams_file;  ///< CSV of all that the drones were sent; empty: none
  std::string summary_file;    ///< JSON; empty: none
  double times = 1;            ///< lockstep: so many times as fast as real time; 0: as fast as it goes
};

/// In real time: link gets its plans by iceoryx, so RouDi must run. Until the script ends, or SIGINT or SIGTERM.
Status fly_in_real_time(const FlightOptions& options);
/// In lockstep: waits at most 30 s for link, then moves its clock, a turn a millisecond. SIGUSR1 halts the clock, and
/// lets it go on. The same script, seed and build give the same bytes, however fast.
Status fly_in_lockstep(const FlightOptions& options);

}  // namespace ledgerline::hil::shim
