#include "ground/mission/check.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ledgerline::ground::mission {
namespace {

Status check_settings(const CheckConfig& config) {
  const auto within = [](double value, double min, double max) { return value >= min && value <= max; };
  if (!within(config.battery_endurance_s, 60, 1'800)) return Error{"battery_endurance_s must be from 60 to 1800"};
  if (!within(config.battery_reserve, 0, 1)) return Error{"battery_reserve must be from 0 to 1"};
  if (!within(config.apart.level_m, 0, 100) || !within(config.apart.height_m, 0, 100))
    return Error{"drones must be apart by 0 to 100 m"};
  if (!within(config.apart.late_s, 0, 60)) return Error{"late_s must be from 0 to 60"};
  if (!within(config.landing_mps, 0.05, 10)) return Error{"landing_mps must be from 0.05 to 10"};
  if (!within(config.flight.speed_mps, motion::min_speed_mps, motion::max_speed_mps))
    return Error{"the flight's speed must be from 0.05 to 8 m/s"};
  return done;
}

constexpr std::size_t max_other_corners = 100;

std::string at_time(double t_s) { return t_s < 0 ? "at the start" : fmt::format("at {:.1f} s", t_s); }

class Check {
 public:
  Check(const CheckConfig& config, std::span<const DroneNow> now) : config_(config), now_(now) {}

  std::vector<Finding> of(const Mission& mission);

 private:
  struct Flown {
    const MissionDrone* drone;  ///< null: has no part in the mission
    std::string name;
    Timetable table;
    Corridor corridor;
  };
  void add(const std::string& drone, std::optional<std::size_t> waypoint, const std::string& words,
           bool forbids = true);
  void check_drone(const MissionDrone& drone);
  bool check_presence(const MissionDrone& drone, const DroneNow& now);
  void check_way(const MissionDrone& drone, const Eigen::Vector3d& here_m);
  void check_fence(const std::string& drone, std::optional<std::size_t> waypoint, const Eigen::Vector3d& at_m);
  void check_battery(const MissionDrone& drone, const DroneNow& now, const Timetable& table);
  void add_other(const DroneNow& now);
  void check_pairs();
  void add_meeting(const Flown& one, const Flown& other, const Corridor::Meeting& meeting);
  double height_m(const Waypoint& waypoint) const { return waypoint.height_m.value_or(config_.flight.height_m); }
  /// Where its path begins.
  Eigen::Vector3d start_of(const DroneNow& now) const;

  const CheckConfig& config_;
  std::span<const DroneNow> now_;
  std::vector<Flown> flown_;
  std::vector<Finding> findings_;
  std::size_t left_out_ = 0;
  bool left_out_forbids_ = false;
};

void Check::add(const std::string& drone, std::optional<std::size_t> waypoint, const std::string& words, bool forbids) {
  if (findings_.size() + 1 >= max_findings) {
    ++left_out_;
    left_out_forbids_ = left_out_forbids_ || forbids;
    return;
  }
  std::string place = drone.empty() ? "" : "drone " + drone;
  if (waypoint) place += fmt::format(", waypoint {}", *waypoint + 1);
  findings_.push_back({drone, waypoint, place.empty() ? words : place + ": " + words, forbids});
}

Eigen::Vector3d Check::start_of(const DroneNow& now) const {
  Eigen::Vector3d start = *now.at_m;
  if (now.on_ground) start.z() = config_.takeoff_height_m;
  return start;
}

// Whether it is known where it is: only then there is more to say.
bool Check::check_presence(const MissionDrone& drone, const DroneNow& now) {
  const auto words = [&]() -> std::string {
    if (!now.seen) return "no state came from it";
    switch (now.phase) {
      case GroundPhase::takeoff:
        return "is taking off";
      case GroundPhase::path:
        return "flies a path already";
      case GroundPhase::landing:
        return "is landing";
      case GroundPhase::manual:
        return now.on_ground ? "is on the ground, though it should hover" : "";
      case GroundPhase::waiting:
      case GroundPhase::landed:
      case GroundPhase::failed:
        return now.on_ground ? "" : "is in the air, and not flown from here" + (now.why.empty() ? "" : ": " + now.why);
    }
    return "";
  }();
  if (!words.empty()) add(drone.drone, {}, words);
  if (!now.at_m && now.seen) add(drone.drone, {}, "has no pose: nobody knows where it is");
  if (!now.at_m || !words.empty()) return false;
  if (now.at_m->allFinite() && now.at_m->cwiseAbs().maxCoeff() <= max_coordinate_m) return true;
  add(drone.drone, {}, "its pose is not on the map");
  return false;
}

void Check::check_fence(const std::string& drone, std::optional<std::size_t> waypoint, const Eigen::Vector3d& at_m) {
  const std::string problem = fence_problem(*config_.fence, at_m);
  if (!problem.empty()) add(drone, waypoint, (waypoint ? "" : "its start ") + problem);
}

void Check::check_way(const MissionDrone& drone, const Eigen::Vector3d& here_m) {
  if (config_.fence) check_fence(drone.drone, {}, here_m);
  const auto& way = drone.waypoints;
  for (std::size_t i = 0; i < way.size(); ++i) {
    const Waypoint& waypoint = way[i];
    if (const double far_m = (waypoint.at_m - here_m.head<2>()).norm(); far_m > motion::max_distance_m)
      add(drone.drone, i, fmt::format("is {:.1f} m from where it is; {} m may be", far_m, motion::max_distance_m));
    for (std::size_t k = 0; k < i; ++k) {
      if ((waypoint.at_m - way[k].at_m).norm() <= motion::max_distance_m) continue;
      add(drone.drone, i, fmt::format("is more than {} m from waypoint {}", motion::max_distance_m, k + 1));
      break;
    }
    const double asked_mps = waypoint.speed_mps.value_or(drone.speed_mps.value_or(0));
    if (asked_mps > config_.flight.speed_mps)
      add(drone.drone, i, fmt::format("{:g} m/s is flown with the flight's {:g}", asked_mps, config_.flight.speed_mps),
          false);
    if (config_.fence) check_fence(drone.drone, i, {waypoint.at_m.x(), waypoint.at_m.y(), height_m(waypoint)});
  }
}

void Check::check_battery(const MissionDrone& drone, const DroneNow& now, const Timetable& table) {
  if (!table.complete) {
    add(drone.drone, {},
        fmt::format("its path takes longer than the {:g} s of a battery", config_.battery_endurance_s));
    return;
  }
  if (!now.battery_share) {
    add(drone.drone, {}, "its battery is not known");
    return;
  }
  const double landing_s = table.moments.back().at_m.z() / config_.landing_mps;
  const double needed_s = config_.takeoff_s + table.end_s() + landing_s;
  const double needed = needed_s / config_.battery_endurance_s + config_.battery_reserve;
  if (needed > *now.battery_share)
    add(drone.drone, {},
        fmt::format("has {:.0f} % of its battery and needs {:.0f} %: {:.0f} s of {:g} s, and {:.0f} % in reserve",
                    100 * *now.battery_share, 100 * needed, needed_s, config_.battery_endurance_s,
                    100 * config_.battery_reserve));
}

void Check::check_drone(const MissionDrone& drone) {
  const auto now = std::ranges::find_if(now_, [&](const DroneNow& n) { return n.name == drone.drone; });
  if (now == now_.end()) return add(drone.drone, {}, "does not fly here");
  if (!check_presence(drone, *now)) return;
  const Eigen::Vector3d start = start_of(*now);
  if (drone.start_m) {
    const double far_m = (*drone.start_m - start.head<2>()).norm();
    if (far_m > config_.start_near_m)
      add(drone.drone, {}, fmt::format("is {:.2f} m from its start; {:g} m may be", far_m, config_.start_near_m));
  }
  check_way(drone, start);
  const Waypoint here{start.head<2>(), start.z()};
  Timetable table = timetable_of(here, drone, config_.flight, config_.battery_endurance_s);
  check_battery(drone, *now, table);
  const std::optional<double> landing_s =
      drone.land_behind ? std::optional(table.moments.back().at_m.z() / config_.landing_mps) : std::nullopt;
  // On the ground it takes up the column that it will rise in.
  Corridor corridor(table, now->on_ground ? now->at_m->z() : start.z(), start.z(), landing_s, config_.flight);
  flown_.push_back({&drone, drone.drone, std::move(table), std::move(corridor)});
  flown_.back().table.moments = {flown_.back().table.moments.back()};  // the corridor has them all
}

void Check::add_meeting(const Flown& one, const Flown& other, const Corridor::Meeting& meeting) {
  const auto where = [](const Flown& flown, double t_s) {
    if (!flown.drone) return std::string(" stays");
    if (t_s < 0) return std::string(" is at its start");
    if (t_s >= flown.table.end_s()) return std::string(" is at its end");
    return fmt::format(" flies to waypoint {}", flown.table.waypoint_at(t_s) + 1);
  };
  const bool starts = meeting.t_s < 0;
  const auto waypoint = starts ? std::nullopt : std::optional(one.table.waypoint_at(meeting.t_s));
  add(one.name, waypoint,
      fmt::format(
          "{} it is {:.2f} m from {} and {:.2f} m in height, which then{}; {:g} m or {:g} m in height it must be, "
          "late by {:g} s as well",
          at_time(meeting.t_s), std::max(0.0, meeting.level_m), other.name, meeting.height_m,
          where(other, meeting.other_t_s), config_.apart.level_m, config_.apart.height_m, config_.apart.late_s));
}

void Check::check_pairs() {
  std::size_t visits = max_visits;
  for (std::size_t i = 0; i < flown_.size(); ++i) {
    for (std::size_t k = i + 1; k < flown_.size(); ++k) {
      const Flown& one = flown_[i].drone ? flown_[i] : flown_[k];
      const Flown& other = flown_[i].drone ? flown_[k] : flown_[i];
      if (!one.drone) continue;  // neither is moved by this mission
      if (const auto meeting = one.corridor.meets(other.corridor, config_.apart, visits))
        add_meeting(one, other, *meeting);
      if (visits == 0)
        return add(one.name, {}, "it and others are close to each other for too long to be checked: part their paths");
    }
  }
}

// One that has no part in the mission: it may be anywhere on its path at any time, and all below it while it takes off
// or lands.
void Check::add_other(const DroneNow& now) {
  if (!now.at_m) {
    if (now.seen && !now.on_ground) add(now.name, {}, "has no part in it, is in the air, and nobody knows where");
    return;
  }
  const bool rises = now.phase == GroundPhase::takeoff || now.phase == GroundPhase::landing;
  const double low_m = rises ? 0 : now.at_m->z(),
               high_m = std::max(now.at_m->z(), rises ? config_.takeoff_height_m : 0);
  flown_.push_back({nullptr, now.name, {}, Corridor(now.at_m->head<2>(), low_m, std::max(low_m, high_m))});
  if (now.way.size() > max_other_corners)
    return add(now.name, {}, "has no part in it, and its path is too long to be held against: wait for its end");
  Eigen::Vector3d from_m = *now.at_m;
  for (const Eigen::Vector3d& to_m : now.way) {
    flown_.push_back({nullptr, now.name, {}, Corridor(from_m, to_m)});
    from_m = to_m;
  }
}

std::vector<Finding> Check::of(const Mission& mission) {
  if (const Status settings = check_settings(config_); !settings) {
    add("", {}, "not checked: " + settings.error().message);
    return findings_;
  }
  if (const Status bounds = check_bounds(mission); !bounds) {
    add("", {}, bounds.error().message);
    return findings_;
  }
  if (!config_.fence) add("", {}, "no fence is known here: nothing is held against it", false);
  for (const MissionDrone& drone : mission.drones) check_drone(drone);
  for (const DroneNow& now : now_) {
    const auto is_it = [&](const MissionDrone& drone) { return drone.drone == now.name; };
    if (std::ranges::none_of(mission.drones, is_it)) add_other(now);
  }
  check_pairs();
  if (left_out_ > 0) findings_.push_back({"", {}, fmt::format("and {} more findings", left_out_), left_out_forbids_});
  return findings_;
}

}  // namespace

std::string fence_problem(const Fence& fence, const Eigen::Vector3d& at_m) {
  const auto low = Eigen::Vector3d::Map(fence.min_m.data()), high = Eigen::Vector3d::Map(fence.max_m.data());
  if ((at_m.array() >= low.array()).all() && (at_m.array() <= high.array()).all()) return "";
  return fmt::format("{:g}, {:g}, {:g} m is beyond the fence: x {:g} to {:g}, y {:g} to {:g}, z {:g} to {:g} m",
                     at_m.x(), at_m.y(), at_m.z(), low.x(), high.x(), low.y(), high.y(), low.z(), high.z());
}

std::vector<Finding> check(const Mission& mission, const CheckConfig& config, std::span<const DroneNow> now) {
  return Check(config, now).of(mission);
}

bool forbids(std::span<const Finding> findings) {
  return std::ranges::any_of(findings, [](const Finding& finding) { return finding.forbids; });
}

}  // namespace ledgerline::ground::mission
