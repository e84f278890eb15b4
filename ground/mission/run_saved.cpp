#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"
#include "ground/json/strict.hpp"
#include "ground/mission/mission.hpp"
#include "ground/mission/run.hpp"

namespace ledgerline::ground::mission {
namespace {

using nlohmann::json;
namespace strict = ground::json;

constexpr int version = 1;
// A mission, one deeper, and five values of each drone.
constexpr strict::Bounds saved_bounds{max_saved_bytes, 6, (5 * motion::max_waypoints + 20) * max_drones + 20};

template <typename Names>
std::optional<std::size_t> index_in(const Names& names, const json& name) {
  if (!name.is_string()) return std::nullopt;
  const auto found = std::find(names.begin(), names.end(), name.get_ref<const std::string&>());
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

Result<RunPhase> phase_from(const json& name) {
  for (std::size_t i = 0; i < enum_count<RunPhase>; ++i) {
    if (name == name_of(static_cast<RunPhase>(i))) return static_cast<RunPhase>(i);
  }
  return Error{"phase must be one of a mission's"};
}

constexpr std::array<std::string_view, 10> leg_names{"standing", "rising", "ready",   "ordered", "flying",
                                                     "halted",   "ended",  "landing", "landed",  "lost"};
static_assert(leg_names.size() == enum_count<DroneProgress::Leg>);

Result<DroneProgress> drone_from(const json& given, const MissionDrone& drone) {
  using Leg = DroneProgress::Leg;
  if (!given.is_object()) return Error{"must be an object"};
  if (const Status keys = strict::only(given, {"drone", "leg", "reached", "to_land"}); !keys) return keys.error();
  if (given.value("drone", json()) != drone.drone) return Error{fmt::format("must be {}", drone.drone)};
  const auto leg = index_in(leg_names, given.value("leg", json()));
  if (!leg) return Error{"leg must be one of a mission's"};
  const json reached = given.value("reached", json());
  const std::size_t count = drone.waypoints.size();
  if (!reached.is_number_unsigned() || reached.get<std::uint64_t>() > count)
    return Error{fmt::format("reached must be 0 to {}", count)};
  const json to_land = given.value("to_land", json());
  if (!to_land.is_boolean()) return Error{"to_land must be true or false"};
  const DroneProgress read{static_cast<Leg>(*leg), reached.get<std::size_t>(), to_land.get<bool>()};
  const bool at_end = read.leg == Leg::ended || read.leg == Leg::landing || read.leg == Leg::landed;
  if (read.leg != Leg::lost && at_end != (read.reached == count))
    return Error{fmt::format("leg {} does not go with {} of {} waypoints", leg_names[*leg], read.reached, count)};
  if (read.leg == Leg::landing && !drone.land_behind)
    return Error{"leg landing does not go with a path that ends in hovering"};
  return read;
}

}  // namespace

std::string text_of(const RunProgress& progress, const Mission& mission) {
  json drones = json::array();
  for (std::size_t i = 0; i < progress.drones.size(); ++i)
    drones.push_back({{"drone", mission.drones[i].drone},
                      {"leg", leg_names[static_cast<std::size_t>(progress.drones[i].leg)]},
                      {"reached", progress.drones[i].reached},
                      {"to_land", progress.drones[i].landing_due}});
  const json state{{"version", version},
                   {"phase", name_of(progress.phase)},
                   {"paused", progress.paused},
                   {"why", progress.why},
                   {"drones", std::move(drones)}};
  return state.dump();
}

std::string text_of(const RunProgress& progress, const Mission& mission, const std::string& canonical) {
  std::string text = text_of(progress, mission);
  text.back() = ',';
  return text + R"("mission":)" + canonical + "}";
}

Result<SavedRun> saved_run_from(std::string_view text) {
  const auto wrong = [](const std::string& what) { return Error{"the kept mission: " + what}; };
  if (text.size() > max_saved_bytes) return wrong(fmt::format("has {} bytes; {} may be", text.size(), max_saved_bytes));
  const auto parsed = strict::object_from(text, "the kept mission", saved_bounds);
  if (!parsed) return parsed.error();
  if (const Status keys = strict::only(*parsed, {"version", "mission", "phase", "paused", "why", "drones"}); !keys)
    return wrong(keys.error().message);
  if (parsed->value("version", json()) != version) return wrong(fmt::format("version must be {}", version));
  auto mission = mission_from_json(parsed->value("mission", json()));
  if (!mission) return wrong(mission.error().message);
  SavedRun saved{std::move(*mission), {}};
  sort_by_name(saved.mission);
  const auto phase = phase_from(parsed->value("phase", json()));
  if (!phase) return wrong(phase.error().message);
  const json paused = parsed->value("paused", json()), why = parsed->value("why", json());
  if (!paused.is_boolean() || !why.is_string()) return wrong("paused must be true or false, why a text");
  const json drones = parsed->value("drones", json());
  if (!drones.is_array() || drones.size() != saved.mission.drones.size())
    return wrong(fmt::format("drones must be a list of {}", saved.mission.drones.size()));
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const auto drone = drone_from(drones[i], saved.mission.drones[i]);
    if (!drone) return wrong(fmt::format("drone number {}: {}", i + 1, drone.error().message));
    saved.progress.drones.push_back(*drone);
  }
  saved.progress.phase = *phase;
  saved.progress.paused = paused.get<bool>();
  saved.progress.why = printable(why.get<std::string>());
  return saved;
}

}  // namespace ledgerline::ground::mission
