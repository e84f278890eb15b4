#pragma once
#include <string>
#include <string_view>

#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"

/// Of transaction.hpp what is for those who have the message already. Inside common/fabric alone.
namespace ledgerline::fabric {

Result<Block> decode_block(const common::Block& block);
/// What a peer has flagged each transaction with (protos.TxValidationCode, a byte each), as long as `block` lives;
/// empty: nothing, as in an orderer's block.
std::string_view flags_of(const common::Block& block);
/// block_header_hash of it.
std::string header_hash(const common::BlockHeader& header);

}  // namespace ledgerline::fabric
