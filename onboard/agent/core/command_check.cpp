#include "onboard/agent/core/command_check.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/access/identity.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/stops.hpp"
#include "common/verification/calls.hpp"
#include "common/verification/control_events.hpp"
#include "onboard/agent/core/proposal_hash.hpp"

namespace ledgerline::agent {
namespace {

constexpr int duplicate_tx_id = 9;  // protos.TxValidationCode

constexpr std::array names{"none",          "broken_chain", "invalid_transaction",
                           "wrong_channel", "malformed",    "unknown_signer",
                           "bad_signature", "not_endorsed", "not_holder",
                           "stopped",       "wrong_epoch",  "foreign_boot",
                           "unknown_stamp", "replayed",     "too_old",
                           "over_limits",   "altered",      "revoked",
                           "evicting",      "may_not_stop"};
static_assert(names.size() == refusal_count);

bool same(const Identity& a, const crypto::IdentityName& b) {
  return a.msp_id() == b.msp_id && a.subject() == b.subject;
}

}  // namespace

std::string_view refusal_name(Refusal refusal) { return names.at(static_cast<std::size_t>(refusal)); }

CommandCheck::CommandCheck(CheckConfig config, const std::vector<DroneName>& drones, crypto::MspRegistry& registry)
    : config_(std::move(config)), registry_(registry) {
  for (const DroneName& name : drones) {
    Drone drone;
    drone.name = name;
    drones_.push_back(std::move(drone));
  }
}

CommandCheck::Drone* CommandCheck::find(std::string_view name) {
  const auto it = std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.name.name == name; });
  return it == drones_.end() ? nullptr : &*it;
}

const CommandCheck::Drone* CommandCheck::find(DroneNumber number) const {
  const auto it = std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.name.number == number; });
  return it == drones_.end() ? nullptr : &*it;
}

const CommandCheck::Counters& CommandCheck::counters(DroneNumber number) const {
  static const Counters not_ours;
  const Drone* drone = find(number);
  return drone ? drone->counters : not_ours;
}

std::optional<std::uint64_t> CommandCheck::lease(DroneNumber number) const {
  const Drone* drone = find(number);
  if (!drone || !drone->control || !drone->control->has_holder()) return std::nullopt;
  return drone->control->epoch();
}

void CommandCheck::set_evicting(DroneNumber number, bool evicting) {
  for (Drone& drone : drones_) {
    if (drone.name.number == number) drone.evicting = evicting;
  }
}

void CommandCheck::set_roles(verification::Roles roles) { roles_ = std::move(roles); }

void CommandCheck::add_roles(const verification::Roles& read) { roles_.add(read); }

verification::Organisations CommandCheck::await_roles() {
  verification::Organisations organisations;
  // Behind each block: nothing is copied while all are known.
  const auto look = [&](const std::string& msp_id) {
    if (!msp_id.empty() && !roles_.follows(msp_id)) organisations.insert(msp_id);
  };
  for (const Drone& drone : drones_) {
    if (!drone.control) continue;
    look(drone.control->owner().msp_id());
    for (const Grant& grant : drone.control->grants()) look(grant.to().msp_id());
  }
  for (const std::string& msp_id : organisations) roles_.await(msp_id);
  return organisations;
}

void CommandCheck::set_control(const Control& control) {
  if (Drone* drone = find(control.drone())) drone->control = control;
}

FirstRecords CommandCheck::records() const {
  FirstRecords records{.controls = {}, .roles = roles_};
  for (const Drone& drone : drones_) {
    if (drone.control) records.controls.push_back(*drone.control);
  }
  return records;
}

void CommandCheck::sent(const StateSample& sample) {
  const auto it =
      std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.name.number == sample.drone; });
  if (it == drones_.end()) return;
  if (it->boot_id != sample.boot_id) {
    it->boot_id = sample.boot_id;
    it->stamps.clear();
  }
  if (!it->stamps.empty() && it->stamps.back() >= sample.stamp_ns) return;  // sent again
  it->stamps.push_back(sample.stamp_ns);
  if (it->stamps.size() > config_.stamps_kept) it->stamps.pop_front();
}

CommandCheck::Checked CommandCheck::check(TimeNs now, std::int64_t now_s, const fabric::Block& block) {
  Checked out;
  if (const Status linked = chain_.add(block); !linked) {
    ++broken_blocks_;
    out.chain_ok = false;
    out.chain_error = linked.error().message;
  }
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.config) continue;
    if (!tx.problem.empty() && out.unverified++ == 0)
      out.unverified_problem = "transaction " + tx.tx_id + ": " + tx.problem;
    if (tx.event_name == contract::command) take_commands(now, now_s, tx, out);
    if (!out.chain_ok) continue;
    const bool stops = tx.event_name == contract::stop;
    if (tx.code == 0 && !stops && verification::is_control_event(tx.event_name)) take_controls(now, now_s, tx, out);
    // A stop that is there again was heard before; that it is, a peer may only say.
    const bool again = tx.code == duplicate_tx_id && !tx.by_flag;
    if (!again && (stops || tx.function == contract::stop)) take_stops(now, tx, out);
  }
  unverified_transactions_ += out.unverified;
  return out;
}

Refusal CommandCheck::check_creator(std::optional<std::int64_t> now_s, const fabric::Transaction& tx,
                                    access::Caller& signer) {
  if (tx.channel != config_.where.channel || tx.contract != config_.where.contract) return Refusal::wrong_channel;
  const auto creator = registry_.member(tx.creator, now_s);
  if (!creator) return Refusal::unknown_signer;
  if (!fabric::creator_signed(tx, *(*creator)->verifier)) return Refusal::bad_signature;
  signer = {(*creator)->name, (*creator)->admin};
  return Refusal::none;
}

Refusal CommandCheck::check_transaction(std::int64_t now_s, const fabric::Transaction& tx,
                                        const Organisations& endorsers, access::Caller& signer) {
  const Refusal why = check_creator(now_s, tx, signer);
  return why != Refusal::none || endorsed_by(endorsers, now_s, tx) ? why : Refusal::not_endorsed;
}

bool CommandCheck::endorsed_by(const Organisations& organisations, std::optional<std::int64_t> now_s,
                               const fabric::Transaction& tx) {
  if (!result_is_of_own_proposal(tx)) return false;
  return std::any_of(tx.endorsements.begin(), tx.endorsements.end(), [&](const fabric::Endorsement& e) {
    const auto endorser = registry_.member(e.endorser, now_s);
    // Peers alone: any other member of the organisation, this agent included, could sign a result of its own making.
    return endorser && (*endorser)->peer && organisations.contains((*endorser)->name.msp_id) &&
           fabric::endorser_signed(tx, e, *(*endorser)->verifier);
  });
}

void CommandCheck::take_commands(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, Checked& out) {
  CommandCall call;  // as it was signed; whatever else the event says is the peer's alone
  const verification::Match match = verification::match_command({tx.function, tx.args}, tx.event_payload, call);
  if (match == verification::Match::altered) return refuse_altered(tx, std::move(call), out);
  if (match == verification::Match::malformed) {
    ++malformed_commands_;
    out.refused.push_back(Refused{.why = Refusal::malformed});
    return;
  }
  const bool ours =
      std::any_of(call.plans().begin(), call.plans().end(), [&](const auto& p) { return find(p.drone()); });
  if (!ours) return;

  access::Caller signer;
  const Refusal whole = check_whole(now_s, tx, out, signer);
  for (const DronePlan& plan : call.plans()) {
    Drone* drone = find(plan.drone());
    if (!drone) continue;
    if (out.chain_ok && tx.code == 0) ++drone->counters.on_ledger;
    if (whole == Refusal::none && commands(*drone, signer.name, plan)) out.commanded.push_back(drone->name.number);
    const Refusal why = whole != Refusal::none ? whole : check_plan(now, *drone, signer.name, plan);
    if (why != Refusal::none) {
      refuse(*drone, plan, why, out);
      continue;
    }
    drone->epoch = plan.epoch();
    drone->last_sequence = plan.sequence();
    ++drone->counters.verified;
    out.plans.push_back(verification::plan_of(drone->name.number, plan));
  }
}

Refusal CommandCheck::check_whole(std::int64_t now_s, const fabric::Transaction& tx, const Checked& out,
                                  access::Caller& signer) {
  if (!out.chain_ok) return Refusal::broken_chain;
  if (tx.code != 0) return Refusal::invalid_transaction;
  return check_transaction(now_s, tx, {config_.msp_id}, signer);
}

void CommandCheck::refuse(Drone& drone, const DronePlan& plan, Refusal why, Checked& out) {
  ++drone.counters.refused;
  ++drone.counters.reasons[static_cast<std::size_t>(why)];
  out.refused.push_back(Refused{drone.name.number, plan.sequence(), plan.state_stamp_ns(), why});
}

// Counted for every drone that was asked for, and for every one that the event names instead. The reason matters
// less than the refusal itself: only the first reason of all is reported.
void CommandCheck::refuse_altered(const fabric::Transaction& tx, CommandCall asked, Checked& out) {
  CommandCall reported;
  if (parse_message(tx.event_payload, reported)) asked.MergeFrom(reported);
  const Refusal why = !out.chain_ok  ? Refusal::broken_chain
                      : tx.code != 0 ? Refusal::invalid_transaction
                                     : Refusal::altered;
  std::vector<const Drone*> counted;
  for (const DronePlan& plan : asked.plans()) {
    Drone* drone = find(plan.drone());
    if (!drone || std::find(counted.begin(), counted.end(), drone) != counted.end()) continue;
    counted.push_back(drone);
    if (out.chain_ok && tx.code == 0) ++drone->counters.on_ledger;
    refuse(*drone, plan, why, out);
  }
}

bool CommandCheck::commands(const Drone& drone, const crypto::IdentityName& signer, const DronePlan& plan) {
  return drone.control && same(commander_of(*drone.control), signer) && plan.epoch() == drone.control->epoch();
}

Refusal CommandCheck::check_plan(TimeNs now, const Drone& drone, const crypto::IdentityName& signer,
                                 const DronePlan& plan) const {
  if (!drone.control || !same(commander_of(*drone.control), signer)) {
    return Refusal::not_holder;
  }
  if (is_lease_revoked(*drone.control)) return Refusal::revoked;
  if ((is_stopped(*drone.control) || drone.pending_stop) && plan.action() != LAND) return Refusal::stopped;
  if (plan.epoch() != drone.control->epoch()) return Refusal::wrong_epoch;
  if (plan.boot_id() != drone.boot_id) return Refusal::foreign_boot;
  if (!std::binary_search(drone.stamps.begin(), drone.stamps.end(), plan.state_stamp_ns())) {
    return Refusal::unknown_stamp;
  }
  const std::uint64_t last = plan.epoch() == drone.epoch ? drone.last_sequence : 0;
  if (plan.sequence() <= last) return Refusal::replayed;
  if (drone.evicting && plan.action() == TAKEOFF) return Refusal::evicting;
  if (now - plan.state_stamp_ns() > config_.max_age_ns) return Refusal::too_old;
  return check_setpoints(now, plan);
}

Refusal CommandCheck::check_setpoints(TimeNs now, const DronePlan& plan) const {
  if (plan.action() != FLY && plan.action() != TAKEOFF && plan.action() != LAND) return Refusal::malformed;
  if (plan.action() == FLY && plan.setpoints_size() == 0) return Refusal::malformed;
  if (plan.setpoints_size() > static_cast<int>(max_setpoints)) return Refusal::over_limits;
  TimeNs last_ns = plan.state_stamp_ns();
  for (const PlannedSetpoint& s : plan.setpoints()) {
    const double speed = std::hypot(s.vx(), s.vy(), s.vz());
    // Written so that NaN fails.
    const bool within = speed <= config_.max_speed_mps && std::abs(s.yaw_rate()) <= config_.max_yaw_rate_radps;
    if (!within || s.at_ns() < last_ns || s.at_ns() > now + config_.horizon_ns) return Refusal::over_limits;
    last_ns = s.at_ns();
  }
  return Refusal::none;
}

std::optional<verification::ControlEvent> CommandCheck::verified_event(std::int64_t now_s,
                                                                       const fabric::Transaction& tx,
                                                                       access::Caller& signer, Checked& out) {
  Controls reported;
  Refusal why = parse_message(tx.event_payload, reported) ? Refusal::none : Refusal::malformed;
  if (why == Refusal::none) {
    if (!concerns_us(reported)) return std::nullopt;
    // A role is kept by the organisation that gives it.
    Organisations endorsers{config_.msp_id};
    if (reported.has_identity()) endorsers.insert(reported.identity().msp_id());
    why = check_transaction(now_s, tx, endorsers, signer);
  }
  if (why == Refusal::none) {
    auto event = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
    if (event) return std::move(*event);
    why = Refusal::altered;
  }
  refuse_control_event(why, 0, out);
  return std::nullopt;
}

void CommandCheck::refuse_control_event(Refusal why, DroneNumber drone, Checked& out) {
  ++refused_control_events_;
  out.refused.push_back(Refused{.drone = drone, .why = why});
}

void CommandCheck::take_controls(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, Checked& out) {
  access::Caller signer;
  const auto event = verified_event(now_s, tx, signer, out);
  if (!event) return;
  const auto role = verification::role_change(*event);
  bool follows = !role || verification::role_follows(*event, signer);  // as a whole or not at all, as on the ledger
  if (!follows) refuse_control_event(Refusal::altered, 0, out);
  for (const Control& control : event->controls.controls()) {
    const Drone* drone = find(control.drone());
    if (!drone) continue;
    if (drone->control && drone->control->has_owner() &&
        verification::control_follows(*event, *drone->control, control, signer))
      continue;
    refuse_control_event(Refusal::altered, drone->name.number, out);
    follows = false;
  }
  if (!follows) return;
  for (const Control& control : event->controls.controls()) {
    Drone* drone = find(control.drone());
    if (!drone) continue;
    const bool cleared =
        event->call.function == contract::clear_stop && is_stopped(*drone->control) && !is_stopped(control);
    // Who commands no more must not fly on until the end of his plan, seconds on a far ledger. Who hands the drone over
    // does, until the first plan of the other: nobody holds it up in between.
    const bool lost = event->call.function != contract::hand_over && drone->control->has_holder() &&
                      control.epoch() > drone->control->epoch() &&
                      to_name(commander_of(*drone->control)) != to_name(commander_of(control));
    if (lost) out.plans.push_back(empty_plan(now, drone->name.number, control.epoch()));
    drone->control = control;
    // What no record shows after its host's apply_stops, or after somebody cleared stops, the ledger never had.
    if (drone->pending_stop && !is_stopped(control)) {
      if (event->call.function == contract::apply_stops) drone->pending_stop->not_on_ledger = true;
      if (event->call.function == contract::clear_stop) drone->pending_stop.reset();
    }
    if (!cleared || drone->pending_stop) continue;
    // A member of the owner's organisation also acts for the person who pressed the key beside the drone.
    const bool owners = signer.name.msp_id == control.owner().msp_id();
    out.plans.push_back(
        contract_word(now, *drone, owners ? PlanAction::stop_cleared_by_owner : PlanAction::stop_cleared));
  }
  if (role) take_role(*role, out);
}

// Anybody's role does: who has one may stop.
bool CommandCheck::concerns_us(const Controls& reported) {
  const auto& all = reported.controls();
  return reported.has_identity() ||
         std::any_of(all.begin(), all.end(), [&](const auto& one) { return find(one.drone()); });
}

void CommandCheck::take_role(const verification::RoleChange& change, Checked& out) {
  // Of an organisation that no drone of ours is granted to nothing counts; it is read when one is.
  if (roles_.follows(change.identity.msp_id())) roles_.take(change);
  for (Drone& drone : drones_) {
    if (!drone.control) continue;
    apply_role(*drone.control, change.identity, change.role);
    if (is_revoked(*drone.control, change.identity)) out.revoked.push_back(drone.name.number);
  }
}

std::optional<Plan> CommandCheck::standing_stop(TimeNs now, DroneNumber number) const {
  const Drone* drone = find(number);
  if (!drone || !drone->control || !(is_stopped(*drone->control) || drone->pending_stop)) return std::nullopt;
  return contract_word(now, *drone, is_cut(*drone->control) ? PlanAction::cut : PlanAction::stop);
}

std::optional<Plan> CommandCheck::no_stop(TimeNs now, DroneNumber number) const {
  const Drone* drone = find(number);
  if (!drone || !drone->control || is_stopped(*drone->control) || drone->pending_stop) return std::nullopt;
  return contract_word(now, *drone, PlanAction::stop_cleared);
}

void CommandCheck::landed(DroneNumber number) {
  for (Drone& drone : drones_) {
    if (drone.name.number == number && drone.pending_stop && drone.pending_stop->not_on_ledger)
      drone.pending_stop.reset();
  }
}

Plan CommandCheck::empty_plan(TimeNs now, DroneNumber number, std::uint64_t epoch) {
  // Newer than any plan of the lease before, older than the first of the next.
  return {.drone = number, .action = PlanAction::fly, .epoch = epoch, .state_stamp_ns = now, .setpoints = {}};
}

Plan CommandCheck::contract_word(TimeNs now, const Drone& drone, PlanAction action) {
  Plan word;
  word.drone = drone.name.number;
  word.action = action;
  word.epoch = std::max(drone.control->epoch(), drone.epoch);
  word.sequence = (word.epoch == drone.epoch ? drone.last_sequence : 0) + 1;  // newer than any plan that link has
  word.state_stamp_ns = drone.stamps.empty() ? now : drone.stamps.back();
  return word;
}

}  // namespace ledgerline::agent
