#include "common/access/rules.hpp"

#include <algorithm>
#include <array>

#include "common/msg/contract.hpp"

namespace ledgerline::access {
namespace {

static_assert(contract::max_drone_requests == 16 && contract::max_drone_grants == 64, "as the texts say");

constexpr std::array rules{
    RuleText{Rule::enrolled, "enrolled", "The drone is enrolled."},
    RuleText{Rule::name_for_good, "name-for-good", "The drone is new, or the same organisation's: names are for good."},
    RuleText{Rule::administrator, "administrator",
             "Administrator (a certificate with OU=admin) of the organisation that the call is about: the drone's, or "
             "the identity's."},
    RuleText{Rule::operator_role, "operator-role", "Operator or supervisor (hand_over: who gets the lease)."},
    RuleText{Rule::not_revoked, "not-revoked", "Not revoked."},
    RuleText{Rule::granted, "granted",
             "Of the drone's organisation, or with a grant to fly, its own or its organisation's."},
    RuleText{Rule::granted_priority, "granted-priority", "Its grant is for this priority."},
    RuleText{Rule::lease_free, "lease-free",
             "Nobody holds the lease, or the caller, a revoked one, or one with a lower priority."},
    RuleText{Rule::lease_held, "lease-held", "Somebody holds the lease; for a request, one who is not revoked."},
    RuleText{Rule::not_own_lease, "not-own-lease", "Does not hold it itself."},
    RuleText{Rule::holder, "holder", "Holds the lease."},
    RuleText{Rule::requested, "requested",
             "Who is named has requested the lease and is granted it, its delegate likewise (deny: has requested it)."},
    RuleText{Rule::request_room, "request-room", "Its organisation has at most 16 requests for the drone."},
    RuleText{Rule::delegate_other, "delegate-other", "The delegate is not the caller itself."},
    RuleText{Rule::delegate_own_organisation, "delegate-own-organisation",
             "The delegate is of the caller's organisation."},
    RuleText{Rule::delegate_role, "delegate-role", "The delegate is neither revoked nor an auditor."},
    RuleText{Rule::holder_or_requester, "holder-or-requester", "Holds the lease, or it is its own request."},
    RuleText{Rule::evicts, "evicts", "Supervisor of the drone's organisation, or the drone's host."},
    RuleText{Rule::that_lease, "that-lease", "The lease is still of the epoch that the call names, if any."},
    RuleText{Rule::foreign_grant, "foreign-grant", "The grant is to another organisation, or somebody of one."},
    RuleText{Rule::grant_room, "grant-room", "The drone has at most 64 grants."},
    RuleText{Rule::grantee_role, "grantee-role", "Who is granted something is neither revoked nor an auditor."},
    RuleText{Rule::stopped, "stopped", "The drone is stopped."},
    RuleText{Rule::own_stop, "own-stop",
             "One of the stops is its own, or it is a supervisor of the drone's organisation."},
    RuleText{Rule::host, "host", "The drone's host."},
    RuleText{Rule::granted_stop, "granted-stop", "As granted, or with a grant to stop or cut."},
    RuleText{Rule::granted_cut, "granted-cut", "The same, with a grant to cut, where the call cuts the motors."},
    RuleText{Rule::that_clear, "that-clear",
             "Its stops were cleared as often as the call says, if it does: an old stop stops nothing again."},
    RuleText{
        Rule::not_claimed, "not-claimed",
        "Nobody of the drone's organisation has claimed it (clear_stop: or the caller is of that organisation); for a "
        "request or denial, nor has its holder, unless that is the caller."},
    RuleText{Rule::claims, "claims",
             "Supervisor or administrator of the drone's organisation, its host, or the lease's holder."},
};

}  // namespace

std::span<const RuleText> all_rules() { return rules; }

std::string_view id_of(Rule rule) { return std::ranges::find(rules, rule, &RuleText::rule)->id; }

const std::vector<FunctionText>& all_functions() {
  static const std::vector<FunctionText> functions{
      {contract::enroll,
       "administrator",
       "The drone is enrolled to the identity, its host; the identity has the role.",
       {Rule::administrator, Rule::name_for_good}},
      {contract::revoke,
       "administrator",
       "The identity may only give back what it holds. Its leases and grants end by apply_stops of the drone's host.",
       {Rule::administrator}},
      {contract::grant,
       "administrator",
       "The identity or organisation has this grant in place of its older one; a lease that it no longer covers ends.",
       {Rule::grantee_role, Rule::enrolled, Rule::administrator, Rule::foreign_grant, Rule::grant_room}},
      {contract::acquire,
       "operator, supervisor",
       "The caller holds the lease, its delegate commands; a new holder or delegate gets a new epoch.",
       {Rule::operator_role, Rule::delegate_other, Rule::delegate_own_organisation, Rule::delegate_role, Rule::enrolled,
        Rule::not_claimed, Rule::granted, Rule::granted_priority, Rule::lease_free}},
      {contract::release,
       "holder",
       "Nobody holds the lease. A revoked holder may release it, too.",
       {Rule::enrolled, Rule::holder}},
      {contract::request,
       "operator, supervisor",
       "The caller's request stands beside the lease, in place of its older one.",
       {Rule::operator_role, Rule::delegate_other, Rule::delegate_own_organisation, Rule::delegate_role, Rule::enrolled,
        Rule::not_claimed, Rule::granted, Rule::granted_priority, Rule::lease_held, Rule::not_own_lease,
        Rule::request_room}},
      {contract::hand_over,
       "holder",
       "Who has requested the lease holds it, with the delegate and priority requested.",
       {Rule::operator_role, Rule::enrolled, Rule::not_claimed, Rule::holder, Rule::not_revoked, Rule::requested}},
      {contract::deny,
       "holder, requester",
       "The request is gone.",
       {Rule::enrolled, Rule::not_claimed, Rule::holder_or_requester, Rule::requested}},
      {contract::evict,
       "supervisor, host",
       "Nobody holds the lease.",
       {Rule::not_revoked, Rule::enrolled, Rule::evicts, Rule::lease_held, Rule::that_lease}},
      {contract::stop,
       "operator, supervisor",
       "The caller's stop stands, beside those of others: the drone lands.",
       {Rule::enrolled, Rule::operator_role, Rule::granted_stop, Rule::granted_cut, Rule::that_clear}},
      {contract::clear_stop,
       "stopper, supervisor",
       "The caller's stop is cleared; by a supervisor of the drone's organisation, everybody's.",
       {Rule::not_revoked, Rule::enrolled, Rule::not_claimed, Rule::stopped, Rule::own_stop}},
      {contract::apply_stops,
       "host",
       "Lease and grants of the revoked end; standing stops are taken into the lease.",
       {Rule::enrolled, Rule::host}},
      {contract::claim,
       "supervisor, administrator, host, holder",
       "evict, grant, clear_stop and release of the claimant go first; what holders and requesters change has to wait.",
       {Rule::enrolled, Rule::not_revoked, Rule::claims}},
      {contract::unclaim,
       "supervisor, administrator, host, holder",
       "Nobody's claim stands; by a holder: its own does not.",
       {Rule::enrolled, Rule::not_revoked, Rule::claims}},
  };
  return functions;
}

std::string access_page() {
  std::string text =
      "# Access: who may do what\n\n"
      "Printed by `ledgerline contract rules` from the rules that the contract applies and that agent, ground and "
      "audit\nhold blocks against (`common/access`). The audit names the rule of a finding. Of commands it counts who "
      "signed "
      "them:\nthat they might is in their endorsements.\n\n"
      "## Functions\n\n"
      "| function | who | effect | rules, in the order asked |\n| --- | --- | --- | --- |\n";
  for (const FunctionText& one : all_functions()) {
    std::string asked;
    for (const Rule rule : one.rules) asked.append(asked.empty() ? "" : ", ").append(id_of(rule));
    text.append("| `").append(one.function).append("` | ").append(one.who).append(" | ").append(one.effect);
    text.append(" | ").append(asked).append(" |\n");
  }
  text += "\n## Rules\nOf the caller, unless they name somebody else.\n\n| rule | what it needs |\n| --- | --- |\n";
  for (const RuleText& one : rules) text.append("| ").append(one.id).append(" | ").append(one.needs).append(" |\n");
  return text;
}

}  // namespace ledgerline::access
