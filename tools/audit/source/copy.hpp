#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "common/base/result.hpp"

/// Where an audit's blocks come from, and go to: files.
namespace ledgerline::audit {

/// Gets each block in the chain's order.
using OnBlock = std::function<void(std::string_view block)>;

/// How reading ended, once there was something to read.
struct Reading {
  std::uint64_t blocks = 0;
  std::string problem;  ///< why there is no more; empty: that was all
};

/// A copy of a chain, which is never written to: the file of an embedded node's ledger (DIR/ledger/blocks, or the
/// folder that it is in; the node must not be running), or a folder with one common.Block in each N.block, from 0.block
/// on, as `peer channel fetch` and --save write them. An error: there is nothing of the kind.
Result<Reading> read_copy(const std::string& path, const OnBlock& on_block);

/// Writes block `number` into such a folder.
Status save_block(const std::string& folder, std::uint64_t number, std::string_view block);

}  // namespace ledgerline::audit
