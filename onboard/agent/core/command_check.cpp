#include "onboard/agent/core/command_check.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/belief/calls.hpp"
#include "common/belief/control_events.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/stops.hpp"
#include "onboard/agent/core/proposal_hash.hpp"

namespace ledgerline::agent {
namespace {

constexpr std::array names{"none",          "broken_chain", "invalid_transaction",
                           "wrong_channel", "malformed",    "unknown_signer",
                           "bad_signature", "not_endorsed", "not_holder",
                           "stopped",       "wrong_epoch",  "foreign_boot",
                           "unknown_stamp", "replayed",     "too_old",
                           "over_limits",   "altered",      "revoked",
                           "evicting"};
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

void CommandCheck::set_control(const Control& control) {
  if (Drone* drone = find(control.drone())) drone->control = control;
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
    out.chain_error = linked.error().what;
  }
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.config) continue;
    if (tx.code == fabric::code_unbelievable) ++unbelievable_transactions_;
    if (tx.event_name == contract::command) {
      take_commands(now, now_s, tx, out);
    } else if (out.chain_ok && tx.code == 0 && tx.event_name == contract::stop) {
      take_stops(now, now_s, tx, out);
    } else if (out.chain_ok && tx.code == 0 && belief::is_control_event(tx.event_name)) {
      take_controls(now, now_s, tx, out);
    }
  }
  return out;
}

Refusal CommandCheck::check_transaction(std::int64_t now_s, const fabric::Transaction& tx, belief::Creator& signer) {
  if (tx.channel != config_.where.channel || tx.contract != config_.where.contract) return Refusal::wrong_channel;
  const auto creator = registry_.member(tx.creator, now_s);
  if (!creator) return Refusal::unknown_signer;
  if (!(*creator)->verifier->verify(tx.payload, tx.signature)) return Refusal::bad_signature;
  if (!result_is_of_own_proposal(tx) || !endorsed_by_us(now_s, tx)) return Refusal::not_endorsed;
  signer = {(*creator)->name, (*creator)->admin};
  return Refusal::none;
}

bool CommandCheck::endorsed_by_us(std::int64_t now_s, const fabric::Transaction& tx) {
  return std::any_of(tx.endorsements.begin(), tx.endorsements.end(), [&](const fabric::Endorsement& e) {
    const auto endorser = registry_.member(e.endorser, now_s);
    // Peers alone: any other member of our organisation, this agent included, could sign a result of its own making.
    return endorser && (*endorser)->name.msp_id == config_.msp_id && (*endorser)->peer &&
           (*endorser)->verifier->verify(tx.response_payload + e.endorser, e.signature);
  });
}

void CommandCheck::take_commands(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, Checked& out) {
  CommandCall call;  // as it was signed; whatever else the event says is the peer's alone
  const belief::Match match = belief::match_command({tx.function, tx.args}, tx.event_payload, call);
  if (match == belief::Match::altered) return refuse_altered(tx, std::move(call), out);
  if (match == belief::Match::malformed) {
    ++malformed_commands_;
    out.refused.push_back(Refused{.why = Refusal::malformed});
    return;
  }
  const bool ours =
      std::any_of(call.plans().begin(), call.plans().end(), [&](const auto& p) { return find(p.drone()); });
  if (!ours) return;

  belief::Creator signer;
  const Refusal whole = check_whole(now_s, tx, out, signer);
  for (const DronePlan& plan : call.plans()) {
    Drone* drone = find(plan.drone());
    if (!drone) continue;
    if (out.chain_ok && tx.code == 0) ++drone->counters.on_ledger;
    if (whole == Refusal::none && holds(*drone, signer.name, plan)) out.heard.push_back(drone->name.number);
    const Refusal why = whole != Refusal::none ? whole : check_plan(now, *drone, signer.name, plan);
    if (why != Refusal::none) {
      refuse(*drone, plan, why, out);
      continue;
    }
    drone->epoch = plan.epoch();
    drone->last_sequence = plan.sequence();
    ++drone->counters.verified;
    out.plans.push_back(belief::plan_of(drone->name.number, plan));
  }
}

Refusal CommandCheck::check_whole(std::int64_t now_s, const fabric::Transaction& tx, const Checked& out,
                                  belief::Creator& signer) {
  if (!out.chain_ok) return Refusal::broken_chain;
  if (tx.code != 0) return Refusal::invalid_transaction;
  return check_transaction(now_s, tx, signer);
}

void CommandCheck::refuse(Drone& drone, const DronePlan& plan, Refusal why, Checked& out) {
  ++drone.counters.refused;
  ++drone.counters.reasons[static_cast<std::size_t>(why)];
  out.refused.push_back(Refused{drone.name.number, plan.sequence(), plan.state_stamp_ns(), why});
}

// Counted for every drone that was asked for, and for every one that the event names instead. Why it is not believed
// counts for little beside that it is not: the first reason of all is told.
void CommandCheck::refuse_altered(const fabric::Transaction& tx, CommandCall asked, Checked& out) {
  CommandCall told;
  if (parse_message(tx.event_payload, told)) asked.MergeFrom(told);
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

// An absent holder reads as an empty name, which no signer has.
bool CommandCheck::holds(const Drone& drone, const crypto::IdentityName& signer, const DronePlan& plan) {
  return drone.control && same(drone.control->holder(), signer) && plan.epoch() == drone.control->epoch();
}

Refusal CommandCheck::check_plan(TimeNs now, const Drone& drone, const crypto::IdentityName& signer,
                                 const DronePlan& plan) const {
  // An absent holder reads as an empty name, which no signer has.
  if (!drone.control || !same(drone.control->holder(), signer)) {
    return Refusal::not_holder;
  }
  if (is_revoked(*drone.control, drone.control->holder())) return Refusal::revoked;
  if (is_stopped(*drone.control) && plan.action() != LAND) return Refusal::stopped;
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

template <typename Event, typename Ours>
std::optional<belief::ControlEvent> CommandCheck::believed(std::int64_t now_s, const fabric::Transaction& tx,
                                                           const Ours& ours, belief::Creator& signer, Checked& out) {
  Event told;
  Refusal why = parse_message(tx.event_payload, told) ? Refusal::none : Refusal::malformed;
  if (why == Refusal::none) {
    if (!ours(told)) return std::nullopt;
    why = check_transaction(now_s, tx, signer);
  }
  if (why == Refusal::none) {
    auto event = belief::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
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
  belief::Creator signer;
  const auto event = believed<Controls>(
      now_s, tx, [this](const Controls& told) { return names_one_of_ours(told); }, signer, out);
  if (!event) return;
  const auto role = belief::role_change(*event);
  bool follows = !role || belief::role_follows(*role, signer);  // as a whole or not at all, as on the ledger
  if (!follows) refuse_control_event(Refusal::altered, 0, out);
  for (const Control& control : event->controls.controls()) {
    const Drone* drone = find(control.drone());
    if (!drone) continue;
    if (drone->control && belief::control_follows(*event, *drone->control, control, signer)) continue;
    refuse_control_event(Refusal::altered, drone->name.number, out);
    follows = false;
  }
  if (!follows) return;
  for (const Control& control : event->controls.controls()) {
    Drone* drone = find(control.drone());
    if (!drone) continue;
    const bool lifted = event->function == contract::resume && is_stopped(*drone->control) && !is_stopped(control);
    drone->control = control;
    if (!lifted) continue;
    // Who speaks for the drone's owner speaks for whoever pressed the key beside it, too.
    const bool owners = signer.name.msp_id == control.owner().msp_id();
    out.plans.push_back(contract_word(now, *drone, owners ? PlanAction::resumed_by_owner : PlanAction::resumed));
  }
  if (role) take_role(*role, out);
}

bool CommandCheck::names_one_of_ours(const Controls& told) {
  const auto& all = told.controls();
  return std::any_of(all.begin(), all.end(), [&](const Control& one) { return find(one.drone()); }) ||
         std::any_of(drones_.begin(), drones_.end(), [&](const Drone& drone) {
           return told.has_identity() && drone.control && names_identity(*drone.control, told.identity());
         });
}

void CommandCheck::take_role(const belief::RoleChange& change, Checked& out) {
  for (Drone& drone : drones_) {
    if (!drone.control) continue;
    apply_role(*drone.control, change.identity, change.role);
    if (is_revoked(*drone.control, change.identity)) out.revoked.push_back(drone.name.number);
  }
}

void CommandCheck::take_stops(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, Checked& out) {
  belief::Creator signer;
  const auto ours = [this](const Stops& told) {
    const auto& all = told.stops();
    return std::any_of(all.begin(), all.end(), [&](const Stop& one) { return find(one.drone()); });
  };
  const auto event = believed<Stops>(now_s, tx, ours, signer, out);
  if (!event) return;
  for (const Stop& stop : event->stops.stops()) {
    Drone* drone = find(stop.drone());
    if (!drone) continue;
    Control record = drone->control.value_or(Control());
    if (!belief::stop_follows(*event, record, stop, signer)) {
      refuse_control_event(Refusal::altered, drone->name.number, out);
      continue;
    }
    record.set_drone(drone->name.name);  // none was read yet: it is stopped, whoever flies it
    add_stop(record, stop);
    drone->control = std::move(record);
    if (auto plan = standing_stop(now, drone->name.number)) out.plans.push_back(*plan);
  }
}

std::optional<Plan> CommandCheck::standing_stop(TimeNs now, DroneNumber number) const {
  const Drone* drone = find(number);
  if (!drone || !drone->control || !is_stopped(*drone->control)) return std::nullopt;
  return contract_word(now, *drone, is_cut(*drone->control) ? PlanAction::cut : PlanAction::stop);
}

std::optional<Plan> CommandCheck::no_stop(TimeNs now, DroneNumber number) const {
  const Drone* drone = find(number);
  if (!drone || !drone->control || is_stopped(*drone->control)) return std::nullopt;
  return contract_word(now, *drone, PlanAction::resumed);
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
