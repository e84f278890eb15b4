#pragma once
#include <Eigen/Core>
#include <vector>

#include "ground/motion/waypoints.hpp"

namespace ledgerline::ground::motion {

struct TrackLimits {
  double acceleration_mps2 =
      1.7;                      ///< along the track, and across it in a bend; of a Tello's 4 the controller keeps half
  double full_scale_mps = 1.0;  ///< a velocity commanded of the drone can be no greater (rc 100)
  double lag_s = 0.3;  ///< so that gaining speed, which needs a commanded velocity ahead of it, respects full_scale_mps
  double vertical_mps = 0.4;  ///< up or down, where waypoints differ in height
  double cut_m = 0.07;        ///< by which a bend may miss its corner; it begins at half the shorter piece at most
};

/// The greatest speed on a way that begins at rest at 0 and ends at rest at `end_m`, by TrackLimits' own acceleration;
/// never none, so that it is left and reached.
double from_rest_to_rest_mps(double s_m, double end_m);

/// A closed path as it is to be flown: the waypoints' polygon with its corners rounded by arcs, and for each place the
/// greatest speed that lets every bend be flown within the acceleration, found by one pass backward and one forward
/// over the lap, both around twice since it closes (time-optimal along a fixed path with bounded acceleration: Bobrow,
/// Dubowsky, Gibson 1985, for a point mass). Any arc length is allowed: laps are taken off. Immutable; any thread.
class Track {
 public:
  Track(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin, double height_m,
        const TrackLimits& limits);

  double length_m() const { return length_m_; }
  /// Arc length of the place that is nearest to this corner: the middle of its bend.
  double length_to(std::size_t corner) const { return corners_m_.at(corner); }

  struct Point {
    Eigen::Vector3d position_m;
    Eigen::Vector3d direction;   ///< of travel; horizontal part of length 1, z: climb per metre
    Eigen::Vector2d bend_per_m;  ///< curvature times the normal to its inside
    double speed_mps;            ///< at most, by the lap's profile
    double gain_mps2;            ///< of speed along the profile: v dv/ds
  };
  Point at(double s_m) const;
  double speed_at(double s_m) const;
  /// At that speed at most, a lap from the profile takes so long.
  double lap_s(double speed_mps) const;

 private:
  struct PathPoint {
    Eigen::Vector3d position;
    Eigen::Vector2d direction;
    Eigen::Vector2d bend;
    double climb;
    double limit;  ///< of speed: bend, climb, the waypoint's own
    double speed;
  };
  void lay(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin, double height_m,
           const TrackLimits& limits);
  void pace(const TrackLimits& limits);

  double length_m_ = 0;
  std::vector<double> corners_m_;  ///< arc length of each
  double step_m_ = 0;              ///< between knots
  std::vector<PathPoint> knots_;
};

}  // namespace ledgerline::ground::motion
