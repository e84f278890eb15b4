#include "onboard/agent/core/command_check.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/access/grants.hpp"
#include "common/base/check.hpp"
#include "common/msg/proto_json.hpp"
#include "common/verification/calls.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::agent {

CommandCheck::CommandCheck(CommandCheckSettings settings, const std::vector<DroneName>& drones,
                           crypto::MspRegistry& registry)
    : settings_(std::move(settings)),
      transactions_(settings_.where, registry),
      control_(settings_.msp_id, drones, transactions_) {
  for (const DroneName& drone : drones) drones_.push_back({.drone = drone});
}

const CommandCheck::Counters& CommandCheck::counters(DroneNumber number) const {
  static const Counters not_ours;
  const Drone* drone = find_drone(drones_, number);
  return drone ? drone->counters : not_ours;
}

void CommandCheck::set_evicting(DroneNumber number, bool evicting) {
  if (Drone* drone = find_drone(drones_, number)) drone->evicting = evicting;
}

void CommandCheck::add_sent_state(const StateSample& sample) {
  Drone* drone = find_drone(drones_, sample.drone);
  if (!drone) return;
  if (drone->boot_id != sample.boot_id) {
    drone->boot_id = sample.boot_id;
    drone->stamps.clear();
  }
  if (!drone->stamps.empty() && drone->stamps.back() >= sample.stamp_ns) return;  // sent again
  drone->stamps.push_back(sample.stamp_ns);
  if (drone->stamps.size() > settings_.stamps_kept) drone->stamps.pop_front();
}

CheckedBlock CommandCheck::check(TimeNs now, std::int64_t now_s, const fabric::Block& block) {
  CheckedBlock out;
  if (const Status linked = chain_.add(block); !linked) {
    ++broken_blocks_;
    out.chain_ok = false;
    out.chain_error = linked.error().message;
  }
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.config) continue;
    if (!tx.problem.empty() && out.unverified++ == 0)
      out.unverified_problem = "transaction " + tx.tx_id + ": " + tx.problem;
    if (tx.event_name == contract::command) check_commands(now, now_s, tx, out);
    if (!out.chain_ok) continue;
    const bool stops = tx.event_name == contract::stop;
    const std::size_t first = out.plans.size();
    if (tx.code == 0 && !stops && verification::is_control_event(tx.event_name))
      control_.check_control_event(now, now_s, tx, out);
    // A stop that is there again was heard before; that it is, a peer may only say.
    const bool again = tx.code == protos::DUPLICATE_TXID && !tx.by_flag;
    if (!again && (stops || tx.function == contract::stop)) control_.check_stop(tx, out);
    for (std::size_t i = first; i < out.plans.size(); ++i) assign_sequence(now, out.plans[i]);
  }
  unverified_transactions_ += out.unverified;
  return out;
}

CheckedBlock CommandCheck::check_refused(TimeNs now, const fabric::Block& block) {
  CheckedBlock out;
  for (fabric::Transaction tx : block.transactions) {
    if (tx.config || tx.function != contract::stop) continue;
    // Its flag, its event and the result of an earlier reading are not verified.
    tx.code = -1;
    tx.event_name.clear();
    tx.event_payload.clear();
    tx.signature_verified = false;
    control_.check_stop(tx, out);
  }
  for (Plan& plan : out.plans) assign_sequence(now, plan);
  return out;
}

void CommandCheck::check_commands(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, CheckedBlock& out) {
  CommandCall call;  // as it was signed; whatever else the event says is the peer's alone
  const verification::Match match = verification::match_command({tx.function, tx.args}, tx.event_payload, call);
  if (match == verification::Match::altered) return refuse_altered(tx, std::move(call), out);
  if (match == verification::Match::malformed) {
    out.refused.push_back({.why = RefusalReason::malformed});
    return;
  }
  const bool ours = std::any_of(call.plans().begin(), call.plans().end(),
                                [&](const auto& p) { return find_drone(drones_, p.drone()); });
  if (!ours) return;

  access::Caller signer;
  const RefusalReason whole = check_whole(now_s, tx, out, signer);
  for (const DronePlan& plan : call.plans()) {
    Drone* drone = find_drone(drones_, plan.drone());
    if (!drone) continue;
    if (out.chain_ok && tx.code == 0) ++drone->counters.on_ledger;
    if (whole == RefusalReason::none && is_under_lease(*drone, signer.name, plan))
      out.commanded.push_back(drone->drone.number);
    const RefusalReason why = whole != RefusalReason::none ? whole : check_plan(now, *drone, signer.name, plan);
    if (why != RefusalReason::none) {
      refuse(*drone, plan, why, out);
      continue;
    }
    drone->epoch = plan.epoch();
    drone->last_sequence = plan.sequence();
    ++drone->counters.verified;
    out.plans.push_back(verification::plan_of(drone->drone.number, plan));
  }
}

RefusalReason CommandCheck::check_whole(std::int64_t now_s, const fabric::Transaction& tx, const CheckedBlock& out,
                                        access::Caller& signer) const {
  if (!out.chain_ok) return RefusalReason::broken_chain;
  if (tx.code != 0) return RefusalReason::invalid_transaction;
  return transactions_.check(now_s, tx, {settings_.msp_id}, signer);
}

void CommandCheck::refuse(Drone& drone, const DronePlan& plan, RefusalReason why, CheckedBlock& out) {
  ++drone.counters.refused;
  ++drone.counters.reasons[static_cast<std::size_t>(why)];
  out.refused.push_back({drone.drone.number, plan.sequence(), plan.state_stamp_ns(), why});
}

// Counted for every drone that was asked for, and for every one that the event names instead. The reason matters
// less than the refusal itself: only the first reason of all is reported.
void CommandCheck::refuse_altered(const fabric::Transaction& tx, CommandCall asked, CheckedBlock& out) {
  CommandCall reported;
  if (parse_message(tx.event_payload, reported)) asked.MergeFrom(reported);
  const RefusalReason why = !out.chain_ok  ? RefusalReason::broken_chain
                            : tx.code != 0 ? RefusalReason::invalid_transaction
                                           : RefusalReason::altered;
  std::vector<const Drone*> counted;
  for (const DronePlan& plan : asked.plans()) {
    Drone* drone = find_drone(drones_, plan.drone());
    if (!drone || std::find(counted.begin(), counted.end(), drone) != counted.end()) continue;
    counted.push_back(drone);
    if (out.chain_ok && tx.code == 0) ++drone->counters.on_ledger;
    refuse(*drone, plan, why, out);
  }
}

bool CommandCheck::is_under_lease(const Drone& drone, const crypto::IdentityName& signer, const DronePlan& plan) const {
  const Control* record = control_.control(drone.drone.number);
  return record && to_name(commander_of(*record)) == signer && plan.epoch() == record->epoch();
}

RefusalReason CommandCheck::check_plan(TimeNs now, const Drone& drone, const crypto::IdentityName& signer,
                                       const DronePlan& plan) const {
  const Control* record = control_.control(drone.drone.number);
  if (!record || to_name(commander_of(*record)) != signer) return RefusalReason::not_holder;
  if (is_lease_revoked(*record)) return RefusalReason::revoked;
  const bool stopped = control_.standing_stop(drone.drone.number).has_value();
  if (access::is_outranked_by_stop(stopped, plan.action())) return RefusalReason::stopped;
  if (plan.epoch() != record->epoch()) return RefusalReason::wrong_epoch;
  if (plan.boot_id() != drone.boot_id) return RefusalReason::foreign_boot;
  if (!std::binary_search(drone.stamps.begin(), drone.stamps.end(), plan.state_stamp_ns())) {
    return RefusalReason::unknown_stamp;
  }
  const std::uint64_t last = plan.epoch() == drone.epoch ? drone.last_sequence : 0;
  if (plan.sequence() <= last) return RefusalReason::replayed;
  if (drone.evicting && plan.action() == TAKEOFF) return RefusalReason::evicting;
  if (now - plan.state_stamp_ns() > settings_.max_age_ns) return RefusalReason::too_old;
  return check_setpoints(now, plan);
}

RefusalReason CommandCheck::check_setpoints(TimeNs now, const DronePlan& plan) const {
  if (plan.action() != FLY && plan.action() != TAKEOFF && plan.action() != LAND) return RefusalReason::malformed;
  if (plan.action() == FLY && plan.setpoints_size() == 0) return RefusalReason::malformed;
  if (plan.setpoints_size() > static_cast<int>(max_setpoints)) return RefusalReason::over_limits;
  TimeNs last_ns = plan.state_stamp_ns();
  for (const PlannedSetpoint& s : plan.setpoints()) {
    const double speed = std::hypot(s.vx(), s.vy(), s.vz());
    // Written so that NaN fails.
    const bool within = speed <= settings_.max_speed_mps && std::abs(s.yaw_rate()) <= settings_.max_yaw_rate_radps;
    if (!within || s.at_ns() < last_ns || s.at_ns() > now + settings_.horizon_ns) return RefusalReason::over_limits;
    if (s.has_reference() && plan.body_frame()) return RefusalReason::malformed;
    if (s.has_reference() && !is_within_limits(s.reference())) return RefusalReason::over_limits;
    last_ns = s.at_ns();
  }
  if (!plan.has_response()) return RefusalReason::none;
  const LearnedResponse& r = plan.response();
  return is_plausible(Response{r.gain(), r.lag_s(), r.dead_s()}) ? RefusalReason::none : RefusalReason::over_limits;
}

// As fast as a setpoint may be; the fence is link's, which keeps references inside.
bool CommandCheck::is_within_limits(const PlannedReference& r) const {
  return std::hypot(r.vx(), r.vy(), r.vz()) <= settings_.max_speed_mps &&
         std::hypot(r.ax(), r.ay(), r.az()) <= absurd_speed && std::hypot(r.x(), r.y(), r.z()) <= absurd_m;
}

std::optional<Plan> CommandCheck::standing_stop(TimeNs now, DroneNumber number) const {
  const auto action = control_.standing_stop(number);
  if (!action) return std::nullopt;
  Plan plan{.drone = number, .action = *action, .setpoints = {}};
  assign_sequence(now, plan);
  return plan;
}

std::optional<Plan> CommandCheck::no_stop(TimeNs now, DroneNumber number) const {
  if (!control_.control(number) || control_.standing_stop(number)) return std::nullopt;
  Plan plan{.drone = number, .action = PlanAction::stop_cleared, .setpoints = {}};
  assign_sequence(now, plan);
  return plan;
}

void CommandCheck::assign_sequence(TimeNs now, Plan& plan) const {
  if (!is_contract_action(plan.action)) return;
  const Drone* drone = find_drone(drones_, plan.drone);
  const Control* record = control_.control(plan.drone);
  if (!LEDGERLINE_CHECK(drone && record, "a contract's action is for a drone whose record is known", plan.drone))
    return;
  plan.epoch = std::max(record->epoch(), drone->epoch);
  plan.sequence = (plan.epoch == drone->epoch ? drone->last_sequence : 0) + 1;
  plan.state_stamp_ns = drone->stamps.empty() ? now : drone->stamps.back();
}

}  // namespace ledgerline::agent
