#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "common/access/access.hpp"
#include "common/base/result.hpp"
#include "common/verification/calls.hpp"
#include "ledgerline.pb.h"

/// Control events held against what their creator signed, by the contract's own rules (common/access) and the record
/// before: what a peer that lies may still do with one is to leave it out. What a peer alone can know stays its word:
/// which role the creator, and whom it names, have. Pure.
namespace ledgerline::verification {

/// A control event that its call vouches for: it is of that function, and of exactly the drones that were asked for.
struct ControlEvent {
  access::Call call;
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

/// Whether `after`, one of the event's records, is what its call makes of `before`; an error names the rule that is
/// against it. A record that is as before follows always: who reads records beside the blocks may have it already.
Status control_follows(const ControlEvent& event, const Control& before, const Control& after,
                       const access::Caller& caller);

/// Whether the creator of an event with a role_change() may give and take it.
Status role_follows(const ControlEvent& event, const access::Caller& caller);

/// A call of `stop`, as its creator signed it.
Result<DronesCall> read_stop_call(const RequestedCall& call);
/// The creator's own stop of one of the drones that he asked for, without any peer's word: how often his stops had been
/// cleared he signed in the call or, where that says nothing of it, in the event of the same payload; else never.
Stop signed_stop(const DronesCall& asked, std::string_view event_payload, const std::string& drone,
                 const Identity& creator);
/// Whether one of the event's stops is its creator's own, as asked. A cut is for the drone's organisation and those
/// whom it is granted to, by the record before.
Status stop_follows(const ControlEvent& event, const Control& before, const Stop& stop, const access::Caller& caller);

}  // namespace ledgerline::verification
