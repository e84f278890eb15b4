#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "common/config/config.hpp"

/// deployment.toml: which hosts there are and what runs on each, which drones, which ledger. One format for the
/// launcher, for what looks after hosts, and for tests; docs/deployment.md has an example.
namespace ledgerline::deployment {

/// What carries states and commands; none: the same controller beside the driver.
enum class LedgerKind : std::uint8_t { embedded, fabric, none };
inline constexpr std::array ledger_kinds{"embedded", "fabric", "none"};
static_assert(ledger_kinds.size() == enum_count<LedgerKind>);
constexpr const char* name_of(LedgerKind kind) { return ledger_kinds[static_cast<std::size_t>(kind)]; }
LedgerKind ledger_kind_of(std::string_view name);  ///< a name of the array

enum class Role { onboard, ground, ledger };
inline constexpr std::size_t role_count = enum_count<Role>;
const char* name_of(Role role);

struct Host {
  std::string name;
  std::string address;  ///< IPv4, as the other hosts reach it
  std::vector<Role> roles;
  std::string organisation;  ///< whose identity its programs have; empty where there is none
  bool has(Role role) const;
};

/// Where a part of the ledger listens.
struct Endpoint {
  std::string host;  ///< a Host's name, of role ledger
  std::uint16_t port = 0;
};
struct Organisation {
  std::string id;  ///< "Org1MSP"
  Endpoint peer;   ///< port 0: a free one, on one host alone
};

struct Drone {
  std::string name;     ///< as it is enrolled
  std::string host;     ///< a Host's name, of role onboard
  std::string address;  ///< IPv4, as its host reaches it
};

struct Deployment {
  LedgerKind ledger = LedgerKind::embedded;
  std::string channel = "teleop", contract = "ledgerline";
  std::vector<Organisation> organisations;
  std::vector<Endpoint> orderers;
  std::vector<Host> hosts;
  std::vector<Drone> drones;

  const Host* host(const std::string& name) const;  ///< null: there is none
};

/// Every key is checked, and that the parts fit: names that are used are there once, with the role that they are used
/// for. Errors name file, line and key (common/config).
Result<Deployment> read(Config& config);

}  // namespace ledgerline::deployment
