#include "chaincode/node/core/ledger/simulation.hpp"

#include <algorithm>
#include <string_view>
#include <utility>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/policy.hpp"

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

/// So many keys a peer of Fabric reads of a range of which the contract wants `wanted`: it hands them over in pages,
/// and has read one key beyond those that it gave, if there is one.
std::size_t keys_read_by_peer(std::size_t wanted) { return (wanted + page - 1) / page * page + 1; }

/// What such a peer says of the range. `reads`: the keys that were read, in order; `exhausted`: there are no more
/// before `end`. Many are recorded as a tree of hashes (Fabric's rwsetutil, of degree 50).
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

void set_version(kvrwset::KVRead& read, const Version& version) {
  read.mutable_version()->set_block_num(version.block);
  read.mutable_version()->set_tx_num(version.tx);
}

}  // namespace

Result<std::optional<std::string>> Simulation::get_state(const std::string& key) {
  const State::Value* value = state_.find(key);
  reads_[key] = value == nullptr ? std::nullopt : std::optional(value->version);
  if (value == nullptr) return std::optional<std::string>{};
  return std::optional(value->bytes);
}

Status Simulation::put_state(const std::string& key, const std::string& value) {
  if (key.empty()) return Error{"a key must not be empty"};
  writes_[key] = value;
  return done;
}

Status Simulation::put_policy(const std::string& key, const std::string& msp_id) {
  policies_[key] = fabric::peer_policy(msp_id);
  return done;
}

Result<std::vector<chaincode::KeyValue>> Simulation::get_range(const std::string& start, const std::string& end,
                                                               std::size_t limit) {
  const std::size_t wanted = recorded_ranges_ == Ranges::as_fabric ? keys_read_by_peer(limit) : limit;
  std::vector<chaincode::KeyValue> found;
  std::vector<kvrwset::KVRead> reads;
  auto value = state_.values().lower_bound(start);
  for (; reads.size() < wanted && value != state_.values().end() && value->first < end; ++value) {
    kvrwset::KVRead& read = reads.emplace_back();
    read.set_key(value->first);
    set_version(read, value->second.version);
    if (found.size() < limit) found.push_back({value->first, value->second.bytes});
  }
  const bool exhausted = reads.size() < wanted;
  if (recorded_ranges_ == Ranges::as_fabric) {
    ranges_.push_back(range_of_peer(start, end, std::move(reads), exhausted));
    return found;
  }
  kvrwset::RangeQueryInfo& query = ranges_.emplace_back();
  query.set_start_key(start);
  query.set_end_key(end);
  query.mutable_raw_reads();
  for (kvrwset::KVRead& read : reads) *query.mutable_raw_reads()->add_kv_reads() = std::move(read);
  query.set_itr_exhausted(exhausted);
  return found;
}

Result<std::vector<chaincode::KeyVersion>> Simulation::get_history(const std::string& key, std::size_t skip,
                                                                   std::size_t limit) {
  std::vector<chaincode::KeyVersion> found;
  const std::vector<Version>* versions = state_.history(key);
  const std::size_t known = versions == nullptr ? 0 : versions->size();
  for (std::size_t i = skip; i < known && found.size() < limit; ++i) {
    auto version = history_.version_of(key, (*versions)[known - 1 - i]);
    if (!version) return version.error();
    found.push_back(std::move(*version));
  }
  const std::uint64_t since = state_.parts().history_since;
  if (since == 0 || found.size() == limit) return found;
  // Older ones may lie in blocks that nobody here has read.
  const auto older = history_.version_of(key, {since - 1, 0});
  return older ? Error{"what was written before block " + std::to_string(since) + " is not known"} : older.error();
}

void Simulation::set_event(const std::string& name, const std::string& payload) {
  event_name_ = name;
  event_payload_ = payload;
}

kvrwset::KVRWSet Simulation::read_write_set() const {
  kvrwset::KVRWSet set;
  for (const auto& [key, version] : reads_) {
    kvrwset::KVRead& read = *set.add_reads();
    read.set_key(key);
    if (version) set_version(read, *version);
  }
  for (const kvrwset::RangeQueryInfo& range : ranges_) *set.add_range_queries_info() = range;
  for (const auto& [key, value] : writes_) {
    kvrwset::KVWrite& write = *set.add_writes();
    write.set_key(key);
    write.set_value(value);
  }
  for (const auto& [key, policy] : policies_) {
    kvrwset::KVMetadataWrite& write = *set.add_metadata_writes();
    write.set_key(key);
    write.add_entries()->set_name(fabric::validation_parameter);
    write.mutable_entries(0)->set_value(policy);
  }
  return set;
}

std::int64_t Simulation::growth_bytes() const {
  std::int64_t growth = 0;
  for (const auto& [key, value] : writes_) {
    const State::Value* now = state_.find(key);
    growth += static_cast<std::int64_t>(value.size());
    if (now != nullptr && now->writer == caller_.name.msp_id) growth -= static_cast<std::int64_t>(now->bytes.size());
  }
  return growth;
}

}  // namespace ledgerline::node
