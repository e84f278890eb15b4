#pragma once
#include <Eigen/Core>
#include <optional>
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

/// How far two drones are to be from each other: level or in height, one of both is enough. That is the measure of
/// link's separation (onboard/link), which keeps the drones of one host 0.5 m apart and begins to hold them 0.18 m
/// before: a path that is nearer would be flown with waiting. Half a metre more leaves it nothing to do in a gust; less
/// than 0.5 m is flown by nobody on one host, and collides between two.
struct Apart {
  double level_m = 0.68;
  double height_m = 0.68;
  double late_s = 2;  ///< the more for one of them to be late by
};

/// All that a drone takes up of a mission's space, at all times: while it takes off and waits at its start, along its
/// path, and at its end, where it hovers, or lands and stands. A tree of pieces, each a straight way in a while between
/// two heights; a node has all of its pieces within `radius` of one line. 36 bytes a node, two nodes for each moment.
class Corridor {
 public:
  /// Of a drone on its timetable, which takes up all from `low_m` to `from_m` until then: hovering, or rising to it.
  /// From there it climbs to the height that its path begins with. `landing_s`: it lands at the end, and all below it
  /// is its for so long; nothing: it hovers there.
  Corridor(const Timetable& table, double low_m, double from_m, std::optional<double> landing_s,
           const ControllerConfig& flight);
  /// Of one that may be anywhere on this straight way at any time.
  Corridor(const Eigen::Vector3d& from_m, const Eigen::Vector3d& to_m);
  /// Of one that stays where it is, between these heights.
  Corridor(const Eigen::Vector2d& at_m, double low_m, double high_m);

  struct Meeting {
    double t_s = 0, other_t_s = 0;  ///< of the mission; -infinity: before it begins
    double level_m = 0, height_m = 0;
  };
  /// A moment of this one, among the first, at which the other is too near, both as punctual as Apart::late_s. Nothing
  /// is overlooked that the two timetables say, to 2 cm beside their lines; what is found may be later than late_s by a
  /// piece of each (0.2 s). `visits` is counted down by the pairs of nodes that were looked at: at 0 the search ends
  /// unfinished, with nothing.
  std::optional<Meeting> meets(const Corridor& other, const Apart& apart, std::size_t& visits) const;

 private:
  struct Node {
    float from_x, from_y, to_x, to_y;
    float radius;
    float low, high;
    float begin_s, end_s;
  };
  struct Branch {
    std::size_t node, pieces;  ///< behind it first the earlier half of the pieces, then the later one
  };
  struct Search;
  void add(const Eigen::Vector2d& from_m, const Eigen::Vector2d& to_m, double low_m, double high_m, double begin_s,
           double end_s);
  void grow();
  Node grow(std::size_t first, std::size_t pieces);
  static Branch earlier(const Branch& branch) { return {branch.node + 1, branch.pieces / 2}; }
  static Branch later(const Branch& branch) {
    return {branch.node + 2 * (branch.pieces / 2), branch.pieces - branch.pieces / 2};
  }

  std::vector<Node> pieces_;  ///< in the order of time; emptied when the tree has grown
  std::vector<Node> tree_;
  std::size_t count_ = 0;  ///< of the pieces
};

}  // namespace ledgerline::ground::mission
