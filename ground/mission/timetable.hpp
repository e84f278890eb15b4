#pragma once
#include <Eigen/Core>
#include <vector>

#include "ground/core/controller.hpp"
#include "ground/mission/mission.hpp"

namespace ledgerline::ground::mission {

/// Where a drone is to be when, from the moment on at which all begin their paths, 0 s. It is the track that
/// PathController flies a pilot's path on, and the reference that it moves along it, 50 ms after 50 ms: a drone that is
/// slowed (by the ledger's delay, wind, another drone) comes later, none comes sooner.
struct Timetable {
  struct Moment {
    double t_s = 0;
    Eigen::Vector3d at_m = Eigen::Vector3d::Zero();
  };
  /// Two are so far apart, but the last: 0.1 m at 1 m/s. From one to the next the drone flies straight, but for the
  /// bend at a corner, which is beside that line by less than 2 cm.
  static constexpr double step_s = 0.1;
  std::vector<Moment> moments;    ///< never empty; the first is at 0 s
  std::vector<double> reached_s;  ///< of each waypoint
  bool complete = true;           ///< false: the path takes longer than was asked for, and ends here before its end

  double end_s() const { return moments.back().t_s; }
  /// Index of the waypoint that it is on its way to; at its end the last one.
  std::size_t waypoint_at(double t_s) const;
};

/// From `here`, which has a height, through the drone's waypoints (motion::check_way() allows them), for `max_s` at
/// most. `flight`: with the speed and height of waypoints that say none; its speed is also that which none exceeds.
Timetable timetable_of(const Waypoint& here, const MissionDrone& drone, const ControllerConfig& flight, double max_s);

}  // namespace ledgerline::ground::mission
