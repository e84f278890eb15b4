#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/tx/policy.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// Where a value was written: block and place in it, as Fabric's versions.
struct Version {
  std::uint64_t block = 0;
  std::uint64_t tx = 0;
  auto operator<=>(const Version&) const = default;
};

/// Where Fabric keeps the definitions of contracts.
inline constexpr const char* lifecycle_name = "_lifecycle";

/// A key of one namespace (a contract's name), or, by its hash, of a collection of private data.
struct KeyName {
  std::string name;
  std::string collection;  ///< empty: the namespace's own keys
  std::string key;
  auto operator<=>(const KeyName&) const = default;
};

/// What was committed before a block, as far as validating the block's transactions needs it.
class ChannelState {
 public:
  virtual ~ChannelState() = default;
  struct Key {
    Version version;
    std::string policy{};  ///< its own, common.SignaturePolicyEnvelope; empty: that of its namespace or collection
  };
  /// nullopt: it is not there, or nobody knows.
  virtual std::optional<Key> find(const KeyName& name) const = 0;
  /// Whether a channel was followed from its first block on: what is not found is then not there.
  virtual bool whole() const { return true; }
  /// What is known of a key, found or not.
  struct Completeness {
    bool version = true, policy = true;
  };
  virtual Completeness known(const KeyName&) const { return {}; }
  /// The policy of its own that a key has, if it has one, by those who know the contract;
  /// common.SignaturePolicyEnvelope. Asked where its policy is not known.
  virtual std::optional<std::string> likely_policy(const KeyName&) const { return std::nullopt; }
  /// Whether the endorsers of the newest write of the key are all among these, and no policy has changed since: then
  /// these satisfy the key's policy, which need not be known.
  virtual bool have_sufficed(const KeyName&, const std::vector<PolicySigner>&) const { return false; }
  /// Whether its readers go by a count or stamp in its value: a write that comes a second time tells them nothing.
  virtual bool is_of_hot_path(const KeyName&) const { return false; }
  /// Whether all keys of a namespace from `start` up to `end` (empty: all behind) are known.
  virtual bool knows_range(const std::string&, const std::string& /*start*/, const std::string& /*end*/) const {
    return true;
  }
  /// The keys that a namespace has from `start` on, in order, until `take` says false.
  virtual void walk(const std::string& name, const std::string& start,
                    const std::function<bool(const std::string& key, Version version)>& take) const = 0;
  virtual bool knows_transaction(const std::string& tx_id) const = 0;
  /// Whether a known id was used only by transactions whose nonce and creator do not give it.
  virtual bool is_claimed(const std::string& /*tx_id*/) const { return false; }
  /// All ids are known of transactions from this block on.
  virtual std::uint64_t ids_since() const { return 0; }
  /// When the first of these came (real time); nullopt: nobody knows.
  virtual std::optional<TimeNs> ids_since_ns() const { return std::nullopt; }

  /// Whose endorsement a namespace's keys need, or a collection's; nullopt: there is no such contract, or, where the
  /// state is not whole, nobody knows.
  virtual std::optional<Policy> policy_of(const std::string& name, const std::string& collection) const = 0;
  /// Whether somebody has only said so, of now: it may have been another one at the block that is validated.
  virtual bool policy_is_unverified(const std::string& /*name*/) const { return false; }
};

}  // namespace ledgerline::fabric
