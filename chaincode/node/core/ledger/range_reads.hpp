#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "ledger/rwset/kvrwset/kv_rwset.pb.h"

/// What a peer of Fabric says in a read set of a range that a contract has read. Pure.
namespace ledgerline::node {

/// So many keys a peer reads of a range of which the contract wants `wanted`: it hands them over in pages, and has read
/// one key beyond those that it gave, if there is one.
std::size_t keys_read_by_peer(std::size_t wanted);

/// `reads`: the keys that were read, in order; `exhausted`: there are no more before `end`. Many are recorded as a tree
/// of hashes (Fabric's rwsetutil, of degree 50).
kvrwset::RangeQueryInfo range_of_peer(const std::string& start, const std::string& end,
                                      std::vector<kvrwset::KVRead> reads, bool exhausted);

}  // namespace ledgerline::node
