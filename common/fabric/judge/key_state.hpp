#pragma once
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "common/fabric/judge/channel_config.hpp"
#include "common/fabric/judge/channel_state.hpp"
#include "common/fabric/judge/key_effects.hpp"
#include "common/fabric/judge/transaction_judge.hpp"

namespace ledgerline::fabric {

/// The state of a channel as a judge needs it who has followed it from its first block on: versions and policies of all
/// keys, but no values; the ids of all transactions; the definitions of contracts, out of Fabric's `_lifecycle`. Memory
/// grows with the number of keys, and by some 120 bytes a transaction. One thread.
class KeyState final : public ChannelState {
 public:
  /// From here on these policies are the channel's.
  void configure(ChannelConfig config) { config_ = std::move(config); }
  /// A contract that the channel has without Fabric's lifecycle, as the embedded node's: its keys need the channel's
  /// own policy.
  void define(const std::string& contract);
  /// What the block's valid transactions have written. `verdicts`: of all of them.
  void apply(std::uint64_t block, const std::vector<Verdict>& verdicts);

  std::optional<Key> find(const KeyName& name) const override;
  void walk(const std::string& name, const std::string& start,
            const std::function<bool(const std::string& key, Version version)>& take) const override;
  bool knows_transaction(const std::string& tx_id) const override;
  std::optional<Policy> policy_of(const std::string& name, const std::string& collection) const override;

  std::size_t keys() const { return keys_.size(); }
  std::size_t transactions() const { return transactions_.size(); }

 private:
  void write(const NamespaceSet& part, Version version);
  void take_definition(std::string_view key, const KeyEffect& effect);
  void take_collections(const std::string& contract, const std::string& bytes);
  Policy application_policy(const std::string& bytes) const;

  ChannelConfig config_;
  std::map<KeyName, Key> keys_;
  std::unordered_set<std::string> transactions_;
  struct Definition {
    std::string policy;                              ///< protos.ApplicationPolicy; empty: the channel's own
    std::map<std::string, std::string> collections;  ///< the same for those of private data; empty: the contract's
  };
  std::map<std::string, Definition> definitions_;  ///< by contract
};

}  // namespace ledgerline::fabric
