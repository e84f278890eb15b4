#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "common/rt/clock.hpp"

/// deployment.toml: which hosts there are and what runs on each, which drones, which ledger. One format for the
/// launcher, for what looks after hosts, and for tests; docs/three-machines.md has an example.
namespace ledgerline::deployment {

/// What carries states and commands; none: the same controller beside the driver.
enum class LedgerKind : std::uint8_t { embedded, fabric, none };
inline constexpr std::array ledger_kinds{"embedded", "fabric", "none"};
static_assert(ledger_kinds.size() == enum_count<LedgerKind>);
constexpr const char* name_of(LedgerKind kind) { return ledger_kinds[static_cast<std::size_t>(kind)]; }
LedgerKind ledger_kind_of(std::string_view name);  ///< a name of the array

enum class Role { drone_host, ground, ledger };
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
  std::string host;     ///< a Host's name, of role drone-host
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

/// What a deployment says of a flight of simulated drones on this machine.
struct OneHost {
  int drones = 0;
  LedgerKind ledger = LedgerKind::embedded;
  int orderers = 1;
};

/// `config`: the file that the deployment was read from. Each thing that such a flight would have to pass over
/// (docs/three-machines.md) is an error with its file, line and key; all of them come at once.
Result<OneHost> on_one_host(Config& config, const Deployment& deployment);
Result<OneHost> read_one_host(Config& config);

/// What agent's and ground's configs say of time, for a ledger that cuts its blocks late.
struct Timeouts {
  // The programs' defaults, for a ledger that answers at once.
  TimeNs max_age_ns = 500 * ns_per_ms;  ///< agent's [check] max_age_ms
  TimeNs silent_after_ns = ns_per_s;    ///< agent's [agent] ledger_silent_after_ms
  TimeNs deadline_ns = ns_per_s;        ///< [ledger] deadline_ms of both
};

/// `longer_ns`: by how much a command may be older (fabric::both_ways_ns), and a quiet ledger is not yet a silent one.
/// `max_age_ns` that somebody asked for counts more; 0: none.
inline Timeouts timeout_with(TimeNs longer_ns, TimeNs max_age_ns = 0) {
  const Timeouts usual;
  return {.max_age_ns = max_age_ns > 0 ? max_age_ns : usual.max_age_ns + longer_ns,
          .silent_after_ns = usual.silent_after_ns + std::max(longer_ns, max_age_ns),
          .deadline_ns = usual.deadline_ns + longer_ns};
}

}  // namespace ledgerline::deployment
