#pragma once
#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"

/// decode_block for those who have the message already. Inside common/fabric alone.
namespace ledgerline::fabric {

Result<Block> decode_block(const common::Block& block);

/// Leaves of a transaction what may still be said where it is not what its flag says: who it is, and why. Nothing that
/// somebody could act on.
void disbelieve(Transaction& transaction, std::string why);

}  // namespace ledgerline::fabric
