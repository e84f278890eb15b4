#pragma once
#include <algorithm>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "common/base/check.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/fabric/validation/channel_state.hpp"
#include "common/fabric/validation/transaction_validator.hpp"

namespace ledgerline::fabric {

/// Which of the keys that a bounded memory holds has to go. A client that writes many pushes out its own: the
/// organisation whose transactions brought most keys loses one, of the kind (a key's first segment) of which it has
/// most, and of these the least recently used one. So keys in use stay. Nobody's flood evicts keys of other
/// organisations, nor keys of other kinds of the own one. Pure; one thread.
class KeyUse {
 public:
  KeyUse() = default;
  KeyUse(KeyUse&&) = default;  // places point into it
  KeyUse& operator=(KeyUse&&) = default;

  class Group;
  struct Slot {
    Group* group = nullptr;
    std::uint64_t used = 0;
  };
  Slot add(const KeyName& name, const std::string& organisation);
  /// It is used now.
  void touch(Slot& slot);
  void remove(const Slot& slot);
  /// There must be one. Valid until the next change.
  const KeyName& oldest_of_largest() const;

  class Group {
    friend class KeyUse;
    std::string organisation_, kind_;
    std::map<std::uint64_t, KeyName> by_use_;
  };

 private:
  /// Of one organisation apart; the contract has thirteen. Kinds beyond that share one.
  static constexpr std::size_t max_kinds = 16;
  std::map<std::string, std::map<std::string, Group>> groups_;  ///< by organisation and kind; none is empty
  std::uint64_t now_ = 0;
};

inline KeyUse::Slot KeyUse::add(const KeyName& name, const std::string& organisation) {
  auto& kinds = groups_[organisation];
  std::string kind = name.key.substr(0, name.key.find('/'));
  if (kinds.size() >= max_kinds && !kinds.contains(kind)) kind.clear();
  Group& group = kinds[kind];
  group.organisation_ = organisation;
  group.kind_ = std::move(kind);
  group.by_use_.emplace_hint(group.by_use_.end(), ++now_, name);
  return {&group, now_};
}

inline void KeyUse::touch(Slot& slot) {
  auto& by_use = slot.group->by_use_;
  auto node = by_use.extract(slot.used);  // no allocation: each state and command comes by here
  LEDGERLINE_CHECK(!node.empty(), "a key that is used has a place in the order of use", slot.used);
  node.key() = slot.used = ++now_;
  by_use.insert(by_use.end(), std::move(node));
}

inline void KeyUse::remove(const Slot& slot) {
  Group& group = *slot.group;
  const std::size_t erased = group.by_use_.erase(slot.used);
  LEDGERLINE_CHECK(erased == 1, "a key is removed once", slot.used);
  if (!group.by_use_.empty()) return;
  const auto kinds = groups_.find(group.organisation_);
  kinds->second.erase(std::string(group.kind_));
  if (kinds->second.empty()) groups_.erase(kinds);
}

inline const KeyName& KeyUse::oldest_of_largest() const {
  LEDGERLINE_CHECK(!groups_.empty(), "a key is looked for to make room, so there is one");
  const auto keys_of = [](const auto& organisation) {
    std::size_t keys = 0;
    for (const auto& [kind, group] : organisation.second) keys += group.by_use_.size();
    return keys;
  };
  const auto most = std::ranges::max_element(groups_, {}, keys_of);
  const auto& largest =
      std::ranges::max_element(most->second, {}, [](const auto& kind) { return kind.second.by_use_.size(); })->second;
  return largest.by_use_.begin()->second;
}

/// The state of a channel as a validator needs it that has followed it: versions and policies of keys, but no values;
/// the ids of transactions; the definitions of contracts, out of Fabric's `_lifecycle`. One thread.
///
/// Followed from its first block on it is whole: memory grows with the number of keys, and by some 120 bytes a
/// transaction. Followed from a later block on it knows what the blocks since have written, and which versions those
/// transactions have read that counted; memory is bounded.
class KeyState final : public ChannelState {
 public:
  KeyState() = default;
  struct Part {
    std::string contract;  ///< whose keys are followed, beside the definitions
    /// Beyond them the writer with most keys loses the least recently used one of its most numerous kind (KeyUse).
    std::size_t max_keys = 20'000;
    std::size_t max_ids = 50'000;  ///< of the newest transactions
    std::size_t max_ranges = 1'000;
    ContractRules rules{};
  };
  explicit KeyState(Part part) : part_(std::move(part)) {}

  /// From here on these policies are the channel's.
  void configure(ChannelConfig config) {
    config_ = std::move(config);
    ++policies_;
  }
  /// A contract that the channel has without Fabric's lifecycle, as the embedded node's: its keys need the channel's
  /// own policy.
  void define(const std::string& contract) { definitions_[contract] = {.policy = std::string()}; }
  /// protos.ApplicationPolicy of a contract whose definition was not followed, by a peer's word; a block replaces it.
  void set_unverified_policy(const std::string& contract, const std::string& policy) {
    Definition& definition = definitions_[contract];
    if (definition.policy && !definition.unverified) return;  // a block has defined it
    definition.policy = policy;
    definition.unverified = true;
  }
  /// What the block's valid transactions have written. `verdicts`: of all of them. `now`: real time, where it is known.
  void apply(std::uint64_t block, const std::vector<TransactionVerdict>& verdicts,
             std::optional<TimeNs> now = std::nullopt);
  /// A transaction that was applied as valid, and was not: what it has written is not known.
  void forget(const ReadWriteSet& sets);

  std::optional<Key> find(const KeyName& name) const override;
  bool whole() const override { return !part_; }
  Completeness known(const KeyName& name) const override;
  std::optional<std::string> likely_policy(const KeyName& name) const override;
  bool have_sufficed(const KeyName& name, const std::vector<PolicySigner>& endorsers) const override;
  bool is_of_hot_path(const KeyName& name) const override;
  bool knows_range(const std::string& name, const std::string& start, const std::string& end) const override;
  void walk(const std::string& name, const std::string& start,
            const std::function<bool(const std::string& key, Version version)>& take) const override;
  bool knows_transaction(const std::string& tx_id) const override;
  bool is_claimed(const std::string& tx_id) const override { return claimed_.contains(tx_id); }
  std::uint64_t ids_since() const override { return ids_since_; }
  std::optional<TimeNs> ids_since_ns() const override { return ids_since_ns_; }
  std::optional<Policy> policy_of(const std::string& name, const std::string& collection) const override;
  bool policy_is_unverified(const std::string& name) const override;

  std::size_t keys() const { return keys_.size(); }
  std::size_t transactions() const { return transactions_.size(); }

 private:
  struct Entry {
    Key key;
    bool there = true;  ///< else it is known that it is not; of a part alone
    Completeness known{};
    std::vector<PolicySigner> sufficed{};  ///< of the newest write that counted; of a part alone
    std::uint64_t policies = 0;            ///< policies_ before that write's block
    KeyUse::Slot slot{};                   ///< of a part alone
  };
  bool follows(const NamespaceSet& part) const;
  /// `writer`: MSP id of whose transaction it is in; of a part alone.
  Entry& entry(const KeyName& name, const std::string& writer);
  void erase(std::map<KeyName, Entry>::iterator entry);
  /// A range with it, or with one that nobody follows any more, is not known.
  void forget_ranges_of(const KeyName& name);
  void learn(const NamespaceSet& part, const std::string& reader);
  void learn(const KeyName& name, const kvrwset::KVRead& read, const std::string& reader);
  void learn(const NamespaceSet& part, const kvrwset::RangeQueryInfo& range, const std::string& reader);
  /// Of a transaction that counts: where its endorsements are too few for keys that have no policy of their own, a key
  /// has that which it is likely to have.
  void learn_from_endorsers(const NamespaceSet& part, const std::vector<PolicySigner>& endorsers,
                            std::uint64_t policies);
  void write(const NamespaceSet& part, Version version, const std::string& writer);
  void write(const KeyName& name, const KeyEffect& effect, Version version, const std::string& writer);
  void record_id(std::uint64_t block, const TransactionVerdict& verdict, std::optional<TimeNs> now);
  /// Of what may have been written or not.
  void forget(const NamespaceSet& part);
  void apply_definition(std::string_view key, const KeyEffect& effect);
  void apply_collections(const std::string& contract, const std::string& bytes);

  ChannelConfig config_;
  std::optional<Part> part_;  ///< none: it is whole
  std::map<KeyName, Entry> keys_;
  KeyUse use_;  ///< of a part's keys
  struct Range {
    std::string name, start, end;
    auto operator<=>(const Range&) const = default;
  };
  std::map<Range, KeyUse::Slot> ranges_;  ///< of a part, whose keys are all known
  KeyUse range_use_;
  std::unordered_set<std::string> transactions_;
  std::unordered_set<std::string> claimed_;  ///< ids used so far only by transactions that do not own them
  struct Id {
    std::string tx_id;
    std::uint64_t block = 0;
    std::optional<TimeNs> came_ns;
  };
  std::deque<Id> newest_;  ///< of a part's, newest last
  std::uint64_t ids_since_ = 0;
  std::optional<TimeNs> ids_since_ns_;
  std::uint64_t policies_ = 0;  ///< grows with each change of a policy that keys without one of their own have
  struct Definition {
    /// protos.ApplicationPolicy; empty: the channel's own; none: a part has not seen it.
    std::optional<std::string> policy{};
    bool unverified = false;
    std::map<std::string, std::string> collections{};  ///< the same for those of private data; empty: the contract's
  };
  std::map<std::string, Definition> definitions_;  ///< by contract
};

}  // namespace ledgerline::fabric
