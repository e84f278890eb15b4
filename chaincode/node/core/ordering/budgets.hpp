#pragma once
#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <string>

#include "chaincode/node/core/types.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::node {

/// A count that is forgiven with time: so many a second.
class LeakyAccount {
 public:
  double at(TimeNs now_ns, double per_s) const {
    return std::max(0.0, count_ - static_cast<double>(now_ns - at_ns_) / ns_per_s * per_s);
  }
  void add(double count, TimeNs now_ns, double per_s) {
    count_ = at(now_ns, per_s) + count;
    at_ns_ = now_ns;
  }

 private:
  double count_ = 0;
  TimeNs at_ns_ = 0;
};

/// Keeps out who sends what turns out invalid: each such transaction is stored, and checked by all who read blocks. Who
/// loses a race, or flies while the contract changes, stays far below the bound. Where an organisation's identities
/// have spent its bound together, those of them go on whose transactions are valid. One thread at a time. `config` must
/// outlive it.
class InvalidBudget {
 public:
  explicit InvalidBudget(const CoreConfig& config) : config_(config) {}

  /// Why nothing of this one is ordered now that is not urgent.
  std::optional<std::string> refusal(const crypto::IdentityName& who, TimeNs now_ns) const;
  /// It is ordered, not yet in a block. A copied transaction id counts against its sender.
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
