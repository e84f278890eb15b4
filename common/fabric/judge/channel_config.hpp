#pragma once
#include <cstdint>
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
  std::uint64_t block = 0;  ///< number of the config block
  /// Organisations of the orderers, with the certificates of their authorities, root and intermediate.
  std::vector<crypto::MspRoot> orderers;
  /// Who must sign a block (/Channel/Orderer/BlockValidation): so many of these policies, each a serialized
  /// common.SignaturePolicyEnvelope, must be satisfied.
  std::vector<std::string> block_policies;
  std::size_t block_policies_needed = 0;
};

/// Takes a block with a configuration apart. An error names what is missing or not supported; never a crash.
/// Raft's and the embedded node's orderers alone: with consensus that tolerates liars (BFT) a block needs more than this
/// reads.
Result<ChannelConfig> read_channel_config(const common::Block& block);

}  // namespace ledgerline::fabric
