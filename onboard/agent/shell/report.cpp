#include "onboard/agent/shell/report.hpp"

#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/msg/names.hpp"
#include "common/rt/histogram.hpp"

namespace ledgerline::agent {
namespace {

using nlohmann::json;

constexpr TimeNs log_gap_ns = 1 * ns_per_s;       // of one kind of message
constexpr TimeNs unheard_gap_ns = 10 * ns_per_s;  // a peer may be away for long

json to_json(const Batcher::Counters& c) {
  return {{"sampled", c.sampled}, {"sent", c.sent},   {"on_ledger", c.on_ledger}, {"merged", c.merged},
          {"dropped", c.dropped}, {"stale", c.stale}, {"pending", c.pending}};
}

json to_json(const TransitionSender::Counters& c) {
  return {{"taken", c.taken},
          {"on_ledger", c.on_ledger},
          {"pending", c.pending},
          {"calls_repeated", c.calls_repeated},
          {"lost", c.lost}};
}

json refused_reasons(const CommandCheck::Counters& c) {
  json reasons = json::object();
  for (std::size_t i = 0; i < refusal_count; ++i) {
    if (c.reasons[i] > 0) reasons[std::string(refusal_name(static_cast<RefusalReason>(i)))] = c.reasons[i];
  }
  return reasons;
}

json to_json(const CommandCheck::Counters& c) {
  return {{"on_ledger", c.on_ledger},
          {"refused", c.refused},
          {"refused_reasons", refused_reasons(c)},
          {"verified", c.verified}};
}

json to_json(const Fusion::Counters& c) {
  return {{"accepted", c.accepted}, {"not_finite", c.not_finite}, {"not_newer", c.not_newer},
          {"outliers", c.outliers}, {"frozen", c.frozen},         {"resets", c.resets}};
}

json violations(const AgentCore& core) {
  json kinds = json::object();
  for (std::size_t i = 0; i < violation_kinds; ++i) {
    const auto kind = static_cast<IntegrityViolation>(i);
    if (core.integrity().of(kind).count > 0) kinds[std::string(name(kind))] = core.integrity().of(kind).count;
  }
  return kinds;
}

}  // namespace

bool advance_if_due(TimeNs now, TimeNs& next, TimeNs period_ns) {
  if (now < next) return false;
  next = now + period_ns;
  return true;
}

void AgentLog::outputs(const AgentOutputs& out) {
  if (core_.checks().failed() && !std::exchange(check_reported_, true))
    spdlog::error("{}a check failed, all drones land: {}", label_, core_.checks().first());
  refusals(out);
  evictions(out);
  for (const auto& stop : out.unconfirmed_stops) {
    spdlog::error(
        "{}drone {}: stopped by {} {}, which the block flags {}: it lands all the same; the stop is over when "
        "apply_stops shows that the ledger has no such stop",
        label_, stop.drone, stop.stopper.msp_id, printable(stop.stopper.subject), stop.code);
  }
  violations(out);
}

void AgentLog::plan_lost(const Plan& plan) const {
  spdlog::error("{}drone {}: plan {} was lost, no shared memory is left: is link running?", label_, plan.drone,
                plan.sequence);
}

void AgentLog::refusals(const AgentOutputs& out) {
  for (const TraceRecord& record : out.traces) {
    if (record.kind != TraceKind::refused || !advance_if_due(record.t_ns, next_refusal_ns_, log_gap_ns)) continue;
    const auto why = static_cast<RefusalReason>(record.extra);
    spdlog::warn("{}drone {}: command {} refused: {}{}", label_, record.drone, record.id, refusal_name(why),
                 why == RefusalReason::broken_chain ? ": " + core_.last_chain_error() : std::string());
  }
}

void AgentLog::violations(const AgentOutputs& out) const {
  for (const IntegrityMonitor::LogEntry& entry : out.violations)
    spdlog::error("{}the ledger is not trusted, {} ({} of {} since the last word): {}", label_, name(entry.kind),
                  entry.since, entry.count, entry.words);
}

void AgentLog::evictions(const AgentOutputs& out) const {
  using Next = fabric::Repeat::Next;
  const double idle_s = to_seconds(core_.idle().idle_ns());
  for (const AgentOutputs::Eviction& eviction : out.evictions) {
    if (!eviction.ended) {
      spdlog::info("{}{}: on the ground and no command of its holder for {:g} s: its lease is ended", label_,
                   eviction.drone, idle_s);
    } else if (*eviction.ended == Next::on_ledger) {
      spdlog::warn("{}{}: its idle holder has lost the lease; who wants to fly it acquires it", label_, eviction.drone);
    } else if (*eviction.ended == Next::again) {
      spdlog::warn("{}{}: its lease is not ended yet, tried again: {}", label_, eviction.drone, eviction.why);
    } else {
      spdlog::error("{}{}: its idle holder keeps the lease, tried again in {:g} s: {}{}", label_, eviction.drone,
                    idle_s, *eviction.ended == Next::refused ? "the contract refuses it: " : "", eviction.why);
    }
  }
}

void AgentLog::outcome(const fabric::Outcome& outcome) {
  if (!outcome.unheard.empty() && advance_if_due(monotonic_ns(), next_unheard_ns_, unheard_gap_ns))
    spdlog::warn("{}a call was endorsed by less than all peers that were asked: {}", label_, outcome.unheard);
  if (outcome.kind == fabric::Outcome::Kind::committed) return;
  if (!advance_if_due(monotonic_ns(), next_outcome_ns_, log_gap_ns)) return;
  spdlog::warn("{}a call did not get through (block {}, code {}): {}", label_, outcome.block, outcome.code,
               outcome.message);
}

void AgentLog::lost_transitions() {
  std::uint64_t lost = 0;
  for (const DroneName& drone : core_.drones()) lost += core_.report(drone.number).transitions.lost;
  if (lost > transitions_lost_)
    spdlog::error("{}{} transitions of the failsafe are lost: link had to keep more than it can", label_, lost);
  transitions_lost_ = lost;
}

std::string status_line(const AgentCore& core, const std::string& channel, TimeNs now,
                        std::optional<std::int64_t> certificate_days) {
  json drones = json::array();
  for (const DroneName& drone : core.drones()) {
    const DroneReport report = core.report(drone.number);
    const StateSample state = report.newest.value_or(StateSample{});
    const json position = state.pose_stamp_ns != 0 ? json(state.position_m) : json();
    json line = {{"name", drone.name},
                 {"phase", name(state.phase)},
                 {"mode", name(state.mode)},
                 {"position", position},
                 {"state_age_ms", nullptr},
                 {"command_age_ms", nullptr},
                 {"height_m", state.height_m},
                 {"two_way_ms", nullptr},
                 {"refused_reasons", refused_reasons(report.commands)}};
    if (report.newest) line["state_age_ms"] = to_ms(now - state.stamp_ns);
    if (report.last_command_verified_ns > 0) {
      line["command_age_ms"] = to_ms(now - report.last_command_verified_ns);
      line["two_way_ms"] = to_ms(report.two_way.quantile(0.5));
    }
    drones.push_back(std::move(line));
  }
  json line = {{"channel", channel},
               {"height", core.height()},
               {"ledger_alive", core.ledger_alive(now)},
               {"ledger_untrusted", core.integrity().stands(now)},
               {"integrity_violations", core.integrity().count()},
               {"transactions_by_flag", core.validated_share().by_flag()},
               {"drones", std::move(drones)}};
  if (certificate_days) line["certificate_days"] = *certificate_days;
  return json{{"agent", std::move(line)}}.dump();
}

std::string summary(const AgentCore& core, const std::string& channel, const ShellCounters& shell) {
  json drones = json::array();
  for (const DroneName& drone : core.drones()) {
    const DroneReport report = core.report(drone.number);
    drones.push_back({{"name", drone.name},
                      {"states", to_json(report.states)},
                      {"transitions", to_json(report.transitions)},
                      {"commands", to_json(report.commands)},
                      {"mocap", to_json(report.mocap)},
                      {"two_way_ms", report.two_way.quantiles_ms()}});
  }
  const Batcher::Transactions& t = core.transactions();
  const StopApplier& stops = core.stop_applier();
  return json{{"channel", channel},
              {"drones", drones},
              {"transactions",
               {{"committed", t.committed},
                {"invalidated", t.invalidated},
                {"refused", t.refused},
                {"unavailable", t.unavailable}}},
              {"blocks", core.blocks()},
              {"blocks_broken", core.check().broken_blocks()},
              {"ordered_blocks_confirmed_after_ms", shell.confirmed_after_ms},
              {"stops_applied", {{"on_ledger", stops.applied()}, {"repeated", stops.repeated()}}},
              {"evictions",
               {{"on_ledger", core.idle().counters().evicted},
                {"refused", core.idle().counters().refused},
                {"repeated", core.idle().counters().repeated},
                {"given_up", core.idle().counters().given_up}}},
              {"integrity_violations", core.integrity().count()},
              {"integrity_violations_by_kind", violations(core)},
              {"alarms",
               {{"on_ledger", core.alarms().counters().on_ledger},
                {"repeated", core.alarms().counters().repeated},
                {"refused", core.alarms().counters().refused}}},
              {"control_events_refused", core.control().refused_events()},
              {"stops_unconfirmed", core.control().unconfirmed_stops()},
              {"transactions_unverified", core.check().unverified_transactions()},
              {"transactions_by_flag", core.validated_share().by_flag()},
              {"transactions_not_by_flag", core.validated_share().validated()},
              {"blocks_not_read", shell.blocks_not_read},
              {"records_compared", shell.records_compared},
              {"records_differ", shell.records_differ},
              {"roles_left_out_of", core.control().roles_left_out()},
              {"link_wakes", shell.link_wakes},
              {"states_without_wake", shell.states_without_wake},
              {"plans_not_handed_over", shell.plans_not_handed_over},
              {"mocap_lost", shell.mocap_lost},
              {"mocap_implausible", shell.mocap_implausible}}
      .dump(2);
}

std::string summary_of_all(const std::vector<std::string>& channels) {
  json all = json::array();
  for (const std::string& one : channels) all.push_back(json::parse(one));
  return json{{"channels", all}}.dump(2);
}

}  // namespace ledgerline::agent
