#pragma once
#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"

/// decode_block for those who have the message already. Inside common/fabric alone.
namespace ledgerline::fabric {

Result<Block> decode_block(const common::Block& block);

}  // namespace ledgerline::fabric
