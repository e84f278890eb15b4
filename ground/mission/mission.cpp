#include "ground/mission/mission.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "common/base/text.hpp"

namespace ledgerline::ground::mission {
namespace {

constexpr bool is_name_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
}

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
  return !text.empty() && text.size() <= max_name && std::all_of(text.begin(), text.end(), is_name_character);
}

Status check_bounds(const Mission& mission) {
  const auto bad_name = [](std::string_view what, const std::string& name) {
    return Error{
        fmt::format("{} \"{}\" must be 1 to {} of A-Z, a-z, 0-9, _ and -", what, printable(name, max_name), max_name)};
  };
  if (!is_name(mission.name)) return bad_name("the mission's name", mission.name);
  if (mission.drones.empty() || mission.drones.size() > max_drones)
    return Error{fmt::format("{} drones; 1 to {} may be", mission.drones.size(), max_drones)};
  std::set<std::string_view> names;
  for (const MissionDrone& drone : mission.drones) {
    if (!is_name(drone.drone)) return bad_name("the drone's name", drone.drone);
    if (!names.insert(drone.drone).second) return Error{fmt::format("drone {} is there twice", drone.drone)};
    if (const Status checked = check_drone(drone); !checked) return checked;
  }
  return done;
}

void sort_by_name(Mission& mission) {
  std::sort(mission.drones.begin(), mission.drones.end(),
            [](const MissionDrone& a, const MissionDrone& b) { return a.drone < b.drone; });
}

std::string canonical(const Mission& mission) {
  std::vector<const MissionDrone*> drones;
  for (const MissionDrone& drone : mission.drones) drones.push_back(&drone);
  std::sort(drones.begin(), drones.end(), [](const auto* a, const auto* b) { return a->drone < b->drone; });
  std::string text = fmt::format(R"({{"name":"{}","drones":[)", mission.name);
  for (const MissionDrone* drone : drones) put(text, *drone);
  text.back() = ']';
  text += '}';
  return text;
}

crypto::Digest digest(const Mission& mission) { return crypto::sha256(canonical(mission)); }

}  // namespace ledgerline::ground::mission
