#include <algorithm>
#include <utility>

#include "common/access/identity.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/stops.hpp"
#include "common/verification/calls.hpp"
#include "common/verification/control_events.hpp"
#include "onboard/agent/core/command_check.hpp"

/// Which stops are obeyed: one proves itself by its signer, whatever block brings it.
namespace ledgerline::agent {

CommandCheck::Checked CommandCheck::check_refused(TimeNs now, const fabric::Block& block) {
  Checked out;
  for (fabric::Transaction tx : block.transactions) {
    if (tx.config || tx.function != contract::stop) continue;
    // Its flag, its event and the result of an earlier reading are not verified.
    tx.code = -1;
    tx.event_name.clear();
    tx.event_payload.clear();
    tx.creator_fits = false;
    take_stops(now, tx, out);
  }
  return out;
}

// Stopping needs less than going. Who signed the stop counts, by the contract's own rule on the records that are
// trusted; flag, endorsers and the wall clock, which a peer or a host without a clock gets wrong, only say whether the
// ledger has it as well.
void CommandCheck::take_stops(TimeNs now, const fabric::Transaction& tx, Checked& out) {
  const auto asked = verification::read_stop_call({tx.function, tx.args});
  const bool valid = tx.code == 0 && tx.event_name == contract::stop;
  Stops reported;
  if (valid && !parse_message(tx.event_payload, reported)) reported.Clear();
  const auto ours = [this](const auto& name) { return find(name) != nullptr; };
  const bool asks = asked && std::any_of(asked->drones().begin(), asked->drones().end(), ours);
  const bool tells =
      std::any_of(reported.stops().begin(), reported.stops().end(), [&](const Stop& s) { return ours(s.drone()); });
  if (!asks && !tells) return;
  access::Caller signer;
  if (const Refusal why = check_creator(std::nullopt, tx, signer); why != Refusal::none)
    return refuse_control_event(why, 0, out);
  std::optional<verification::ControlEvent> event;
  if (valid) {
    auto read = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
    if (read) {
      event = std::move(*read);
    } else {
      refuse_control_event(Refusal::altered, 0, out);
    }
  }
  if (!asks) return;
  const StopEvent said{.signer = signer,
                       .endorsed_by_us = event && endorsed_by({config_.msp_id}, std::nullopt, tx),
                       .again = std::find(heard_stops_.begin(), heard_stops_.end(), tx.tx_id) != heard_stops_.end(),
                       .event = event ? &*event : nullptr,
                       .tx = tx};
  for (Drone& drone : drones_) {
    if (std::find(asked->drones().begin(), asked->drones().end(), drone.name.name) == asked->drones().end()) continue;
    const Stop stop = verification::signed_stop(*asked, tx.event_payload, drone.name.name, to_message(signer.name));
    take_stop(now, said, stop, drone, out);
  }
}

void CommandCheck::take_stop(TimeNs now, const StopEvent& said, const Stop& stop, Drone& drone, Checked& out) {
  Control record = drone.control.value_or(Control());
  record.set_drone(drone.name.name);  // none was read yet: it is stopped for any pilot
  const Stop* reported = nullptr;
  if (said.event != nullptr) {
    const auto& stops = said.event->stops.stops();  // of exactly the drones that were asked for
    reported = &*std::find_if(stops.begin(), stops.end(), [&](const Stop& one) { return one.drone() == stop.drone(); });
    if (!verification::stop_follows(*said.event, record, *reported, said.signer)) {
      refuse_control_event(Refusal::altered, drone.name.number, out);
      reported = nullptr;
    }
  }
  const bool vouched = reported != nullptr && said.endorsed_by_us;
  if (!vouched && access::check_stop(record, said.signer, roles_.of(said.signer.name), false)) {
    const bool known = reported == nullptr && said.tx.code == 0;  // as altered
    if (!known) refuse_control_event(Refusal::may_not_stop, drone.name.number, out);
    return;
  }
  if (stop.clears() < clears_of(record, stop.stopper())) return;
  if (reported != nullptr) add_stop(record, *reported);
  if (!is_stopped_by(record, stop.stopper())) {
    if (said.again) return;
    drone.pending_stop = PendingStop{};
    if (heard_stops_.empty() || heard_stops_.back() != said.tx.tx_id) heard_stops_.push_back(said.tx.tx_id);
    if (heard_stops_.size() > max_remembered_stops) heard_stops_.pop_front();
    ++unconfirmed_stops_;
    const bool validated = said.tx.creator_fits && !said.tx.by_flag && said.tx.problem.empty();
    out.unconfirmed.push_back({drone.name.number, said.signer.name, said.tx.code, validated});
  }
  drone.control = std::move(record);
  if (auto plan = standing_stop(now, drone.name.number)) out.plans.push_back(*plan);
}

}  // namespace ledgerline::agent
