#pragma once
#include <string>
#include <string_view>

#include "chaincode/node/core/ledger/ledger.hpp"
#include "common/base/result.hpp"

namespace ledgerline::endorser {

/// What an endorser knows behind its newest block, so that it need not read the chain again.
struct Snapshot {
  node::ChainEnd end;
  std::string config_block;  ///< common.Block, the newest with a configuration
  node::State contract, lifecycle;
};

/// Numbers little-endian, texts behind their length, keys in their order.
std::string to_bytes(const node::ChainEnd& end, std::string_view config_block, const node::State& contract,
                     const node::State& lifecycle);
/// An error: the bytes are not whole, or more than that. Takes no more memory than the bytes say they hold.
Result<Snapshot> snapshot_from(std::string_view bytes);

}  // namespace ledgerline::endorser
