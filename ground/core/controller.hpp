#pragma once
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "ground/core/follower.hpp"
#include "ground/core/path.hpp"
#include "ground/motion/predictor.hpp"
#include "ground/motion/track.hpp"

namespace ledgerline::ground {

using motion::Motion;

/// Speed growing at every turn, a turn being a lap: start, start + step, ...; a step of 0: always the same.
struct Ramp {
  double start_mps = 0;  ///< 0: no ramp
  double step_mps = 0;
};

/// "START:STEP", m/s: 0.05 to 8, and 0 to 2.
Result<Ramp> ramp_from(const std::string& text);

struct ControllerConfig {
  bool predict = true;  ///< else the plain controller: newest state, newest command, no model
  double speed_mps = 0.5;
  Ramp ramp;
  double height_m = 1.0;
  double lag_s = 0.3;                  ///< of the drone's answer to a velocity setpoint, taken until it was learned
  double full_scale_mps = 1.0;         ///< what the drone can be commanded at most: rc 100
  double max_acceleration_mps2 = 4.0;  ///< link's limit of acceleration
  double position_gain = 2.0;          ///< 1/s; with the lag: damped nearly critically by velocity_gain
  double velocity_gain = 0.4;
  double height_gain = 1.0;  ///< 1/s
  double yaw_gain = 1.0;     ///< 1/s
  double max_vertical_mps = 0.5;
  double max_yaw_rate_radps = 0.7;
  double leash_m = 0.4;                   ///< the reference stops when it is this far ahead of the drone
  TimeNs pose_lost_ns = 300 * ns_per_ms;  ///< link's limit: it brakes with an older pose, and the reference waits
  double allowed_error_m = 0.4;           ///< that prediction's error may reach; speed is limited so that it does not
  double min_limit_mps = 0.2;             ///< but never below this
};

/// Of the tracks that such a controller flies.
motion::TrackLimits track_limits(const ControllerConfig& config);

/// How well predictions come true: their error as a share of the way flown meanwhile, learned by comparing each
/// prediction with the states around the moment that it was for. Bounded; one thread.
class PredictionError {
 public:
  static constexpr double unknown = 0.2, least = 0.02;  ///< of the way
  void expect(TimeNs at_ns, const Eigen::Vector2d& position_m);
  /// The newest state: where the drone was, and how fast.
  void observe(const Motion& state);
  double share() const;

 private:
  struct Expected {
    TimeNs at_ns;
    Eigen::Vector2d position_m, from_m;
  };
  std::deque<Expected> expected_;
  Motion last_;
  double errors_m2_ = 0, ways_m2_ = 0;
};

/// What is learned of a drone, whatever path it flies, and the plans that it has on their way; until its host restarts,
/// since its clock may restart with it. One thread.
struct DroneModel {
  explicit DroneModel(const ControllerConfig& config);
  motion::Predictor predictor;
  PredictionError error{};
};

/// Follows a path: a reference moves along the Track (slower in bends, waiting when the drone falls behind), and the
/// drone is steered to it by velocity setpoints: the reference's velocity, led by what the drone's lag takes, plus
/// corrections of position and velocity, less the wind's drift, over the drone's gain. Each plan starts from the state
/// predicted for the moment when its first setpoint takes effect (motion::Predictor), and ends as late as asked for.
///
/// With u commanded, and the model lag v' = gain u + drift - v, the law
///     u = (v_ref + lag a_ref + K (p_ref - p) + V (v_ref - v) - drift) / gain
/// leaves lag e'' + (1 + V) e' + K e = 0 of the error. K falls with the age at application, as 1.6 / age: what the
/// model does not say must not be corrected faster than it is seen.
///
/// A latency-aware limit of speed: at limit_mps() three times the expected error of a prediction (its share of the way,
/// times speed, times age) is allowed_error_m. Above the limit, which is never below min_limit_mps, the reference is
/// slowed.
///
/// While link brakes, or its pose is older than it takes one for, the reference waits.
///
/// Without prediction: a reference that runs along the sharp path at the speed asked for, or the waypoint's, and waits
/// for nobody; the velocity for the newest state as it came, held until the next one.
///
/// The work of a plan is bounded, whatever the times in the state: after a pause of more than 3 s the reference goes on
/// from where it was, as it would after 3 s. Deterministic; one thread.
class PathController final : public Follower {
 public:
  static constexpr TimeNs step_ns = 50 * ns_per_ms;
  static constexpr std::size_t steps = 12;  ///< of a plan at least: 0.6 s
  static constexpr TimeNs max_ns = 3 * ns_per_s;

  /// `model`: of the drone; null: nothing is known of it yet.
  PathController(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin, ControllerConfig config,
                 double yaw_rad, std::shared_ptr<DroneModel> model = nullptr);

  /// Lets the reference move from `from_ns` on, as far as `end_m` along the track (laps count on); until then it waits
  /// at the origin.
  void start(TimeNs from_ns, double end_m = std::numeric_limits<double>::infinity()) override;
  void observe(const StateSample& state) override;
  bool ready() const override { return model_->predictor.ready(); }
  /// Setpoints for first_ns, first_ns + 50 ms, ... as many as asked for (12 to 40); first_ns must not go back from plan
  /// to plan. Without prediction: one velocity, held for 2 s from first_ns on. `id` is for Predictor::withdraw().
  std::vector<Setpoint> plan(std::uint64_t id, TimeNs first_ns, std::size_t count = steps) override;

  /// Of the reference, over all laps.
  double progress_m() const override { return progress_m_; }
  bool at_end() const override { return started_ && progress_m_ >= end_m_; }
  /// Of one lap, as progress counts it.
  double lap_m() const override { return config_.predict ? track_.length_m() : path_.length_m(); }
  double length_to(std::size_t corner) const override {
    return config_.predict ? track_.length_to(corner) : path_.length_to(corner);
  }
  const Path& path() const override { return path_; }
  /// Of the first waypoint: where it hovers until it is started.
  double start_height_m() const override { return track_.at(0).position_m.z(); }
  /// The time that these laps should take.
  double expected_s(int laps) const override;

  /// The speed asked for at this place, by the ramp.
  double requested_mps(double s_m) const;
  /// The latency-aware limit; infinite without prediction.
  double limit_mps() const { return limit_mps_; }
  /// The least limit that slowed the reference down; nothing: it never did.
  std::optional<double> slowed_to_mps() const { return slowed_to_mps_; }
  const motion::Predictor& predictor() const { return model_->predictor; }

 private:
  double pace(double s_m, const Eigen::Vector2d& drone) const;
  double speed_at(double s_m) const;
  double advance(double s_m, const Eigen::Vector2d& drone, double dt_s) const;
  /// What the path wants at a place, of a drone that is there.
  struct Wanted {
    Eigen::Vector3d position_m;
    Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
    Eigen::Vector2d acceleration_mps2 = Eigen::Vector2d::Zero();
  };
  Wanted wanted_at(double s_m, const Eigen::Vector2d& drone) const;
  Setpoint steer(const Motion& from, double s_m) const;
  void limit(double age_s);
  double plain_mps(double s_m) const;
  std::vector<Setpoint> plan_plain(TimeNs first_ns);
  Setpoint level(const Motion& from, double height_m, double climb_mps) const;

  ControllerConfig config_;
  Path path_;
  motion::Track track_;
  double yaw_rad_;
  std::shared_ptr<DroneModel> model_;  ///< never null
  Motion raw_;                         ///< the newest state as it came
  TimeNs raw_stamp_ns_ = 0;
  bool waits_ = false;  ///< link brakes, or is about to: plans are not flown
  bool started_ = false;
  double end_m_ = 0;
  TimeNs reference_ns_ = 0;  ///< the moment that progress_m_ belongs to
  double progress_m_ = 0;
  double position_gain_;
  double limit_mps_ = std::numeric_limits<double>::infinity();
  std::optional<double> slowed_to_mps_;
};

}  // namespace ledgerline::ground
