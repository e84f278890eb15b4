#include "common/fabric/validation/key_state.hpp"

#include <algorithm>

#include "common/base/check.hpp"
#include "peer/collection.pb.h"
#include "peer/lifecycle/chaincode_definition.pb.h"
#include "peer/lifecycle/db.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr std::string_view fields = "namespaces/fields/", validation = "/ValidationInfo";
constexpr std::string_view collections_field = "/Collections";
constexpr std::string_view implicit_collection = "_implicit_org_";  // and an MSP id: what an organisation has approved
}  // namespace

std::optional<ChannelState::Key> KeyState::find(const KeyName& name) const {
  const auto found = keys_.find(name);
  return found == keys_.end() || !found->second.there ? std::nullopt : std::optional(found->second.key);
}

ChannelState::Completeness KeyState::known(const KeyName& name) const {
  const auto found = keys_.find(name);
  if (found != keys_.end()) return found->second.known;
  // In a range that is known, what was not found is not there.
  const bool missing = whole() || std::any_of(ranges_.begin(), ranges_.end(), [&](const auto& one) {
                         const Range& range = one.first;
                         return name.collection.empty() && range.name == name.name && range.start <= name.key &&
                                (range.end.empty() || name.key < range.end);
                       });
  return {missing, missing};
}

std::optional<std::string> KeyState::likely_policy(const KeyName& name) const {
  const bool asked = part_ && part_->rules.likely_policy && name.name == part_->contract && name.collection.empty();
  return asked ? part_->rules.likely_policy(name.key) : std::nullopt;
}

bool KeyState::have_sufficed(const KeyName& name, const std::vector<PolicySigner>& endorsers) const {
  const auto found = keys_.find(name);
  if (found == keys_.end() || found->second.policies != policies_) return false;
  const std::vector<PolicySigner>& then = found->second.sufficed;
  return !then.empty() && std::all_of(then.begin(), then.end(), [&](const PolicySigner& one) {
    return std::find(endorsers.begin(), endorsers.end(), one) != endorsers.end();  // an identity is there once
  });
}

bool KeyState::is_of_hot_path(const KeyName& name) const {
  return part_ && part_->rules.is_of_hot_path && name.name == part_->contract && name.collection.empty() &&
         part_->rules.is_of_hot_path(name.key);
}

bool KeyState::knows_range(const std::string& name, const std::string& start, const std::string& end) const {
  return whole() || std::any_of(ranges_.begin(), ranges_.end(), [&](const auto& one) {
           const Range& range = one.first;
           return range.name == name && range.start <= start &&
                  (range.end.empty() || (!end.empty() && end <= range.end));
         });
}

void KeyState::walk(const std::string& name, const std::string& start,
                    const std::function<bool(const std::string& key, Version version)>& take) const {
  for (auto it = keys_.lower_bound({name, "", start}); it != keys_.end(); ++it) {
    if (it->first.name != name || !it->first.collection.empty()) return;
    if (it->second.there && it->second.known.version && !take(it->first.key, it->second.key.version)) return;
  }
}

bool KeyState::knows_transaction(const std::string& tx_id) const { return transactions_.contains(tx_id); }

std::optional<Policy> KeyState::policy_of(const std::string& name, const std::string& collection) const {
  if (name == lifecycle_name) {
    if (collection.empty()) return config_.lifecycle_endorsement;
    if (!collection.starts_with(implicit_collection)) return unsatisfiable_policy();
    const auto found = config_.endorsement_of.find(collection.substr(implicit_collection.size()));
    return found == config_.endorsement_of.end() ? unsatisfiable_policy() : found->second;
  }
  const auto found = definitions_.find(name);
  if (found == definitions_.end() || !found->second.policy) return std::nullopt;
  const std::string& policy = *found->second.policy;
  if (collection.empty()) return application_policy(config_, policy);
  const auto own = found->second.collections.find(collection);
  if (own == found->second.collections.end()) return whole() ? std::optional(unsatisfiable_policy()) : std::nullopt;
  return application_policy(config_, own->second.empty() ? policy : own->second);
}

bool KeyState::policy_is_unverified(const std::string& name) const {
  const auto found = definitions_.find(name);
  return found != definitions_.end() && found->second.unverified;
}

void KeyState::apply_collections(const std::string& contract, const std::string& bytes) {
  protos::CollectionConfigPackage package;
  auto& collections = definitions_[contract].collections;
  collections.clear();
  if (!package.ParseFromString(bytes)) return;
  for (const protos::CollectionConfig& one : package.config()) {
    const protos::StaticCollectionConfig& config = one.static_collection_config();
    collections[config.name()] =
        config.has_endorsement_policy() ? config.endorsement_policy().SerializeAsString() : std::string();
  }
}

/// A definition is a key for each of its fields.
void KeyState::apply_definition(std::string_view key, const KeyEffect& effect) {
  if (!key.starts_with(fields)) return;
  ++policies_;
  key.remove_prefix(fields.size());
  const std::size_t slash = key.rfind('/');
  if (slash == std::string_view::npos) return;
  const std::string contract(key.substr(0, slash));
  const std::string_view field = key.substr(slash);
  lifecycle::StateData data;
  lifecycle::ChaincodeValidationInfo info;
  if (field == validation && effect.kind == KeyEffect::Kind::deletion) {
    definitions_.erase(contract);
  } else if (!data.ParseFromString(effect.value)) {
    return;
  } else if (field == validation && info.ParseFromString(data.bytes())) {
    definitions_[contract].policy = info.validation_parameter();
    definitions_[contract].unverified = false;
  } else if (field == collections_field) {
    apply_collections(contract, data.bytes());
  }
}

bool KeyState::follows(const NamespaceSet& part) const {
  return whole() || (part.collection.empty() && (part.name == part_->contract || part.name == lifecycle_name));
}

KeyState::Entry& KeyState::entry(const KeyName& name, const std::string& writer) {
  const auto found = keys_.find(name);
  if (found != keys_.end()) {
    if (part_) use_.touch(found->second.slot);
    return found->second;
  }
  if (part_ && keys_.size() >= part_->max_keys) erase(keys_.find(use_.oldest_of_largest()));
  const Completeness at_first = known(name);
  Entry& made = keys_[name];
  made.there = false;
  made.known = at_first;
  if (part_) made.slot = use_.add(name, writer);
  LEDGERLINE_CHECK(!part_ || keys_.size() <= std::max<std::size_t>(part_->max_keys, 1), "the memory of keys is bounded",
                   keys_.size(), part_->max_keys);
  return made;
}

void KeyState::erase(std::map<KeyName, Entry>::iterator entry) {
  forget_ranges_of(entry->first);
  if (part_) use_.remove(entry->second.slot);
  keys_.erase(entry);
}

void KeyState::forget_ranges_of(const KeyName& name) {
  // In order of their starts, so that a flood of keys before all of them looks at none.
  for (auto it = ranges_.lower_bound({name.name, "", ""}); it != ranges_.end();) {
    const Range& range = it->first;
    if (range.name != name.name || range.start > name.key) return;
    const bool within = range.end.empty() || name.key < range.end;
    if (within) range_use_.remove(it->second);
    it = within ? ranges_.erase(it) : std::next(it);
  }
}

/// A transaction that counts has read what was there.
void KeyState::learn(const NamespaceSet& part, const std::string& reader) {
  for (const kvrwset::KVRead& read : part.set.reads()) learn({part.name, part.collection, read.key()}, read, reader);
  for (const kvrwset::RangeQueryInfo& range : part.set.range_queries_info()) learn(part, range, reader);
}

void KeyState::learn(const NamespaceSet& part, const kvrwset::RangeQueryInfo& range, const std::string& reader) {
  const auto& reads = range.raw_reads().kv_reads();
  for (const kvrwset::KVRead& read : reads) learn({part.name, part.collection, read.key()}, read, reader);
  if (!range.itr_exhausted() || !range.has_raw_reads()) return;
  const Range whole_range{part.name, range.start_key(), range.end_key()};
  if (const auto known = ranges_.find(whole_range); known != ranges_.end()) return range_use_.touch(known->second);
  // One with more keys than there is room for has lost its first ones by now.
  const bool all = std::all_of(reads.begin(), reads.end(), [&](const kvrwset::KVRead& read) {
    return keys_.contains({part.name, part.collection, read.key()});
  });
  if (!all || part_->max_ranges == 0 || knows_range(part.name, range.start_key(), range.end_key())) return;
  if (ranges_.size() >= part_->max_ranges) {
    const KeyName oldest = range_use_.oldest_of_largest();  // as it was added below
    const auto gone = ranges_.find({oldest.name, oldest.key, oldest.collection});
    LEDGERLINE_CHECK(gone != ranges_.end(), "what is used last is a range that is known", ranges_.size());
    range_use_.remove(gone->second);
    ranges_.erase(gone);
  }
  ranges_.emplace(whole_range, range_use_.add({part.name, range.end_key(), range.start_key()}, reader));
}

void KeyState::learn(const KeyName& name, const kvrwset::KVRead& read, const std::string& reader) {
  Entry& found = entry(name, reader);
  if (found.known.version) return;
  found.known.version = true;
  found.there = read.has_version();
  found.known.policy = found.known.policy || !found.there;  // what is not there has none
  if (found.there) found.key.version = {read.version().block_num(), read.version().tx_num()};
}

void KeyState::learn_from_endorsers(const NamespaceSet& part, const std::vector<PolicySigner>& endorsers,
                                    std::uint64_t policies) {
  const auto common = policy_of(part.name, part.collection);
  const bool too_few = common && !satisfies(*common, endorsers);
  for (const kvrwset::KVWrite& write : part.set.writes()) {
    const auto found = keys_.find({part.name, part.collection, write.key()});
    if (found == keys_.end() || found->second.known.policy) continue;
    const auto own = too_few ? likely_policy(found->first) : std::nullopt;
    if (own && satisfies(*own, endorsers)) {
      found->second.key.policy = *own;
      found->second.known.policy = true;
    } else {
      found->second.sufficed = endorsers;
      found->second.policies = policies;
    }
  }
}

void KeyState::write(const KeyName& name, const KeyEffect& effect, Version version, const std::string& writer) {
  if (effect.kind == KeyEffect::Kind::deletion && whole()) {
    keys_.erase(name);
    return;
  }
  Entry& found = entry(name, writer);
  if (effect.kind == KeyEffect::Kind::deletion) {
    found = {.key = {}, .there = false, .known = {}, .slot = found.slot};
    return;
  }
  if (effect.kind == KeyEffect::Kind::policy && !found.there) {
    // Where it is not known whether the key is there, neither is what this has changed.
    if (found.known.version && whole()) keys_.erase(name);
    return;
  }
  found.there = true;
  found.key.version = version;
  found.known.version = true;
  if (effect.kind == KeyEffect::Kind::value) return;
  found.key.policy = effect.policy;
  found.known.policy = true;
}

void KeyState::write(const NamespaceSet& part, Version version, const std::string& writer) {
  const bool defines = part.name == lifecycle_name && part.collection.empty();
  for (const auto& [key, effect] : effects_of(part.set)) {
    if (defines) apply_definition(key, effect);
    write({part.name, part.collection, key}, effect, version, writer);
  }
}

void KeyState::record_id(std::uint64_t block, const TransactionVerdict& verdict, std::optional<TimeNs> now) {
  const bool claim = verdict.code == protos::BAD_PROPOSAL_TXID;
  // In Fabric any client that claims an id uses it up, so its owner is refused from then on.
  if (claim && config_.embedded_node) return;
  const std::string& tx_id = verdict.tx_id;
  if (tx_id.size() != id_digits) return;
  if (part_ && newest_.empty()) {
    ids_since_ = block;
    ids_since_ns_ = now;
  }
  const bool is_new = transactions_.insert(tx_id).second;
  if (claim && is_new) claimed_.insert(tx_id);
  if (!claim && !is_new) claimed_.erase(tx_id);
  if (!is_new || !part_) return;
  newest_.push_back({tx_id, block, now});
  if (newest_.size() <= part_->max_ids) return;
  LEDGERLINE_CHECK(newest_.size() > 1, "some ids are known", part_->max_ids);
  const Id& oldest = newest_.front();
  transactions_.erase(oldest.tx_id);
  claimed_.erase(oldest.tx_id);
  ids_since_ = oldest.block + 1;
  ids_since_ns_ = newest_[1].came_ns;
  newest_.pop_front();
}

void KeyState::forget(const NamespaceSet& part) {
  for (const auto& [key, effect] : effects_of(part.set)) {
    const auto found = keys_.find({part.name, part.collection, key});
    if (found != keys_.end() && effect.kind == KeyEffect::Kind::value && found->second.there) {
      found->second.known.version = false;  // a value leaves the policy as it was
    } else if (found != keys_.end()) {
      erase(found);
    }
    forget_ranges_of({part.name, part.collection, key});
  }
}

void KeyState::forget(const ReadWriteSet& sets) {
  for (const NamespaceSet& part : sets.parts) {
    if (follows(part)) forget(part);
  }
}

void KeyState::apply(std::uint64_t block, const std::vector<TransactionVerdict>& verdicts, std::optional<TimeNs> now) {
  const std::uint64_t policies = policies_;  // endorsements count by those before the block
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const TransactionVerdict& verdict = verdicts[i];
    LEDGERLINE_CHECK(verdict.code != protos::VALID || verdict.sets.code == protos::VALID,
                     "what a valid transaction has written is well-formed", block, i, verdict.sets.code);
    record_id(block, verdict, now);  // of invalid ones, too
    for (const NamespaceSet& part : verdict.sets.parts) {
      if (!follows(part)) continue;
      if (verdict.code != protos::VALID) {
        forget(part);
        continue;
      }
      if (part_) learn(part, verdict.creator_msp);
      write(part, {block, i}, verdict.creator_msp);
      if (part_) learn_from_endorsers(part, verdict.endorsers, policies);
    }
  }
}

}  // namespace ledgerline::fabric
