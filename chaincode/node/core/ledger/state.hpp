#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "ledger/rwset/kvrwset/kv_rwset.pb.h"

namespace ledgerline::node {

/// Where a value was written: block and place in it, as Fabric's versions.
struct Version {
  std::uint64_t block = 0;
  std::uint64_t tx = 0;
  auto operator<=>(const Version&) const = default;
};

/// The name under which Fabric keeps a key's policy among its metadata.
inline constexpr const char* validation_parameter = "VALIDATION_PARAMETER";

/// The contract's keys with their newest values, where each was ever written, and the known transactions. In memory;
/// made again from the blocks at every start.
class State {
 public:
  struct Value {
    std::string bytes;
    Version version;
    std::string policy{};  ///< the key's own, common.SignaturePolicyEnvelope; empty: the contract's
  };
  using Values = std::map<std::string, Value>;

  const Value* find(const std::string& key) const;
  const Values& values() const { return values_; }
  /// Oldest first; nullptr: never written.
  const std::vector<Version>* history(const std::string& key) const;
  /// What a transaction writes: values, then policies of keys. A policy outlives the key's next values, not its deletion; one for a
  /// key that is not there has no effect. As Fabric.
  void write(const kvrwset::KVRWSet& set, Version version);

  struct Tx {
    std::uint64_t block = 0;
    int code = 0;
  };
  std::optional<Tx> find_tx(const std::string& tx_id) const;
  /// The first one of an id counts.
  void add_tx(const std::string& tx_id, Tx tx) { txs_.emplace(tx_id, tx); }

 private:
  void write(const kvrwset::KVWrite& write, Version version);

  Values values_;
  std::map<std::string, std::vector<Version>> history_;
  std::unordered_map<std::string, Tx> txs_;  // looked up only, never walked: its order would not repeat
};

/// The valid writes of the block under validation, laid over the state. Policies of keys are those before the block.
class Overlay {
 public:
  explicit Overlay(const State& state) : state_(state) {}
  /// Fabric's checks: each key that was read still has the version that was read, each range still has the same keys.
  /// Gives a protos.TxValidationCode.
  int check(const kvrwset::KVRWSet& set) const;
  void add(const kvrwset::KVRWSet& set);

 private:
  bool same_version(const kvrwset::KVRead& read) const;
  bool same_range(const kvrwset::RangeQueryInfo& range) const;

  const State& state_;
  std::map<std::string, bool> written_;
};

}  // namespace ledgerline::node
