#include <nlohmann/json.hpp>

#include "common/rt/histogram.hpp"
#include "tools/report/results.hpp"

namespace ledgerline::report {
namespace {

using nlohmann::json;

json or_null(const std::optional<double>& value) { return value ? json(rounded(*value)) : json(); }

json to_json(const std::optional<ReportedMetrics>& reported) {
  if (!reported) return nullptr;
  return {{"count", reported->count},
          {"max_three_sigma_m", rounded(reported->max_three_sigma_m)},
          {"rms_error_m", or_null(reported->rms_error_m)},
          {"max_error_m", or_null(reported->max_error_m)},
          {"inside", or_null(reported->inside)}};
}

json to_json(const DroneResult& drone) {
  json cross_track = nullptr;
  if (drone.path_flown)
    cross_track = {{"rms", rounded(drone.cross_track_rms_m)}, {"max", rounded(drone.cross_track_max_m)}};
  json laps = json::array();
  for (double lap : drone.lap_s) laps.push_back(rounded(lap));
  json turns = json::array();
  for (const DroneResult::Turn& turn : drone.turns) {
    turns.push_back({{"asked_mps", rounded(turn.asked_mps)},
                     {"flown_mps", rounded(turn.flown_mps)},
                     {"rms_m", rounded(turn.rms_m)},
                     {"max_m", rounded(turn.max_m)}});
  }
  return {{"id", drone.id},
          {"two_way_ms", drone.two_way_ms},
          {"age_ms", drone.age_ms},
          {"cross_track_m", cross_track},
          {"lap_s", laps},
          {"turns", turns},
          {"limit_mps", or_null(drone.limit_mps)},
          {"slowed_to_mps", or_null(drone.slowed_to_mps)},
          {"reported_position", to_json(metrics_of(drone.reported))},
          {"states",
           {{"sampled", drone.states.sampled},
            {"sent", drone.states.sent},
            {"on_ledger", drone.states.on_ledger},
            {"merged", drone.states.merged},
            {"dropped", drone.states.dropped}}},
          {"transitions",
           {{"made", drone.transitions.made},
            {"on_ledger", drone.transitions.on_ledger},
            {"lost", drone.transitions.lost}}},
          {"commands",
           {{"sent", drone.commands.sent},
            {"on_ledger", drone.commands.on_ledger},
            {"refused", drone.commands.refused},
            {"applied", drone.commands.applied},
            {"late", drone.commands.late},
            {"dropped", drone.commands.dropped},
            {"reasons", drone.reasons}}}};
}

}  // namespace

json to_json(const Results& r) {
  json asked{{"shape", launcher::shape_name(r.asked)},
             {"drones", r.asked.drones},
             {"rate_hz", r.asked.rate_hz},
             {"side_m", r.asked.side_m},
             {"predict", r.asked.predict},
             {"ramp", r.asked.ramp.start_mps > 0
                          ? json{{"start_mps", r.asked.ramp.start_mps}, {"step_mps", r.asked.ramp.step_mps}}
                          : json()},
             {"speed_mps", r.asked.speed_mps},
             {"laps", r.asked.manual ? 0 : r.asked.laps},
             {"seconds", r.asked.seconds},
             {"ledger", name_of(r.asked.ledger)},
             {"orderers", r.asked.ledger == launcher::Ledger::fabric ? json(r.asked.orderers) : json(nullptr)},
             {"storage", r.asked.tmpfs ? "tmpfs" : "disk"},
             {"batch_timeout_ms", to_ms(r.asked.batch_timeout_ns)},
             {"batch_count", r.asked.batch_count},
             {"blocks_of", r.asked.blocks},
             {"endorser", r.asked.endorser},
             {"endorser_within", r.asked.endorser_within},
             {"gateway", r.asked.gateway},
             {"proxy", r.asked.proxy},
             {"seed", r.asked.seed}};
  if (r.asked.own) asked["own_drones"] = true;
  if (r.asked.proxy || r.asked.shim) {
    asked["faults"] = {{"file", r.asked.faults}, {"switched", json::array()}};
    for (const SwitchedFault& one : r.faults)
      asked["faults"]["switched"].push_back({{"t_s", rounded(one.t_s)}, {"command", one.command}});
  }
  json cpu = json::object();
  for (const auto& [name, percent] : r.cpu_percent) cpu[name] = rounded(percent, 10);
  json memory = json::object();
  for (const auto& [name, mb] : r.memory_mb) memory[name] = rounded(mb, 10);
  json drones = json::array();
  for (const DroneResult& drone : r.drones) drones.push_back(to_json(drone));
  json ended_early = json::array();
  for (const auto& [program, how] : r.ended_early) ended_early.push_back({{"program", program}, {"how", how}});
  json object{{"asked", asked},
              {"machine",
               {{"cpu", r.machine.cpu},
                {"cores", r.machine.cores},
                {"memory_gb", rounded(r.machine.memory_gb, 10)},
                {"system", r.machine.system}}},
              {"ledger",
               {{"kind", launcher::is_of_others(r.asked) ? "existing" : name_of(r.asked.ledger)},
                {"batch_timeout_ms", to_ms(r.asked.batch_timeout_ns)},
                {"batch_count", r.asked.batch_count},
                {"storage", r.storage},
                {"bytes_per_drone_hour", rounded(r.bytes_per_drone_hour, 1e-6)},
                {"restarts", r.restarts},
                {"disk_ms", r.disk_ms},
                {"blocks", r.blocks},
                {"transactions", r.transactions}}},
              {"drones", drones},
              {"flight_s", rounded(r.flight_s)},
              {"messages_per_s", rounded(r.messages_per_s, 10)},
              {"transactions_per_s", rounded(r.transactions_per_s, 10)},
              {"cpu_percent", cpu},
              {"memory_mb", memory},
              {"restarts", r.onboard_restarts},
              {"ended_early", ended_early},
              {"ok", r.ok}};
  if (!r.ok) object["why"] = r.why;
  return object;
}

}  // namespace ledgerline::report
