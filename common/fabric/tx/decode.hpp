#pragma once
#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"

/// Of transaction.hpp what is for those who have the message already. Inside common/fabric alone.
namespace ledgerline::fabric {

Result<Block> decode_block(const common::Block& block);
/// 0: none that can be.
TimeNs time_of(const google::protobuf::Timestamp& timestamp);
/// block_header_hash of it.
std::string header_hash(const common::BlockHeader& header);

}  // namespace ledgerline::fabric
