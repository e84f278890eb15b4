#include "common/fabric/tx/policy.hpp"

#include <algorithm>
#include <functional>
#include <map>
#include <optional>

#include "common/fabric/tx/form.hpp"
#include "common/policies.pb.h"
#include "msp/msp_principal.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr int max_depth = 16;  // of rules within rules; ours have two

bool matches(const common::MSPPrincipal& principal, const PolicySigner& endorser) {
  common::MSPRole role;
  if (principal.principal_classification() != common::MSPPrincipal::ROLE ||
      !role.ParseFromString(principal.principal()) || role.msp_identifier() != endorser.msp_id) {
    return false;
  }
  return role.role() == common::MSPRole::MEMBER || (role.role() == common::MSPRole::PEER && endorser.peer) ||
         (role.role() == common::MSPRole::ORDERER && endorser.orderer);
}

/// `used`: who counts already.
bool holds(const common::SignaturePolicyEnvelope& policy, const common::SignaturePolicy& rule,
           const std::vector<PolicySigner>& endorsers, std::vector<bool>& used, int depth) {
  if (depth > max_depth) return false;
  if (rule.has_n_out_of()) {
    int held = 0;
    std::vector<bool> then = used;
    for (const common::SignaturePolicy& part : rule.n_out_of().rules()) {
      std::vector<bool> with = then;
      if (!holds(policy, part, endorsers, with, depth + 1)) continue;
      then = std::move(with);
      ++held;
    }
    if (held < rule.n_out_of().n()) return false;
    used = std::move(then);
    return true;
  }
  if (rule.Type_case() != common::SignaturePolicy::kSignedBy || rule.signed_by() < 0 ||
      rule.signed_by() >= policy.identities_size()) {
    return false;
  }
  for (std::size_t i = 0; i < endorsers.size(); ++i) {
    if (used[i] || !matches(policy.identities(rule.signed_by()), endorsers[i])) continue;
    used[i] = true;
    return true;
  }
  return false;
}

/// Null: it is none. Valid until the next call of the thread. A channel has a few, asked for with each endorsement.
const common::SignaturePolicyEnvelope* parsed(std::string_view policy) {
  constexpr std::size_t max_known = 64;  // anybody may give a key of his own another one
  thread_local std::map<std::string, std::optional<common::SignaturePolicyEnvelope>, std::less<>> known;
  auto found = known.find(policy);
  if (found == known.end()) {
    common::SignaturePolicyEnvelope envelope;
    const bool whole = parse(envelope, policy);
    if (known.size() >= max_known) known.clear();
    found = known.emplace(policy, whole ? std::optional(std::move(envelope)) : std::nullopt).first;
  }
  return found->second ? &*found->second : nullptr;
}

/// One of those who have that role there.
std::string policy_of(const std::string& msp_id, common::MSPRole::MSPRoleType type) {
  common::MSPRole role;
  role.set_msp_identifier(msp_id);
  role.set_role(type);
  common::SignaturePolicyEnvelope policy;
  common::MSPPrincipal& principal = *policy.add_identities();
  principal.set_principal_classification(common::MSPPrincipal::ROLE);
  principal.set_principal(role.SerializeAsString());
  auto& rule = *policy.mutable_rule()->mutable_n_out_of();
  rule.set_n(1);
  rule.add_rules()->set_signed_by(0);
  return policy.SerializeAsString();
}

}  // namespace

std::string peer_policy(const std::string& msp_id) { return policy_of(msp_id, common::MSPRole::PEER); }
std::string member_policy(const std::string& msp_id) { return policy_of(msp_id, common::MSPRole::MEMBER); }

bool satisfies(std::string_view policy, const std::vector<PolicySigner>& endorsers) {
  const common::SignaturePolicyEnvelope* envelope = parsed(policy);
  if (envelope == nullptr) return false;
  std::vector<bool> used(endorsers.size(), false);
  return holds(*envelope, envelope->rule(), endorsers, used, 0);
}

bool satisfies(const Policy& policy, const std::vector<PolicySigner>& endorsers) {
  const auto satisfied = std::count_if(policy.parts.begin(), policy.parts.end(),
                                       [&](const std::string& part) { return satisfies(part, endorsers); });
  return static_cast<std::size_t>(satisfied) >= policy.needed;
}

}  // namespace ledgerline::fabric
