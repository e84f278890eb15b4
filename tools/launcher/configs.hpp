#pragma once
#include <map>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "tools/launcher/options.hpp"

namespace ledgerline::launcher {

/// Where everything of a run lies.
struct RunFiles {
  std::string directory;
  std::string in(const std::string& name) const { return directory + "/" + name; }
  std::string page_token() const { return in("page.token"); }
  std::string proxy_faults() const { return in("faults.sock"); }      ///< passed to the proxy
  std::string fault_switches() const { return in("switches.sock"); }  ///< the page's, which the launcher serves
  std::string log(const std::string& program) const { return in(program + ".log"); }
  std::string config(const std::string& program) const { return in(program + ".toml"); }
  std::string trace(const std::string& program) const { return in(program + ".trace"); }
  /// What it left when it ended for the `times`th time and was started again.
  std::string trace(const std::string& program, std::uint64_t times) const {
    return in(program + "." + std::to_string(times) + ".trace");
  }
  std::string summary(const std::string& program) const { return in(program + ".summary.json"); }
};

/// Of the paths that fly flies.
inline constexpr double height_m = 1.0;

/// "User1@org1.ledgerline": the directory with its msp/ in the node's crypto material.
std::string user_dir(const RunFiles& files, int organisation, const std::string& user);

/// Writes sim.toml, which sim needs before anything else is there.
Status write_sim_config(const RunFiles& files, const Options& options);

/// Without a ledger: link.toml and local.toml.
Status write_local_configs(const RunFiles& files, const Options& options);

/// The child that is the proxy of a flight (docs/faults.md).
inline const std::string proxy_name = "hil-proxy";

/// Where the ledger is.
struct LedgerEndpoints {
  std::string endpoint;               ///< of the node, or of the peer of the drones' organisation
  std::vector<std::string> orderers;  ///< of Fabric, for the direct path
  std::vector<std::string> peers;     ///< one of each organisation; the first is `endpoint`
  std::string own_endorser{};         ///< of the drones' organisation; empty: it has none but its peer
};

/// Writes endorser.toml, for the endorser of the drones' organisation.
Status write_endorser_config(const RunFiles& files, const LedgerEndpoints& endpoints);

/// The shim's memory: it must be a file in memory, so it is not in the run's folder; of this process and run.
std::string shim_memory(const RunFiles& files);

/// Writes the proxy's config: every drone but those behind the shim, and for agent and ground a server of their own for
/// each of `endpoints`. The ready line reports their ports.
Status write_proxy_config(const RunFiles& files, const Options& options, const LedgerEndpoints& endpoints);

/// The addresses of a proxy's servers by name ("agent", "ground", "agent-orderer1" ...); empty: no proxy.
using Proxied = std::map<std::string, std::string>;

/// Writes link.toml, agent.toml, ground.toml, and admin.toml and operator.toml for ledgerline control.
/// `proxied`: what agent and ground are given in the place of `endpoints`.
Status write_configs(const RunFiles& files, const Options& options, const LedgerEndpoints& endpoints,
                     const Proxied& proxied = {});

/// What a flight's agent.toml says of time: for the blocks of a ledger that the flight starts, and --max-age.
deployment::Timeouts agents_timeouts(const Options& options);

/// Somebody who signs in at a flight's page.
struct MadeOperator {
  std::string name;
  std::string certificate;  ///< file
  std::string pass_phrase;  ///< of his key; for the terminal alone
};

/// Makes an identity of Org2 for each of these names, by its CA's key that lies beside a ledger of the flight's own, as
/// an MSP folder in operators/ of the run.
Result<std::vector<MadeOperator>> make_operators(const RunFiles& files, const std::vector<std::string>& names);

/// What may be an operator's name: it is a folder and part of a subject.
bool is_operator_name(const std::string& name);

}  // namespace ledgerline::launcher
