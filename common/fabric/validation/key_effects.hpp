#pragma once
#include <map>
#include <string>

#include "ledger/rwset/kvrwset/kv_rwset.pb.h"

namespace ledgerline::fabric {

/// What one transaction does to one key.
struct KeyEffect {
  enum class Kind {
    value,             ///< a new value; the key's policy stays
    value_and_policy,  ///< both are new
    policy,            ///< the policy alone, where the key is there; else nothing
    deletion,          ///< of the policy, too
  };
  Kind kind = Kind::value;
  std::string value{};
  std::string policy{};  ///< common.SignaturePolicyEnvelope; empty: none from now on
};

/// By key, as Fabric 2.5 reads a set. An empty value is a deletion. Fabric adds up what is said of a key, so that a
/// value given twice in one set counts as new metadata alone, which no contract's peer makes; its state keeps the old
/// value then (core/ledger/kvledger/txmgmt/validation/tx_ops.go).
std::map<std::string, KeyEffect> effects_of(const kvrwset::KVRWSet& set);

}  // namespace ledgerline::fabric
