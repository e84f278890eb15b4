#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/msg/onboard.hpp"
#include "ground/core/path.hpp"

namespace ledgerline::ground {

/// Steers one drone along its path: what Planner and Phases need of the controller that flies it. Our own is
/// PathController; a plug-in's is made by load_controller(). Times are the drone host's clock. One thread.
class Follower {
 public:
  virtual ~Follower() = default;

  /// The path is flown from `from_ns` on, as far as `end_m` along it (laps count on); until then it waits at the
  /// origin.
  virtual void start(TimeNs from_ns, double end_m) = 0;
  /// A state in flight.
  virtual void observe(const StateSample& state) = 0;
  /// It knows enough to plan.
  virtual bool ready() const = 0;
  /// Setpoints from `first_ns` on, which does not go back from plan to plan; none of them `count` steps of 50 ms later
  /// or more. Empty: there is nothing that could be flown, and check() may say why.
  virtual std::vector<Setpoint> plan(std::uint64_t id, TimeNs first_ns, std::size_t count) = 0;

  /// Along the path, over all laps.
  virtual double progress_m() const = 0;
  virtual bool at_end() const = 0;
  /// Of one lap, as progress counts it.
  virtual double lap_m() const = 0;
  /// Up to a corner of the path in the first lap, as progress counts it.
  virtual double length_to(std::size_t corner) const = 0;
  virtual const Path& path() const = 0;
  /// Of the first waypoint: where it hovers until it is started.
  virtual double start_height_m() const = 0;
  /// The time that these laps should take.
  virtual double expected_s(int laps) const = 0;
  /// The error says why it cannot go on: the drone is landed.
  virtual Status check() const { return done; }
};

struct ControllerConfig;

/// What a follower is made for: one drone, when it stands ready to take off.
struct FollowerTask {
  std::string drone;
  std::vector<Waypoint> waypoints;
  Eigen::Vector2d origin_m = Eigen::Vector2d::Zero();  ///< where it stands
  double yaw_rad = 0;                                  ///< where it looks
  int laps = 1;
};
/// The error says why this drone cannot be flown so.
using MakeFollower =
    std::function<Result<std::unique_ptr<Follower>>(const FollowerTask& task, const ControllerConfig& config)>;

}  // namespace ledgerline::ground
