#include "ground/mission/corridor.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::ground::mission {
namespace {

constexpr int steps_kept = static_cast<int>(Timetable::step_s / to_seconds(PathController::step_ns) + 0.5);

}  // namespace

std::size_t Timetable::waypoint_at(double t_s) const {
  const auto next = std::lower_bound(reached_s.begin(), reached_s.end(), t_s);
  const auto passed = static_cast<std::size_t>(next - reached_s.begin());
  return complete ? std::min(passed, reached_s.size() - 1) : passed;
}

Timetable timetable_of(const Waypoint& here, const MissionDrone& drone, const ControllerConfig& flight, double max_s) {
  std::vector<Waypoint> way = drone.way();
  for (Waypoint& waypoint : way) waypoint.height_m = waypoint.height_m.value_or(flight.height_m);
  const motion::OpenCourse course = motion::open_course(here, way);
  const motion::Track track(course.waypoints, course.origin_m, flight.height_m, track_limits(flight));
  const double end_m = track.length_to(course.last);
  const double asked_mps = flight.ramp.start_mps > 0 ? flight.ramp.start_mps : flight.speed_mps;

  Timetable table;
  double s_m = 0, t_s = 0;
  const auto arrive = [&] {
    while (table.reached_s.size() < way.size() && s_m >= track.length_to(course.first + table.reached_s.size()))
      table.reached_s.push_back(t_s);
  };
  table.moments.push_back({0, track.at(0).position_m});
  arrive();
  constexpr double dt_s = to_seconds(PathController::step_ns);
  for (int i = 1; s_m < end_m; ++i) {
    if (t_s >= max_s) {
      table.complete = false;
      return table;
    }
    const double speed_mps = std::min({track.speed_at(s_m), asked_mps, motion::from_rest_to_rest_mps(s_m, end_m)});
    s_m = std::min(end_m, s_m + speed_mps * dt_s);
    t_s = i * dt_s;
    if (s_m == end_m || i % steps_kept == 0) table.moments.push_back({t_s, track.at(s_m).position_m});
    arrive();
  }
  // A change of height alone has no length: the drone climbs where it is.
  const double climb_m = std::abs(here.height_m.value_or(0) - table.moments.front().at_m.z());
  const double climb_s = climb_m / track_limits(flight).vertical_mps;
  if (climb_s > t_s) {
    table.moments.push_back({climb_s, table.moments.back().at_m});
    table.reached_s.back() = climb_s;
  }
  return table;
}

}  // namespace ledgerline::ground::mission
