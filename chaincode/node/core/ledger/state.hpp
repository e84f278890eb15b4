#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/fabric/validation/channel_state.hpp"
#include "ledger/rwset/kvrwset/kv_rwset.pb.h"

namespace ledgerline::node {

using fabric::Version;

/// The contract's keys with their newest values, where each was ever written, and the known transactions. In memory;
/// made again from the blocks at every start.
class State {
 public:
  struct Value {
    std::string bytes;
    Version version;
    std::string policy{};  ///< the key's own, common.SignaturePolicyEnvelope; empty: the contract's
    std::string writer{};  ///< MSP id
  };
  using Values = std::map<std::string, Value>;

  struct Tx {
    std::uint64_t block = 0;
    int code = 0;
  };
  /// All that there is, for who keeps it elsewhere.
  struct Parts {
    Values values{};
    std::map<std::string, std::vector<Version>> history{};
    std::unordered_map<std::string, Tx> txs{};  ///< looked up, or taken in any order
    /// The history has what was written from this block on, and nothing of before.
    std::uint64_t history_since = 0;
  };
  State() = default;
  explicit State(Parts parts);
  const Parts& parts() const { return parts_; }

  const Value* find(const std::string& key) const;
  const Values& values() const { return parts_.values; }
  /// Oldest first; nullptr: never written, since Parts::history_since.
  const std::vector<Version>* history(const std::string& key) const;
  /// What a transaction of a member of `writer` does to keys (fabric::effects_of).
  void write(const kvrwset::KVRWSet& set, Version version, const std::string& writer = {});
  /// Of the values that an organisation's members wrote last.
  std::size_t stored_bytes(const std::string& writer) const;

  std::optional<Tx> find_tx(const std::string& tx_id) const;
  /// The first one of an id counts.
  void add_tx(const std::string& tx_id, Tx tx) { parts_.txs.emplace(tx_id, tx); }

 private:
  void subtract_stored(const Value& value);

  Parts parts_;
  std::map<std::string, std::size_t> stored_;  // by who wrote
};

/// The state as a validator of transactions sees it: that of one contract. `state` must outlive it.
class StateView final : public fabric::ChannelState {
 public:
  /// `policy`: whose endorsement keys need that have none of their own.
  StateView(const State& state, std::string contract, fabric::Policy policy)
      : state_(state), contract_(std::move(contract)), policy_(std::move(policy)) {}

  std::optional<Key> find(const fabric::KeyName& name) const override;
  void walk(const std::string& name, const std::string& start,
            const std::function<bool(const std::string& key, Version version)>& take) const override;
  bool knows_transaction(const std::string& tx_id) const override { return state_.find_tx(tx_id).has_value(); }
  std::optional<fabric::Policy> policy_of(const std::string& name, const std::string& collection) const override;

 private:
  const State& state_;
  const std::string contract_;
  const fabric::Policy policy_;
};

}  // namespace ledgerline::node
