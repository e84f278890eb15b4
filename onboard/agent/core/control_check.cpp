#include "onboard/agent/core/control_check.hpp"

#include <algorithm>
#include <array>

#include "common/base/check.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/stops.hpp"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::agent {
namespace {

constexpr std::array reason_names{"none",          "broken_chain", "invalid_transaction",
                                  "wrong_channel", "malformed",    "unknown_signer",
                                  "bad_signature", "not_endorsed", "not_holder",
                                  "stopped",       "wrong_epoch",  "foreign_boot",
                                  "unknown_stamp", "replayed",     "too_old",
                                  "over_limits",   "altered",      "revoked",
                                  "evicting",      "may_not_stop"};
static_assert(reason_names.size() == refusal_count);

/// Whether the result that the endorsers signed is that of the transaction's own proposal, which names creator and
/// call: else a result endorsed for somebody else could be put into one's own transaction. Fabric's peers check the
/// same; this check does not lean on them. As Fabric's protoutil.GetProposalHash2. False for malformed bytes.
bool result_is_of_own_proposal(const fabric::Transaction& tx) {
  protos::ProposalResponsePayload response;
  common::Payload payload;
  protos::Transaction transaction;
  protos::ChaincodeActionPayload action;
  if (!response.ParseFromString(tx.response_payload) || !payload.ParseFromString(tx.payload) ||
      !transaction.ParseFromString(payload.data()) || transaction.actions_size() != 1 ||
      !action.ParseFromString(transaction.actions(0).payload())) {
    return false;
  }
  return response.proposal_hash() == fabric::proposal_hash(payload.header().channel_header(),
                                                           payload.header().signature_header(),
                                                           action.chaincode_proposal_payload());
}

}  // namespace

std::string_view refusal_name(RefusalReason reason) { return reason_names.at(static_cast<std::size_t>(reason)); }

RefusalReason TransactionCheck::check_creator(std::optional<std::int64_t> now_s, const fabric::Transaction& tx,
                                              access::Caller& signer) const {
  if (tx.channel != where_.channel || tx.contract != where_.contract) return RefusalReason::wrong_channel;
  const auto creator = registry_.member(tx.creator, now_s);
  if (!creator) return RefusalReason::unknown_signer;
  if (!fabric::creator_signed(tx, *(*creator)->verifier)) return RefusalReason::bad_signature;
  signer = {(*creator)->name, (*creator)->admin};
  return RefusalReason::none;
}

RefusalReason TransactionCheck::check(std::int64_t now_s, const fabric::Transaction& tx,
                                      const verification::Organisations& endorsers, access::Caller& signer) const {
  const RefusalReason why = check_creator(now_s, tx, signer);
  return why != RefusalReason::none || is_endorsed_by(endorsers, now_s, tx) ? why : RefusalReason::not_endorsed;
}

bool TransactionCheck::is_endorsed_by(const verification::Organisations& organisations,
                                      std::optional<std::int64_t> now_s, const fabric::Transaction& tx) const {
  if (!result_is_of_own_proposal(tx)) return false;
  return std::any_of(tx.endorsements.begin(), tx.endorsements.end(), [&](const fabric::Endorsement& e) {
    const auto endorser = registry_.member(e.endorser, now_s);
    // Peers alone: any other member of the organisation, this agent included, could sign a result of its own making.
    return endorser && (*endorser)->peer && organisations.contains((*endorser)->name.msp_id) &&
           fabric::endorser_signed(tx, e, *(*endorser)->verifier);
  });
}

ControlCheck::ControlCheck(std::string msp_id, const std::vector<DroneName>& drones, TransactionCheck transactions)
    : msp_id_(std::move(msp_id)), transactions_(std::move(transactions)) {
  for (const DroneName& name : drones) drones_.push_back({.name = name});
}

ControlCheck::Drone* ControlCheck::find(std::string_view name) {
  const auto it = std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.name.name == name; });
  return it == drones_.end() ? nullptr : &*it;
}

const ControlCheck::Drone* ControlCheck::find(DroneNumber number) const {
  const auto it = std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.name.number == number; });
  return it == drones_.end() ? nullptr : &*it;
}

const Control* ControlCheck::control(DroneNumber number) const {
  const Drone* drone = find(number);
  return drone && drone->control ? &*drone->control : nullptr;
}

std::optional<PlanAction> ControlCheck::standing_stop(DroneNumber number) const {
  const Control* record = control(number);
  if (!record || !(is_stopped(*record) || find(number)->pending_stop)) return std::nullopt;
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
  if (Drone* drone = find(control.drone())) drone->control = control;
}

FirstRecords ControlCheck::records() const {
  FirstRecords records{.controls = {}, .roles = roles_};
  for (const Drone& drone : drones_) {
    if (drone.control) records.controls.push_back(*drone.control);
  }
  return records;
}

void ControlCheck::on_landed(DroneNumber number) {
  for (Drone& drone : drones_) {
    if (drone.name.number == number && drone.pending_stop && drone.pending_stop->not_on_ledger)
      drone.pending_stop.reset();
  }
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

// Anybody's role does: who has one may stop.
bool ControlCheck::concerns_us(const Controls& reported) {
  const auto& all = reported.controls();
  return reported.has_identity() ||
         std::any_of(all.begin(), all.end(), [&](const auto& one) { return find(one.drone()); });
}

// As a whole or not at all, as on the ledger.
bool ControlCheck::event_follows(const verification::ControlEvent& event, const access::Caller& signer,
                                 CheckedBlock& out) {
  bool follows = !verification::role_change(event) || verification::role_follows(event, signer);
  if (!follows) refuse(RefusalReason::altered, 0, out);
  for (const Control& control : event.controls.controls()) {
    const Drone* drone = find(control.drone());
    if (!drone) continue;
    if (drone->control && drone->control->has_owner() &&
        verification::control_follows(event, *drone->control, control, signer))
      continue;
    refuse(RefusalReason::altered, drone->name.number, out);
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
  Drone* drone = find(control.drone());
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
  // Takes what link still has of another's plans away: newer than any of the lease before, older than the first of the
  // next.
  if (lost)
    out.plans.push_back({.drone = drone->name.number,
                         .action = PlanAction::fly,
                         .epoch = control.epoch(),
                         .state_stamp_ns = now,
                         .setpoints = {}});
  // What no record shows after its host's apply_stops, or after somebody cleared stops, the ledger never had.
  if (drone->pending_stop && !is_stopped(control)) {
    if (function == contract::apply_stops) drone->pending_stop->not_on_ledger = true;
    if (function == contract::clear_stop) drone->pending_stop.reset();
  }
  const bool cleared = function == contract::clear_stop && is_stopped(before) && !is_stopped(control);
  if (!cleared || drone->pending_stop) return;
  // A member of the owner's organisation also acts for the person who pressed the key beside the drone.
  const bool owners = signer.name.msp_id == control.owner().msp_id();
  out.plans.push_back({.drone = drone->name.number,
                       .action = owners ? PlanAction::stop_cleared_by_owner : PlanAction::stop_cleared,
                       .setpoints = {}});
}

void ControlCheck::apply_role_change(const verification::RoleChange& change, CheckedBlock& out) {
  // Of an organisation that no drone of ours is granted to nothing counts; it is read when one is.
  if (roles_.follows(change.identity.msp_id())) roles_.apply(change);
  for (Drone& drone : drones_) {
    if (!drone.control) continue;
    apply_role(*drone.control, change.identity, change.role);
    if (is_revoked(*drone.control, change.identity)) out.revoked.push_back(drone.name.number);
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
  const auto ours = [this](const auto& name) { return find(name) != nullptr; };
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
    if (std::find(asked->drones().begin(), asked->drones().end(), drone.name.name) == asked->drones().end()) continue;
    const Stop stop = verification::signed_stop(*asked, tx.event_payload, drone.name.name, to_message(signer.name));
    apply_stop(given, stop, drone, out);
  }
}

void ControlCheck::apply_stop(const SignedStop& given, const Stop& stop, Drone& drone, CheckedBlock& out) {
  Control record = drone.control.value_or(Control());
  record.set_drone(drone.name.name);  // none was read yet: it is stopped for any pilot
  const Stop* reported = nullptr;
  if (given.event != nullptr) {
    const auto& stops = given.event->stops.stops();  // of exactly the drones that were asked for
    reported = &*std::find_if(stops.begin(), stops.end(), [&](const Stop& one) { return one.drone() == stop.drone(); });
    if (!verification::stop_follows(*given.event, record, *reported, given.signer)) {
      refuse(RefusalReason::altered, drone.name.number, out);
      reported = nullptr;
    }
  }
  const bool vouched = reported != nullptr && given.is_endorsed;
  if (!vouched && access::check_stop(record, given.signer, roles_.of(given.signer.name), false)) {
    const bool known = reported == nullptr && given.tx.code == 0;  // as altered
    if (!known) refuse(RefusalReason::may_not_stop, drone.name.number, out);
    return;
  }
  if (stop.clears() < clears_of(record, stop.stopper())) return;
  if (reported != nullptr) add_stop(record, *reported);
  if (!is_stopped_by(record, stop.stopper())) {
    if (given.is_repeated) return;
    drone.pending_stop = PendingStop{};
    if (obeyed_stops_.empty() || obeyed_stops_.back() != given.tx.tx_id) obeyed_stops_.push_back(given.tx.tx_id);
    if (obeyed_stops_.size() > max_remembered_stops) obeyed_stops_.pop_front();
    ++unconfirmed_stops_;
    const bool validated = given.tx.creator_fits && !given.tx.by_flag && given.tx.problem.empty();
    out.unconfirmed.push_back({drone.name.number, given.signer.name, given.tx.code, validated});
  }
  drone.control = std::move(record);
  const auto stands = standing_stop(drone.name.number);
  if (LEDGERLINE_CHECK(stands, "a drone that somebody has stopped is stopped", drone.name.name))
    out.plans.push_back({.drone = drone.name.number, .action = *stands, .setpoints = {}});
}

}  // namespace ledgerline::agent
