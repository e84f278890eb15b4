#include "ground/core/flight/command_outbox.hpp"

#include <algorithm>
#include <set>

#include "common/msg/contract.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::ground {

TraceRecord trace_of(const FlightDrone& drone, const PlannedCommand& command, TimeNs at_ns) {
  TraceRecord record;
  record.t_ns = at_ns;
  record.kind = TraceKind::command_made;
  record.drone = drone.number;
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
  return record;
}

CommandOutbox::CommandOutbox(std::vector<Slot> slots, PlanTiming& timing, FlightTransactions& counters)
    : timing_(timing), counters_(counters) {
  for (Slot& slot : slots) drones_.push_back({.slot = std::move(slot)});
}

std::size_t CommandOutbox::drone_of(const PlannedCommand& command) const {
  const auto of = [&](const Waiting& drone) { return drone.slot.drone.name == command.plan.drone(); };
  return static_cast<std::size_t>(std::ranges::find_if(drones_, of) - drones_.begin());
}

void CommandOutbox::put(std::size_t drone, PlannedCommand command) {
  Waiting& waiting = drones_[drone];
  if (waiting.command) {
    ++waiting.slot.status->commands.merged;
    command.plan.set_sequence(waiting.command->plan.sequence());  // never sent, or refused with others: free again
    withdraw(*waiting.command);
  }
  waiting.command = std::move(command);
}

void CommandOutbox::begin_lease(std::size_t drone, const std::string& organisation, std::uint64_t epoch) {
  Waiting& waiting = drones_[drone];
  waiting.organisation = organisation;
  waiting.epoch = epoch;
  waiting.next_sequence = 1;
  if (waiting.command) withdraw(*waiting.command);
  waiting.command.reset();
}

void CommandOutbox::continue_behind(std::size_t drone, std::uint64_t sequence) {
  drones_[drone].next_sequence = std::max(drones_[drone].next_sequence, sequence);
}

void CommandOutbox::submit(TimeNs now, std::uint64_t& next_id, FlightOutputs& out) {
  std::set<std::string> organisations;
  for (const Waiting& waiting : drones_) {
    if (waiting.command) organisations.insert(waiting.organisation);
  }
  for (const std::string& organisation : organisations) submit_to(organisation, now, next_id, out);
}

void CommandOutbox::submit_to(const std::string& organisation, TimeNs now, std::uint64_t& next_id, FlightOutputs& out) {
  fabric::InFlight<Commands>& in_flight = in_flight_[organisation];
  if (in_flight.full() || !in_flight.may_go_behind_open(now)) return;
  Commands commands;
  CommandCall call;
  call.set_organisation(organisation);
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    Waiting& waiting = drones_[i];
    if (!waiting.command || waiting.organisation != organisation) continue;
    PlannedCommand command = std::move(*waiting.command);
    waiting.command.reset();
    if (command.plan.sequence() == 0) {
      command.plan.set_sequence(waiting.next_sequence++);
      ++waiting.slot.status->commands.sent;
      out.traces.push_back(trace_of(waiting.slot.drone, command, command.made_ns));
    }
    timing_.submitted(i, command.plan.sequence(), command.made_on_drone_ns);
    out.traces.push_back({.t_ns = now,
                          .kind = TraceKind::command_submitted,
                          .drone = waiting.slot.drone.number,
                          .extra = static_cast<std::uint32_t>(next_id),
                          .id = command.plan.sequence(),
                          .stamp_ns = command.plan.state_stamp_ns()});
    *call.add_plans() = command.plan;
    commands.push_back(std::move(command));
  }
  const std::uint64_t id = next_id++;
  ++counters_.submitted;
  out.submissions.push_back(
      {id, {contract::command, {call.SerializeAsString()}, true, verification::command_need(call.organisation())}});
  in_flight.add(id, now, std::move(commands));
}

void CommandOutbox::on_block(TimeNs now, const fabric::Transaction& tx) {
  CommandCall call;
  const verification::Match match = verification::match_command({tx.function, tx.args}, tx.event_payload, call);
  if (match != verification::Match::same || call.plans().empty()) return;
  const DronePlan& first = call.plans(0);
  const auto in_flight = in_flight_.find(call.organisation());
  if (in_flight == in_flight_.end()) return;
  const auto submitted_ns = in_flight->second.mark_in_block([&](const Commands& commands) {
    const DronePlan& mine = commands.front().plan;
    return mine.drone() == first.drone() && mine.sequence() == first.sequence() && mine.epoch() == first.epoch() &&
           mine.state_stamp_ns() == first.state_stamp_ns();
  });
  if (submitted_ns) timing_.measure(now - *submitted_ns);
}

void CommandOutbox::on_outcome(TimeNs now, const fabric::Outcome& outcome, std::uint64_t id, FlightOutputs& out) {
  std::optional<fabric::InFlight<Commands>::Entry> ended;
  for (auto& [organisation, in_flight] : in_flight_) {
    if ((ended = in_flight.end(id, outcome))) break;
  }
  if (!ended) return;
  for (const auto& [kind, t_ns] : {std::pair{TraceKind::call_endorsed, outcome.endorsed_ns},
                                   std::pair{TraceKind::call_ordered, outcome.ordered_ns}}) {
    if (t_ns != 0) out.traces.push_back({.t_ns = t_ns, .kind = kind, .id = id, .stamp_ns = ended->submitted_ns});
  }
  using Kind = fabric::Outcome::Kind;
  if (outcome.kind != Kind::committed && outcome.kind != Kind::refused) {
    for (const PlannedCommand& command : ended->what) withdraw(command);
  }
  switch (outcome.kind) {
    case Kind::committed:
      ++counters_.committed;
      if (!ended->in_block) timing_.measure(now - ended->submitted_ns);
      return;
    case Kind::invalidated:
      ++counters_.invalidated;
      return;
    case Kind::refused:
      ++counters_.refused;
      resend(ended->what, outcome);
      return;
    case Kind::unavailable:
      ++counters_.unavailable;
      return;
    case Kind::overloaded:
      ++counters_.overloaded;
      return;
  }
}

// All plans but the refused drone's wait again, unless a newer one does already.
void CommandOutbox::resend(Commands& refused, const fabric::Outcome& outcome) {
  const auto names = [&](const PlannedCommand& command) {
    return outcome.refusal && fabric::names(*outcome.refusal, command.plan.drone());
  };
  const bool one_drone = std::ranges::any_of(refused, names);
  for (PlannedCommand& command : refused) {
    Waiting& waiting = drones_[drone_of(command)];
    if (!one_drone || names(command)) {
      ++waiting.slot.status->commands.refused;
      withdraw(command);
    } else if (waiting.command || command.plan.sequence() + 1 != waiting.next_sequence) {
      ++waiting.slot.status->commands.merged;  // a newer one waits, or is on its way
      withdraw(command);
    } else if (command.plan.epoch() == waiting.epoch) {
      waiting.command = std::move(command);
    } else {
      withdraw(command);  // of an earlier lease
    }
  }
}

}  // namespace ledgerline::ground
