#pragma once
#include <cstddef>
#include <map>
#include <optional>
#include <string>

#include "chaincode/node/core/ordering/leaky_account.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// Keeps out who sends what turns out invalid: each such transaction is stored, and checked by all who read blocks. Who
/// loses a race, or flies while the contract changes, stays far below the bound. Where an organisation's identities
/// have spent its bound together, those of them go on whose transactions are valid. One thread at a time. `config` must
/// outlive it.
class InvalidBudget {
 public:
  explicit InvalidBudget(const CoreConfig& config) : config_(config) {}

  /// Why nothing of this one is ordered now that is not urgent.
  std::optional<std::string> refusal(const crypto::IdentityName& who, TimeNs now_ns) const;
  /// It waits for its block. By its id: who has claimed another's id waits under his own.
  void ordered(const std::string& tx_id, const crypto::IdentityName& who);
  /// It is in a block. One that was not ordered here is ignored.
  void settle(const std::string& tx_id, bool valid, TimeNs now_ns);

 private:
  struct Standing {
    LeakyAccount invalid;
    bool had_valid = false;
  };
  void forget_idle(TimeNs now_ns);

  const CoreConfig& config_;
  std::multimap<std::string, crypto::IdentityName> waiting_;  ///< as many as Waiting has, and a block
  std::map<crypto::IdentityName, Standing> identities_;
  std::map<std::string, LeakyAccount> organisations_;
};

}  // namespace ledgerline::node
