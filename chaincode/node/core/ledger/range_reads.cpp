#include "chaincode/node/core/ledger/range_reads.hpp"

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

#include "common/crypto/crypto.hpp"

namespace ledgerline::node {
namespace {

constexpr std::size_t page = 100;         // Fabric's maxResultLimit between peer and chaincode
constexpr std::uint32_t max_degree = 50;  // Fabric's maxDegreeQueryReadsHashing

std::string hash_of(std::string_view bytes) {
  const crypto::Digest digest = crypto::sha256(bytes);
  return {digest.begin(), digest.end()};
}

/// Fabric's merkle tree over the reads: each level holds at most `max_degree` hashes, then their own hash goes a level
/// up.
class Tree {
 public:
  void add(std::string hash) {
    levels_[1].push_back(std::move(hash));
    for (std::uint32_t level = 1; levels_[level].size() > max_degree; ++level) {
      lift(level, hash_of(joined(levels_[level])));
      highest_ = std::max(highest_, level + 1);
    }
  }

  kvrwset::QueryReadsMerkleSummary summary() {
    for (std::uint32_t level = 1; level < highest_; ++level) {
      const std::vector<std::string>& hashes = levels_[level];
      if (!hashes.empty()) lift(level, hashes.size() == 1 ? hashes[0] : hash_of(joined(hashes)));
    }
    if (levels_[highest_].size() > max_degree) {
      lift(highest_, hash_of(joined(levels_[highest_])));
      ++highest_;
    }
    kvrwset::QueryReadsMerkleSummary out;
    out.set_max_degree(max_degree);
    out.set_max_level(highest_);
    for (const std::string& hash : levels_[highest_]) out.add_max_level_hashes(hash);
    return out;
  }

 private:
  static std::string joined(const std::vector<std::string>& hashes) {
    std::string all;
    for (const std::string& hash : hashes) all += hash;
    return all;
  }
  void lift(std::uint32_t level, std::string hash) {
    levels_[level].clear();
    levels_[level + 1].push_back(std::move(hash));
  }

  std::map<std::uint32_t, std::vector<std::string>> levels_;
  std::uint32_t highest_ = 1;
};

}  // namespace

std::size_t keys_read_by_peer(std::size_t wanted) { return (wanted + page - 1) / page * page + 1; }

kvrwset::RangeQueryInfo range_of_peer(const std::string& start, const std::string& end,
                                      std::vector<kvrwset::KVRead> reads, bool exhausted) {
  kvrwset::RangeQueryInfo out;
  out.set_start_key(start);
  out.set_end_key(exhausted || reads.empty() ? end : reads.back().key());
  out.set_itr_exhausted(exhausted);
  if (reads.size() <= max_degree) {
    for (kvrwset::KVRead& read : reads) *out.mutable_raw_reads()->add_kv_reads() = std::move(read);
    return out;
  }
  Tree tree;
  kvrwset::QueryReads pending;
  for (kvrwset::KVRead& read : reads) {
    *pending.add_kv_reads() = std::move(read);
    if (static_cast<std::uint32_t>(pending.kv_reads_size()) <= max_degree) continue;
    tree.add(hash_of(pending.SerializeAsString()));
    pending.Clear();
  }
  if (pending.kv_reads_size() > 0) tree.add(hash_of(pending.SerializeAsString()));
  *out.mutable_reads_merkle_hashes() = tree.summary();
  return out;
}

}  // namespace ledgerline::node
