#include "ground/core/flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/access/stops.hpp"
#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "common/verification/calls.hpp"
#include "ground/core/manual.hpp"

namespace ledgerline::ground {
namespace {

constexpr std::uint64_t sequence_gap = 1000;
constexpr TimeNs new_enough_ns =
    200 * ns_per_ms;  // a state to make a plan from at once; agent takes none beyond 500 ms
constexpr TimeNs note_again_ns = 1 * ns_per_s;
constexpr std::size_t max_notes = 8;                         // of a drone in that time
constexpr std::size_t max_kind = 64, max_alarm_words = 300;  // bytes in the log: agent's own are no longer

}  // namespace

std::string name_of(GroundPhase phase) {
  constexpr std::array names{"waiting", "takeoff", "path", "manual", "landing", "landed", "failed"};
  static_assert(names.size() == enum_count<GroundPhase>);
  return names[static_cast<std::size_t>(phase)];
}

Task task_of(const FlightConfig& config, std::size_t drone) {
  if (const auto& own = config.drones[drone].task) return *own;
  return {config.shape, config.side_m, config.waypoints, config.controller.speed_mps, config.laps};
}

void set_velocity(const Twist& velocity, TimeNs came_ns, PilotCommand& command) {
  if (command.velocity) ++command.replaced;
  command.velocity = velocity;
  command.came_ns = came_ns;
}

std::optional<std::size_t> index_of(const std::vector<FlightDrone>& drones, std::string_view name) {
  for (std::size_t i = 0; i < drones.size(); ++i) {
    if (drones[i].name == name) return i;
  }
  return std::nullopt;
}

FlightCore::Drone::Drone(const FlightConfig& config, std::size_t i, const Lease& lease, const IntakeState& seen,
                         const PlanTiming& timing)
    : planner(config, i, lease, seen, status), phases(config, lease, seen, timing, planner, status) {}

FlightCore::FlightCore(FlightConfig config)
    : config_(std::move(config)),
      leases_(config_, transactions_),
      intake_(config_, leases_, transactions_),
      timing_(config_.drones.size()),
      stops_(config_.drones, config_.self),
      requests_(config_) {
  std::vector<CommandOutbox::Slot> slots;
  for (std::size_t i = 0; i < config_.drones.size(); ++i) {
    drones_.push_back(std::make_unique<Drone>(config_, i, leases_.of(i), intake_.of(i), timing_));
    Drone& drone = *drones_[i];
    slots.push_back({config_.drones[i], &drone.status, [&drone](std::uint64_t plan) { drone.planner.withdraw(plan); }});
  }
  if (!config_.ledger) return;
  outbox_.emplace(std::move(slots), timing_, transactions_);
}

Status FlightCore::set_control(const std::string& control) {
  Control record;
  if (auto status = parse_message(control, record); !status) return status;
  const auto change = leases_.set(record);
  if (!change) return change.error();
  if (*change) lease_changed(0, **change);
  return ledgerline::done;
}

FlightOutputs FlightCore::step(TimeNs now_ns, const FlightInputs& inputs) {
  if (started_ns_ == 0) {
    started_ns_ = now_ns;
    for (auto& drone : drones_) drone->phases.begin(now_ns);
  }
  FlightOutputs out;
  if (inputs.outcome) on_outcome(now_ns, inputs, out);
  if (inputs.block) on_block(now_ns, inputs, out);
  for (const StateSample& state : inputs.states) {
    const auto of = [&](const FlightDrone& drone) { return drone.number == state.drone; };
    const auto drone = std::ranges::find_if(config_.drones, of);
    if (drone != config_.drones.end())
      on_state(now_ns, static_cast<std::size_t>(drone - config_.drones.begin()), state, out);
  }
  const bool time_is_up = config_.manual && config_.seconds > 0 && now_ns - started_ns_ > from_seconds(config_.seconds);
  ending_ = ending_ || (config_.manual && (time_is_up || !inputs.land.empty()));
  // Of all commands in one step the safest counts, no matter who gives it.
  for (const PilotCommand& command : inputs.commands) {
    if (brings_down(command)) on_command(now_ns, command, out);
  }
  for (const PilotCommand& command : inputs.commands) {
    if (!brings_down(command)) on_command(now_ns, command, out);
  }
  for (std::size_t i = 0; i < drones_.size(); ++i) step_drone(now_ns, i, inputs, out);
  stops_.submit(now_ns, leases_, next_id_, out.submissions);
  requests_.step(now_ns, leases_, next_id_, out.submissions, out.notes);
  if (outbox_ && !inputs.more) outbox_->submit(now_ns, next_id_, out);
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    if (!drones_[i]->diagnosis.is_due(now_ns)) continue;
    Diagnosis::Finding finding = diagnose(now_ns, i);
    if (i < inputs.unheard.size() && !inputs.unheard[i].empty()) {
      finding.level = std::max(finding.level, DiagnosticLevel::warn);
      finding.words += "; " + inputs.unheard[i];
    }
    const auto found = drones_[i]->diagnosis.update(now_ns, std::move(finding));
    if (!found) continue;
    const std::string& name = config_.drones[i].name;
    const Header header{inputs.realtime_s * ns_per_s, name + "/base_link"};
    DroneUpdate& update = out.diagnoses.emplace_back();
    update.drone = i;
    update.diagnosis = diagnostic_to_cdr(header, name, found->level, found->words);
  }
  return out;
}

Diagnosis::Finding FlightCore::diagnose(TimeNs now_ns, std::size_t index) const {
  const Drone& drone = *drones_[index];
  const FlightStatus& status = drone.status;
  const Lease& lease = leases_.of(index);
  if (is_stopped(lease.stoppers)) return {DiagnosticLevel::error, "stopped by " + stopper_names(lease.stoppers)};
  if (status.phase == GroundPhase::failed) return {DiagnosticLevel::error, status.why};
  if (status.phase == GroundPhase::waiting || (config_.manual && status.phase == GroundPhase::landed)) {
    const Status ready = drone.phases.check_ready(now_ns);
    return ready ? Diagnosis::Finding{DiagnosticLevel::ok, "may take off"}
                 : Diagnosis::Finding{DiagnosticLevel::warn, ready.error().message};
  }
  if (!status.why.empty()) return {DiagnosticLevel::warn, status.why};
  return {DiagnosticLevel::ok, name_of(status.phase)};
}

void FlightCore::step_drone(TimeNs now_ns, std::size_t index, const FlightInputs& inputs, FlightOutputs& out) {
  Drone& drone = *drones_[index];
  if (ending_ && drone.phases.in_air()) drone.phases.land(now_ns, "");
  if (!inputs.land.empty() && !config_.manual) drone.phases.land(now_ns, inputs.land);
  if (drone.fresh) drone.phases.advance(now_ns, timing_.of(index).delay_ns);
  if (drone.fresh || (drone.commanded && now_ns - intake_.of(index).received_ns < new_enough_ns)) {
    if (auto command = drone.planner.make(now_ns, timing_.of(index))) {
      outbox_ ? outbox_->put(index, std::move(*command)) : emit_local_plan(now_ns, index, std::move(*command), out);
    }
  }
  drone.fresh = drone.commanded = false;
  if (const Status flown = drone.phases.check_takeoff(now_ns); !flown)
    refuse(now_ns, index, "no take-off: " + flown.error().message, out);
  if (const auto note = drone.phases.check_time(now_ns))
    out.notes.push_back(fmt::format("{}: {}", config_.drones[index].name, *note));
  if (drone.status.slowed_to_mps && !std::exchange(drone.slowed_said, true)) {
    out.notes.push_back(
        fmt::format("{}: slowed to {:.2f} m/s: at the age that its commands are flown with, more might leave the path",
                    config_.drones[index].name, *drone.status.slowed_to_mps));
  }
}

void FlightCore::on_block(TimeNs now_ns, const FlightInputs& inputs, FlightOutputs& out) {
  intake_.on_block(now_ns);
  std::size_t looked_at = out.updates.size();
  for (const fabric::Transaction& tx : inputs.block->transactions) {
    if (!tx.problem.empty()) ++transactions_.transactions_unverified;
    if (tx.code != 0 || tx.config) continue;
    if (tx.channel != config_.where.channel || tx.contract != config_.where.contract) continue;
    if (tx.event_name == contract::set) {
      for (const StateIntake::New& one : intake_.read(tx, inputs.realtime_s, out.updates))
        on_state(now_ns, one.drone, one.state, out);
      for (; looked_at < out.updates.size(); ++looked_at) on_alarm(out.updates[looked_at], out);
    } else if (tx.event_name == contract::command) {
      if (outbox_) outbox_->on_block(now_ns, tx);
    } else if (verification::is_control_event(tx.event_name)) {
      for (const LeaseBook::Change& change : leases_.on_event(tx, inputs.realtime_s)) lease_changed(now_ns, change);
    }
  }
}

void FlightCore::on_alarm(const DroneUpdate& update, FlightOutputs& out) {
  if (update.alarm.empty()) return;
  const auto alarms = alarms_from_cdr(update.alarm);
  if (!alarms) {
    ++transactions_.malformed;
    return;
  }
  FlightStatus& status = drones_[update.drone]->status;
  const std::string& name = config_.drones[update.drone].name;
  ++status.alarms;
  const auto standing = std::ranges::find_if(*alarms, [](const Alarm& alarm) { return alarm.stands; });
  status.ledger_untrusted = standing != alarms->end();
  out.notes.push_back(status.ledger_untrusted
                          ? fmt::format("{}: its agent does not trust the ledger: {} ({} times): {}", name,
                                        printable(standing->kind, max_kind), standing->count,
                                        printable(standing->words, max_alarm_words))
                          : fmt::format("{}: its agent trusts the ledger again", name));
}

void FlightCore::on_state(TimeNs now_ns, std::size_t index, const StateSample& sample, FlightOutputs& out) {
  if (!intake_.is_new(index, sample)) return;
  Drone& drone = *drones_[index];
  const bool same_boot = intake_.same_boot(index, sample);
  // A link that was started again while the drone flies has yet to find it: it knows nothing, and the silence goes on.
  drone.fresh = !(sample.phase == LinkPhase::disconnected && drone.phases.in_air());
  intake_.accept(index, sample, drone.fresh ? std::optional(now_ns) : std::nullopt);
  if (!same_boot && sample.applied_sequence > 0) {
    const std::uint64_t behind = sample.applied_sequence + sequence_gap;
    drone.next_sequence = std::max(drone.next_sequence, behind);
    if (outbox_) outbox_->continue_behind(index, behind);
  }
  timing_.observe(index, intake_.of(index).state);
  drone.planner.observe(same_boot);
  ++drone.status.states_received;
  out.traces.push_back({.t_ns = now_ns,
                        .kind = TraceKind::state_received,
                        .drone = config_.drones[index].number,
                        .id = sample.sequence,
                        .stamp_ns = sample.stamp_ns});
}

void FlightCore::lease_changed(TimeNs now_ns, const LeaseBook::Change& change) {
  if (change.new_epoch) {
    const Lease& lease = leases_.of(change.drone);
    const std::string organisation = lease.owner ? lease.owner->msp_id : std::string();
    if (outbox_) outbox_->begin_lease(change.drone, organisation, lease.epoch);
    timing_.begin_lease(change.drone);
  }
  Phases& phases = drones_[change.drone]->phases;
  phases.lease_changed(now_ns);
  // A path belongs to the pilot who gave it: the drone's new holder gives another.
  if (change.new_epoch && config_.manual && drones_[change.drone]->status.phase == GroundPhase::path)
    (void)phases.pause_path(now_ns);
}

void FlightCore::on_outcome(TimeNs now_ns, const FlightInputs& inputs, FlightOutputs& out) {
  if (const auto stop = stops_.on_outcome(now_ns, *inputs.outcome, inputs.outcome_id)) {
    if (!stop->problem.empty()) refuse(now_ns, stop->drone, stop->problem, out);
  } else if (const auto answer = requests_.on_outcome(now_ns, *inputs.outcome, inputs.outcome_id)) {
    if (!answer->problem.empty())
      out.notes.push_back(fmt::format("{}: {}", config_.drones[answer->drone].name, answer->problem));
  } else if (outbox_) {
    outbox_->on_outcome(now_ns, *inputs.outcome, inputs.outcome_id, out);
    if (!inputs.outcome->refusal) return;
    for (std::size_t i = 0; i < drones_.size(); ++i) {
      if (fabric::names(*inputs.outcome->refusal, config_.drones[i].name))
        drones_[i]->diagnosis.refuse(now_ns, inputs.outcome->message);
    }
  }
}

void FlightCore::on_command(TimeNs now_ns, const PilotCommand& command, FlightOutputs& out) {
  if (command.drone >= drones_.size()) return;
  Drone& drone = *drones_[command.drone];
  drone.commanded = true;
  const bool stop = command.stop || command.cut;
  if (stop) stops_.request(now_ns, command.drone, command.cut, command.by);
  if (command.cut && drone.phases.in_air()) drone.status.cut_in_air = true;
  if (command.clear_stop && !stop) {
    const Status asked = is_on_ground(command.drone)
                             ? stops_.request_clear(now_ns, command.drone)
                             : Error{"its stop is not cleared: it is not known to be on the ground"};
    if (!asked) refuse(now_ns, command.drone, asked.error().message, out);
  }
  if (stop || command.land) {
    const crypto::IdentityName& who = command.by ? *command.by : config_.self;
    const std::string why = stop             ? "stopped by " + who.msp_id + " " + who.subject
                            : config_.manual ? ""
                                             : "landed by its pilot";
    const Status landed = drone.phases.land_by_pilot(now_ns, why, stop);
    // A stop comes from the ledger, no matter who flies.
    if (!landed && !stop) refuse(now_ns, command.drone, "no landing: " + landed.error().message, out);
  } else if (const Status ours = check_holder(command); !ours) {
    if (command.takeoff || command.order || command.pause || command.velocity)
      refuse(now_ns, command.drone, ours.error().message, out);
    return;
  } else if ((command.takeoff || command.order) && stops_.pending(command.drone)) {
    refuse(now_ns, command.drone, "a stop of it is on its way to the ledger", out);
    return;
  } else if (command.takeoff) {
    if (const Status taken = drone.phases.take_off(now_ns, ending_); !taken)
      refuse(now_ns, command.drone, "no take-off: " + taken.error().message, out);
  }
  if (command.order && !stop && !command.land) {
    const TimeNs delay_ns = timing_.of(command.drone).delay_ns;
    if (const Status taken = drone.phases.apply_order(now_ns, *command.order, delay_ns); !taken)
      refuse(now_ns, command.drone, taken.error().message, out);
  }
  if (command.pause && !stop && !command.land) {
    if (const Status taken = drone.phases.pause_path(now_ns); !taken)
      refuse(now_ns, command.drone, taken.error().message, out);
  }
  PilotCounters& counters = drone.status.pilot;
  counters.replaced += command.replaced;
  counters.bad_values += command.bad_values;
  counters.malformed += command.malformed;
  counters.late += command.late;
  if (command.bad_values > 0) add_note(now_ns, command.drone, "a velocity that no drone can fly: not flown", out);
  if (command.late > 0 && !command.velocity)
    add_note(now_ns, command.drone, "a velocity was held back on its way: not flown", out);
  if (!command.velocity) return;
  if (drone.status.phase == GroundPhase::path && config_.manual && !command.order &&
      is_deliberate(*command.velocity, config_.controller) && drone.phases.pause_path(now_ns))
    add_note(now_ns, command.drone, "paused: its pilot flies it by hand; resume flies the rest of its path", out);
  if (drone.status.phase != GroundPhase::manual) {
    ++counters.not_flying;
    if (is_deliberate(*command.velocity, config_.controller))
      add_note(
          now_ns, command.drone,
          fmt::format("a velocity of its pilot is not flown: its flight is in phase {}", name_of(drone.status.phase)),
          out);
  } else {
    ++(drone.planner.manual().set_velocity(command.came_ns, *command.velocity) ? counters.velocities
                                                                               : counters.bad_values);
  }
}

bool FlightCore::is_on_ground(std::size_t index) const {
  const IntakeState& seen = intake_.of(index);
  return !is_flown(drones_[index]->status.phase) && seen.has_state && ledgerline::is_on_ground(seen.state.phase);
}

Status FlightCore::check_holder(const PilotCommand& command) const {
  const Lease& lease = leases_.of(command.drone);
  // We do not fly a drone that we do not command, no matter who asks for it.
  if (!lease.holder || lease.commander != config_.self) return ledgerline::done;
  if (lease.holder == (command.by ? *command.by : config_.self)) return ledgerline::done;
  return Error{"its lease is held by " + holder_words(lease) + ": the holder's word counts"};
}

// Counted always, each said once a second: a pilot's messages may come as fast as they like.
void FlightCore::refuse(TimeNs now_ns, std::size_t index, const std::string& why, FlightOutputs& out) {
  ++drones_[index]->status.pilot.refused;
  add_note(now_ns, index, why, out);
}

void FlightCore::add_note(TimeNs now_ns, std::size_t index, const std::string& why, FlightOutputs& out) {
  auto& said = drones_[index]->notes;
  std::erase_if(said, [&](const auto& one) { return one.second <= now_ns - note_again_ns; });
  if (said.size() >= max_notes || std::ranges::find(said, why, &Note::first) != said.end()) return;
  said.emplace_back(why, now_ns);
  drones_[index]->diagnosis.refuse(now_ns, why);
  out.notes.push_back(fmt::format("{}: {}", config_.drones[index].name, why));
}

// Without a ledger.
void FlightCore::emit_local_plan(TimeNs now_ns, std::size_t index, PlannedCommand command, FlightOutputs& out) {
  command.plan.set_sequence(drones_[index]->next_sequence++);
  command.plan.set_epoch(1);
  ++drones_[index]->status.commands.sent;
  out.traces.push_back(trace_of(config_.drones[index], command, now_ns));
  out.plans.push_back(verification::plan_of(config_.drones[index].number, command.plan));
}

bool FlightCore::done() const {
  // A stop is the ledger's business beyond this flight.
  if (stops_.pending()) return false;
  if (config_.manual) {
    return ending_ && std::ranges::none_of(drones_, [](const auto& d) {
             return d->phases.in_air() || d->status.phase == GroundPhase::landing;
           });
  }
  return std::ranges::all_of(drones_, [](const auto& d) { return d->status.phase >= GroundPhase::landed; });
}

bool FlightCore::ok() const {
  return std::ranges::all_of(drones_, [&](const auto& d) {
    // A person who flies by hand may end it by a stop as well, but not by a fall.
    if (config_.manual)
      return d->status.phase != GroundPhase::failed && !d->status.cut_in_air &&
             (d->status.why.empty() || is_landed_by_stop(d->status));
    return d->status.finished && d->status.phase == GroundPhase::landed && d->status.why.empty();
  });
}

std::string FlightCore::why() const {
  std::string all;
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    const std::string& why = drones_[i]->status.why;
    if (!why.empty()) all += fmt::format("{}{}: {}", all.empty() ? "" : "; ", config_.drones[i].name, why);
  }
  return all;
}

}  // namespace ledgerline::ground
