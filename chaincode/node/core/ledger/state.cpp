#include "chaincode/node/core/ledger/state.hpp"

#include "common/fabric/judge/block_overlay.hpp"

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
  if (fabric::deletes(write)) {
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
      if (entry.name() == fabric::validation_parameter) value->second.policy = entry.value();
    }
  }
}

std::optional<State::Tx> State::find_tx(const std::string& tx_id) const {
  const auto found = txs_.find(tx_id);
  return found == txs_.end() ? std::nullopt : std::optional(found->second);
}

std::optional<StateView::Key> StateView::find(const fabric::KeyName& name) const {
  const State::Value* value = name.name == contract_ && name.collection.empty() ? state_.find(name.key) : nullptr;
  return value == nullptr ? std::nullopt : std::optional(Key{value->version, value->policy});
}

void StateView::walk(const std::string& name, const std::string& start,
                     const std::function<bool(const std::string& key, Version version)>& take) const {
  if (name != contract_) return;
  for (auto it = state_.values().lower_bound(start); it != state_.values().end(); ++it) {
    if (!take(it->first, it->second.version)) return;
  }
}

std::optional<fabric::Policy> StateView::policy_of(const std::string& name, const std::string& collection) const {
  if (name != contract_) return std::nullopt;
  return collection.empty() ? policy_ : fabric::nobody();  // it has no private data
}

}  // namespace ledgerline::node
