#pragma once
#include <cmath>
#include <deque>

#include "common/base/random.hpp"
#include "common/msg/onboard.hpp"
#include "ground/motion/response.hpp"

namespace ledgerline::ground::motion {

/// A drone for tests that answers exactly as a Response does, in a gusty wind, in steps of 1 ms; not the code under
/// test.
class ReportedDrone {
 public:
  ReportedDrone(const Response& response, double gust_mps = 0, double noise_m = 0, std::uint64_t seed = 1)
      : response_(response), gust_mps_(gust_mps), noise_m_(noise_m), random_(seed) {}

  TimeNs now_ns = 100 * ns_per_s;
  Eigen::Vector3d position{0, 0, 1}, velocity{0, 0, 0}, wind{0, 0, 0}, sent{0, 0, 0};

  void step() {
    now_ns += ns_per_ms;
    pipe_.push_back(sent);
    if (pipe_.size() > 1 + static_cast<std::size_t>(response_.dead_s * 1e3)) pipe_.pop_front();
    for (int i = 0; i < 2; ++i) gust_[i] += -gust_[i] * 1e-3 + gust_mps_ * std::sqrt(2e-3) * random_.normal();
    velocity += (response_.gain * pipe_.front() + wind + gust_ - velocity) * 1e-3 / response_.lag_s;
    position += 1e-3 * velocity;
  }
  void run_until(TimeNs t_ns) {
    while (now_ns < t_ns) step();
  }

  /// As link and agent would say it.
  StateSample state() {
    StateSample s;
    s.phase = LinkPhase::flying;
    s.stamp_ns = s.pose_stamp_ns = now_ns;
    for (std::size_t i = 0; i < 3; ++i) {
      s.position_m[i] = position[static_cast<int>(i)] + noise_m_ * random_.normal();
      s.velocity_mps[i] = velocity[static_cast<int>(i)];
      s.sent_velocity_mps[i] = static_cast<float>(sent[static_cast<int>(i)]);
    }
    return s;
  }

 private:
  Response response_;
  double gust_mps_, noise_m_;
  Random random_;
  Eigen::Vector3d gust_ = Eigen::Vector3d::Zero();
  std::deque<Eigen::Vector3d> pipe_;
};

constexpr TimeNs state_period_ns = ns_per_s / 30;

/// A velocity that turns a corner every 1.5 s, as around a square, 0.7 m/s.
inline Eigen::Vector3d around_a_square(TimeNs t_ns) {
  constexpr Eigen::Index corners = 4;
  const auto side = static_cast<Eigen::Index>(t_ns / (1'500 * ns_per_ms)) % corners;
  const double v = side < 2 ? 0.7 : -0.7;
  return side % 2 == 0 ? Eigen::Vector3d(v, 0, 0) : Eigen::Vector3d(0, v, 0);
}

}  // namespace ledgerline::ground::motion
