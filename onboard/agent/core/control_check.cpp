#include "onboard/agent/core/control_check.hpp"

#include <algorithm>
#include <utility>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/base/check.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::agent {

ControlCheck::ControlCheck(std::string msp_id, const std::vector<DroneName>& drones, TransactionCheck transactions)
    : msp_id_(std::move(msp_id)), transactions_(std::move(transactions)) {
  for (const DroneName& drone : drones) drones_.push_back({.drone = drone});
}

const Control* ControlCheck::control(DroneNumber number) const {
  const Drone* drone = find_drone(drones_, number);
  return drone && drone->control ? &*drone->control : nullptr;
}

std::optional<PlanAction> ControlCheck::standing_stop(DroneNumber number) const {
  const Control* record = control(number);
  if (!record || !(is_stopped(*record) || find_drone(drones_, number)->pending_stop != PendingStop::none))
    return std::nullopt;
  return is_cut(*record) ? PlanAction::cut : PlanAction::stop;
}

std::optional<std::uint64_t> ControlCheck::lease(DroneNumber number) const {
  const Control* record = control(number);
  return record && record->has_holder() ? std::optional(record->epoch()) : std::nullopt;
}

verification::Organisations ControlCheck::await_roles() {
  verification::Organisations organisations;
  // Behind each block: nothing is copied while all are known.
  const auto add_unknown = [&](const std::string& msp_id) {
    if (!msp_id.empty() && !roles_.follows(msp_id)) organisations.insert(msp_id);
  };
  for (const Drone& drone : drones_) {
    if (!drone.control) continue;
    add_unknown(drone.control->owner().msp_id());
    for (const Grant& grant : drone.control->grants()) add_unknown(grant.to().msp_id());
  }
  for (const std::string& msp_id : organisations) roles_.await(msp_id);
  return organisations;
}

void ControlCheck::set_control(const Control& control) {
  if (Drone* drone = find_drone(drones_, control.drone())) drone->control = control;
}

FirstRecords ControlCheck::records() const {
  FirstRecords records{.controls = {}, .roles = roles_};
  for (const Drone& drone : drones_) {
    if (drone.control) records.controls.push_back(*drone.control);
  }
  return records;
}

void ControlCheck::on_landed(DroneNumber number) {
  Drone* drone = find_drone(drones_, number);
  if (drone && drone->pending_stop == PendingStop::not_on_ledger) drone->pending_stop = PendingStop::none;
}

std::optional<verification::ControlEvent> ControlCheck::verified_event(std::int64_t now_s,
                                                                       const fabric::Transaction& tx,
                                                                       access::Caller& signer, CheckedBlock& out) {
  Controls reported;
  RefusalReason why = parse_message(tx.event_payload, reported) ? RefusalReason::none : RefusalReason::malformed;
  if (why == RefusalReason::none) {
    if (!concerns_us(reported)) return std::nullopt;
    // A role is kept by the organisation that gives it.
    verification::Organisations endorsers{msp_id_};
    if (reported.has_identity()) endorsers.insert(reported.identity().msp_id());
    why = transactions_.check(now_s, tx, endorsers, signer);
  }
  if (why == RefusalReason::none) {
    auto event = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
    if (event) return std::move(*event);
    why = RefusalReason::altered;
  }
  refuse(why, 0, out);
  return std::nullopt;
}

void ControlCheck::refuse(RefusalReason why, DroneNumber drone, CheckedBlock& out) {
  ++refused_events_;
  out.refused.push_back({.drone = drone, .why = why});
}

// Any role change concerns us: it may allow a stop.
bool ControlCheck::concerns_us(const Controls& reported) {
  const auto& all = reported.controls();
  return reported.has_identity() ||
         std::any_of(all.begin(), all.end(), [&](const auto& one) { return find_drone(drones_, one.drone()); });
}

// As a whole or not at all, as on the ledger.
bool ControlCheck::event_follows(const verification::ControlEvent& event, const access::Caller& signer,
                                 CheckedBlock& out) {
  bool follows = !verification::role_change(event) || verification::role_follows(event, signer);
  if (!follows) refuse(RefusalReason::altered, 0, out);
  for (const Control& control : event.controls.controls()) {
    const Drone* drone = find_drone(drones_, control.drone());
    if (!drone) continue;
    if (drone->control && drone->control->has_owner() &&
        verification::control_follows(event, *drone->control, control, signer))
      continue;
    refuse(RefusalReason::altered, drone->drone.number, out);
    follows = false;
  }
  return follows;
}

void ControlCheck::check_control_event(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx,
                                       CheckedBlock& out) {
  access::Caller signer;
  const auto event = verified_event(now_s, tx, signer, out);
  if (!event || !event_follows(*event, signer, out)) return;
  for (const Control& control : event->controls.controls()) apply_control(now, *event, control, signer, out);
  if (const auto role = verification::role_change(*event)) apply_role_change(*role, out);
}

void ControlCheck::apply_control(TimeNs now, const verification::ControlEvent& event, const Control& control,
                                 const access::Caller& signer, CheckedBlock& out) {
  Drone* drone = find_drone(drones_, control.drone());
  if (!drone) return;
  const Control before = *std::exchange(drone->control, control);
  LEDGERLINE_CHECK(control.epoch() >= before.epoch(), "a record's epoch does not go back", control.drone(),
                   control.epoch(), before.epoch());
  LEDGERLINE_CHECK(control.owner().msp_id() == before.owner().msp_id(), "a drone stays its organisation's",
                   control.drone());
  const std::string& function = event.call.function;
  // Who commands no more must not fly on until the end of his plan, seconds on a far ledger. Who hands the drone over
  // does, until the first plan of the other: nobody holds it up in between.
  const bool lost = function != contract::hand_over && before.has_holder() && control.epoch() > before.epoch() &&
                    to_name(commander_of(before)) != to_name(commander_of(control));
  // An empty plan, which makes link drop the previous lease's plans: newer than any of those, older than the next
  // lease's first.
  if (lost)
    out.plans.push_back({.drone = drone->drone.number,
                         .action = PlanAction::fly,
                         .epoch = control.epoch(),
                         .state_stamp_ns = now,
                         .setpoints = {}});
  // What no record shows after its host's apply_stops, or after somebody cleared stops, the ledger never had.
  if (drone->pending_stop != PendingStop::none && !is_stopped(control)) {
    if (function == contract::apply_stops) drone->pending_stop = PendingStop::not_on_ledger;
    if (function == contract::clear_stop) drone->pending_stop = PendingStop::none;
  }
  const bool cleared = function == contract::clear_stop && is_stopped(before) && !is_stopped(control);
  if (!cleared || drone->pending_stop != PendingStop::none) return;
  // A member of the owner's organisation also acts for the person who pressed the key beside the drone.
  const bool owners = signer.name.msp_id == control.owner().msp_id();
  out.plans.push_back({.drone = drone->drone.number,
                       .action = owners ? PlanAction::stop_cleared_by_owner : PlanAction::stop_cleared,
                       .setpoints = {}});
}

void ControlCheck::apply_role_change(const verification::RoleChange& change, CheckedBlock& out) {
  // Of an organisation that no drone of ours is granted to nothing counts; it is read when one is.
  if (roles_.follows(change.identity.msp_id())) roles_.apply(change);
  for (Drone& drone : drones_) {
    if (!drone.control) continue;
    apply_role(*drone.control, change.identity, change.role);
    if (is_revoked(*drone.control, change.identity)) out.revoked.push_back(drone.drone.number);
  }
}

// Stopping needs less than going. Who signed the stop counts, by the contract's own rule on the records that are
// trusted; flag, endorsers and the wall clock, which a peer or a host without a clock gets wrong, only say whether the
// ledger has it as well.
void ControlCheck::check_stop(const fabric::Transaction& tx, CheckedBlock& out) {
  const auto asked = verification::read_stop_call({tx.function, tx.args});
  const bool valid = tx.code == 0 && tx.event_name == contract::stop;
  Stops reported;
  if (valid && !parse_message(tx.event_payload, reported)) reported.Clear();
  const auto ours = [this](const auto& name) { return find_drone(drones_, name) != nullptr; };
  const bool asks = asked && std::any_of(asked->drones().begin(), asked->drones().end(), ours);
  const bool reports =
      std::any_of(reported.stops().begin(), reported.stops().end(), [&](const Stop& s) { return ours(s.drone()); });
  if (!asks && !reports) return;
  access::Caller signer;
  if (const RefusalReason why = transactions_.check_creator(std::nullopt, tx, signer); why != RefusalReason::none)
    return refuse(why, 0, out);
  std::optional<verification::ControlEvent> event;
  if (valid) {
    auto read = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
    if (read) {
      event = std::move(*read);
    } else {
      refuse(RefusalReason::altered, 0, out);
    }
  }
  if (!asks) return;
  const SignedStop given{
      .tx = tx,
      .signer = signer,
      .is_endorsed = event && transactions_.is_endorsed_by({msp_id_}, std::nullopt, tx),
      .is_repeated = std::find(obeyed_stops_.begin(), obeyed_stops_.end(), tx.tx_id) != obeyed_stops_.end(),
      .event = event ? &*event : nullptr};
  for (Drone& drone : drones_) {
    if (std::find(asked->drones().begin(), asked->drones().end(), drone.drone.name) == asked->drones().end()) continue;
    const Stop stop = verification::signed_stop(*asked, tx.event_payload, drone.drone.name, to_message(signer.name));
    apply_stop(given, stop, drone, out);
  }
}

void ControlCheck::apply_stop(const SignedStop& given, const Stop& stop, Drone& drone, CheckedBlock& out) {
  Control record = drone.control.value_or(Control());
  record.set_drone(drone.drone.name);  // none was read yet: it is stopped for any pilot
  const Stop* reported = nullptr;
  if (given.event != nullptr) {
    const auto& stops = given.event->stops.stops();  // of exactly the drones that were asked for
    reported = &*std::find_if(stops.begin(), stops.end(), [&](const Stop& one) { return one.drone() == stop.drone(); });
    if (!verification::stop_follows(*given.event, record, *reported, given.signer)) {
      refuse(RefusalReason::altered, drone.drone.number, out);
      reported = nullptr;
    }
  }
  const bool vouched = reported != nullptr && given.is_endorsed;
  if (!vouched && access::check_stop(record, given.signer, roles_.of(given.signer.name), false)) {
    const bool known = reported == nullptr && given.tx.code == 0;  // as altered
    if (!known) refuse(RefusalReason::may_not_stop, drone.drone.number, out);
    return;
  }
  if (stop.clears() < clears_of(record, stop.stopper())) return;
  if (reported != nullptr) add_stop(record, *reported);
  if (!is_stopped_by(record, stop.stopper())) {
    if (given.is_repeated) return;
    drone.pending_stop = PendingStop::unconfirmed;
    if (obeyed_stops_.empty() || obeyed_stops_.back() != given.tx.tx_id) obeyed_stops_.push_back(given.tx.tx_id);
    if (obeyed_stops_.size() > max_remembered_stops) obeyed_stops_.pop_front();
    ++unconfirmed_stops_;
    const bool validated = given.tx.signature_verified && !given.tx.by_flag && given.tx.problem.empty();
    out.unconfirmed.push_back({drone.drone.number, given.signer.name, given.tx.code, validated});
  }
  drone.control = std::move(record);
  const auto stands = standing_stop(drone.drone.number);
  if (LEDGERLINE_CHECK(stands, "a drone that somebody has stopped is stopped", drone.drone.name))
    out.plans.push_back({.drone = drone.drone.number, .action = *stands, .setpoints = {}});
}

}  // namespace ledgerline::agent
