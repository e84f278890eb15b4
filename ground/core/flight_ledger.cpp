// FlightCore's talk with the ledger: states and records out of blocks, calls and what became of them.
#include <fmt/format.h>

#include <algorithm>

#include "common/belief/calls.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "common/msg/stops.hpp"
#include "ground/core/flight_state.hpp"

namespace ledgerline::ground {
namespace {

constexpr std::uint64_t sequence_gap = 1000;
constexpr TimeNs least_delay_ns = 10 * ns_per_ms;
constexpr TimeNs max_beyond_ns = 1'900 * ns_per_ms;  // agent takes no setpoint for later than 2 s from now
// Of the plans: there before their first setpoint's moment. More would make all of them for later, and what is not
// foreseen (gusts) grows with that; one that comes late only takes over late.
constexpr double in_time = 0.75;
constexpr double quick = 0.1;        // of the plans
constexpr double almost_all = 0.99;  // of the plans: what their length is for
constexpr std::size_t arrivals_needed = 8;

crypto::IdentityName to_name(const Identity& identity) { return {identity.msp_id(), identity.subject()}; }

}  // namespace

Status FlightCore::set_control(const std::string& control) {
  Control record;
  if (auto status = parse_message(control, record); !status) return status;
  if (!find(record.drone())) return Error{fmt::format("a record of {} came, which does not fly here", record.drone())};
  take_control(0, record);
  return ledgerline::done;
}

void FlightCore::take_control(TimeNs now_ns, const Control& control) {
  Drone* drone = find(control.drone());
  if (!drone || control.epoch() < drone->epoch) return;
  if (control.epoch() != drone->epoch) {
    drone->next_sequence = 1;
    if (drone->pending) forget(*drone->pending);
    drone->pending.reset();
    drone->made = {};
    drone->arrivals = {};
    drone->timing.reset();
  }
  drone->record = control;
  drone->epoch = control.epoch();
  drone->owner.reset();
  drone->holder.reset();
  drone->stoppers.clear_stoppers();
  *drone->stoppers.mutable_stoppers() = control.stoppers();
  if (control.has_owner()) drone->owner = to_name(control.owner());
  if (control.has_holder()) drone->holder = to_name(control.holder());
  if (!drone->in_air_phase()) return;
  if (is_stopped(drone->stoppers)) {
    land(now_ns, *drone, "stopped by " + stopper_names(drone->stoppers));
  } else if (drone->holder != config_.self) {
    end_path(*drone);
    drone->status.why = "lost its lease" + (drone->holder ? " to " + drone->holder->subject : "");
    enter(now_ns, *drone, DronePhase::failed);
  }
}

// Who signed it; nobody who is believed: none.
std::optional<belief::Creator> FlightCore::creator_of(const fabric::Transaction& tx, std::int64_t realtime_s) const {
  const auto member = config_.believed->member(tx.creator, realtime_s);
  if (!member || !(*member)->verifier->verify(tx.payload, tx.signature)) return std::nullopt;
  return belief::Creator{(*member)->name, (*member)->admin};
}

void FlightCore::take_control_event(TimeNs now_ns, const fabric::Transaction& tx, std::int64_t realtime_s) {
  const auto event = belief::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
  if (!event) {
    ++transactions_.altered;
    return;
  }
  const auto ours = [&](const auto& all) {
    return std::any_of(all.begin(), all.end(), [&](const auto& one) { return find(one.drone()); });
  };
  if (!ours(event->controls.controls()) && !ours(event->stops.stops())) return;
  std::optional<belief::Creator> creator;
  if (config_.believed && !(creator = creator_of(tx, realtime_s))) {
    ++transactions_.unbelieved;
    return;
  }
  for (const Control& control : event->controls.controls()) {
    const Drone* drone = find(control.drone());
    const bool follows =
        drone && (!creator || (drone->record && belief::control_follows(*event, *drone->record, control, *creator)));
    if (drone && !follows) ++transactions_.altered;
    if (follows) take_control(now_ns, control);
  }
  for (const Stop& stop : event->stops.stops()) {
    const Drone* drone = find(stop.drone());
    const bool follows =
        drone && (!creator || belief::stop_follows(*event, drone->record.value_or(Control()), stop, *creator));
    if (drone && !follows) ++transactions_.altered;
    if (follows) take_stop(now_ns, stop);
  }
}

void FlightCore::take_stop(TimeNs now_ns, const Stop& stop) {
  Drone& drone = *find(stop.drone());
  add_stop(drone.stoppers, stop);
  if (drone.record) add_stop(*drone.record, stop);
  if (drone.in_air_phase()) land(now_ns, drone, "stopped by " + stopper_names(drone.stoppers));
}

void FlightCore::take_block(TimeNs now_ns, const FlightInputs& inputs, FlightOutputs& out) {
  for (const fabric::Transaction& tx : inputs.block->transactions) {
    if (tx.code == fabric::code_unbelievable) ++transactions_.unbelievable;
    if (tx.code != 0 || tx.config) continue;
    if (tx.channel != config_.where.channel || tx.contract != config_.where.contract) continue;
    if (tx.event_name == contract::set) {
      take_states(now_ns, tx, inputs.realtime_s, out);
    } else if (tx.event_name == contract::command) {
      take_own_commands(now_ns, tx);
    } else if (belief::is_control_event(tx.event_name)) {
      take_control_event(now_ns, tx, inputs.realtime_s);
    }
  }
}

// The contract let only the drone's owner write; this is the check that does not lean on the peer.
bool FlightCore::believed(const fabric::Transaction& tx, std::int64_t realtime_s, const Drone& drone) const {
  if (!config_.believed) return true;
  const auto member = config_.believed->member(tx.creator, realtime_s);
  if (!member || (drone.owner && (*member)->name != *drone.owner)) return false;
  return (*member)->verifier->verify(tx.payload, tx.signature);
}

void FlightCore::take_states(TimeNs now_ns, const fabric::Transaction& tx, std::int64_t realtime_s,
                             FlightOutputs& out) {
  SetCall call;  // as it was signed; whatever else the event says is the peer's alone
  const belief::Match match = belief::match_set({tx.function, tx.args}, tx.event_payload, call);
  if (match != belief::Match::same) {
    ++(match == belief::Match::malformed ? transactions_.malformed : transactions_.altered);
    return;
  }
  const Drone* checked = nullptr;  // the signature is checked once per drone in a row, not per asset
  std::vector<DroneNews> all(drones_.size());
  for (const Asset& asset : call.assets()) {
    const auto slash = asset.id().find('/');
    Drone* drone = find(std::string_view(asset.id()).substr(0, slash));
    if (!drone || slash == std::string::npos) continue;
    const auto what = std::string_view(asset.id()).substr(slash + 1);
    const bool status = what == "link" && asset.msg_type() == link_status_type;
    const bool odometry = what == "odom" && asset.msg_type() == odometry_type;
    const bool battery = what == "battery" && asset.msg_type() == battery_type;
    const bool transitions = what == "failsafe" && asset.msg_type() == transitions_type;
    if (!status && !odometry && !battery && !transitions) continue;
    if (drone != checked) {
      if (!believed(tx, realtime_s, *drone)) {
        ++transactions_.unbelieved;
        continue;
      }
      checked = drone;
    }
    DroneNews& news = all[drone->index];
    if (odometry) news.odometry = asset.msg_data();
    if (battery) news.battery = asset.msg_data();
    if (transitions) news.transitions = asset.msg_data();
    if (!status) continue;
    auto sample = link_status_from_cdr(asset.msg_data());
    if (!sample) {
      ++transactions_.malformed;
      continue;
    }
    if (drone->has_state && sample->boot_id == drone->state.boot_id && sample->sequence <= drone->state.sequence)
      continue;
    news.state = *sample;
    take_state(now_ns, *drone, *sample, out);
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    DroneNews& news = all[i];
    news.drone = i;
    if (!news.state) news.odometry = news.battery = "";  // sent again for the frame's sake
    if (news.state || !news.transitions.empty()) out.news.push_back(std::move(news));
  }
}

void FlightCore::take_state(TimeNs now_ns, Drone& drone, const StateSample& sample, FlightOutputs& out) {
  const bool same_boot = drone.has_state && sample.boot_id == drone.state.boot_id;
  if (same_boot && sample.sequence <= drone.state.sequence) return;
  if (!same_boot) {
    drone.first_setpoint_ns = 0;
    drone.manual = ManualController(config_.controller, config_.cmd_timeout_ns);
  }
  drone.state = sample;
  drone.state.drone = drone.who.number;
  drone.has_state = true;
  // A link that was started again while the drone flies has yet to find it: it knows nothing, and the silence goes on.
  drone.fresh = !(sample.phase == FlightPhase::disconnected && drone.in_air_phase());
  if (drone.fresh) drone.received_ns = now_ns;
  // A ground that was started again under the same lease goes on behind what was flown, and what may be under way.
  if (!same_boot && sample.applied_sequence > 0)
    drone.next_sequence = std::max(drone.next_sequence, sample.applied_sequence + sequence_gap);
  observe(drone);
  ++drone.status.states_received;
  TraceRecord record;
  record.t_ns = now_ns;
  record.kind = TraceKind::state_received;
  record.drone = drone.who.number;
  record.id = sample.sequence;
  record.stamp_ns = sample.stamp_ns;
  out.traces.push_back(record);
}

// Every state counts, not the newest of a burst alone.
void FlightCore::observe(Drone& drone) {
  const StateSample& s = drone.state;
  if (s.applied_sequence != drone.applied_sequence) drone.margin.add(s.applied_late_ns);
  drone.applied_sequence = s.applied_sequence;
  const auto made = [&](std::uint64_t sequence) {
    const Drone::Made& one = drone.made[sequence % drone.made.size()];
    return sequence != 0 && one.sequence == sequence ? std::optional(one.stamp_ns) : std::nullopt;
  };
  if (s.arrived_sequence != drone.arrived_sequence) {
    drone.arrived_sequence = s.arrived_sequence;
    if (const auto made_ns = made(s.arrived_sequence)) drone.arrivals.add(std::max<TimeNs>(0, s.arrived_ns - *made_ns));
    if (drone.arrivals.size() >= arrivals_needed) {
      const auto at = [&](double q) { return drone.arrivals.quantile(q).value_or(0); };
      drone.timing = timing_for(at(quick), at(in_time), at(almost_all) - at(0.5));
    }
  } else if (const auto next_ns = made(s.arrived_sequence + 1);
             next_ns && s.stamp_ns - *next_ns > timing(drone).delay_ns + overdue_ns) {
    drone.arrivals = {};
    drone.timing.reset();
  }
  if (s.phase != FlightPhase::flying) return;
  if (drone.controller) drone.controller->observe(s, drone.margin.value_ns());
  if (config_.manual) drone.manual.observe(s, drone.margin.value_ns());
}

void FlightCore::take_own_commands(TimeNs now_ns, const fabric::Transaction& tx) {
  CommandCall call;
  const belief::Match match = belief::match_command({tx.function, tx.args}, tx.event_payload, call);
  if (match != belief::Match::same || call.plans().empty()) return;
  const DronePlan& first = call.plans(0);
  const auto submitted_ns = in_flight_.landed([&](const Commands& commands) {
    const DronePlan& mine = commands.front().plan;
    return mine.drone() == first.drone() && mine.sequence() == first.sequence() && mine.epoch() == first.epoch() &&
           mine.state_stamp_ns() == first.state_stamp_ns();
  });
  if (submitted_ns) measure(now_ns - *submitted_ns);
}

void FlightCore::measure(TimeNs one_way_ns) {
  two_way_.add(one_way_ns);
  guess_ = timing_for(two_way_.own(quick), two_way_.quantile(in_time),
                      two_way_.quantile(almost_all) - two_way_.quantile(0.5));
}

FlightCore::Timing FlightCore::timing_for(TimeNs soonest_ns, TimeNs in_time_ns, TimeNs tail_ns) {
  Timing timing;
  // Long enough for two successors in a row that come as late as one of a hundred.
  timing.steps = std::min<std::size_t>(
      max_setpoints, PathController::steps + static_cast<std::size_t>(2 * tail_ns / PathController::step_ns));
  // After an outage the tail is long, and agent would refuse every plan that comes sooner: none may speak of more than
  // max_beyond_ns behind its arrival, be it as quick as one of ten. Shorter plans first (see make_plan), then sooner
  // ones.
  timing.farthest_ns = soonest_ns + max_beyond_ns;
  timing.delay_ns = std::min(std::clamp(in_time_ns, least_delay_ns, max_delay_ns),
                             timing.farthest_ns - static_cast<TimeNs>(PathController::steps) * PathController::step_ns);
  return timing;
}

const FlightCore::Timing& FlightCore::timing(const Drone& drone) const { return drone.timing ? *drone.timing : guess_; }

// A plan that will not be flown.
void FlightCore::forget(const PlannedCommand& command) {
  Drone* drone = find(command.plan.drone());
  if (!drone) return;
  if (drone->controller) drone->controller->withdraw(command.id);
  drone->manual.withdraw(command.id);
}

void FlightCore::take_outcome(TimeNs now_ns, const fabric::Outcome& outcome, std::uint64_t id, FlightOutputs& out) {
  if (take_stop_outcome(now_ns, outcome, id, out)) return;
  auto ended = in_flight_.end(id, outcome);
  if (!ended) return;
  Commands& commands = ended->what;
  for (const auto& [kind, t_ns] : {std::pair{TraceKind::call_endorsed, outcome.endorsed_ns},
                                   std::pair{TraceKind::call_ordered, outcome.ordered_ns}}) {
    if (t_ns != 0) out.traces.push_back({.t_ns = t_ns, .kind = kind, .id = id, .stamp_ns = ended->submitted_ns});
  }
  if (outcome.kind != fabric::Outcome::Kind::committed && outcome.kind != fabric::Outcome::Kind::refused) {
    for (const PlannedCommand& command : commands) forget(command);
  }
  switch (outcome.kind) {
    case fabric::Outcome::Kind::committed:
      ++transactions_.committed;
      if (!ended->landed) measure(now_ns - ended->submitted_ns);
      return;
    case fabric::Outcome::Kind::invalidated:
      ++transactions_.invalidated;
      return;
    case fabric::Outcome::Kind::refused:
      ++transactions_.refused;
      resend(commands, outcome);
      return;
    case fabric::Outcome::Kind::unavailable:
      ++transactions_.unavailable;
      return;
    case fabric::Outcome::Kind::overloaded:
      ++transactions_.overloaded;
      return;
  }
}

// All plans but the refused drone's wait again, unless a newer one does already.
void FlightCore::resend(Commands& refused, const fabric::Outcome& outcome) {
  const auto names = [&](const Drone& drone) {
    return outcome.refusal && fabric::names(*outcome.refusal, drone.who.name);
  };
  const bool one_drone = std::any_of(refused.begin(), refused.end(),
                                     [&](const PlannedCommand& c) { return names(*find(c.plan.drone())); });
  for (PlannedCommand& command : refused) {
    Drone& drone = *find(command.plan.drone());
    if (!one_drone || names(drone)) {
      ++drone.status.commands_refused;
      forget(command);
    } else if (drone.pending || command.plan.sequence() + 1 != drone.next_sequence) {
      ++drone.status.commands_merged;  // a newer one waits, or is on its way
      forget(command);
    } else if (command.plan.epoch() == drone.epoch) {
      drone.pending = std::move(command);
    } else {
      forget(command);  // of an earlier lease
    }
  }
}

void FlightCore::submit_pending(TimeNs now_ns, FlightOutputs& out) {
  if (in_flight_.full() || !in_flight_.may_go_behind_open(now_ns)) return;
  Commands commands;
  CommandCall call;
  for (auto& drone : drones_) {
    if (!drone->pending) continue;
    PlannedCommand command = std::move(*drone->pending);
    drone->pending.reset();
    if (command.plan.sequence() == 0) {
      command.plan.set_sequence(drone->next_sequence++);
      ++drone->status.commands_sent;
      TraceRecord record;
      record.t_ns = command.made_ns;
      record.kind = TraceKind::command_made;
      record.drone = drone->who.number;
      record.extra = static_cast<std::uint32_t>(command.plan.action());
      record.id = command.plan.sequence();
      record.stamp_ns = command.plan.state_stamp_ns();
      if (!command.plan.setpoints().empty()) {
        const PlannedSetpoint& first = command.plan.setpoints(0);
        record.v[0] = first.vx();
        record.v[1] = first.vy();
        record.v[2] = first.vz();
      }
      record.v[3] = command.progress_m;
      out.traces.push_back(record);
    }
    // Of a number that is used again, what is made newest counts.
    drone->made[command.plan.sequence() % drone->made.size()] = {command.plan.sequence(), command.made_stamp_ns};
    out.traces.push_back({.t_ns = now_ns,
                          .kind = TraceKind::command_submitted,
                          .drone = drone->who.number,
                          .extra = static_cast<std::uint32_t>(next_id_),
                          .id = command.plan.sequence(),
                          .stamp_ns = command.plan.state_stamp_ns()});
    *call.add_plans() = command.plan;
    commands.push_back(std::move(command));
  }
  if (commands.empty()) return;
  const std::uint64_t id = next_id_++;
  ++transactions_.submitted;
  out.submissions.push_back({id, {contract::command, {call.SerializeAsString()}, true}});
  in_flight_.add(id, now_ns, std::move(commands));
}

// Without a ledger.
void FlightCore::hand_over_plans(TimeNs now_ns, FlightOutputs& out) {
  for (auto& drone : drones_) {
    if (!drone->pending) continue;
    const PlannedCommand command = std::move(*drone->pending);
    drone->pending.reset();
    Plan plan;
    plan.drone = drone->who.number;
    plan.action = static_cast<PlanAction>(command.plan.action());
    plan.sequence = drone->next_sequence++;
    plan.epoch = 1;
    plan.state_stamp_ns = command.plan.state_stamp_ns();
    plan.count = static_cast<std::uint32_t>(command.plan.setpoints_size());
    for (std::uint32_t i = 0; i < plan.count; ++i) {
      const PlannedSetpoint& s = command.plan.setpoints(static_cast<int>(i));
      plan.setpoints[i] = {s.at_ns(), {s.vx(), s.vy(), s.vz()}, s.yaw_rate()};
    }
    ++drone->status.commands_sent;
    TraceRecord record;
    record.t_ns = now_ns;
    record.kind = TraceKind::command_made;
    record.drone = drone->who.number;
    record.extra = static_cast<std::uint32_t>(plan.action);
    record.id = plan.sequence;
    record.stamp_ns = plan.state_stamp_ns;
    for (std::size_t i = 0; i < 3 && plan.count > 0; ++i)
      record.v[i] = static_cast<double>(plan.setpoints[0].velocity_mps[i]);
    record.v[3] = command.progress_m;
    out.traces.push_back(record);
    out.plans.push_back(plan);
  }
}

}  // namespace ledgerline::ground
