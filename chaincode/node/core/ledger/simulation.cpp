#include "chaincode/node/core/ledger/simulation.hpp"

#include "chaincode/node/core/ledger/range_reads.hpp"
#include "common/fabric/tx/policy.hpp"

namespace ledgerline::node {
namespace {

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
    auto version = read_version_(key, (*versions)[known - 1 - i]);
    if (!version) return version.error();
    found.push_back(std::move(*version));
  }
  const std::uint64_t since = state_.parts().history_since;
  if (since == 0 || found.size() == limit) return found;
  // Older ones may lie in blocks that nobody here has read.
  const auto older = read_version_(key, {since - 1, 0});
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
