#include "chaincode/node/core/ledger/state.hpp"

#include "peer/transaction.pb.h"

namespace ledgerline::node {

const State::Value* State::find(const std::string& key) const {
  const auto found = values_.find(key);
  return found == values_.end() ? nullptr : &found->second;
}

const std::vector<Version>* State::history(const std::string& key) const {
  const auto found = history_.find(key);
  return found == history_.end() ? nullptr : &found->second;
}

void State::write(const kvrwset::KVWrite& write, Version version) {
  history_[write.key()].push_back(version);
  if (write.is_delete()) {
    values_.erase(write.key());
  } else {
    Value& value = values_[write.key()];
    value.bytes = write.value();
    value.version = version;
  }
}

void State::write(const kvrwset::KVRWSet& set, Version version) {
  for (const kvrwset::KVWrite& one : set.writes()) write(one, version);
  for (const kvrwset::KVMetadataWrite& metadata : set.metadata_writes()) {
    const auto value = values_.find(metadata.key());
    if (value == values_.end()) continue;
    value->second.version = version;
    value->second.policy.clear();
    for (const kvrwset::KVMetadataEntry& entry : metadata.entries()) {
      if (entry.name() == validation_parameter) value->second.policy = entry.value();
    }
  }
}

std::optional<State::Tx> State::find_tx(const std::string& tx_id) const {
  const auto found = txs_.find(tx_id);
  return found == txs_.end() ? std::nullopt : std::optional(found->second);
}

bool Overlay::same_version(const kvrwset::KVRead& read) const {
  if (written_.contains(read.key())) return false;
  const State::Value* value = state_.find(read.key());
  if (value == nullptr || !read.has_version()) return value == nullptr && !read.has_version();
  return value->version == Version{read.version().block_num(), read.version().tx_num()};
}

bool Overlay::same_range(const kvrwset::RangeQueryInfo& range) const {
  const auto& reads = range.raw_reads().kv_reads();
  const std::string& start = range.start_key();
  // A query that stopped early has seen the keys up to its last one, and says nothing about those behind it.
  const bool bounded = range.itr_exhausted();
  if (!bounded && reads.empty()) return true;
  const std::string end = bounded ? range.end_key() : reads.rbegin()->key() + '\0';
  for (auto it = written_.lower_bound(start); it != written_.end() && it->first < end; ++it) return false;
  auto value = state_.values().lower_bound(start);
  for (const kvrwset::KVRead& read : reads) {
    if (value == state_.values().end() || value->first >= end || value->first != read.key() || !same_version(read)) {
      return false;
    }
    ++value;
  }
  return value == state_.values().end() || value->first >= end;
}

int Overlay::check(const kvrwset::KVRWSet& set) const {
  for (const kvrwset::KVRead& read : set.reads()) {
    if (!same_version(read)) return protos::MVCC_READ_CONFLICT;
  }
  for (const kvrwset::RangeQueryInfo& range : set.range_queries_info()) {
    if (!same_range(range)) return protos::PHANTOM_READ_CONFLICT;
  }
  return protos::VALID;
}

void Overlay::add(const kvrwset::KVRWSet& set) {
  for (const kvrwset::KVWrite& write : set.writes()) written_[write.key()] = true;
  for (const kvrwset::KVMetadataWrite& write : set.metadata_writes()) {
    if (state_.find(write.key()) != nullptr) written_[write.key()] = true;
  }
}

}  // namespace ledgerline::node
