#pragma once
#include <cstddef>
#include <map>
#include <string>

#include "chaincode/node/core/types.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// How many urgent envelopes an identity, and its whole organisation, may have ordered that were not found valid. A
/// valid one gives its place back at once; any other one's place comes back slowly, so that nobody lives on invalid
/// ones, and who lost a few races is not punished for long. It counts each transaction once: a replayed envelope costs
/// its creator nothing and is not urgent. One thread at a time. `config` must outlive it.
class UrgentBudget {
 public:
  explicit UrgentBudget(const CoreConfig& config) : config_(config) {}

  /// Takes a place of the identity's and one of its organisation's. False: one of the two has none left, or the
  /// transaction has its place already; then nothing changes.
  bool reserve(const std::string& tx_id, const crypto::IdentityName& who, TimeNs now_ns);
  /// The transaction is in a block, or was not taken at all (then its place comes back as that of a valid one). Others
  /// than those reserved are ignored.
  void settle(const std::string& tx_id, bool gives_back);

  std::size_t remembered() const { return identities_.size(); }

 private:
  /// Places that are taken: those of transactions that wait, and the invalid ones', which flow back with time.
  struct Account {
    std::size_t waiting = 0;
    double invalid = 0;
    TimeNs at_ns = 0;
  };
  static void refill(Account& account, double per_s, TimeNs now_ns);
  void forget_idle(TimeNs now_ns);

  const CoreConfig& config_;
  std::map<crypto::IdentityName, Account> identities_;
  std::map<std::string, Account> organisations_;  ///< as many as the channel has
  std::map<std::string, crypto::IdentityName> waiting_;
};

}  // namespace ledgerline::node
