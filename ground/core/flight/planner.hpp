#pragma once
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "ground/core/flight/plan_timing.hpp"
#include "ground/core/flight/state_intake.hpp"
#include "ground/core/follower.hpp"
#include "ground/core/lease/lease_book.hpp"
#include "ground/core/manual.hpp"

namespace ledgerline::ground {

constexpr double near_m = 0.2;  ///< of a place: close enough to call it reached
constexpr double still_mps = 0.2;

/// Near this place of the map, and no longer on its way.
inline bool is_settled(const StateSample& state, const std::array<double, 3>& place_m) {
  return std::hypot(state.position_m[0] - place_m[0], state.position_m[1] - place_m[1]) < near_m &&
         std::abs(state.position_m[2] - place_m[2]) < near_m &&
         std::hypot(state.velocity_mps[0], state.velocity_mps[1], state.velocity_mps[2]) < still_mps;
}

/// A path that a pilot gave a drone in the air: what its follower flies, where it ends, and what is left of it when it
/// is paused. One thread.
class PilotPath {
 public:
  /// From `here` on through `way` (check_way() allows it; metres of the map); `height_m`: of waypoints that say none.
  PilotPath(std::vector<Waypoint> way, bool land_behind, const Waypoint& here, double height_m);

  const motion::OpenPath& course() const { return course_; }
  bool land_behind() const { return land_behind_; }
  /// As far as its follower shall fly.
  double end_m(const Follower& follower) const { return follower.length_to(course_.last); }
  /// A state in flight: looks which waypoints the drone has reached.
  void observe(const Follower& follower, const StateSample& state);
  /// Settled at its last waypoint.
  bool at_end(const Follower& follower, const StateSample& state) const;
  /// Waypoints, from the first on; without the last one until the path ends.
  std::size_t reached() const { return next_; }
  /// The waypoints not reached yet; the last one is among them until the path ends.
  std::vector<Waypoint> rest() const;
  /// From where it began; map frame.
  std::vector<std::array<double, 3>> corners() const;

 private:
  std::vector<Waypoint> way_;
  bool land_behind_;
  Waypoint here_;
  motion::OpenPath course_;
  std::size_t next_ = 0;  ///< the first one of the way that was not reached yet
};

/// A plan on its way to the ledger.
struct PlannedCommand {
  DronePlan plan;  ///< sequence 0: not submitted yet
  TimeNs made_ns = 0;
  TimeNs made_on_drone_ns = 0;  ///< the same moment on the drone's clock
  double progress_m = 0;
  std::uint64_t id = 0;  ///< for withdraw()
};

/// Where what was sent to a drone takes it, as far as its model knows; map frame. Now is what the newest state was when
/// it came, and what has passed since: as old as the drone that people see.
struct CommittedPath {
  static constexpr std::size_t max_points = 24;
  std::vector<Eigen::Vector3d> points_m;                  ///< from now on; 2 to max_points of them
  TimeNs step_ns = 0;                                     ///< from point to point; to the last one at most
  TimeNs until_ns = 0;                                    ///< from now to the last point
  Eigen::Vector3d predicted_m = Eigen::Vector3d::Zero();  ///< where it is when a command given now takes effect
};

/// Makes one drone's plans: which action its phase wants now, and setpoints along its path, or as its pilot commands.
/// Counts laps. Times in plans are the drone host's clock alone. Deterministic; one thread. What it is given must
/// outlive it.
class Planner {
 public:
  Planner(const FlightConfig& config, std::size_t drone, const Lease& lease, const IntakeState& seen,
          FlightStatus& status);

  /// The path begins where the drone stands. The error says why nobody can steer along it.
  Status begin_path(const std::array<double, 2>& origin_m, double yaw_rad);
  /// Behind the take-off: the path is flown from then on.
  void start_path(TimeNs at_ns);
  /// In the air, instead of what was flown before: a pilot's path, from where the drone is. It waits there until
  /// `from_ns`. After an error nothing has changed.
  Status begin_pilot_path(const std::vector<Waypoint>& way, bool land_behind, TimeNs from_ns);
  /// A state of this boot; another boot forgets what was planned for the one before.
  void observe(bool same_boot);
  /// A plan that answers the newest state, where there is anything to say.
  std::optional<PlannedCommand> make(TimeNs now, const PlanTiming::Timing& timing);
  /// The plan will not be flown.
  void withdraw(std::uint64_t id) {
    if (model_) model_->predictor.withdraw(id);
    if (display_model_) display_model_->withdraw(id);
  }

  /// What is sent and not flown yet. Nothing: all of it is flown, link does not fly plans now, we do not command it, or
  /// plans are made without a model (ControllerConfig::predict). For people alone: no plan depends on it.
  std::optional<CommittedPath> committed(TimeNs now, const PlanTiming::Timing& timing) const;

  /// Of a path that is flown or was; null before.
  const Follower* follower() const { return follower_.get(); }
  /// The newest that its pilot gave; null before.
  const PilotPath* pilot_path() const { return pilot_path_ ? &*pilot_path_ : nullptr; }
  /// The same as follower() where it is our own; else null.
  const PathController* controller() const { return controller_; }
  /// Of this drone's path.
  int laps() const { return task_.laps; }
  ManualController& manual() { return manual_; }

 private:
  Status make_follower(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin_m, double yaw_rad,
                       int laps);
  /// Flown in the drone's own frame, by velocities.
  bool by_hand() const { return config_.manual && status_.phase != GroundPhase::path; }
  /// Its command is for now, whenever it comes.
  bool plain() const { return !by_hand() && !config_.controller.predict; }
  /// When a plan that is made now begins, at the soonest; the drone's clock.
  TimeNs next_first_ns(TimeNs made_on_drone_ns, const PlanTiming::Timing& timing) const;
  bool needs_plan() const;
  std::vector<Setpoint> setpoints(TimeNs now, const PlannedCommand& command, const PlanTiming::Timing& timing);
  void report();
  void count_laps(TimeNs at_ns);

  const FlightConfig& config_;
  const std::size_t drone_;
  const Lease& lease_;
  const IntakeState& seen_;
  FlightStatus& status_;
  const Task task_;
  std::unique_ptr<Follower> follower_;
  PathController* controller_ = nullptr;  ///< the follower, where it is our own
  std::shared_ptr<DroneModel> model_;     ///< of our own; null before, and where a plug-in steers
  std::uint64_t model_boot_id_ = 0;       ///< of the states that it was made for
  /// Of all plans that the drone was sent, for committed(): where model_ has not all of them, by hand and by a plug-in.
  std::optional<motion::Predictor> display_model_;
  std::optional<PilotPath> pilot_path_;
  ManualController manual_;
  std::uint64_t next_plan_ = 1;
  TimeNs first_setpoint_ns_ = 0;  ///< of the newest plan; the drone's clock, as below
  TimeNs lap_since_ns_ = 0, last_at_ns_ = 0;
  double last_progress_m_ = 0;
};

}  // namespace ledgerline::ground
