#pragma once
#include <cmath>
#include <deque>
#include <vector>

#include "common/base/random.hpp"
#include "common/msg/onboard.hpp"
#include "ground/core/controller.hpp"

namespace ledgerline::ground {

/// A drone for tests: velocity follows the setpoint with a first-order lag, in a gusty wind if wanted; plans arrive
/// after a delay and each setpoint is flown when its time has come.
class LaggedDrone {
 public:
  explicit LaggedDrone(double lag_s, double gust_mps = 0, std::uint64_t seed = 1)
      : lag_s_(lag_s), gust_mps_(gust_mps), random_(seed) {}

  void deliver(TimeNs at_ns, std::vector<Setpoint> plan) { coming_.push_back({at_ns, std::move(plan)}); }

  void run_until(TimeNs t_ns) {
    while (motion.stamp_ns < t_ns) step();
  }

  Motion motion;
  Eigen::Vector3d setpoint_mps = Eigen::Vector3d::Zero();  ///< the setpoint that it flies

  /// As link would say it.
  StateSample state() const {
    StateSample sample;
    sample.phase = LinkPhase::flying;
    sample.stamp_ns = sample.pose_stamp_ns = motion.stamp_ns;
    for (int i = 0; i < 3; ++i) {
      const auto k = static_cast<std::size_t>(i);
      sample.position_m[k] = motion.position_m[i];
      sample.velocity_mps[k] = motion.velocity_mps[i];
      sample.sent_velocity_mps[k] = static_cast<float>(setpoint_mps[i]);
    }
    sample.yaw_rad = motion.yaw_rad;
    return sample;
  }

 private:
  void step() {
    constexpr double dt_s = 0.001;
    motion.stamp_ns += ns_per_ms;
    while (!coming_.empty() && coming_.front().first <= motion.stamp_ns) {
      plans_.push_back(std::move(coming_.front().second));
      coming_.pop_front();
    }
    Eigen::Vector3d wanted = Eigen::Vector3d::Zero();
    double yaw_rate = 0;
    while (plans_.size() > 1 && plans_[1].front().at_ns <= motion.stamp_ns) plans_.pop_front();
    if (!plans_.empty()) {
      for (const Setpoint& s : plans_.front()) {
        if (s.at_ns > motion.stamp_ns) break;
        wanted = {s.velocity_mps[0], s.velocity_mps[1], s.velocity_mps[2]};
        yaw_rate = static_cast<double>(s.yaw_rate_radps);
      }
    }
    for (int i = 0; i < 2; ++i) gust_[i] += -gust_[i] * dt_s + gust_mps_ * std::sqrt(2 * dt_s) * random_.normal();
    setpoint_mps = wanted;
    motion.velocity_mps += (wanted + gust_ - motion.velocity_mps) * dt_s / lag_s_;
    motion.position_m += motion.velocity_mps * dt_s;
    motion.yaw_rad += yaw_rate * dt_s;
  }

  double lag_s_, gust_mps_;
  Random random_;
  Eigen::Vector3d gust_ = Eigen::Vector3d::Zero();
  std::deque<std::pair<TimeNs, std::vector<Setpoint>>> coming_;
  std::deque<std::vector<Setpoint>> plans_;
};

}  // namespace ledgerline::ground
