#pragma once
#include <string>
#include <vector>

#include "chaincode/node/core/types.hpp"
#include "common/common.pb.h"

/// Blocks as Fabric's orderers and peers make them.
namespace ledgerline::node {

/// What the next block names.
std::string header_hash(const common::BlockHeader& header);
/// SHA-256 over all envelopes, one behind the other.
std::string data_hash(const common::BlockData& data);

/// Where a chain ends, and so what the next block follows.
struct ChainEnd {
  std::uint64_t height = 0;
  std::string hash;  ///< of the last block's header; empty: there is none
};

/// Puts a block together, with room for signatures and flags.
common::Block make_block(const ChainEnd& end, const std::vector<std::string>& envelopes);
/// Adds the orderer's signature over the header.
Status sign_block(common::Block& block, const crypto::SigningIdentity& orderer);

/// The channel's configuration (organisations with their certificates, batch settings) as an envelope for block 0.
std::string make_config_envelope(const CoreConfig& config, const crypto::SigningIdentity& orderer);

}  // namespace ledgerline::node
