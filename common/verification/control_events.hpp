#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/verification/calls.hpp"
#include "ledgerline.pb.h"

/// Control events (enroll, revoke, grant, acquire, release, request,
/// hand_over, deny, evict, stop, clear_stop, apply_stops) checked by what their creator signed and by the record
/// before: what a peer that lies may still do with one is to leave it out. What a peer alone can know stays its word:
/// whether the creator has the role that the contract asks for. Pure.
namespace ledgerline::verification {

/// What a creator asked for, whichever of the three forms it was written in.
using ControlCall = std::variant<EnrollCall, RevokeCall, GrantCall, LeaseCall, AnswerCall, DronesCall>;

/// A control event that its call vouches for: it is of that function, and of exactly the drones that were asked for.
struct ControlEvent {
  std::string function;  ///< by its name of today
  ControlCall asked;
  Controls controls;  ///< of all but stop
  Stops stops;        ///< of stop
};
Result<ControlEvent> read_control_event(const RequestedCall& call, std::string_view event_name,
                                        std::string_view event_payload);
/// What an enroll or revoke makes of somebody's role.
struct RoleChange {
  Identity identity;
  Role role = ROLE_NONE;
};
std::optional<RoleChange> role_change(const ControlEvent& event);
/// Whether events of this name are control events.
bool is_control_event(std::string_view event_name);

struct Creator {
  crypto::IdentityName name;
  bool admin = false;
};

/// Whether `after`, one of the event's records, is what its function makes of `before`; an error says why not. A record
/// that is as before follows always: who reads records beside the blocks may have it already. An epoch never goes back,
/// and grows with each change of holder; the owner's organisation never changes; nobody's stop is cleared but the
/// creator's own, or all by the owner's organisation; a lease is acquired as far as the grants of the record before
/// allow, and taken from its holder by the owner's organisation alone, by a higher priority, where the holder is
/// revoked, or where he gives it to one who requested it.
Status control_follows(const ControlEvent& event, const Control& before, const Control& after, const Creator& creator);

/// Whether the creator may give and take roles of that organisation.
Status role_follows(const RoleChange& change, const Creator& creator);

/// A call of `stop`, as its creator signed it.
Result<DronesCall> read_stop_call(const RequestedCall& call);
/// The creator's own stop of one of the drones that he asked for, without any peer's word: how often his stops had been
/// cleared he signed in the call or, where that says nothing of it, in the event of the same payload; else never.
Stop signed_stop(const DronesCall& asked, std::string_view event_payload, const std::string& drone,
                 const Identity& creator);
/// Whether somebody of that role may stop the record's drone: the contract's own rule.
bool may_stop(const Control& record, Role role, const Identity& who);

/// Whether one of the event's stops is its creator's own, as asked. A cut is for the drone's organisation and those
/// whom it is granted to, by the record before.
Status stop_follows(const ControlEvent& event, const Control& before, const Stop& stop, const Creator& creator);

}  // namespace ledgerline::verification
