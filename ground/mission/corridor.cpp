#include "ground/mission/corridor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ledgerline::ground::mission {
namespace {

constexpr double for_ever = std::numeric_limits<double>::infinity();

struct Line {
  float from_x, from_y, to_x, to_y;
};

float distance(float x, float y, const Line& line) {
  const float dx = line.to_x - line.from_x, dy = line.to_y - line.from_y;
  const float length2 = dx * dx + dy * dy;
  const float along = length2 > 0 ? ((x - line.from_x) * dx + (y - line.from_y) * dy) / length2 : 0;
  const float share = std::clamp(along, 0.0F, 1.0F);
  const float ex = x - line.from_x - share * dx, ey = y - line.from_y - share * dy;
  return std::sqrt(ex * ex + ey * ey);
}

// On which side of the line: its sign alone says something.
float side(float x, float y, const Line& line) {
  return (line.to_x - line.from_x) * (y - line.from_y) - (line.to_y - line.from_y) * (x - line.from_x);
}

float distance(const Line& a, const Line& b) {
  const bool b_crosses = (side(b.from_x, b.from_y, a) > 0) != (side(b.to_x, b.to_y, a) > 0);
  const bool a_crosses = (side(a.from_x, a.from_y, b) > 0) != (side(a.to_x, a.to_y, b) > 0);
  if (a_crosses && b_crosses) return 0;
  return std::min({distance(a.from_x, a.from_y, b), distance(a.to_x, a.to_y, b), distance(b.from_x, b.from_y, a),
                   distance(b.to_x, b.to_y, a)});
}

template <typename Node>
Line line_of(const Node& node) {
  return {node.from_x, node.from_y, node.to_x, node.to_y};
}

}  // namespace

Corridor::Corridor(const Timetable& table, double low_m, double from_m, std::optional<double> landing_s,
                   const ControllerConfig& flight) {
  const auto& moments = table.moments;
  const Eigen::Vector2d start = moments.front().at_m.head<2>(), end = moments.back().at_m.head<2>();
  const double first_m = moments.front().at_m.z(), end_m = moments.back().at_m.z();
  add(start, start, std::min(low_m, first_m), std::max(from_m, first_m), -for_ever, 0);
  // A path's first place may have another height than the drone: it climbs while it flies on.
  const double climb_s = std::abs(first_m - from_m) / track_limits(flight).vertical_mps;
  for (std::size_t i = 1; i < moments.size(); ++i) {
    const Eigen::Vector3d& a = moments[i - 1].at_m;
    const Eigen::Vector3d& b = moments[i].at_m;
    const double rises_from_m = moments[i - 1].t_s < climb_s ? from_m : a.z();
    const auto heights = std::minmax({a.z(), b.z(), rises_from_m});
    add(a.head<2>(), b.head<2>(), heights.first, heights.second, moments[i - 1].t_s, moments[i].t_s);
  }
  const double landed_s = table.end_s() + landing_s.value_or(0);
  if (landing_s) add(end, end, 0, end_m, table.end_s(), landed_s);
  const double rest_m = landing_s ? 0 : end_m;
  add(end, end, rest_m, rest_m, landed_s, for_ever);
  grow();
}

Corridor::Corridor(const Eigen::Vector3d& from_m, const Eigen::Vector3d& to_m) {
  const auto [low_m, high_m] = std::minmax(from_m.z(), to_m.z());
  add(from_m.head<2>(), to_m.head<2>(), low_m, high_m, -for_ever, for_ever);
  grow();
}

Corridor::Corridor(const Eigen::Vector2d& at_m, double low_m, double high_m) {
  add(at_m, at_m, low_m, high_m, -for_ever, for_ever);
  grow();
}

void Corridor::add(const Eigen::Vector2d& from_m, const Eigen::Vector2d& to_m, double low_m, double high_m,
                   double begin_s, double end_s) {
  const auto narrow = [](double value) { return static_cast<float>(value); };
  pieces_.push_back({narrow(from_m.x()), narrow(from_m.y()), narrow(to_m.x()), narrow(to_m.y()), 0, narrow(low_m),
                     narrow(high_m), narrow(begin_s), narrow(end_s)});
}

void Corridor::grow() {
  count_ = pieces_.size();
  tree_.reserve(2 * count_ - 1);
  grow(0, count_);
  pieces_ = {};
}

// In the order of a walk: a node, all of its earlier half, all of its later half.
Corridor::Node Corridor::grow(std::size_t first, std::size_t pieces) {
  const std::size_t at = tree_.size();
  tree_.push_back(pieces_[first]);
  if (pieces == 1) return tree_[at];
  const Node before = grow(first, pieces / 2), behind = grow(first + pieces / 2, pieces - pieces / 2);
  Node node{before.from_x,
            before.from_y,
            behind.to_x,
            behind.to_y,
            0,
            std::min(before.low, behind.low),
            std::max(before.high, behind.high),
            before.begin_s,
            behind.end_s};
  // Both halves' lines are within that of where they join, and their pieces within their own radius of them.
  node.radius = distance(behind.from_x, behind.from_y, line_of(node)) + std::max(before.radius, behind.radius);
  tree_[at] = node;
  return node;
}

struct Corridor::Search {
  const Corridor& one;
  const Corridor& other;
  const Apart& apart;
  std::size_t& visits;

  std::optional<Meeting> between(const Branch& a, const Branch& b) {
    if (visits == 0) return std::nullopt;
    --visits;
    const Node& first = one.tree_[a.node];
    const Node& second = other.tree_[b.node];
    const auto late_s = static_cast<float>(apart.late_s);
    if (first.begin_s > second.end_s + late_s || second.begin_s > first.end_s + late_s) return std::nullopt;
    const float height_m = std::max(first.low - second.high, second.low - first.high);
    if (height_m >= static_cast<float>(apart.height_m)) return std::nullopt;
    const float level_m = distance(line_of(first), line_of(second)) - first.radius - second.radius;
    if (level_m >= static_cast<float>(apart.level_m)) return std::nullopt;
    if (a.pieces == 1 && b.pieces == 1)
      return Meeting{first.begin_s, second.begin_s, level_m, std::max(0.0F, height_m)};
    if (a.pieces >= b.pieces) {
      if (auto met = between(earlier(a), b)) return met;
      return between(later(a), b);
    }
    if (auto met = between(a, earlier(b))) return met;
    return between(a, later(b));
  }
};

std::optional<Corridor::Meeting> Corridor::meets(const Corridor& other, const Apart& apart, std::size_t& visits) const {
  return Search{*this, other, apart, visits}.between({0, count_}, {0, other.count_});
}

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
  const motion::OpenPath course = motion::open_path(here, way);
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
