#include "tools/report/results.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/text.hpp"
#include "common/rt/histogram.hpp"

namespace ledgerline::report {
namespace {

using nlohmann::json;

json read_summary(const launcher::RunFiles& files, const std::string& program, Results& results) {
  std::ifstream file(files.summary(program));
  json summary = json::parse(file, nullptr, false);
  if (summary.is_object()) return summary;
  results.missing.push_back(files.summary(program));
  return json::object();
}

std::vector<TraceRecord> read(const launcher::RunFiles& files, const std::string& program, Results& results) {
  std::vector<TraceRecord> all;
  const auto append = [&](const std::string& file) {
    const auto trace = read_trace(file);
    if (trace) all.insert(all.end(), trace->begin(), trace->end());
    if (!trace) results.missing.push_back(file);
  };
  const auto restarts = results.onboard_restarts.find(program);
  const std::uint64_t times = restarts == results.onboard_restarts.end() ? 0 : restarts->second;
  for (std::uint64_t i = 1; i <= times; ++i) append(files.trace(program, i));
  append(files.trace(program));
  return all;
}

const json& at(const json& object, const std::string& key) {
  static const json nothing;
  if (!object.is_object()) return nothing;
  const auto found = object.find(key);
  return found == object.end() ? nothing : *found;
}

double number_of(const json& value) { return value.is_number() ? value.get<double>() : 0; }

// Beyond these it is no count and no time: a damaged file.
std::uint64_t count_of(const json& value) {
  const double number = number_of(value);
  return number > 0 && number < 1e15 ? static_cast<std::uint64_t>(number) : 0;
}
std::uint64_t count_of(const json& object, const std::string& key) { return count_of(at(object, key)); }
TimeNs time_of(const json& value) { return static_cast<TimeNs>(std::clamp(number_of(value), 0.0, 4e18)); }
bool is_time(TimeNs t) { return t >= 0 && t <= INT64_MAX / 2; }

Quantiles quantiles_in(const json& q) {
  const auto part = [&](const char* name) { return number_of(at(q, name)); };
  return {part("p5"),  part("q1"),  part("median"), part("q3"),
          part("p95"), part("p99"), part("max"),    count_of(q, "count")};
}

const json& drone_in(const json& summary, const std::string& name) {
  static const json nothing;
  for (const json& drone : at(summary, "drones")) {
    if (at(drone, "name") == name) return drone;
  }
  return nothing;
}

std::vector<std::array<double, 2>> flown_path(const std::vector<TraceRecord>& truth, std::uint16_t drone,
                                              TimeNs begin_ns, TimeNs end_ns) {
  constexpr TimeNs apart_ns = 40 * ns_per_ms;  // for the eye; metrics are made from all records
  std::vector<std::array<double, 2>> points;
  TimeNs last_ns = 0;
  for (const TraceRecord& r : truth) {
    if (r.kind != TraceKind::truth || r.drone != drone || r.t_ns < begin_ns || r.t_ns > end_ns) continue;
    if (!points.empty() && r.t_ns - last_ns < apart_ns) continue;
    points.push_back({r.v[0], r.v[1]});
    last_ns = r.t_ns;
  }
  return points;
}

void read_path(const json& ground, const std::vector<TraceRecord>& truth, std::uint16_t number,
               const launcher::Options& asked, DroneResult& drone) {
  const json& origin = at(ground, "origin");
  const json& between = at(ground, "path_ns");
  if (!origin.is_array() || origin.size() != 2 || !between.is_array() || between.size() != 2) return;
  const TimeNs begin_ns = time_of(between[0]), end_ns = time_of(between[1]);
  // By hand it may have taken off more than once: path_ns is of the last time.
  drone.flown = asked.manual ? flown_path(truth, number, 0, INT64_MAX) : flown_path(truth, number, begin_ns, end_ns);
  if (asked.manual) return;
  const ground::Path path = launcher::path_of(asked, number, {number_of(origin[0]), number_of(origin[1])});
  for (const auto& corner : path.corners()) drone.wanted.push_back({corner.x(), corner.y()});
  if (!drone.wanted.empty()) drone.wanted.push_back(drone.wanted.front());
  if (asked.own) return;
  const CrossTrack error = cross_track(truth, number, path, begin_ns, end_ns);
  drone.path_flown = error.count > 0;
  drone.cross_track_rms_m = error.rms_m;
  drone.cross_track_max_m = error.max_m;
  TimeNs from_ns = begin_ns;
  for (const double lap_s : drone.lap_s) {
    const TimeNs to_ns = from_ns + from_seconds(std::clamp(lap_s, 0.0, 1e6));
    const CrossTrack of_lap = cross_track(truth, number, path, from_ns, to_ns);
    const double asked_mps = asked.ramp.start_mps > 0
                                 ? asked.ramp.start_mps + asked.ramp.step_mps * static_cast<double>(drone.turns.size())
                                 : launcher::task_of(asked, number).course.speed_mps;
    drone.turns.push_back(
        {asked_mps, lap_s > 0 ? number_of(at(ground, "lap_m")) / lap_s : 0, of_lap.rms_m, of_lap.max_m});
    from_ns = to_ns;
  }
}

}  // namespace

std::vector<Sample> latencies(const std::vector<TraceRecord>& trace, TraceKind kind, std::uint16_t drone,
                              TimeNs begin_ns) {
  std::vector<Sample> samples;
  std::set<std::uint64_t> seen;
  for (const TraceRecord& r : trace) {
    if (r.kind != kind || r.drone != drone || !is_time(r.t_ns) || !is_time(r.stamp_ns)) continue;
    if (!seen.insert(r.id).second) continue;
    samples.push_back({to_seconds(r.t_ns - begin_ns), to_ms(r.t_ns - r.stamp_ns)});
  }
  return samples;
}

Quantiles quantiles_of(const std::vector<Sample>& samples) {
  Histogram histogram;
  for (const Sample& s : samples) histogram.add(from_seconds(s.ms * 1e-3));
  return histogram.quantiles_ms();
}

CrossTrack cross_track(const std::vector<TraceRecord>& truth, std::uint16_t drone, const ground::Path& path,
                       TimeNs begin_ns, TimeNs end_ns) {
  CrossTrack result;
  double squares = 0;
  for (const TraceRecord& r : truth) {
    if (r.kind != TraceKind::truth || r.drone != drone || r.t_ns < begin_ns || r.t_ns > end_ns) continue;
    const double off_m = path.distance_m({r.v[0], r.v[1]});
    squares += off_m * off_m;
    result.max_m = std::max(result.max_m, off_m);
    ++result.count;
  }
  if (result.count > 0) result.rms_m = std::sqrt(squares / static_cast<double>(result.count));
  return result;
}

namespace {

/// What the programs of a flight left behind.
struct Left {
  json node, link, agent, ground;  ///< summaries
  std::vector<TraceRecord> link_trace, agent_trace, truth;
};

Left read_left(const launcher::RunFiles& files, const launcher::Options& asked, Results& results) {
  const bool ledger = asked.ledger != launcher::Ledger::none;
  const std::string controller = launcher::controller_program(asked);
  Left left;
  const std::string node = launcher::ledger_program(asked);
  left.node = node.empty() ? json::object() : read_summary(files, node, results);
  left.link = read_summary(files, "link", results);
  left.agent = ledger ? read_summary(files, "agent", results) : json::object();
  left.ground = read_summary(files, controller, results);
  left.link_trace = read(files, "link", results);
  left.agent_trace = read(files, ledger ? "agent" : controller, results);
  if (!asked.own) left.truth = read(files, "sim", results);  // nobody else knows where drones really are
  return left;
}

std::vector<SwitchedFault> read_faults(const launcher::RunFiles& files, TimeNs begin_ns, Results& results) {
  std::vector<SwitchedFault> faults;
  for (const auto& [asked, program] :
       {std::pair(results.asked.proxy, launcher::proxy_name), std::pair(results.asked.shim, std::string("sim"))}) {
    const json summary = asked ? read_summary(files, program, results) : json::object();
    for (const json& one : at(summary, "switched")) {
      const json& command = at(one, "command");
      if (command.is_string())
        faults.push_back({to_seconds(time_of(at(one, "t_ns")) - begin_ns), printable(command.get<std::string>())});
    }
  }
  std::ranges::stable_sort(faults, {}, &SwitchedFault::t_s);
  return faults;
}

void read_ledger(const json& node, const launcher::RunRecord& record, Results& results) {
  results.blocks = count_of(node, "blocks");
  results.transactions = count_of(node, "transactions");
  results.disk_ms = quantiles_in(at(node, "disk_ms"));
  results.storage = at(node, "storage").is_string() ? at(node, "storage").get<std::string>() : "unknown";
  if (results.flight_s > 0) {
    constexpr double hour_s = 3600;
    results.bytes_per_drone_hour =
        static_cast<double>(record.ledger_grown_bytes) / results.asked.drones / results.flight_s * hour_s;
  }
  const json& restarts = at(node, "restarts");
  for (const auto& [name, count] : restarts.items()) {
    if (count_of(count) > 0) results.restarts[name] = count_of(count);
  }
}

DroneResult read_drone(const Left& left, const launcher::Options& asked, std::uint16_t number, TimeNs begin_ns,
                       TimeNs end_ns) {
  DroneResult drone;
  drone.id = launcher::drone_name(asked, number);
  drone.two_way = latencies(left.agent_trace, TraceKind::command_verified, number, begin_ns);
  drone.age = latencies(left.link_trace, TraceKind::command_applied, number, begin_ns);
  drone.two_way_ms = quantiles_of(drone.two_way);
  drone.age_ms = quantiles_of(drone.age);

  const json& l = drone_in(left.link, drone.id);
  const json& a = drone_in(left.agent, drone.id);
  const json& g = drone_in(left.ground, drone.id);
  const json& states = at(a, "states");
  const json& commands = at(a, "commands");
  drone.states = {.sampled = count_of(states, "sampled") + count_of(l, "states_lost"),
                  .sent = count_of(states, "sent"),
                  .on_ledger = count_of(states, "on_ledger"),
                  .merged = count_of(states, "merged"),
                  .dropped = count_of(states, "dropped") + count_of(l, "states_lost")};
  const json& transitions = at(l, "transitions");
  drone.transitions = {.made = count_of(transitions, "made"),
                       .on_ledger = count_of(at(a, "transitions"), "on_ledger"),
                       .lost = count_of(transitions, "lost")};
  drone.commands = {.sent = count_of(g, "commands_sent"),
                    .on_ledger = count_of(commands, "on_ledger"),
                    .refused = count_of(commands, "refused") + count_of(g, "commands_refused"),
                    .applied = count_of(l, "commands_applied"),
                    .late = count_of(l, "commands_late"),
                    .dropped = count_of(l, "commands_dropped")};
  for (const json& reasons : {at(commands, "refused_reasons"), at(l, "drop_reasons")}) {
    for (const auto& [reason, count] : reasons.items()) drone.reasons[reason] += count_of(count);
  }
  for (const json& lap : at(g, "lap_s")) drone.lap_s.push_back(number_of(lap));
  if (at(g, "why").is_string()) drone.why = printable(at(g, "why").get<std::string>());
  if (at(g, "limit_mps").is_number()) drone.limit_mps = number_of(at(g, "limit_mps"));
  if (at(g, "slowed_to_mps").is_number()) drone.slowed_to_mps = number_of(at(g, "slowed_to_mps"));
  read_path(g, left.truth, number, asked, drone);
  drone.reported = reported_positions(left.link_trace, left.truth, number, begin_ns);
  drone.moments = flown_moments(left.link_trace, number, begin_ns, end_ns);
  drone.modes = mode_changes(left.link_trace, number, begin_ns, end_ns);
  if (asked.own) {
    for (const FlownMoment& one : drone.moments)
      if (std::isfinite(one.position_m[0])) drone.flown.push_back({one.position_m[0], one.position_m[1]});
  }
  return drone;
}

}  // namespace

Results read_results(const launcher::RunFiles& files, const launcher::Options& asked,
                     const launcher::RunRecord& record) {
  Results results;
  results.asked = asked;
  results.machine = launcher::describe_machine();
  results.ok = record.ok;
  results.why = record.why;
  results.cpu_percent = record.cpu_percent;
  results.memory_mb = record.memory_mb;
  results.onboard_restarts = record.restarts;
  results.ended_early = record.ended_early;
  results.flight_s = to_seconds(record.end_ns - record.begin_ns);
  const Left left = read_left(files, asked, results);
  read_ledger(left.node, record, results);
  results.faults = read_faults(files, record.begin_ns, results);

  std::vector<Sample> all_two_way, all_age;
  std::uint64_t messages = 0;
  for (int k = 1; k <= asked.drones; ++k) {
    DroneResult drone = read_drone(left, asked, static_cast<std::uint16_t>(k), record.begin_ns, record.end_ns);
    all_two_way.insert(all_two_way.end(), drone.two_way.begin(), drone.two_way.end());
    all_age.insert(all_age.end(), drone.age.begin(), drone.age.end());
    messages += drone.states.on_ledger + drone.commands.on_ledger;
    results.drones.push_back(std::move(drone));
  }
  results.two_way_ms = quantiles_of(all_two_way);
  results.age_ms = quantiles_of(all_age);
  const auto transactions =
      count_of(at(left.agent, "transactions"), "committed") + count_of(at(left.ground, "transactions"), "committed");
  if (results.flight_s > 0) {
    results.messages_per_s = static_cast<double>(messages) / results.flight_s;
    results.transactions_per_s = static_cast<double>(transactions) / results.flight_s;
  }
  return results;
}

std::vector<std::string> fault_lines(const Results& r) {
  constexpr std::size_t max_shown = 50;
  std::vector<std::string> lines;
  if (!r.asked.faults.empty()) lines.push_back("of " + r.asked.faults);
  for (const SwitchedFault& one : r.faults) {
    if (lines.size() == max_shown) return lines.push_back("and more: --json has them all"), lines;
    lines.push_back(fmt::format("{:.1f} s: {}", one.t_s, one.command));
  }
  return lines;
}

std::vector<std::string> differences(const Results& r) {
  const std::string embedded = "the embedded node, one process, storage " + r.storage;
  return {
      "the published study: " + std::string("Wi-Fi between three machines and real drones; here: one machine, ") +
          (r.asked.own ? "drones of a deployment" : "loopback, simulated drones"),
      "the published study: Hyperledger Fabric, 3 organisations, 3 Raft orderers; here: " +
          (launcher::is_of_others(r.asked)            ? std::string("a network of others")
           : r.asked.ledger == launcher::Ledger::none ? "no ledger, the controller beside the driver"
           : r.asked.ledger == launcher::Ledger::fabric
               ? fmt::format("Hyperledger Fabric 2.5, 3 organisations, {} Raft orderer(s), storage {}",
                             r.asked.orderers, r.storage)
               : embedded),
      "the published study: blocks of 10 messages or 2 s; here: " +
          (launcher::is_of_others(r.asked) ? std::string("as that network has it")
           : r.asked.ledger == launcher::Ledger::none
               ? "none"
               : fmt::format("{} or {:.0f} ms", r.asked.batch_count, to_ms(r.asked.batch_timeout_ns))),
      fmt::format("the published study: 70 messages/s with one drone, 250 with three; here: {:.0f}", r.messages_per_s),
  };
}

}  // namespace ledgerline::report
