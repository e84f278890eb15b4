#include "chaincode/node/core/ordering/invalid_budget.hpp"

namespace ledgerline::node {
namespace {

constexpr std::size_t max_standings = 1'024;  // identities; as Waiting
/// Invalid ones that are forgiven: 50 a second cost a reader a hundredth of a core, 100 of an organisation two. With
/// half a host whose states a new contract refuses would be silent for longer than its apply_stops takes; with ten
/// times as many a flood of 350 a second would go on for ever.
constexpr double identity_forgiven_per_s = 50, organisation_forgiven_per_s = 100;

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
  if (identities_.size() >= max_standings) forget_idle(now_ns);
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

}  // namespace ledgerline::node
