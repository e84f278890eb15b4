#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "common/msg/onboard.hpp"
#include "ground/motion/response.hpp"

namespace ledgerline::ground::motion {

/// Position, velocity and yaw of a drone at a moment of its clock; map frame.
struct Motion {
  TimeNs stamp_ns = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  double yaw_rad = 0;
};

struct PredictorConfig {
  Response first;                       ///< taken until something was learned
  bool learn = true;                    ///< estimate the response online
  double sent_acceleration_mps2 = 4.0;  ///< link's limit: how fast the velocity sent to the drone changes
};

/// Where a drone will be when a plan takes effect, from its states and the plans that were sent:
///
///  - a Kalman filter for each axis has position, velocity and drift (what the wind adds to the velocity, slowly
///    changing), driven by what link says it sent to the drone, through the Response (Bar-Shalom, Li, Kirubarajan:
///    Estimation with Applications to Tracking and Navigation, 5.2 and 6.2);
///  - from the newest state on, plans that were sent but not flown yet drive the same model: each setpoint at the
///    moment when link will fly it and for as long, zero after a plan's end, and the sent velocity changes no faster
///    than link's limit of acceleration allows;
///  - the Response is learned meanwhile (ResponseEstimator).
///
/// States may come in bursts, with gaps, twice or out of order: one that is not newer changes nothing, one whose pose
/// is not newer says what the drone was sent and no more. A pause of more than 1 s, or a pose more than 0.5 m from
/// where it was expected, restarts the filter; what was learned of the response stays. Bounded in memory, and in work
/// by max_ns, whatever the times say. Deterministic; one thread. Horizontal axes and height share one response; yaw
/// simply follows its rate.
class Predictor {
 public:
  /// The maximum time that is predicted over.
  static constexpr TimeNs max_ns = 5 * ns_per_s;

  explicit Predictor(const PredictorConfig& config);

  /// A state in flight.
  void observe(const StateSample& state);
  /// A plan is on its way (not empty, times growing); from its first setpoint on it replaces those before.
  void sent(std::uint64_t id, std::span<const Setpoint> plan);
  /// That plan will not be flown: it was replaced before it left, or the ledger refused it.
  void withdraw(std::uint64_t id);

  bool ready() const { return stamp_ns_ > 0; }
  /// The newest state as filtered.
  Motion newest() const;
  const Eigen::Vector3d& drift_mps() const { return drift_; }
  const Response& response() const { return response_; }

  /// The model, running ahead of time. The motion is always one dead time ahead of the last velocity given: nothing
  /// sent later can change it.
  class Rollout {
   public:
    const Motion& effect() const { return motion_; }  ///< its stamp: sent_until_ns() + dead time
    TimeNs sent_until_ns() const { return sent_ns_; }
    const Eigen::Vector3d& sent_mps() const { return sent_; }
    /// The drone is sent this velocity, as fast as link lets it change, until then.
    void send(const Eigen::Vector3d& velocity_mps, double yaw_rate_radps, TimeNs until_ns);

   private:
    friend class Predictor;
    void move(const Eigen::Vector3d& sent, double dt_s);
    Response response_;
    double sent_acceleration_mps2_ = 0;
    Eigen::Vector3d drift_ = Eigen::Vector3d::Zero();
    TimeNs sent_ns_ = 0;
    Eigen::Vector3d sent_ = Eigen::Vector3d::Zero();
    Motion motion_;
  };
  /// As it will stand when a setpoint that says `meant_ns` is about to be flown: link flies it later by its playout's
  /// margin.
  Rollout until(TimeNs meant_ns) const;

 private:
  struct AppliedVelocity {
    TimeNs stamp_ns = 0;
    Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
    double yaw_rate_radps = 0;
  };
  struct Sent {
    std::uint64_t id;
    std::vector<Setpoint> plan;
  };
  AppliedVelocity applied_at(TimeNs t_ns) const;
  void propagate(TimeNs to_ns);
  void correct(const StateSample& state);
  void start(const StateSample& state);
  std::optional<Setpoint> planned(TimeNs at_ns) const;

  PredictorConfig config_;
  ResponseEstimator estimator_;
  Response response_;
  std::deque<AppliedVelocity> applied_;  ///< by link's words, oldest first
  std::deque<Sent> sent_;
  TimeNs late_ns_ = 0;

  TimeNs stamp_ns_ = 0;  ///< of the pose; 0: none yet
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero(), velocity_ = Eigen::Vector3d::Zero(),
                  drift_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();  ///< of each axis: all see the same noise at the same times
  double yaw_rad_ = 0;
};

}  // namespace ledgerline::ground::motion
