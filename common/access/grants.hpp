#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>

#include "common/access/stops.hpp"
#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

/// Leases, grants and requests of a control record: what the contract decides by, and what agent and ground check its
/// events by. Grants say what a drone's organisation lets others do with it, requests who asks its holder for the
/// lease: each identity once, a newer request replaces its older one. Thread-safe as the messages are.

namespace ledgerline {

/// Whether a role is one of those that fly, stop and answer.
inline bool is_operator(Role role) { return role == OPERATOR || role == SUPERVISOR; }

/// Whether a grant is for anything: one that is not withdraws what there was.
inline bool has_rights(const Grant& grant) { return grant.fly() || grant.stop() || grant.cut(); }

/// What an operator or supervisor may do with a drone.
struct Rights {
  bool fly = false, stop = false, cut = false;
  std::uint32_t max_priority = 0;  ///< of an acquire
};

/// Within the drone's organisation everything, elsewhere what is granted to the identity or to its organisation.
template <typename List>
Rights rights_of(const List& grants, const std::string& owner_msp_id, const Identity& who) {
  if (who.msp_id() == owner_msp_id) return {true, true, true, contract::max_priority};
  Rights rights;
  for (const Grant& grant : grants) {
    const Identity& to = grant.to();
    if (to.msp_id() != who.msp_id() || (!to.subject().empty() && to.subject() != who.subject())) continue;
    rights.fly |= grant.fly();
    rights.stop |= grant.stop() || grant.fly() || grant.cut();
    rights.cut |= grant.cut();
    if (grant.fly()) rights.max_priority = std::max(rights.max_priority, grant.max_priority());
  }
  return rights;
}
/// For people: "fly up to priority 10, stop".
inline std::string rights_text(const Grant& grant) {
  std::string rights;
  const auto add = [&](const std::string& right) { rights += (rights.empty() ? "" : ", ") + right; };
  if (grant.fly()) add("fly up to priority " + std::to_string(grant.max_priority()));
  if (grant.stop()) add("stop");
  if (grant.cut()) add("cut");
  return rights.empty() ? "nothing" : rights;
}
inline bool is_revoked(const Control& control, const Identity& who) {
  return std::any_of(control.revoked().begin(), control.revoked().end(),
                     [&](const Identity& one) { return same_identity(one, who); });
}
inline Rights rights_of(const Control& control, const Identity& who) {
  if (is_revoked(control, who)) return {};
  return rights_of(control.grants(), control.owner().msp_id(), who);
}

/// Who alone commands the drone under its lease: the delegate, else the holder. Of a drone that nobody holds it is
/// empty, as no signer is.
inline const Identity& commander_of(const Control& control) {
  return control.has_delegate() ? control.delegate() : control.holder();
}

/// Of a LeaseCall or a Request; null: the holder shall command.
template <typename Message>
const Identity* delegate_in(const Message& message) {
  return message.has_delegate() ? &message.delegate() : nullptr;
}

/// Whether a holder may let somebody command in its place: another one of its own organisation.
inline bool may_delegate(const Identity& holder, const Identity& delegate) {
  return delegate.msp_id() == holder.msp_id() && !delegate.subject().empty() && !same_identity(delegate, holder);
}

/// Whether the record speaks of an identity: as holder, as delegate, or in a grant to it alone.
inline bool names_identity(const Control& control, const Identity& who) {
  return (control.has_holder() && same_identity(control.holder(), who)) ||
         (control.has_delegate() && same_identity(control.delegate(), who)) ||
         std::any_of(control.grants().begin(), control.grants().end(),
                     [&](const Grant& grant) { return same_identity(grant.to(), who); });
}

/// Whether nobody of that role may fly, stop or hold a drone any more: revoked, or made an auditor. (Who was never
/// enrolled may be granted something beforehand.)
inline bool withdraws_rights(Role role) { return role == REVOKED || role == AUDITOR; }

/// Applies a role change to the record's list of the revoked, if the record names that identity.
inline void apply_role(Control& control, const Identity& who, Role role) {
  remove_entry(*control.mutable_revoked(), who, std::identity());
  if (!withdraws_rights(role) || !names_identity(control, who)) return;
  put_entry(*control.mutable_revoked(), who, std::identity());
}

/// The revoked are only those whom the record speaks of.
inline void forget_unnamed(Control& control) {
  auto& all = *control.mutable_revoked();
  all.erase(std::remove_if(all.begin(), all.end(), [&](const Identity& one) { return !names_identity(control, one); }),
            all.end());
}

/// Whether nothing is flown under the lease any more, which apply_stops of the drone's host ends: its holder or his
/// delegate is revoked.
inline bool is_lease_revoked(const Control& control) {
  return control.has_holder() &&
         (is_revoked(control, control.holder()) || (control.has_delegate() && is_revoked(control, control.delegate())));
}

/// Whether the drone has this holder, with this delegate (null: none), already.
inline bool is_lease_of(const Control& control, const Identity& holder, const Identity* delegate) {
  return control.has_holder() && same_identity(control.holder(), holder) &&
         control.has_delegate() == (delegate != nullptr) &&
         (delegate == nullptr || same_identity(control.delegate(), *delegate));
}

/// Gives a lease to somebody, `delegate` commands in its place (null: it commands itself). The same holder with the
/// same delegate keeps his epoch.
inline void begin_lease(Control& control, const Identity& holder, const Identity* delegate, std::uint64_t new_epoch,
                        std::uint32_t priority) {
  if (!is_lease_of(control, holder, delegate)) {
    *control.mutable_holder() = holder;
    control.clear_delegate();
    if (delegate != nullptr) *control.mutable_delegate() = *delegate;
    control.set_epoch(new_epoch);
  }
  control.set_priority(priority);
  forget_unnamed(control);
}

/// Ends a lease; the epoch is the new one.
inline void end_lease(Control& control, std::uint64_t epoch) {
  control.clear_holder();
  control.clear_delegate();
  control.set_priority(0);
  control.set_epoch(epoch);
  forget_unnamed(control);
}

/// Ends the lease and the grants of those who are revoked.
inline void end_revoked(Control& control, std::uint64_t new_epoch) {
  auto& grants = *control.mutable_grants();
  grants.erase(
      std::remove_if(grants.begin(), grants.end(), [&](const Grant& g) { return is_revoked(control, g.to()); }),
      grants.end());
  if (is_lease_revoked(control)) end_lease(control, new_epoch);
  forget_unnamed(control);
}

/// Puts a grant in place of what its identity or organisation had. A lease that is no longer granted ends, under the
/// new epoch; a priority that is no longer granted is lowered.
inline void set_grant(Control& control, const Grant& grant, std::uint64_t new_epoch) {
  const auto whose = [](const Grant& one) -> const Identity& { return one.to(); };
  if (has_rights(grant)) {
    put_entry(*control.mutable_grants(), grant, whose);
  } else {
    remove_entry(*control.mutable_grants(), grant.to(), whose);
  }
  forget_unnamed(control);
  if (!control.has_holder()) return;
  // By the grants alone: apply_stops ends the lease of a revoked one, unless it is enrolled again before that.
  const Rights rights = rights_of(control.grants(), control.owner().msp_id(), control.holder());
  if (!rights.fly) return end_lease(control, new_epoch);
  control.set_priority(std::min(control.priority(), rights.max_priority));
}

inline const Identity& whose_request(const Request& request) { return request.who(); }

/// nullptr: it asks for nothing.
inline const Request* request_of(const Control& control, const Identity& who) {
  const auto& all = control.requests();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Request& one) { return same_identity(one.who(), who); });
  return found == all.end() ? nullptr : &*found;
}

/// False: there was none.
inline bool remove_request(Control& control, const Identity& who) {
  return remove_entry(*control.mutable_requests(), who, whose_request);
}

/// `delegate`: of the lease that is asked for; null: none.
inline void add_request(Control& control, const Identity& who, const Identity* delegate, std::uint32_t priority) {
  Request one;
  *one.mutable_who() = who;
  if (delegate != nullptr) *one.mutable_delegate() = *delegate;
  one.set_priority(priority);
  put_entry(*control.mutable_requests(), one, whose_request);
}

}  // namespace ledgerline
