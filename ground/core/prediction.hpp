#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "common/msg/onboard.hpp"
#include "ground/motion/predictor.hpp"

namespace ledgerline::ground {

using motion::Motion;

/// Where a drone will be: its velocity follows the setpoints with a first-order lag. Remembers what was sent, so that a
/// plan can start from the state at the moment when its first setpoint is meant to be flown. Bounded in work and
/// memory, whatever the times in the state. Deterministic; one thread.
class Prediction {
 public:
  /// Nothing is predicted over more than this: a pose or a plan that far back says nothing, and costs time.
  static constexpr TimeNs longest_ns = 3 * ns_per_s;

  explicit Prediction(double lag_s) : lag_s_(lag_s) {}

  Motion at(const Motion& state, TimeNs at_ns) const;
  Motion move(const Motion& from, const Setpoint& setpoint, double dt_s) const;
  /// A plan went out, made from this state; not empty. From its first setpoint on it replaces those before.
  void sent(const Motion& state, std::span<const Setpoint> plan);

 private:
  double lag_s_;
  std::vector<Setpoint> sent_;  ///< what the drone is thought to fly, in order of time
};

}  // namespace ledgerline::ground
