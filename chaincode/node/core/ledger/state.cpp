#include "chaincode/node/core/ledger/state.hpp"

#include <utility>

#include "common/base/check.hpp"
#include "common/fabric/tx/form.hpp"

namespace ledgerline::node {

State::State(Parts parts) : parts_(std::move(parts)) {
  for (const auto& [key, value] : parts_.values) stored_[value.writer] += value.bytes.size();
}

const State::Value* State::find(const std::string& key) const {
  const auto found = parts_.values.find(key);
  return found == parts_.values.end() ? nullptr : &found->second;
}

const std::vector<Version>* State::history(const std::string& key) const {
  const auto found = parts_.history.find(key);
  return found == parts_.history.end() ? nullptr : &found->second;
}

std::size_t State::stored_bytes(const std::string& writer) const {
  const auto found = stored_.find(writer);
  return found == stored_.end() ? 0 : found->second;
}

void State::subtract_stored(const Value& value) {
  std::size_t& stored = stored_[value.writer];
  LEDGERLINE_CHECK(stored >= value.bytes.size(), "what is replaced was counted when it was stored", value.writer,
                   stored, value.bytes.size());
  stored -= value.bytes.size();
}

void State::write(const kvrwset::KVRWSet& set, Version version, const std::string& writer) {
  for (const kvrwset::KVWrite& one : set.writes()) parts_.history[one.key()].push_back(version);
  for (auto& [key, effect] : fabric::effects_of(set)) {
    const auto found = parts_.values.find(key);
    if (effect.kind == fabric::KeyEffect::Kind::deletion) {
      if (found == parts_.values.end()) continue;
      subtract_stored(found->second);
      parts_.values.erase(found);
      continue;
    }
    const bool policy_alone = effect.kind == fabric::KeyEffect::Kind::policy;
    if (found == parts_.values.end() && policy_alone) continue;
    Value& value = found == parts_.values.end() ? parts_.values[key] : found->second;
    if (!policy_alone) {
      subtract_stored(value);
      stored_[writer] += effect.value.size();
      value.bytes = effect.value;
      value.writer = writer;
    }
    if (effect.kind != fabric::KeyEffect::Kind::value) value.policy = effect.policy;
    value.version = version;
  }
}

std::optional<State::Tx> State::find_tx(const std::string& tx_id) const {
  const auto found = parts_.txs.find(tx_id);
  return found == parts_.txs.end() ? std::nullopt : std::optional(found->second);
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
  return collection.empty() ? policy_ : fabric::unsatisfiable_policy();  // it has no private data
}

}  // namespace ledgerline::node
