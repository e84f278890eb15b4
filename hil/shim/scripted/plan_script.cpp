#include "hil/shim/scripted/plan_script.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/file.hpp"
#include "common/config/config.hpp"
#include "hil/proxy/settings.hpp"
#include "hil/shim/drone_ways.hpp"

namespace ledgerline::hil::shim {
namespace {

constexpr std::size_t max_tables = 1'000;
constexpr double max_s = 3'600;

PlanAction action_of(const std::string& name) {
  return name == "takeoff" ? PlanAction::takeoff : name == "land" ? PlanAction::land : PlanAction::fly;
}

DroneNumber drone_of(Config& config, const std::string& key, int drones) {
  std::vector<std::string> names{"*"};
  const auto targets = DroneWays::targets(drones);
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
  script.faults = proxy::read_faults(*config, DroneWays::targets(script.drones));
  TimeNs newest_ns = 0;
  for (const auto& say : script.says) newest_ns = std::max(newest_ns, say.until_ns);
  constexpr TimeNs rest_ns = 5 * ns_per_s;
  script.end_ns = from_seconds(config->number("end_s", to_seconds(newest_ns + rest_ns), 0.1, max_s));
  if (script.says.empty()) config->wrong("say", "must be there at least once: what agent says");
  if (const Status status = config->finish(); !status) return status.error();
  return script;
}

}  // namespace ledgerline::hil::shim
