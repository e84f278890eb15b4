#include "chaincode/node/core/ordering/budgets.hpp"

#include <algorithm>

#include "common/base/check.hpp"

namespace ledgerline::node {
namespace {

/// Invalid ones that are forgiven: 50 a second cost a reader a hundredth of a core, 100 of an organisation two. With
/// half a host whose states a new contract refuses would be silent for longer than its apply_stops takes; with ten
/// times as many a flood of 350 a second would go on for ever.
constexpr double identity_forgiven_per_s = 50, organisation_forgiven_per_s = 100;

/// Invalid ones that are forgiven. A pilot who loses a race sends again after 25 to 250 ms, ten times at most: 2 a
/// second keep even that one within its budget. At 20 a second a flood would be forgiven as fast as it comes.
constexpr double identity_per_s = 2, organisation_per_s = 8;

}  // namespace

std::optional<std::string> InvalidBudget::refusal(const crypto::IdentityName& who, TimeNs now_ns) const {
  const auto identity = identities_.find(who);
  const bool known = identity != identities_.end();
  const double own = known ? identity->second.invalid.at(now_ns, identity_forgiven_per_s) : 0;
  if (own >= static_cast<double>(config_.invalid_of_identity))
    return "too many transactions of this identity were invalid; try again in a while";
  const auto organisation = organisations_.find(who.msp_id);
  if (organisation == organisations_.end() || organisation->second.at(now_ns, organisation_forgiven_per_s) <
                                                  static_cast<double>(config_.invalid_of_organisation)) {
    return std::nullopt;
  }
  if (known && identity->second.had_valid && own < 1) return std::nullopt;
  return "too many transactions of " + who.msp_id + " were invalid; try again in a while";
}

void InvalidBudget::ordered(const std::string& tx_id, const crypto::IdentityName& who) { waiting_.emplace(tx_id, who); }

void InvalidBudget::settle(const std::string& tx_id, bool valid, TimeNs now_ns) {
  const auto found = waiting_.find(tx_id);
  if (found == waiting_.end()) return;
  if (identities_.size() >= max_idle_identities) forget_idle(now_ns);
  Standing& standing = identities_[found->second];
  if (valid) {
    standing.had_valid = true;
  } else {
    standing.invalid.add(1, now_ns, identity_forgiven_per_s);
    organisations_[found->second.msp_id].add(1, now_ns, organisation_forgiven_per_s);
  }
  waiting_.erase(found);
}

/// Who had valid ones is forgotten, too: that counts only while its organisation's bound is spent.
void InvalidBudget::forget_idle(TimeNs now_ns) {
  std::erase_if(identities_,
                [&](const auto& one) { return one.second.invalid.at(now_ns, identity_forgiven_per_s) <= 0; });
}

void UrgentBudget::refill(Account& account, double per_s, TimeNs now_ns) {
  const double back = static_cast<double>(now_ns - account.at_ns) / ns_per_s * per_s;
  account.invalid = std::max(0.0, account.invalid - back);
  account.at_ns = now_ns;
}

bool UrgentBudget::reserve(const std::string& tx_id, const crypto::IdentityName& who, TimeNs now_ns) {
  if (waiting_.contains(tx_id)) return false;
  if (identities_.size() >= max_idle_identities) forget_idle(now_ns);
  Account& identity = identities_[who];
  Account& organisation = organisations_[who.msp_id];
  refill(identity, identity_per_s, now_ns);
  refill(organisation, organisation_per_s, now_ns);
  const auto is_spent = [](const Account& account, std::size_t places) {
    return static_cast<double>(account.waiting) + account.invalid + 1 > static_cast<double>(places);
  };
  if (is_spent(identity, config_.urgent_of_identity)) return false;
  if (is_spent(organisation, config_.urgent_of_organisation)) return false;
  ++identity.waiting;
  ++organisation.waiting;
  waiting_.emplace(tx_id, who);
  return true;
}

void UrgentBudget::settle(const std::string& tx_id, bool gives_back) {
  const auto found = waiting_.find(tx_id);
  if (found == waiting_.end()) return;
  Account& identity = identities_[found->second];
  Account& organisation = organisations_[found->second.msp_id];
  waiting_.erase(found);
  for (Account* account : {&identity, &organisation}) {
    LEDGERLINE_CHECK(account->waiting > 0, "who has an urgent transaction that waits has a place taken", tx_id);
    --account->waiting;
    if (!gives_back) account->invalid += 1;
  }
}

void UrgentBudget::forget_idle(TimeNs now_ns) {
  for (auto& [who, account] : identities_) refill(account, identity_per_s, now_ns);
  std::erase_if(identities_, [](const auto& one) { return one.second.waiting == 0 && one.second.invalid <= 0; });
}

}  // namespace ledgerline::node
