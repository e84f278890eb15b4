#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/policy.hpp"

/// What a channel's configuration says of who is to be believed. Pure.
namespace common {
class Block;
}

namespace ledgerline::fabric {

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
};

/// Everybody in the channel: the application's organisations and those of the orderers, for a registry of members.
std::vector<crypto::MspRoot> everybody(const ChannelConfig& config);

/// Takes a block with a configuration apart. A policy that is not there, or of a kind that is not read, is satisfied by
/// nobody. An error names what is missing or not supported; never a crash.
/// Raft's and the embedded node's orderers alone: with consensus that tolerates liars (BFT) a block needs more than this
/// reads.
Result<ChannelConfig> read_channel_config(const common::Block& block);

}  // namespace ledgerline::fabric
