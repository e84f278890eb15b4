#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "hil/sitl/facts.hpp"

namespace ledgerline::hil {

/// What a script is flown on with the real processes.
struct RealStack {
  bool fabric = false;  ///< its ledger, with three orderers; else the embedded node
  bool shim = false;    ///< drones behind the shim (docs/shim.md), which knows the SDK's calls; else UDP and the proxy
};
inline constexpr int fabric_orderers = 3;
inline constexpr const char* leader_part = "orderer leader";

/// Its connections to the ledger, as the proxy knows them: "agent", and with Fabric "agent-orderer1" and so on.
std::vector<std::string> servers_of(Process process, const RealStack& stack);

/// What is to be done when a fault begins, or ends: in this order.
struct RealActs {
  std::vector<std::string> proxy;                     ///< commands of hil/proxy/switches.hpp, also the shim's
  std::vector<std::pair<std::string, int>> programs;  ///< signals to programs of the flight: "ledgerline-agent"
  /// Signals to parts of Fabric's network: "peer1"; leader_part: the orderer that leads.
  std::vector<std::pair<std::string, int>> parts;
  std::vector<std::string> control;  ///< arguments of ledgerline-control
  int burn_core = -1;                ///< begin, or no longer, to compute on this core
  std::uint64_t take_bytes = 0;      ///< memory to take, or to give back
  bool fill_disk = false;            ///< to fill the ledger's disk, or to make room again
};

}  // namespace ledgerline::hil
