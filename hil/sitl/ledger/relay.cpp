#include "hil/sitl/ledger/relay.hpp"

#include <algorithm>
#include <utility>

#include "common/access/access.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "hil/sitl/ledger/serving_peer.hpp"
#include "peer/chaincode_event.pb.h"

namespace ledgerline::hil {
namespace {

const crypto::IdentityName rival{"Org3MSP", "CN=User1@org3.ledgerline"};

/// Whose result it tampers with.
std::string_view function_of(RelayTampering tampering) {
  if (tampering >= RelayTampering::asked_plan || tampering < RelayTampering::frame_cut) return contract::command;
  if (tampering <= RelayTampering::frame_replayed) return contract::set;
  return tampering <= RelayTampering::stop_other ? contract::stop : contract::apply_stops;
}
bool of_what_was_asked(RelayTampering tampering) { return tampering >= RelayTampering::asked_plan; }

std::string bytes_of(const Control& record) {
  Controls controls;
  *controls.add_controls() = record;
  *controls.mutable_identity() = record.owner();
  return controls.SerializeAsString();
}

/// The record as of another holder, and of that lease; nobody's where there is no name.
std::string held_by(Control record, const std::optional<crypto::IdentityName>& name, std::uint64_t epoch) {
  record.clear_holder();
  if (name) *record.mutable_holder() = to_message(*name);
  record.set_epoch(epoch);
  return bytes_of(record);
}

std::string owned_by(Control record, const crypto::IdentityName& name) {
  *record.mutable_owner() = to_message(name);
  return bytes_of(record);
}

std::string cut_of(const std::string& drone, const crypto::IdentityName& stopper) {
  Stops stops;
  Stop& stop = *stops.add_stops();
  stop.set_drone(drone);
  *stop.mutable_stopper() = to_message(stopper);
  stop.set_cut(true);
  return stops.SerializeAsString();
}

void set_velocity(DronePlan& plan, float vx, float vz, float yaw_rate) {
  for (PlannedSetpoint& setpoint : *plan.mutable_setpoints()) {
    setpoint.set_vx(vx);
    setpoint.set_vy(0);
    setpoint.set_vz(vz);
    setpoint.set_yaw_rate(yaw_rate);
  }
}

/// Flies for so long, from its state on.
void add_setpoints(DronePlan& plan, float vx, float vz) {
  plan.clear_setpoints();
  for (int i = 1; i <= 10; ++i) plan.add_setpoints()->set_at_ns(plan.state_stamp_ns() + i * 50 * ns_per_ms);
  set_velocity(plan, vx, vz, 0);
}

std::string other_drone(const std::string& drone) { return drone == "tello1" ? "tello2" : "tello1"; }

void tamper_plan(DronePlan& plan, RelayTampering tampering) {
  switch (tampering) {
    case RelayTampering::plan_speed:
    case RelayTampering::plan_form:
      return set_velocity(plan, 2, 0, 0);
    case RelayTampering::plan_climb:
      return set_velocity(plan, 0, 1, 0);
    case RelayTampering::plan_turn:
      return set_velocity(plan, 0, 0, 3);
    case RelayTampering::plan_takeoff:
      return plan.set_action(TAKEOFF);
    case RelayTampering::plan_land:
      return plan.set_action(LAND);
    case RelayTampering::plan_fly:
      if (plan.action() != FLY) add_setpoints(plan, 0, 1);
      return plan.set_action(FLY);
    case RelayTampering::plan_times:
      for (PlannedSetpoint& setpoint : *plan.mutable_setpoints()) setpoint.set_at_ns(setpoint.at_ns() + ns_per_s);
      return;
    case RelayTampering::plan_longer:
      if (!plan.setpoints().empty()) {
        const PlannedSetpoint last = plan.setpoints(plan.setpoints_size() - 1);
        for (int i = 1; i <= 5; ++i) {
          *plan.add_setpoints() = last;
          plan.mutable_setpoints(plan.setpoints_size() - 1)->set_at_ns(last.at_ns() + i * 100 * ns_per_ms);
        }
      }
      return;
    case RelayTampering::plan_drone:
      return plan.set_drone(other_drone(plan.drone()));
    case RelayTampering::plan_boot:
      return plan.set_boot_id(plan.boot_id() ^ 1);
    case RelayTampering::plan_stamp:
      return plan.set_state_stamp_ns(plan.state_stamp_ns() - 1);
    case RelayTampering::plan_sequence:
      return plan.set_sequence(plan.sequence() + 1000);
    case RelayTampering::plan_epoch:
      return plan.set_epoch(plan.epoch() + 1);
    default:
      return;
  }
}

}  // namespace

// As the launcher left it.
Control Relay::record_of(const std::string& drone) const {
  Control record;
  record.set_drone(drone);
  *record.mutable_owner() = to_message(names_.drone_host);
  *record.mutable_holder() = to_message(names_.holder);
  record.set_epoch(1);
  Grant& operators = *record.add_grants();
  operators.mutable_to()->set_msp_id(names_.holder.msp_id);
  operators.set_fly(true);
  operators.set_max_priority(contract::max_priority);
  operators.set_stop(true);
  operators.set_cut(true);
  return record;
}

std::optional<Relay::Event> Relay::tampered_command(const std::string& payload) {
  auto call = parsed<CommandCall>(payload);
  if (call.plans().empty()) return std::nullopt;
  const std::string drone = call.plans(0).drone();
  const Control record = record_of(drone);
  switch (tampering_) {
    case RelayTampering::plan_added: {
      DronePlan more = call.plans(0);
      more.set_action(TAKEOFF);
      more.set_sequence(more.sequence() + 1);
      *call.add_plans() = more;
      return Event{contract::command, call.SerializeAsString()};
    }
    case RelayTampering::plan_left_out:
      return Event{contract::command, CommandCall().SerializeAsString()};
    case RelayTampering::plan_replayed: {
      if (earlier_command_.empty()) earlier_command_ = payload;
      auto earlier = parsed<CommandCall>(earlier_command_);
      earlier.mutable_plans(0)->set_sequence(call.plans(0).sequence());
      earlier.mutable_plans(0)->set_state_stamp_ns(call.plans(0).state_stamp_ns());
      return Event{contract::command, earlier.SerializeAsString()};
    }
    case RelayTampering::command_acquire:
      return Event{contract::acquire, held_by(record, rival, 2)};
    case RelayTampering::command_release:
      return Event{contract::release, held_by(record, std::nullopt, 2)};
    case RelayTampering::command_clear_stop:
      return Event{contract::clear_stop, bytes_of(record)};
    case RelayTampering::command_enroll:
      return Event{contract::enroll, owned_by(record, rival)};
    case RelayTampering::command_apply_stops:
      return Event{contract::apply_stops, held_by(record, names_.holder, 9)};
    case RelayTampering::command_cut:
      return Event{contract::stop, cut_of(drone, names_.holder)};
    case RelayTampering::command_silent:
      return Event{};
    case RelayTampering::command_other:
      return Event{contract::command, payload};
    default:
      for (DronePlan& plan : *call.mutable_plans()) tamper_plan(plan, tampering_);
      return Event{contract::command,
                   tampering_ == RelayTampering::plan_form ? to_json(call) : call.SerializeAsString()};
  }
}

// First the lease, then a climb and a flight ahead: all of it under the host's own signature.
std::optional<Relay::Event> Relay::host_flies(const SetCall& batch) {
  for (const Asset& asset : batch.assets()) {
    if (asset.msg_type() != link_status_type) continue;
    const auto state = state_from_cdr(asset.msg_data(), "");
    if (!state) continue;
    const std::string drone = asset.id().substr(0, asset.id().find('/'));
    if (host_sequence_++ == 0) {
      return Event{contract::acquire, held_by(record_of(drone), names_.drone_host, 2)};
    }
    CommandCall call;
    call.set_organisation("Org1MSP");
    DronePlan& plan = *call.add_plans();
    plan.set_drone(drone);
    plan.set_boot_id(state->sample.boot_id);
    plan.set_state_stamp_ns(state->sample.stamp_ns);
    plan.set_sequence(host_sequence_);
    plan.set_epoch(2);
    add_setpoints(plan, 1, 1);
    return Event{contract::command, call.SerializeAsString()};
  }
  return std::nullopt;
}

std::optional<Relay::Event> Relay::tampered_batch(const std::string& payload) {
  auto batch = parsed<SetCall>(payload);
  if (!batch.stream() || batch.assets().empty()) return std::nullopt;
  const std::string drone = batch.assets(0).id().substr(0, batch.assets(0).id().find('/'));
  const Control record = record_of(drone);
  switch (tampering_) {
    case RelayTampering::frame_cut:
      return Event{contract::stop, cut_of(drone, names_.drone_host)};
    case RelayTampering::frame_acquire:
      return Event{contract::acquire, held_by(record, rival, 2)};
    case RelayTampering::frame_release:
      return Event{contract::release, held_by(record, std::nullopt, 2)};
    case RelayTampering::frame_clear_stop:
      return Event{contract::clear_stop, bytes_of(record)};
    case RelayTampering::frame_enroll:
      return Event{contract::enroll, owned_by(record, rival)};
    case RelayTampering::frame_back:
      return Event{contract::acquire, held_by(record, rival, 0)};
    case RelayTampering::frame_flies:
      return host_flies(batch);
    case RelayTampering::frame_replayed:
      if (earlier_batch_.empty()) earlier_batch_ = payload;
      break;
    default:
      break;
  }
  const auto earlier = parsed<SetCall>(earlier_batch_);
  for (int i = 0; i < batch.assets_size(); ++i) {
    Asset& asset = *batch.mutable_assets(i);
    auto odometry = odometry_from_cdr(asset.msg_data());
    if (asset.msg_type() != odometry_type || !odometry) continue;
    if (tampering_ == RelayTampering::frame_pose) odometry->position_m[0] += 3;
    for (const Asset& old : earlier.assets()) {
      if (tampering_ != RelayTampering::frame_replayed || old.id() != asset.id()) continue;
      if (const auto then = odometry_from_cdr(old.msg_data())) odometry->position_m = then->position_m;
    }
    asset.set_msg_data(to_cdr(*odometry));
  }
  return Event{contract::set, batch.SerializeAsString()};
}

// `payload`: the honest event.
std::optional<Relay::Event> Relay::tampered_stop(const std::string& payload) const {
  auto stops = parsed<Stops>(payload);
  auto controls = parsed<Controls>(payload);
  for (Stop& stop : *stops.mutable_stops()) {
    if (tampering_ == RelayTampering::stop_cut) stop.set_cut(true);
    if (tampering_ == RelayTampering::stop_other) *stop.mutable_stopper() = to_message(rival);
  }
  for (Control& record : *controls.mutable_controls()) {
    if (tampering_ == RelayTampering::apply_stops_clears) record.clear_stoppers();
    if (tampering_ == RelayTampering::apply_stops_back) {
      *record.mutable_holder() = to_message(rival);
      record.set_epoch(0);
    }
  }
  if (tampering_ <= RelayTampering::stop_other) return Event{contract::stop, stops.SerializeAsString()};
  return Event{contract::apply_stops, controls.SerializeAsString()};
}

std::string Relay::tamper(const fabric::Call& call, std::string bytes) {
  if (tampering_ == RelayTampering::none || call.function != function_of(tampering_)) return bytes;
  auto opened = fabric::open_transaction(bytes);
  if (!opened) return bytes;
  auto event = parsed<protos::ChaincodeEvent>(opened->result.events());
  const auto tampered = call.function == contract::set       ? tampered_batch(call.args.at(0))
                        : call.function == contract::command ? tampered_command(call.args.at(0))
                                                             : tampered_stop(event.payload());
  if (!tampered) return bytes;
  if (of_what_was_asked(tampering_)) {
    auto proposal = parsed<protos::ChaincodeProposalPayload>(opened->action.chaincode_proposal_payload());
    auto invocation = parsed<protos::ChaincodeInvocationSpec>(proposal.input());
    auto& args = *invocation.mutable_chaincode_spec()->mutable_input();
    if (tampering_ == RelayTampering::asked_function) {
      args.set_args(0, contract::set);
    } else {
      auto plans = parsed<CommandCall>(call.args.at(0));
      for (DronePlan& plan : *plans.mutable_plans()) set_velocity(plan, 2, 0, 0);
      args.set_args(1, plans.SerializeAsString());
      event.set_payload(plans.SerializeAsString());
    }
    proposal.set_input(invocation.SerializeAsString());
    opened->action.set_chaincode_proposal_payload(proposal.SerializeAsString());
    const common::Header& header = opened->payload.header();
    opened->response.set_proposal_hash(fabric::proposal_hash(header.channel_header(), header.signature_header(),
                                                             opened->action.chaincode_proposal_payload()));
  } else {
    event.set_event_name(tampered->name);
    event.set_payload(tampered->payload);
    if (tampering_ == RelayTampering::command_other) event.set_tx_id(std::string(64, '0'));
  }
  opened->result.set_events(event.event_name().empty() ? std::string() : event.SerializeAsString());
  opened->seal_result();
  std::string envelope = opened->bytes();
  endorse_by(envelope, &names_.peer);
  return envelope;
}

}  // namespace ledgerline::hil
