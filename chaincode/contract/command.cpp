#include <cmath>
#include <set>

#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/onboard.hpp"

/// command: plans of the lease's holder, or of who commands in its place.
namespace ledgerline::chaincode {
namespace {

bool is_finite(const PlannedSetpoint& setpoint) {
  const PlannedReference& r = setpoint.reference();
  for (const float value : {setpoint.vx(), setpoint.vy(), setpoint.vz(), setpoint.yaw_rate(), r.x(), r.y(), r.z(),
                            r.vx(), r.vy(), r.vz(), r.ax(), r.ay(), r.az()}) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

/// As Response is kept within, wherever it is learned (common/msg/onboard.hpp).
Status check_response(const LearnedResponse& response) {
  if (is_plausible(ledgerline::Response{response.gain(), response.lag_s(), response.dead_s()})) return done;
  return Error{"the response is no drone's"};
}

Status check_setpoints(const DronePlan& plan) {
  const auto count = static_cast<std::size_t>(plan.setpoints_size());
  if (Status status = check_limit("the plan has", count, "setpoints", contract::max_plan_setpoints); !status)
    return status;
  if (count == 0) {
    if (plan.action() == FLY) return Error{"the plan has no setpoints"};
    return done;
  }
  if (plan.has_response()) {
    if (Status status = check_response(plan.response()); !status) return status;
  }
  TimeNs last = plan.setpoints(0).at_ns();
  if (last < 0) return Error{"a setpoint's time is negative"};
  for (const PlannedSetpoint& setpoint : plan.setpoints()) {
    if (!is_finite(setpoint)) return Error{"a setpoint is not finite"};
    if (setpoint.has_reference() && plan.body_frame()) return Error{"a setpoint in the drone's frame has a reference"};
    if (setpoint.at_ns() < last) return Error{"the plan's times go backwards"};
    last = setpoint.at_ns();
  }
  if (last - plan.setpoints(0).at_ns() > contract::max_plan_ns) {
    return Error{"the plan lasts " + std::to_string((last - plan.setpoints(0).at_ns()) / ns_per_ms) +
                 " ms; the limit is " + std::to_string(contract::max_plan_ns / ns_per_ms) + " ms"};
  }
  return done;
}

/// Why the caller does not command a drone.
Error not_the_commander(const Control& control, const crypto::IdentityName& caller) {
  const std::string who = to_text(caller);
  if (!control.has_holder()) return Error{"the lease is held by nobody, not by " + who + ", who may acquire it"};
  const bool holder = to_name(control.holder()) == caller;
  return Error{"the lease is held by " + access::holder_text(control) +
               (control.has_delegate() ? "; not by " : ", not by ") + who +
               (holder ? ", who may acquire it without a delegate" : ", who may request it")};
}

/// What one finds in the control record of a drone that the lease does not let fly.
Status why_not(Stub& stub, const DronePlan& plan, const std::string& organisation) {
  const auto record = read_control(stub, plan.drone());
  if (!record) return record.error();
  if (!*record) return Error{access::not_enrolled_text()};
  const Control& control = (*record)->message;
  if (control.owner().msp_id() != organisation) {
    return Error{"it belongs to " + control.owner().msp_id() + ", not to " + organisation};
  }
  if (to_name(commander_of(control)) != stub.caller()) return not_the_commander(control, stub.caller());
  if (plan.epoch() != control.epoch()) {
    return Error{"the lease's epoch is " + std::to_string(control.epoch()) + ", the plan says " +
                 std::to_string(plan.epoch())};
  }
  if (is_stopped(control)) {
    return Error{"stopped by " + stopper_names(control) + "; only LAND is accepted until they, or a supervisor of " +
                 control.owner().msp_id() + ", clear it"};
  }
  return Error{"its lease's record does not name it; its host's apply_stops renews records of an older version"};
}

Status check_plan(Stub& stub, const DronePlan& plan, const std::string& organisation, Records<Lease>& leases) {
  if (!Action_IsValid(plan.action())) return Error{"unknown action " + std::to_string(plan.action())};
  if (Status status = check_setpoints(plan); !status) return status;
  const auto lease = leases.at(lease_key(organisation, stub.caller(), plan.epoch()));
  if (!lease) return lease.error();
  const bool held = contains((*lease)->drones(), plan.drone());
  const bool stopped = contains((*lease)->stopped(), plan.drone());
  if (held && !access::is_outranked_by_stop(stopped, plan.action())) return done;
  return why_not(stub, plan, organisation);
}

}  // namespace

Answer command(Stub& stub, const Arguments& call) {
  if (call.form == Arguments::Form::plain) return Error{"command: give plans in protobuf or JSON"};
  CommandCall commands;
  if (Status status = parse_message(call.message, commands); !status) return status.error();
  if (commands.plans().empty()) return Error{"command: no plans"};
  if (Status status = check_call_size(commands.plans_size(), "plans"); !status) return status.error();
  const std::string& organisation = commands.organisation();
  if (organisation.empty() || !check_id(organisation) || first_segment(organisation) != organisation) {
    return Error{"command: organisation must be the MSP id of the one whose drones these are"};
  }
  std::set<std::string> drones;
  Records<Lease> leases(stub);
  for (const DronePlan& plan : commands.plans()) {
    if (Status status = check_drone_name(plan.drone()); !status) return status.error();
    if (!drones.insert(plan.drone()).second) return Error{plan.drone() + ": two plans in one call"};
    if (Status status = check_plan(stub, plan, organisation, leases); !status)
      return Error{plan.drone() + ": " + status.error().message};
  }
  // Written without being read: commands never conflict with each other. The lease's acquire has made the key.
  const Status written =
      write_record(stub, command_key(organisation, stub.caller()), commands, contract::record_version);
  if (!written) return written.error();
  stub.set_event(contract::command, write_form(call, commands));
  return std::string();
}

}  // namespace ledgerline::chaincode
