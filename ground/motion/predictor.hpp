#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "common/estimation/motion_filter.hpp"
#include "common/msg/onboard.hpp"
#include "ground/motion/response.hpp"

namespace ledgerline::ground::motion {

using estimation::Motion;
using estimation::Rollout;

struct PredictorConfig {
  Response first;                       ///< taken until something was learned
  bool learn = true;                    ///< estimate the response online
  double sent_acceleration_mps2 = 4.0;  ///< link's limit: how fast the velocity sent to the drone changes
};

/// Where a drone will be when a plan takes effect, from its states and the plans that were sent:
///
///  - estimation::MotionFilter has position, velocity and drift, driven by what link says it sent to the drone;
///  - from the newest state on, plans that were sent but not flown yet drive the same model: each setpoint at the
///    moment when link will fly it and for as long, zero after a plan's end, and the sent velocity changes no faster
///    than link's limit of acceleration allows;
///  - the Response is learned meanwhile (ResponseEstimator).
///
/// States may come in bursts, with gaps, twice or out of order: one that is not newer changes nothing, one whose pose
/// is not newer says what the drone was sent and no more. Where the filter restarts, what was learned of the
/// response stays. Bounded in memory, and in work by max_ns, whatever the times say. Deterministic; one thread.
class Predictor {
 public:
  /// The maximum time that is predicted over.
  static constexpr TimeNs max_ns = 5 * ns_per_s;

  explicit Predictor(const PredictorConfig& config);

  /// A state in flight.
  void observe(const StateSample& state);
  /// A plan is on its way (not empty, times growing); from its first setpoint on it replaces those before.
  /// `body_frame`: its velocities are in the drone's own frame, as it looks when they are flown.
  void sent(std::uint64_t id, std::span<const Setpoint> plan, bool body_frame = false);
  /// That plan will not be flown: it was replaced before it left, or the ledger refused it.
  void withdraw(std::uint64_t id);

  bool ready() const { return filter_.ready(); }
  /// The newest state as filtered.
  const Motion& newest() const { return filter_.newest(); }
  const Eigen::Vector3d& drift_mps() const { return filter_.drift_mps(); }
  const Response& response() const { return filter_.response(); }

  /// As it will stand when a setpoint that says `meant_ns` is about to be flown: link flies it later by its playout's
  /// margin.
  Rollout until(TimeNs meant_ns) const;
  /// What the plans sent make of the drone: its motion at `from_ns`, or at the newest state if that is later, and from
  /// there in equal steps, of 50 ms or a multiple, until the end of the newest plan has taken effect; so the last step
  /// may be shorter. At most `most` motions (2 at least). Empty: nothing is known or sent, or it is over by then.
  std::vector<Motion> committed(TimeNs from_ns, std::size_t most) const;

 private:
  struct Sent {
    std::uint64_t id;
    std::vector<Setpoint> plan;
    bool body_frame;
  };
  std::optional<Setpoint> planned(TimeNs at_ns, double yaw_rad) const;
  /// What link says it sent counts until then.
  TimeNs known_until_ns() const;
  void send_planned(Rollout& rollout, TimeNs until_ns) const;

  PredictorConfig config_;
  ResponseEstimator estimator_;
  estimation::MotionFilter filter_;
  std::deque<Sent> sent_;
  TimeNs late_ns_ = 0;
};

}  // namespace ledgerline::ground::motion
