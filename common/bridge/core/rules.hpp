#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

/// Which topics a bridge carries, and how ROS 2's names stand on the ledger.
namespace ledgerline::bridge {

inline constexpr std::string_view anybody = "*";  ///< Rule::from of a topic that is taken from any writer

/// One [[topic]] of the config. The first one that matches a topic, in a direction, decides.
struct Rule {
  std::string name;  ///< ROS's; "*" stands for any characters
  std::string type;  ///< empty: whatever type the topic has
  bool to_ledger = false, from_ledger = false;
  /// From the ledger: first segment of the ids that are taken, an organisation's MSP id or an enrolled name; `anybody`:
  /// all. Empty: nobody's.
  std::string from;
  std::string channel;       ///< empty: that of [ledger]
  std::string config_block;  ///< file with a config block of `channel`: its trust anchor; empty: none is named here
  bool latest = false;       ///< only the newest message waits; a newer one takes its place
  bool latched = false;      ///< who comes late gets the last value, on the ledger and on DDS
  bool stream = false;       ///< rides in this host's batches; else it has a key of its own
  double rate_hz = 0;        ///< at most; 0: all
  int every = 1;             ///< every n-th message
  int priority = 0;          ///< higher ones go first
  std::size_t queue = 0;     ///< messages that may wait
  bool reliable = true;
  int depth = 0;          ///< of DDS's history
  bool left_out = false;  ///< what it matches is not carried here: the program's own, or another channel's
};

struct BridgeConfig {
  std::string name;                   ///< distinguishes bridges of one identity
  std::vector<std::string> enrolled;  ///< names that are enrolled to this identity: topics below them are theirs
  TimeNs min_gap_ns = 0;              ///< between two transactions of a kind
  double bulk_share = 0.005;          ///< see Uplink
  bool beside = false;                ///< beside a program whose own traffic comes first
  std::string status_file;            ///< for `ledgerline topics`; empty: none
  TimeNs status_period_ns = 0;
  std::string checkpoint;  ///< file of the newest block verified on the channel of [ledger]; empty: none is kept
  std::vector<Rule> rules;

  bool carries_something() const;
};

/// A program that bridges topics beside its own work.
struct Host {
  std::vector<std::string> topics;    ///< it reads or writes these itself: they are left out
  std::vector<std::string> enrolled;  ///< names that are its identity's, besides those in [[enrolled]]
  bool sends_states = false;          ///< its identity's batches are its drones' states, so no topic may ride in them
};

/// Reads [bridge], [[enrolled]], [[topic]] and [output] status, status_period_ms, checkpoint; config.finish() then says
/// what is wrong. `host`: null where bridging is all that the program does; else [output] checkpoint is the program's
/// own, and checkpoint_beside() says the bridge's.
BridgeConfig read_bridge(Config& config, const Host* host = nullptr);

/// BridgeConfig::checkpoint beside a program whose own is `own`: each block stream has a file for itself.
std::string checkpoint_beside(const std::string& own);
/// The file of one of a bridge's channels.
std::string checkpoint_of(const BridgeConfig& config, const std::string& channel, const std::string& of_ledger);

/// The rule that carries a topic to the ledger, or an id from it; null where none does. `by_name`: rules with a "*" in
/// their name are passed over.
const Rule* rule_up(const std::vector<Rule>& rules, std::string_view ros_topic);
const Rule* rule_down(const std::vector<Rule>& rules, std::string_view ros_topic, std::string_view id,
                      bool by_name = false);

/// A topic by which a drone is flown, placed or checked: who may write it on a DDS domain moves drones there. It is
/// taken from the ledger only by a rule that names it without "*". All names that pilots, mocap, agent and ground have.
bool is_guarded(std::string_view ros_topic);

bool is_wildcard(const Rule& rule);
/// "*" in `pattern` stands for any characters, "/" too.
bool matches(std::string_view pattern, std::string_view text);

/// "/chatter" -> "Org2MSP/chatter"; below an enrolled name of ours "/tello1/odom" -> "tello1/odom".
std::string ledger_id(std::string_view ros_topic, std::string_view msp_id, const std::vector<std::string>& enrolled);
/// The other way round: an id below an organisation loses its first segment. Empty where nothing is left of it.
std::string_view ros_topic_of(std::string_view id, std::string& buffer);
/// Whether the contract lets it through as an id. An organisation's own peer may have endorsed another one: of any
/// length, and no text in UTF-8.
bool is_ledger_id(std::string_view id);
std::string_view first_segment(std::string_view id);
bool is_msp_id(std::string_view segment);

/// "pkg/msg/Type".
bool is_ros_type(std::string_view type);

/// Who wrote, as it stands in Origin.
std::uint64_t writer_of(const crypto::IdentityName& who, const std::string& bridge);

}  // namespace ledgerline::bridge
