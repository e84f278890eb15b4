#include "ground/mission/mission.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>

#include "common/base/text.hpp"
#include "common/msg/contract.hpp"
#include "ground/json/strict.hpp"
#include "ground/motion/waypoints.hpp"

namespace ledgerline::ground::mission {
namespace {

constexpr bool is_name_character(char c) { return contract::is_alphanumeric(c) || c == '_' || c == '-'; }

bool is_on_map(const Eigen::Vector2d& at_m) {
  return std::abs(at_m.x()) <= max_coordinate_m && std::abs(at_m.y()) <= max_coordinate_m;
}

Status check_drone(const MissionDrone& drone) {
  const auto wrong = [&](std::string_view words) { return Error{fmt::format("drone {}{}", drone.drone, words)}; };
  if (drone.start_m && !is_on_map(*drone.start_m))
    return wrong(fmt::format(": its start must be within {} m of the map's origin, x and y", max_coordinate_m));
  if (drone.speed_mps && !(*drone.speed_mps >= motion::min_speed_mps && *drone.speed_mps <= motion::max_speed_mps))
    return wrong(fmt::format(": has speed {} m/s; {} to {} may be", *drone.speed_mps, motion::min_speed_mps,
                             motion::max_speed_mps));
  if (drone.waypoints.empty() || drone.waypoints.size() > motion::max_waypoints)
    return wrong(fmt::format(": has {} waypoints; 1 to {} may be", drone.waypoints.size(), motion::max_waypoints));
  for (std::size_t i = 0; i < drone.waypoints.size(); ++i) {
    const Waypoint& waypoint = drone.waypoints[i];
    if (!is_on_map(waypoint.at_m))
      return wrong(
          fmt::format(", waypoint {}: x and y must be from {} to {} m", i + 1, -max_coordinate_m, max_coordinate_m));
    if (const Status checked = motion::check_limits(waypoint); !checked)
      return wrong(fmt::format(", waypoint {}: {}", i + 1, checked.error().message));
    if (i > 0 && (waypoint.at_m - drone.waypoints[i - 1].at_m).norm() < motion::min_apart_m)
      return wrong(fmt::format(", waypoint {}: is closer than 1 cm to the one before", i + 1));
  }
  return done;
}

// The shortest that reads as the same; -0 is 0.
void put(std::string& text, std::string_view before, double value) {
  fmt::format_to(std::back_inserter(text), "{}{}", before, value == 0 ? 0.0 : value);
}

void put(std::string& text, const MissionDrone& drone) {
  fmt::format_to(std::back_inserter(text), R"({{"drone":"{}")", drone.drone);
  if (drone.start_m) {
    put(text, R"(,"start":{"x":)", drone.start_m->x());
    put(text, R"(,"y":)", drone.start_m->y());
    text += '}';
  }
  if (drone.speed_mps) put(text, R"(,"speed":)", *drone.speed_mps);
  text += R"(,"waypoints":[)";
  for (const Waypoint& waypoint : drone.waypoints) {
    put(text, R"({"x":)", waypoint.at_m.x());
    put(text, R"(,"y":)", waypoint.at_m.y());
    if (waypoint.height_m) put(text, R"(,"z":)", *waypoint.height_m);
    if (waypoint.speed_mps) put(text, R"(,"speed":)", *waypoint.speed_mps);
    text += "},";
  }
  text.back() = ']';
  text += drone.land_behind ? R"(,"then":"land"},)" : R"(,"then":"hover"},)";
}

}  // namespace

std::vector<Waypoint> MissionDrone::way() const {
  std::vector<Waypoint> way = waypoints;
  for (Waypoint& waypoint : way) {
    if (!waypoint.speed_mps) waypoint.speed_mps = speed_mps;
  }
  return way;
}

bool is_name(std::string_view text) {
  return !text.empty() && text.size() <= max_name && std::ranges::all_of(text, is_name_character);
}

namespace {

Status check_name(std::string_view name) {
  if (contract::is_drone_name(name) && name.size() <= max_name) return done;
  return Error{fmt::format("the drone's name \"{}\" {} ({} at most)", printable(name, max_name),
                           contract::drone_name_rule, max_name)};
}

}  // namespace

Status check_bounds(const Mission& mission) {
  if (!is_name(mission.name))
    return Error{fmt::format("the mission's name \"{}\" must be 1 to {} of A-Z, a-z, 0-9, _ and -",
                             printable(mission.name, max_name), max_name)};
  if (mission.drones.empty() || mission.drones.size() > max_drones)
    return Error{fmt::format("{} drones; 1 to {} may be", mission.drones.size(), max_drones)};
  std::set<std::string_view> names;
  for (const MissionDrone& drone : mission.drones) {
    if (const Status named = check_name(drone.drone); !named) return named;
    if (!names.insert(drone.drone).second) return Error{fmt::format("drone {} is there twice", drone.drone)};
    if (const Status checked = check_drone(drone); !checked) return checked;
  }
  return done;
}

void sort_by_name(Mission& mission) {
  std::ranges::sort(mission.drones, [](const MissionDrone& a, const MissionDrone& b) { return a.drone < b.drone; });
}

std::string canonical(const Mission& mission) {
  std::vector<const MissionDrone*> drones;
  for (const MissionDrone& drone : mission.drones) drones.push_back(&drone);
  std::ranges::sort(drones, [](const auto* a, const auto* b) { return a->drone < b->drone; });
  std::string text = fmt::format(R"({{"name":"{}","drones":[)", mission.name);
  for (const MissionDrone* drone : drones) put(text, *drone);
  text.back() = ']';
  text += '}';
  return text;
}

crypto::Digest digest(const Mission& mission) { return crypto::sha256(canonical(mission)); }

namespace {

using nlohmann::json;
namespace strict = ground::json;

// Mission, drones, drone, waypoints, waypoint, number; five values a waypoint.
constexpr strict::Bounds mission_bounds{max_mission_bytes, 5, (5 * motion::max_waypoints + 10) * max_drones + 3};

Status check_size(std::string_view text) {
  if (text.size() <= max_mission_bytes) return done;
  return Error{fmt::format("the mission has {} bytes; {} may be", text.size(), max_mission_bytes)};
}

Result<std::string> text_of(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_string()) return Error{fmt::format("{} must be a text", key)};
  return found->get<std::string>();
}

Result<Eigen::Vector2d> start_from(const json& given) {
  const auto place = strict::waypoint_from(given);
  if (!place) return Error{"start: " + place.error().message};
  if (place->height_m || place->speed_mps) return Error{"start: is x and y alone"};
  return place->at_m;
}

Result<MissionDrone> drone_from(const json& given) {
  MissionDrone drone;
  const auto keys = strict::only(given, {"drone", "start", "speed", "waypoints", "then"});
  if (!keys) return keys.error();
  if (given.contains("start")) {
    const auto start = start_from(given["start"]);
    if (!start) return start.error();
    drone.start_m = *start;
  }
  if (given.contains("speed")) {
    if (!given["speed"].is_number()) return Error{"speed must be a number"};
    drone.speed_mps = given["speed"].get<double>();
  }
  const auto land_behind = strict::land_behind_from(given.value("then", json("hover")));
  if (!land_behind) return land_behind.error();
  drone.land_behind = *land_behind;
  const auto waypoints = given.find("waypoints");
  if (waypoints == given.end() || !waypoints->is_array() || waypoints->size() > motion::max_waypoints)
    return Error{fmt::format("waypoints must be a list of 1 to {}", motion::max_waypoints)};
  for (const json& one : *waypoints) {
    const auto waypoint = strict::waypoint_from(one);
    if (!waypoint) return Error{fmt::format("waypoint {}: {}", drone.waypoints.size() + 1, waypoint.error().message)};
    drone.waypoints.push_back(*waypoint);
  }
  return drone;
}

Result<Mission> bounded(Mission mission) {
  if (const Status checked = check_bounds(mission); !checked) return checked.error();
  return mission;
}

// Whether a heading is one, and has the column `then`.
Result<bool> has_then(std::span<const std::string_view> cells) {
  constexpr std::array<std::string_view, 6> columns{"drone", "x", "y", "z", "speed", "then"};
  if (cells.size() != 5 && cells.size() != 6) return Error{"the heading must be drone,x,y,z,speed or that and then"};
  if (!std::equal(cells.begin(), cells.end(), columns.begin()))
    return Error{"the heading must be drone,x,y,z,speed or that and then"};
  return cells.size() == columns.size();
}

class CsvReader {
 public:
  /// What is wrong with the line; the mission has its waypoint else.
  Status take(std::span<const std::string_view> cells, bool then, int line);
  Mission mission;

 private:
  Result<MissionDrone*> drone_of(std::string_view name);
  std::map<std::string, std::size_t, std::less<>> at_;
  std::map<std::string, bool, std::less<>> said_;  // then, of each drone that has one
};

Result<MissionDrone*> CsvReader::drone_of(std::string_view name) {
  if (const auto found = at_.find(name); found != at_.end()) return &mission.drones[found->second];
  if (const Status named = check_name(name); !named) return named.error();
  if (mission.drones.size() == max_drones) return Error{fmt::format("more than {} drones", max_drones)};
  at_.emplace(name, mission.drones.size());
  mission.drones.push_back({std::string(name)});
  return &mission.drones.back();
}

Status CsvReader::take(std::span<const std::string_view> cells, bool then, int line) {
  const std::size_t columns = then ? 6 : 5;
  if (cells.size() != columns) return Error{fmt::format("{} columns, not {} as the heading", cells.size(), columns)};
  const auto drone = drone_of(cells[0]);
  if (!drone) return drone.error();
  auto waypoint = motion::waypoint_of(cells.subspan(1, 4));
  if (!waypoint) return waypoint.error();
  if ((*drone)->waypoints.size() == motion::max_waypoints)
    return Error{fmt::format("more than {} waypoints of drone {}", motion::max_waypoints, (*drone)->drone)};
  waypoint->line = line;
  (*drone)->waypoints.push_back(*waypoint);
  if (!then || cells[5].empty()) return done;
  if (cells[5] != "hover" && cells[5] != "land") return Error{"then must be hover, land or empty"};
  (*drone)->land_behind = cells[5] == "land";
  const auto [said, first] = said_.emplace((*drone)->drone, (*drone)->land_behind);
  if (!first && said->second != (*drone)->land_behind)
    return Error{fmt::format("then of drone {} was another before", (*drone)->drone)};
  return done;
}

}  // namespace

Result<Mission> mission_from_document(const json& given) {
  if (!given.is_object()) return Error{"the mission must be an object"};
  if (const Status keys = strict::only(given, {"name", "drones"}); !keys) return keys.error();
  const auto name = text_of(given, "name");
  if (!name) return name.error();
  const auto drones = given.find("drones");
  if (drones == given.end() || !drones->is_array() || drones->size() > max_drones)
    return Error{fmt::format("drones must be a list of 1 to {}", max_drones)};
  Mission mission{*name, {}};
  for (const json& one : *drones) {
    const std::size_t number = mission.drones.size() + 1;
    if (!one.is_object()) return Error{fmt::format("drone number {} must be an object", number)};
    auto drone_name = text_of(one, "drone");
    if (!drone_name) return Error{fmt::format("drone number {}: {}", number, drone_name.error().message)};
    auto drone = drone_from(one);
    if (!drone) {
      const std::string& what = drone.error().message;
      return Error{fmt::format("drone {}{}{}", printable(*drone_name, max_name),
                               what.starts_with("waypoint ") ? ", " : ": ", what)};
    }
    drone->drone = std::move(*drone_name);
    mission.drones.push_back(std::move(*drone));
  }
  return bounded(std::move(mission));
}

Result<Mission> mission_from_json(std::string_view text) {
  if (const Status size = check_size(text); !size) return size.error();
  const auto parsed = strict::object_from(text, "the mission", mission_bounds);
  if (!parsed) return parsed.error();
  return mission_from_document(*parsed);
}

Result<Mission> mission_from_csv(std::string_view text, const std::string& name, const std::string& file) {
  if (const Status size = check_size(text); !size) return size.error();
  CsvReader reader;
  reader.mission.name = name;
  std::optional<bool> then;
  for (motion::CsvLines lines(text); lines.next();) {
    const auto cells = motion::cells_of(lines.line());
    Status taken = done;
    if (!then) {
      const auto heading = has_then(cells);
      if (heading) then = *heading;
      if (!heading) taken = heading.error();
    } else {
      taken = reader.take(cells, *then, lines.number());
    }
    if (!taken)
      return Error{fmt::format("{}{}: {}", file.empty() ? "line " : file + ":", lines.number(), taken.error().message)};
  }
  if (!then) return Error{"the mission has no line"};
  return bounded(std::move(reader.mission));
}

}  // namespace ledgerline::ground::mission
