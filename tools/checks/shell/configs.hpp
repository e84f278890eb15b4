#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "tools/checks/core/problem.hpp"

/// The configs of this host: whether their programs read them, and the keys that the checks go by, which are read even
/// where something else of the file is wrong.
namespace ledgerline::checks {

struct ServerKeys {
  std::string msp_id{}, endpoint{}, tls_ca{}, server_name{}, tls_certificate{}, tls_key{};
};
struct LedgerKeys {
  ServerKeys peer;
  std::string channel, contract, msp_id, msp_dir, certificate, private_key, config_block;
  TimeNs deadline_ns = 0;
  bool patient = false;  ///< timeouts = "auto"
  std::vector<ServerKeys> orderers, endorsers, peers;
  std::vector<std::pair<std::string, std::string>> msps;  ///< id, file
};
struct DroneKeys {
  std::string name, address, interface;
  bool by_mocap = false;  ///< in link's: motion capture says where it is, or may
};

struct ProgramConfig {
  std::string program;  ///< a part of the reference: "agent", "control"
  std::string file;     ///< "agent.toml"
  std::string path;
  std::string label{};  ///< begins what the ledger answers; empty: the program is on one channel
  std::optional<LedgerKeys> ledger{};
  std::vector<DroneKeys> drones{};
  std::vector<std::string> written{};     ///< files that it writes
  std::vector<std::string> interfaces{};  ///< that it names
  TimeNs max_age_ns = 0, silent_after_ns = 0;
  bool real_time = true;
  double battery_low = 0;
  std::string state_listen{};             ///< link's
  std::string pose_topic{}, pose_type{};  ///< agent's, of motion capture
};

/// node.env, of the embedded ledger.
struct NodeConfig {
  std::string path, listen;
};

struct Configs {
  std::vector<ProgramConfig> programs;  ///< those whose files are there and are TOML
  Findings findings;
  std::optional<NodeConfig> node{};
  const ProgramConfig* of(const std::string& program) const;  ///< null: there is none
};

/// Of one program, "agent" or "bridge"; an error: its file cannot be read or is no TOML.
Result<ProgramConfig> read_config(const std::string& program, const std::string& path);

/// Whether the file is there and this user may not read it, or may not enter a folder of its path.
bool is_forbidden(const std::string& path);
/// The cure where others than its owner may well read it.
std::string cure_of_forbidden(const std::string& path);

/// `role`: whose files must be there; empty: any one file.
Configs read_configs(const std::string& dir, const std::string& role);

/// A program's config once for each channel that it is on, with the keys and the drones of that channel; the file's
/// name says which, where there are several.
std::vector<ProgramConfig> of_each_channel(const ProgramConfig& one);

inline constexpr const char* config_roles[] = {"drone-host", "ground", "ledger", "bridge", "admin"};

}  // namespace ledgerline::checks
