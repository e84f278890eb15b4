#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/program/command_line.hpp"
#include "hil/shim/scripted_agent.hpp"
#include "sim/shell/shell.hpp"

namespace ledgerline::hil::shim {

/// A script flown by the real link, with simulated drones, and this program in agent's place.
struct ScriptedFlight {
  std::string memory;         ///< file of the shim; empty: UDP, from `first_address` on
  std::string first_address;  ///< of tello1
  sim::Parameters parameters;
  PlanScript script;
  std::string faults_socket;   ///< empty: none
  std::string datagrams_file;  ///< CSV of all that the drones were sent; empty: none
  std::string summary_file;    ///< JSON; empty: none
  double times = 1;            ///< lockstep: so many times as fast as real time; 0: as fast as it goes
};

/// `ledgerline hil shim`: its options, and what they do. Must outlive the parsing.
class ShimVerb {
 public:
  static const char* const about;

  explicit ShimVerb(Verb verb);
  bool is_given() const { return verb_.is_given(); }
  /// The exit code.
  int run();

 private:
  Status read();
  int fly_by_script();

  Verb verb_;
  sim::SimOptions drones_;
  ScriptedFlight flight_;
  std::string plans_, faults_file_, lockstep_;
};

}  // namespace ledgerline::hil::shim
