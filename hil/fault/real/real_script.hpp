#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// Which ledger a script is flown on with the real processes.
struct RealLedger {
  bool fabric = false;  ///< with three orderers; else the embedded node
};

/// All that the real processes cannot have of this script, a line each: faults of what is simulated inside (sensors,
/// mocap, battery, the real clock ...), settings that ./fly has not, rules that the traces do not tell.
Status check_real(const Script& script, const RealLedger& ledger);

/// For ledgerline-fly, without --out and --json.
std::vector<std::string> fly_arguments(const Script& script, std::uint64_t seed, const RealLedger& ledger);

/// What is to be done when a fault begins, or ends: in this order.
struct RealActs {
  std::vector<std::string> proxy;                     ///< commands of hil/proxy/switches.hpp
  std::vector<std::pair<std::string, int>> programs;  ///< signals to programs of the flight: "ledgerline-agent"
  /// Signals to parts of Fabric's network: "peer1"; leader_part: the orderer that leads.
  std::vector<std::pair<std::string, int>> parts;
  std::vector<std::string> control;  ///< arguments of ledgerline-control
  int burn_core = -1;                ///< begin, or no longer, to compute on this core
  std::uint64_t take_bytes = 0;      ///< memory to take, or to give back
  bool fill_disk = false;            ///< to fill the ledger's disk, or to make room again
};
/// Of a fault that check_real() lets through, as it begins and as it ends. `active`: all that go on then, in the order
/// of the script; with the one that begins, without the one that ends. What another one keeps up is not ended.
RealActs acts_at_begin(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger);
RealActs acts_at_end(const Fault& fault, const std::vector<Fault>& active, int drones, const RealLedger& ledger);

}  // namespace ledgerline::hil
