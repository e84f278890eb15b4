#include "chaincode/node/core/ordering/urgent_budget.hpp"

#include <algorithm>

namespace ledgerline::node {
namespace {

constexpr std::size_t max_remembered = 1'024;  // identities, though nothing of theirs waits; as Waiting
/// Invalid ones that are forgiven. A pilot who loses a race sends again after 25 to 250 ms, ten times at most: 2 a
/// second keep even that one within its budget. At 20 a second a flood would be forgiven as fast as it comes.
constexpr double identity_per_s = 2, organisation_per_s = 8;

}  // namespace

void UrgentBudget::refill(Account& account, double per_s, TimeNs now_ns) {
  const double back = static_cast<double>(now_ns - account.at_ns) / ns_per_s * per_s;
  account.invalid = std::max(0.0, account.invalid - back);
  account.at_ns = now_ns;
}

bool UrgentBudget::reserve(const std::string& tx_id, const crypto::IdentityName& who, TimeNs now_ns) {
  if (waiting_.contains(tx_id)) return false;
  if (identities_.size() >= max_remembered) forget_idle(now_ns);
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
    --account->waiting;
    if (!gives_back) account->invalid += 1;
  }
}

void UrgentBudget::forget_idle(TimeNs now_ns) {
  for (auto& [who, account] : identities_) refill(account, identity_per_s, now_ns);
  std::erase_if(identities_, [](const auto& one) { return one.second.waiting == 0 && one.second.invalid <= 0; });
}

}  // namespace ledgerline::node
