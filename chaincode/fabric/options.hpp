#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"

namespace ledgerline::fabric_network {

/// A network of three organisations with one peer each, and one or three Raft orderers; all on one host by default.
struct Options {
  std::string dir;    ///< everything of it: identities, ledgers, logs
  std::string tools;  ///< folder with Fabric's programs and sample configuration (scripts/fabric-tools)
  std::string chaincode = "ledgerline-chaincode";  ///< the chaincode service's program
  std::string host = "127.0.0.1";
  std::uint16_t first_port = 0;  ///< 0: free ones are looked for
  int orderers = 1;              ///< 1 or 3
  std::string channel = "teleop";
  int batch_count = 1;
  TimeNs batch_timeout_ns = 10 * ns_per_ms;
  std::uint64_t batch_bytes = 2'000'000;
  bool majority = false;  ///< endorsed by a majority of the organisations instead of by any one
};

/// Ports of one network, all on `host`.
struct Ports {
  std::uint16_t first = 0;
  std::uint16_t orderer(int number) const { return static_cast<std::uint16_t>(first + 2 * (number - 1)); }
  std::uint16_t orderer_admin(int number) const { return static_cast<std::uint16_t>(orderer(number) + 1); }
  std::uint16_t peer(int organisation) const { return static_cast<std::uint16_t>(first + 6 + 3 * (organisation - 1)); }
  std::uint16_t peer_chaincode(int organisation) const { return static_cast<std::uint16_t>(peer(organisation) + 1); }
  std::uint16_t chaincode(int organisation) const { return static_cast<std::uint16_t>(peer(organisation) + 2); }
  static constexpr int count = 15;
};

}  // namespace ledgerline::fabric_network
