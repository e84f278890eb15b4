#include "common/access/access.hpp"

#include <algorithm>
#include <array>
#include <functional>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/base/check.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::access {
namespace {

using crypto::IdentityName;

std::optional<Refusal> refuse(Rule rule, std::string text) { return Refusal{rule, std::move(text)}; }

std::string revoked_text(const IdentityName& who) {
  return to_text(who) + " is revoked; an administrator of " + who.msp_id + " may enroll it again";
}

std::string no_operator_text(const IdentityName& who, Role role) {
  if (role == REVOKED) return revoked_text(who);
  return to_text(who) + " is neither operator nor supervisor; an administrator of " + who.msp_id +
         " may enroll it as one";
}

std::optional<Refusal> check_operator(const IdentityName& who, std::optional<Role> role) {
  return !role || is_operator(*role) ? std::nullopt : refuse(Rule::operator_role, no_operator_text(who, *role));
}

std::optional<Refusal> check_not_revoked(const IdentityName& who, std::optional<Role> role) {
  return role == REVOKED ? refuse(Rule::not_revoked, revoked_text(who)) : std::nullopt;
}

std::optional<Refusal> check_administrator(const std::string& function, const std::string& organisation,
                                           const Caller& caller) {
  if (caller.admin && caller.name.msp_id == organisation) return std::nullopt;
  return refuse(Rule::administrator,
                "only an administrator of " + organisation + " may " + function + " its identities");
}

/// A delegate needs no role: it commands under a lease, and may do nothing else by it.
std::optional<Refusal> check_delegate(const Identity& delegate, const IdentityName& holder, const Roles& roles) {
  const IdentityName who = to_name(delegate);
  if (who == holder) {
    return refuse(Rule::delegate_other,
                  "delegate is " + to_text(holder) + " itself, who commands without one; leave it out");
  }
  if (!may_delegate(to_message(holder), delegate)) {
    return refuse(Rule::delegate_own_organisation, to_text(who) + " cannot command for " + to_text(holder) +
                                                       ": a delegate is of its holder's organisation");
  }
  const auto role = roles.of(who);
  if (!role || !withdraws_rights(*role)) return std::nullopt;
  return refuse(
      Rule::delegate_role,
      "delegate " + (*role == REVOKED ? revoked_text(who) : to_text(who) + " is an auditor, who commands nothing"));
}

std::optional<Refusal> check_grantee(const Grant& grant, const Roles& roles) {
  const IdentityName who = to_name(grant.to());
  const auto role = roles.of(who);
  if (!has_rights(grant) || !role || !withdraws_rights(*role)) return std::nullopt;  // withdrawn it may be at any time
  return refuse(Rule::grantee_role, no_operator_text(who, *role));
}

Refusal wait_for(const Identity& claimant, const std::string& owner) {
  return {Rule::not_claimed, to_text(claimant) +
                                 " has claimed it for a change of its own; try again. A supervisor of " + owner +
                                 " may end the claim by unclaim"};
}

/// Of one drone's record: changed in place, or refused.
class Change {
 public:
  Change(const Control& before, const Call& call, const Caller& caller, const RuleInputs& inputs)
      : control(before), call_(call), caller_(caller), inputs_(inputs), self_(to_message(caller.name)) {}

  std::optional<Refusal> run() {
    static const std::map<std::string_view, std::optional<Refusal> (Change::*)()> functions{
        {contract::enroll, &Change::enroll},
        {contract::revoke, &Change::revoke},
        {contract::grant, &Change::grant},
        {contract::acquire, &Change::acquire},
        {contract::release, &Change::release},
        {contract::request, &Change::request},
        {contract::hand_over, &Change::hand_over},
        {contract::deny, &Change::deny},
        {contract::evict, &Change::evict},
        {contract::clear_stop, &Change::clear_stop},
        {contract::apply_stops, &Change::apply_stops}};
    const bool needs_owner = call_.function != contract::enroll && call_.function != contract::revoke;
    if (needs_owner && !control.has_owner()) return refuse(Rule::enrolled, not_enrolled_text());
    return std::invoke(functions.at(call_.function), this);
  }

  Control control;

 private:
  template <typename Message>
  const Message& message() const {
    return std::get<Message>(call_.message);
  }
  const std::string& owner() const { return control.owner().msp_id(); }
  bool is_own_organisation() const { return caller_.name.msp_id == owner(); }
  bool is_host() const { return to_name(control.owner()) == caller_.name; }
  bool is_supervisor() const { return inputs_.roles.of(caller_.name) == SUPERVISOR && is_own_organisation(); }
  bool is_held() const { return control.has_holder() && !is_lease_revoked(control); }
  bool holds() const { return control.has_holder() && to_name(control.holder()) == caller_.name; }

  /// The contract's own limits: a chain of before them has more.
  bool is_beyond(std::ptrdiff_t count, std::size_t limit) const {
    return inputs_.roles.all && static_cast<std::size_t>(count) > limit;
  }

  std::optional<Refusal> enroll() {
    const auto& asked = message<EnrollCall>();
    if (control.has_owner() && owner() != asked.identity().msp_id()) {
      return refuse(Rule::name_for_good, "enrolled to organisation " + owner() + " already; names are for good");
    }
    const bool same = control.has_owner() && same_identity(control.owner(), asked.identity());
    if (!same && inputs_.moves_streams) *control.add_former_owners() = control.owner();
    *control.mutable_owner() = asked.identity();
    if (asked.role() != ROLE_NONE) apply_role(control, asked.identity(), asked.role());
    return std::nullopt;
  }

  std::optional<Refusal> revoke() {
    apply_role(control, message<RevokeCall>().identity(), REVOKED);
    return std::nullopt;
  }

  std::optional<Refusal> grant() {
    const Grant& asked = message<GrantCall>().grant();
    if (!caller_.admin || !is_own_organisation()) {
      return refuse(Rule::administrator,
                    to_text(self_) + " may not grant it: only an administrator of " + owner() + " may");
    }
    if (asked.to().msp_id() == owner()) {
      return refuse(Rule::foreign_grant,
                    "operators and supervisors of " + owner() + " need no grant; take the role away");
    }
    set_grant(control, asked, inputs_.new_epoch);
    if (!is_beyond(control.grants_size(), contract::max_drone_grants)) return std::nullopt;
    return refuse(Rule::grant_room, "it has " + std::to_string(contract::max_drone_grants) +
                                        " grants already, which is the limit; an administrator of " + owner() +
                                        " may withdraw some");
  }

  /// Whether the caller may fly the drone so, no matter who flies it now.
  std::optional<Refusal> check_granted(const LeaseCall& asked) const {
    const std::uint32_t priority = asked.priority();
    if (asked.has_delegate() && is_revoked(control, asked.delegate()))
      return refuse(Rule::delegate_role, "delegate " + revoked_text(to_name(asked.delegate())));
    const Rights rights = rights_of(control, self_);
    if (!rights.fly) {
      return refuse(Rule::granted, to_text(self_) + " may not fly it: " + owner() +
                                       " has granted that neither to this identity nor to " + self_.msp_id() +
                                       "; an administrator of " + owner() + " may");
    }
    if (priority <= rights.max_priority) return std::nullopt;
    return refuse(Rule::granted_priority, owner() + " has granted " + to_text(self_) + " priorities up to " +
                                              std::to_string(rights.max_priority) + ", not " +
                                              std::to_string(priority) + "; an administrator of " + owner() +
                                              " may grant more");
  }

  std::optional<Refusal> acquire() {
    const auto& asked = message<LeaseCall>();
    if (std::optional<Refusal> why = check_granted(asked)) return why;
    if (is_held() && !holds() && asked.priority() <= control.priority()) {
      return refuse(Rule::lease_free, "the lease is held by " + to_text(control.holder()) + " with priority " +
                                          std::to_string(control.priority()) +
                                          ", who may release it, or hand it over on request; a supervisor of " +
                                          owner() + " may evict it");
    }
    begin_lease(control, self_, delegate_in(asked), inputs_.new_epoch, asked.priority());
    remove_request(control, self_);
    return std::nullopt;
  }

  std::optional<Refusal> not_the_holder() const {
    return refuse(Rule::holder,
                  to_text(self_) + " does not hold the lease; " +
                      (!control.has_holder()    ? "nobody does, and who is granted it may acquire it"
                       : control.has_delegate() ? holder_text(control) + " and may itself hand it over on request"
                                                : holder_text(control) + " does, who may hand it over on request"));
  }
  std::optional<Refusal> check_holder() const {
    if (!holds()) return not_the_holder();
    return is_revoked(control, control.holder()) ? refuse(Rule::not_revoked, revoked_text(caller_.name)) : std::nullopt;
  }

  std::optional<Refusal> release() {
    if (!holds()) return not_the_holder();  // a revoked one may give back what it holds
    end_lease(control, inputs_.new_epoch);
    return std::nullopt;
  }

  std::optional<Refusal> request() {
    const auto& asked = message<LeaseCall>();
    if (std::optional<Refusal> why = check_granted(asked)) return why;
    if (!is_held()) return refuse(Rule::lease_held, "nobody holds the lease; acquire it");
    if (holds()) return refuse(Rule::not_own_lease, to_text(self_) + " holds the lease already");
    add_request(control, self_, delegate_in(asked), asked.priority());
    const auto of_us = std::ranges::count(control.requests(), self_.msp_id(),
                                          [](const ledgerline::Request& one) { return one.who().msp_id(); });
    if (!is_beyond(of_us, contract::max_drone_requests)) return std::nullopt;
    return refuse(Rule::request_room, "it has " + std::to_string(contract::max_drone_requests) + " requests of " +
                                          self_.msp_id() + " already, which is the limit; its holder may deny some");
  }

  std::optional<Refusal> hand_over() {
    const Identity& to = message<AnswerCall>().to();
    if (std::optional<Refusal> why = check_holder()) return why;
    const ledgerline::Request* request = request_of(control, to);
    if (request == nullptr) return refuse(Rule::requested, to_text(to) + " has not requested it; it may request it");
    const Rights rights = rights_of(control, to);
    if (!rights.fly) {
      return refuse(Rule::requested,
                    to_text(to) + " is not granted it any more; an administrator of " + owner() + " may grant it");
    }
    const Identity* delegate = delegate_in(*request);
    const auto role = delegate != nullptr ? inputs_.roles.of(to_name(*delegate)) : std::nullopt;
    if (delegate != nullptr && (is_revoked(control, *delegate) || (role && withdraws_rights(*role)))) {
      return refuse(Rule::requested, to_text(to) + " has requested it for " + to_text(*delegate) +
                                         ", whose organisation lets it command no more; it may request it again");
    }
    begin_lease(control, to, delegate, inputs_.new_epoch, std::min(request->priority(), rights.max_priority));
    remove_request(control, to);
    return std::nullopt;
  }

  std::optional<Refusal> deny() {
    const Identity& to = message<AnswerCall>().to();
    const std::optional<Refusal> holder = check_holder();
    if (holder && to_name(to) != caller_.name) {
      return refuse(
          Rule::holder_or_requester,
          to_text(self_) + " may not deny it: only the lease's holder, or who has requested it, may: " + holder->text);
    }
    if (remove_request(control, to)) return std::nullopt;
    return refuse(Rule::requested, to_text(to) + " has not requested it; nothing to deny");
  }

  std::optional<Refusal> evict() {
    const auto& asked = message<DronesCall>();
    if (!is_supervisor() && !is_host()) {
      return refuse(Rule::evicts, to_text(self_) + " may not evict: neither a supervisor of " + owner() +
                                      " nor the drone's host, who may");
    }
    if (!control.has_holder()) return refuse(Rule::lease_held, "nobody holds the lease; there is nothing to evict");
    const auto meant = said_of(asked, asked.epochs(), control.drone());
    if (meant && *meant != control.epoch()) {
      return refuse(Rule::that_lease, "its lease is not the one of epoch " + std::to_string(*meant) +
                                          " any more: " + to_text(control.holder()) + " holds it under epoch " +
                                          std::to_string(control.epoch()));
    }
    end_lease(control, inputs_.new_epoch);
    return std::nullopt;
  }

  std::optional<Refusal> clear_stop() {
    if (!is_stopped(control)) {
      return refuse(Rule::stopped, "not stopped; there is nothing that " + to_text(self_) + " could clear");
    }
    if (clear_stops(control, self_, is_supervisor())) return std::nullopt;
    return refuse(Rule::own_stop, "stopped by " + stopper_names(control) +
                                      "; only they, each its own, or a supervisor of " + owner() + " may clear it");
  }

  std::optional<Refusal> apply_stops() {
    if (!is_host()) {
      return refuse(Rule::host, "enrolled to " + to_text(control.owner()) + ", who alone applies its stops");
    }
    end_revoked(control, inputs_.new_epoch);
    return std::nullopt;
  }

  const Call& call_;
  const Caller& caller_;
  const RuleInputs& inputs_;
  const Identity self_;
};

template <typename List>
bool same_list(const List& a, const List& b) {
  return std::ranges::equal(
      a, b, [](const auto& one, const auto& other) { return one.SerializeAsString() == other.SerializeAsString(); });
}

/// What every change leaves true of a record, whichever rule allowed it and whatever the record was.
void check_change(const Control& before, const Control& after, const Call& call, const Caller& caller,
                  const RuleInputs& inputs) {
  const std::string& function = call.function;
  const auto is = [&](std::initializer_list<std::string_view> names) {
    return std::ranges::find(names, std::string_view(function)) != names.end();
  };
  const bool same_lease = before.has_holder() == after.has_holder() && before.has_delegate() == after.has_delegate() &&
                          same_identity(before.holder(), after.holder()) &&
                          same_identity(before.delegate(), after.delegate());
  LEDGERLINE_CHECK(after.drone() == before.drone(), "a change is of one drone", before.drone(), after.drone());
  LEDGERLINE_CHECK(!before.has_owner() || after.owner().msp_id() == before.owner().msp_id(),
                   "a drone stays its organisation's", function, before.drone());
  LEDGERLINE_CHECK(same_lease || after.epoch() == inputs.new_epoch, "another lease has a new epoch", function,
                   before.drone(), after.epoch(), inputs.new_epoch);
  LEDGERLINE_CHECK(same_lease || after.has_holder() || !after.has_delegate(), "nobody commands without a holder",
                   function, before.drone());
  LEDGERLINE_CHECK(function != contract::acquire || to_name(after.holder()) == caller.name,
                   "who acquires holds the lease", before.drone());
  LEDGERLINE_CHECK(same_lease || is({contract::acquire, contract::release, contract::hand_over, contract::evict,
                                     contract::grant, contract::apply_stops}),
                   "only these change a lease", function, before.drone());
  LEDGERLINE_CHECK(function == contract::clear_stop || same_list(before.stoppers(), after.stoppers()),
                   "only clear_stop ends a stop", function, before.drone());
  LEDGERLINE_CHECK(is({contract::grant, contract::apply_stops}) || same_list(before.grants(), after.grants()),
                   "only these change grants", function, before.drone());
}

}  // namespace

std::string holder_text(const Control& control) {
  const std::string holder = to_text(control.holder());
  return control.has_delegate() ? holder + ", who lets " + to_text(control.delegate()) + " command it" : holder;
}

std::string not_enrolled_text() { return "not enrolled; an administrator of its organisation may enroll it"; }

std::vector<IdentityName> roles_needed(const Call& call, const Caller& caller) {
  const std::string& function = call.function;
  std::vector<IdentityName> whose;
  if (function == contract::acquire || function == contract::request) {
    whose.push_back(caller.name);
    const auto& lease = std::get<LeaseCall>(call.message);
    if (lease.has_delegate()) whose.push_back(to_name(lease.delegate()));
  }
  if (function == contract::evict || function == contract::clear_stop) whose.push_back(caller.name);
  if (function == contract::hand_over) whose.push_back(to_name(std::get<AnswerCall>(call.message).to()));
  if (function == contract::grant) whose.push_back(to_name(std::get<GrantCall>(call.message).grant().to()));
  return whose;
}

std::vector<IdentityName> roles_needed(const Call& call, const Control& before) {
  if (call.function != contract::hand_over) return {};
  const ledgerline::Request* request = request_of(before, std::get<AnswerCall>(call.message).to());
  if (request == nullptr || !request->has_delegate()) return {};
  return {to_name(request->delegate())};
}

std::optional<Refusal> check_call(const Call& call, const Caller& caller, const Roles& roles) {
  const std::string& function = call.function;
  const auto own_role = roles.of(caller.name);
  if (function == contract::enroll)
    return check_administrator(function, std::get<EnrollCall>(call.message).identity().msp_id(), caller);
  if (function == contract::revoke)
    return check_administrator(function, std::get<RevokeCall>(call.message).identity().msp_id(), caller);
  if (function == contract::grant) return check_grantee(std::get<GrantCall>(call.message).grant(), roles);
  if (function == contract::hand_over) {
    const IdentityName to = to_name(std::get<AnswerCall>(call.message).to());
    return check_operator(to, roles.of(to));
  }
  if (function == contract::evict || function == contract::clear_stop) return check_not_revoked(caller.name, own_role);
  if (function != contract::acquire && function != contract::request) return std::nullopt;
  if (std::optional<Refusal> why = check_operator(caller.name, own_role)) return why;
  const auto& lease = std::get<LeaseCall>(call.message);
  return lease.has_delegate() ? check_delegate(lease.delegate(), caller.name, roles) : std::nullopt;
}

std::variant<Control, Refusal> apply(const Control& before, const Call& call, const Caller& caller,
                                     const RuleInputs& inputs) {
  if (std::optional<Refusal> why = check_call(call, caller, inputs.roles)) return std::move(*why);
  Change change(before, call, caller, inputs);
  if (std::optional<Refusal> why = change.run()) return std::move(*why);
  check_change(before, change.control, call, caller, inputs);
  return std::move(change.control);
}

std::optional<Refusal> check_stop(const Control& record, const Caller& caller, std::optional<Role> role, bool cut) {
  if (std::optional<Refusal> why = check_operator(caller.name, role)) return why;
  const Rights rights = rights_of(record, to_message(caller.name));
  if (cut ? rights.cut : rights.stop) return std::nullopt;
  const std::string& owner = record.owner().msp_id();
  return refuse(cut ? Rule::granted_cut : Rule::granted_stop,
                to_text(caller.name) + " may not " + (cut ? "cut" : "stop") + " it: " + owner +
                    " has granted that neither to this identity nor to " + caller.name.msp_id +
                    "; an administrator of " + owner + " may");
}

std::optional<Refusal> check_clears(const DronesCall& call, const std::string& drone, const Caller& caller,
                                    std::uint64_t clears) {
  const auto meant = said_of(call, call.clears(), drone);
  if (!meant || *meant == clears) return std::nullopt;
  return refuse(Rule::that_clear, "a stop meant for " + std::to_string(*meant) + " clears of the stops of " +
                                      to_text(caller.name) + "; the ledger has " + std::to_string(clears) +
                                      ": name that, or none");
}

bool claims_for_owner(const std::string& owner_msp_id, bool hosts, const Caller& caller, Role role) {
  return role != REVOKED && caller.name.msp_id == owner_msp_id && (role == SUPERVISOR || caller.admin || hosts);
}

std::optional<Refusal> check_holders_claim(const Control& record, const Caller& caller, Role role) {
  if (std::optional<Refusal> why = check_not_revoked(caller.name, role)) return why;
  if (record.has_holder() && to_name(record.holder()) == caller.name) return std::nullopt;
  const std::string& owner = record.owner().msp_id();
  return refuse(Rule::claims, to_text(caller.name) + " may not claim it: only a supervisor or administrator of " +
                                  owner + ", the drone's host or the lease's holder may");
}

std::optional<Refusal> check_claimed(const std::vector<Identity>& claimants, const Control& record,
                                     const std::string& function, const Caller& caller) {
  constexpr std::array<std::string_view, 4> waits{contract::acquire, contract::request, contract::hand_over,
                                                  contract::deny};
  const std::string& owner = record.owner().msp_id();
  const bool clears_from_elsewhere = function == contract::clear_stop && caller.name.msp_id != owner;
  const bool has_to_wait = clears_from_elsewhere || std::ranges::find(waits, function) != waits.end();
  return claimants.empty() || !has_to_wait ? std::nullopt : std::optional(wait_for(claimants.front(), owner));
}

bool waits_for_holder(const std::string& function) {
  return function == contract::request || function == contract::deny;
}

std::optional<Refusal> check_claimed(const HolderClaim& claim, const Control& record, const std::string& function,
                                     const Caller& caller) {
  const bool stands = claim.has_holder() && claim.epoch() == record.epoch();
  if (!waits_for_holder(function) || !stands || to_name(claim.holder()) == caller.name) return std::nullopt;
  return wait_for(claim.holder(), record.owner().msp_id());
}

}  // namespace ledgerline::access
