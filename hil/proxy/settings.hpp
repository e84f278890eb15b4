#pragma once
#include <netinet/in.h>

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "common/msg/onboard.hpp"
#include "hil/proxy/switches.hpp"

namespace ledgerline::hil::proxy {

/// Addresses of all kinds are IPv4.
struct DroneRoute {
  std::string name;
  in_addr listen{};   ///< the address that clients fly, port 8889; what comes from the drone leaves from it
  in_addr address{};  ///< of the drone, port 8889
};
struct ServerRoute {
  std::string name;
  sockaddr_in listen{};   ///< port 0: any free one, which the ready line reports
  sockaddr_in address{};  ///< of the server
};

struct Settings {
  std::uint64_t seed = 1;
  std::string faults_socket;  ///< for commands while it runs; empty: none
  std::string summary_file;   ///< empty: none
  in_addr source{};           ///< the own address toward drones; any by default
  std::vector<DroneRoute> drones;
  std::vector<ServerRoute> servers;
  std::vector<ScheduledFault> faults;

  /// All of them as what commands are about: drones first, both in the order of the file.
  std::vector<Target> targets() const;
};

/// The [[fault]] tables of a script, at most 1,000: `at_s`, `for_s` (may be missing) and `do`, a command. What is wrong
/// is in config.finish().
std::vector<ScheduledFault> read_faults(Config& config, const std::vector<Target>& targets);

/// From a config and, where its name is not empty, a script of faults. Errors name file, line and key (common/config).
Result<Settings> read_settings(const std::string& config_file, const std::string& script_file);
/// The config alone.
Result<Settings> read_settings(Config& config);

std::string address_text(const sockaddr_in& address);

}  // namespace ledgerline::hil::proxy
