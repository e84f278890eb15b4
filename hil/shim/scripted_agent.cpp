#include "hil/shim/scripted_agent.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/file.hpp"
#include "common/config/config.hpp"
#include "hil/proxy/settings.hpp"
#include "hil/shim/drone_links.hpp"

namespace ledgerline::hil::shim {
namespace {

constexpr std::size_t max_tables = 1'000;
constexpr double max_s = 3'600;

PlanAction action_of(const std::string& name) {
  return name == "takeoff" ? PlanAction::takeoff : name == "land" ? PlanAction::land : PlanAction::fly;
}

DroneNumber drone_of(Config& config, const std::string& key, int drones) {
  std::vector<std::string> names{"*"};
  const auto targets = DroneLinks::targets(drones);
  for (const auto& target : targets) names.push_back(target.name);
  const std::string name = config.choice(key, names, "*");
  return static_cast<DroneNumber>(std::find(names.begin(), names.end(), name) - names.begin());
}

std::size_t tables(Config& config, const std::string& name) {
  const std::size_t count = config.table_count(name);
  if (count > max_tables) config.wrong(name, fmt::format("must be {} tables at most", max_tables));
  return std::min(count, max_tables);
}

PlanScript::Say read_say(Config& config, const std::string& table, int drones) {
  PlanScript::Say say;
  say.at_ns = from_seconds(config.number(table + "at_s", 0, max_s));
  say.until_ns = say.at_ns + from_seconds(config.number(table + "for_s", 0.1, 0.001, max_s));
  say.drone = drone_of(config, table + "drone", drones);
  say.action = action_of(config.choice(table + "what", {"fly", "takeoff", "land"}, "fly"));
  const auto velocity = config.numbers(table + "velocity_mps", 3, {0, 0, 0});
  for (std::size_t i = 0; i < 3 && i < velocity.size(); ++i) {
    say.velocity_mps[i] = static_cast<float>(velocity[i]);
    if (std::abs(velocity[i]) > 10) config.wrong(table + "velocity_mps", "must be from -10 to 10 m/s");
  }
  say.yaw_rate_radps = static_cast<float>(config.number(table + "yaw_rate_radps", 0, -10, 10));
  return say;
}

}  // namespace

Result<PlanScript> load_plan_script(const std::string& path) {
  const auto text = read_file(path);
  if (!text) return text.error();
  return parse_plan_script(*text, path);
}

Result<PlanScript> parse_plan_script(std::string_view toml, const std::string& file) {
  auto config = Config::parse(toml, file);
  if (!config) return config.error();
  PlanScript script;
  script.drones = static_cast<int>(config->integer("drones", 1, 1, max_drones));
  for (std::size_t i = 0, count = tables(*config, "say"); i < count; ++i)
    script.says.push_back(read_say(*config, fmt::format("say.{}.", i), script.drones));
  for (std::size_t i = 0, count = tables(*config, "silence"); i < count; ++i) {
    const std::string table = fmt::format("silence.{}.", i);
    PlanScript::Silence silence;
    silence.at_ns = from_seconds(config->number(table + "at_s", 0, max_s));
    silence.until_ns = silence.at_ns + from_seconds(config->number(table + "for_s", 0.001, max_s));
    script.silences.push_back(silence);
  }
  script.faults = proxy::read_faults(*config, DroneLinks::targets(script.drones));
  TimeNs newest_ns = 0;
  for (const auto& say : script.says) newest_ns = std::max(newest_ns, say.until_ns);
  constexpr TimeNs rest_ns = 5 * ns_per_s;
  script.end_ns = from_seconds(config->number("end_s", to_seconds(newest_ns + rest_ns), 0.1, max_s));
  if (script.says.empty()) config->wrong("say", "must be there at least once: what agent says");
  if (const Status status = config->finish(); !status) return status.error();
  return script;
}

namespace {

constexpr TimeNs flown_period_ns = ns_per_s / 30, other_period_ns = 100 * ns_per_ms;
constexpr TimeNs pose_period_ns = 10 * ns_per_ms, heartbeat_period_ns = 50 * ns_per_ms;
constexpr TimeNs setpoint_period_ns = 50 * ns_per_ms;
constexpr std::uint32_t setpoints = 12;          // 0.6 s, as ground's plans
constexpr TimeNs ahead_ns = 20 * ns_per_ms;      // time for an ordinary thread to hand the plan over before it is due
constexpr TimeNs state_age_ns = 20 * ns_per_ms;  // of the state that a plan would answer
constexpr std::size_t max_transitions = 10'000;

}  // namespace

ScriptedAgent::ScriptedAgent(const PlanScript& script, TimeNs begin_ns)
    : script_(script), begin_ns_(begin_ns), next_pose_ns_(begin_ns), next_heartbeat_ns_(begin_ns) {
  for (const auto& say : script.says) next_ns_.push_back(begin_ns + say.at_ns);
}

const ScriptedAgent::DueMessages& ScriptedAgent::step(TimeNs now, const sim::Simulator& drones) {
  said_.plans.clear();
  said_.poses.clear();
  said_.heartbeats.clear();
  const auto silent_at = [&](TimeNs moment) {
    return std::any_of(script_.silences.begin(), script_.silences.end(), [&](const auto& silence) {
      return moment - begin_ns_ >= silence.at_ns && moment - begin_ns_ < silence.until_ns;
    });
  };
  const bool silent = silent_at(now);
  if (now >= next_heartbeat_ns_) {
    next_heartbeat_ns_ += heartbeat_period_ns;
    heartbeat_.stamp_ns = now;
    heartbeat_.ledger_alive = true;
    if (!silent) said_.heartbeats.push_back(heartbeat_);
  }
  if (now >= next_pose_ns_) {
    next_pose_ns_ += pose_period_ns;
    for (DroneNumber drone = 1; drone <= script_.drones && !silent; ++drone) {
      const sim::Truth truth = drones.truth(drone);
      said_.poses.push_back({.drone = drone,
                             .stamp_ns = now,
                             .position_m = truth.position_m,
                             .velocity_mps = truth.velocity_mps,
                             .yaw_rad = truth.yaw_rad});
    }
  }
  for (std::size_t i = 0; i < script_.says.size(); ++i) {
    const PlanScript::Say& say = script_.says[i];
    if (now < next_ns_[i] || next_ns_[i] - begin_ns_ >= say.until_ns) continue;
    plan(next_ns_[i], now, say, silent_at(next_ns_[i]));
    next_ns_[i] += say.action == PlanAction::fly ? flown_period_ns : other_period_ns;
  }
  return said_;
}

void ScriptedAgent::plan(TimeNs due, TimeNs now, const PlanScript::Say& say, bool silent) {
  for (DroneNumber drone = 1; drone <= script_.drones; ++drone) {
    if (say.drone != 0 && say.drone != drone) continue;
    Plan plan;
    plan.drone = drone;
    plan.action = say.action;
    plan.sequence = ++sequences_[drone];
    plan.epoch = static_cast<std::uint64_t>(begin_ns_) + 1;  // later than of a script that link flew before
    plan.state_stamp_ns = due - state_age_ns;
    plan.verified_ns = now;
    if (say.action == PlanAction::fly) {
      plan.count = setpoints;
      for (std::uint32_t k = 0; k < setpoints; ++k)
        plan.setpoints[k] = {due + ahead_ns + k * setpoint_period_ns, say.velocity_mps, say.yaw_rate_radps};
    }
    if (!silent) said_.plans.push_back(plan);
  }
}

void ScriptedAgent::add(const Transition& transition) {
  if (transition.drone > max_drones) return;
  if (heartbeat_.boot_id != transition.boot_id) {
    heartbeat_.boot_id = transition.boot_id;
    heartbeat_.transitions_taken = {};
  }
  std::uint64_t& taken = heartbeat_.transitions_taken[transition.drone];
  if (transition.number != taken + 1) return;  // given again
  taken = transition.number;
  heartbeat_.transitions_on_ledger[transition.drone] = taken;
  if (transitions_.size() < max_transitions) transitions_.push_back(transition);
}

}  // namespace ledgerline::hil::shim
