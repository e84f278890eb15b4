#pragma once
#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/policy.hpp"
#include "common/rt/clock.hpp"

/// What a channel's configuration says of who is to be trusted, and of when blocks are cut. Pure.
namespace common {
class Block;
}
namespace ledgerline::fabric {

/// When its orderers cut a block: at so many transactions, else so long behind its first one.
struct Batching {
  TimeNs timeout_ns = 0;
  std::uint32_t max_messages = 0;
};

struct ChannelConfig {
  std::string channel;
  std::uint64_t block = 0;                     ///< number of the config block
  std::vector<crypto::MspRoot> orderers;       ///< organisations of the orderers, with their revocation lists
  Policy block_validation;                     ///< who must sign a block: /Channel/Orderer/BlockValidation
  std::vector<crypto::MspRoot> organisations;  ///< of the application, with their revocation lists
  Policy endorsement;                          ///< /Channel/Application/Endorsement
  Policy lifecycle_endorsement;                ///< /Channel/Application/LifecycleEndorsement
  bool embedded_node = false;                  ///< of ledgerline-node, whose rules differ in what docs/ledger.md lists
  std::map<std::string, Policy> endorsement_of;  ///< of each organisation alone, by MSP id
  std::optional<Batching> batching{};            ///< nullopt: it says nothing that can be read
  std::string consensus{};                       ///< "etcdraft" ...
  std::vector<std::string> orderer_addresses{};  ///< HOST:PORT
  /// In words, for people: "MAJORITY Endorsement", or "a signature policy"; empty: there is none.
  std::string endorsement_words{}, lifecycle_words{};
  std::vector<std::string> capabilities{};  ///< "channel V2_0", "orderer V2_0", "application V2_5" ...
};

/// Go's time.Duration as text, "2s", "1m0.5s", "250ms", as configurations have it; nullopt: it is none, or negative.
std::optional<TimeNs> read_go_duration(std::string_view text);

/// Everybody in the channel: the application's organisations and those of the orderers, for a registry of members.
std::vector<crypto::MspRoot> everybody(const ChannelConfig& config);

/// What a contract's endorsers must satisfy, by the protos.ApplicationPolicy of its definition; empty: the channel's.
/// One that is not read is satisfied by nobody.
Policy application_policy(const ChannelConfig& config, const std::string& definition);

/// Takes a block with a configuration apart. A policy that is not there, or of a kind that is not read, is satisfied by
/// nobody. An error names what is missing or not supported; never a crash.
/// Raft's and the embedded node's orderers alone: with consensus that tolerates Byzantine orderers (BFT) a block needs
/// more than this reads.
Result<ChannelConfig> read_channel_config(const common::Block& block);

/// How much later a command may come on a channel that cuts its blocks after `timeout_ns` (BatchTimeout) or at
/// `max_messages`: a state comes in one block, and the command that it led to in another. At most 55 s, since limits
/// end at a minute. 0 where each transaction has a block of its own.
inline TimeNs both_ways_ns(TimeNs timeout_ns, std::uint32_t max_messages) {
  constexpr TimeNs max_ns = 55 * ns_per_s;
  return max_messages == 1 ? 0 : std::min(2 * std::min(timeout_ns, max_ns), max_ns);
}

}  // namespace ledgerline::fabric
