#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// The rules by name, and which of them each function of the contract asks: the table that docs/access.md prints.
namespace ledgerline::access {

/// What has to be true for a call; a refusal names the one that is not.
enum class Rule : std::uint8_t {
  enrolled,
  name_for_good,
  administrator,
  operator_role,
  not_revoked,
  granted,
  granted_priority,
  lease_free,
  lease_held,
  not_own_lease,
  holder,
  requested,
  request_room,
  delegate_other,
  delegate_own_organisation,
  delegate_role,
  holder_or_requester,
  evicts,
  that_lease,
  foreign_grant,
  grant_room,
  grantee_role,
  stopped,
  own_stop,
  host,
  granted_stop,
  granted_cut,
  that_clear,
  not_claimed,
  claims,
};

struct RuleText {
  Rule rule;
  std::string_view id;     ///< "lease-free": in logs, audits and the page
  std::string_view needs;  ///< a sentence
};
std::span<const RuleText> all_rules();
std::string_view id_of(Rule rule);

struct FunctionText {
  std::string_view function;
  std::string_view who;
  std::string_view effect;
  std::vector<Rule> rules;  ///< in the order in which they are asked
};
const std::vector<FunctionText>& all_functions();

/// docs/access.md.
std::string access_page();

}  // namespace ledgerline::access
