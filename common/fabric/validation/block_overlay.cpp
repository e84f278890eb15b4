#include "common/fabric/validation/block_overlay.hpp"

#include "common/base/check.hpp"
#include "common/fabric/tx/form.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

bool same_version(const kvrwset::KVRead& read, const std::optional<Version>& version) {
  if (!version || !read.has_version()) return !version && !read.has_version();
  return *version == Version{read.version().block_num(), read.version().tx_num()};
}

void add_keys_with_policies(const ReadWriteSet& sets, std::set<KeyName>& keys) {
  for (const NamespaceSet& part : sets.parts) {
    for (const kvrwset::KVMetadataWrite& write : part.set.metadata_writes())
      keys.insert({part.name, part.collection, write.key()});
  }
}

}  // namespace

bool BlockOverlay::is_known(const NamespaceSet& part, const kvrwset::KVRead& read) const {
  const KeyName name{part.name, part.collection, read.key()};
  return written_.contains(name) || (state_.known(name).version && !perhaps_written_.contains(name));
}

bool BlockOverlay::is_known(const NamespaceSet& part, const kvrwset::RangeQueryInfo& range) const {
  if (range.has_reads_merkle_hashes()) return false;
  return state_.whole() || (range.itr_exhausted() && state_.knows_range(part.name, range.start_key(), range.end_key()));
}

bool BlockOverlay::is_current(const NamespaceSet& part, const kvrwset::KVRead& read) const {
  const KeyName name{part.name, part.collection, read.key()};
  if (written_.contains(name)) return false;
  if (!state_.known(name).version) return true;
  const auto key = state_.find(name);
  return same_version(read, key ? std::optional(key->version) : std::nullopt);
}

bool BlockOverlay::is_current(const NamespaceSet& part, const kvrwset::RangeQueryInfo& range) const {
  if (range.has_reads_merkle_hashes()) return true;  // of many reads a peer reports hashes alone: nobody can say
  // A query that stopped early has seen the keys up to its last one, and says nothing about those behind it.
  const std::string& end = range.end_key();
  const bool with_end = !range.itr_exhausted();
  const auto within = [&](const std::string& key) { return end.empty() || key < end || (with_end && key == end); };
  // A key that the block has written before has a version that nobody can have read.
  for (auto it = written_.lower_bound({part.name, part.collection, range.start_key()}); it != written_.end(); ++it) {
    const KeyName& name = it->first;
    if (name.name != part.name || name.collection != part.collection || !within(name.key)) break;
    if (it->second || state_.find(name)) return false;
  }
  // Both go up: each key that is there must have been read, and nothing else where that is known.
  const auto& reads = range.raw_reads().kv_reads();
  int seen = 0;
  bool same = true;
  const auto skip_unknown = [&](const std::string* up_to) {
    for (; same && seen < reads.size() && (up_to == nullptr || reads[seen].key() < *up_to); ++seen) {
      const std::string& key = reads[seen].key();
      const bool up = key >= range.start_key() && (seen == 0 || reads[seen - 1].key() < key);
      same = up && within(key) && !is_known(part, reads[seen]);
    }
  };
  state_.walk(part.name, range.start_key(), [&](const std::string& key, Version version) {
    if (!within(key)) return false;
    skip_unknown(&key);
    same = same && seen < reads.size() && reads[seen].key() == key && same_version(reads[seen], version);
    ++seen;
    return same;
  });
  skip_unknown(nullptr);
  return same && seen == reads.size();
}

BlockOverlay::Checked BlockOverlay::check(const ReadWriteSet& sets) const {
  LEDGERLINE_CHECK(sets.code == protos::VALID, "only what is well-formed is compared with the state", sets.code);
  bool unknown = false;
  for (const NamespaceSet& part : sets.parts) {
    for (const kvrwset::KVRead& read : part.set.reads()) {
      if (!is_current(part, read)) return {protos::MVCC_READ_CONFLICT, unknown};
      unknown = unknown || !is_known(part, read);
    }
    for (const kvrwset::RangeQueryInfo& range : part.set.range_queries_info()) {
      if (!is_current(part, range)) return {protos::PHANTOM_READ_CONFLICT, unknown};
      unknown = unknown || !is_known(part, range);
    }
  }
  return {protos::VALID, unknown};
}

bool BlockOverlay::exists(const KeyName& key) const {
  const auto found = written_.find(key);
  return found == written_.end() ? state_.find(key).has_value() : found->second;
}

void BlockOverlay::add(const ReadWriteSet& sets) {
  LEDGERLINE_CHECK(sets.code == protos::VALID, "only what is well-formed is written", sets.code);
  for (const NamespaceSet& part : sets.parts) {
    for (const auto& [key, effect] : effects_of(part.set)) {
      const KeyName name{part.name, part.collection, key};
      if (effect.kind != KeyEffect::Kind::policy || exists(name)) {
        written_[name] = effect.kind != KeyEffect::Kind::deletion;
      } else if (!state_.known(name).version && !written_.contains(name)) {
        perhaps_written_.insert(name);
      }
    }
  }
}

void BlockOverlay::add_policies(const ReadWriteSet& sets) { add_keys_with_policies(sets, new_policies_); }

void BlockOverlay::add_possible_policies(const ReadWriteSet& sets) { add_keys_with_policies(sets, possible_policies_); }

}  // namespace ledgerline::fabric
