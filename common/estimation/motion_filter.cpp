#include "common/estimation/motion_filter.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace ledgerline::estimation {
namespace {

constexpr TimeNs pause_ns = ns_per_s;  // between poses: after it the filter restarts
constexpr double jump_m = 0.5;         // no drone is that far from where it was expected
// Measurements: agent's fused pose from optical mocap; its velocity lags by some 50 ms, so it counts little.
constexpr double position_sigma_m = 0.002, velocity_sigma_mps = 0.3;
// What the model leaves out, as white noise: of acceleration, and of the drift's change.
constexpr double acceleration_noise = 0.05;  // m/s2 / sqrt(Hz)
constexpr double drift_noise = 0.05;         // m/s / sqrt(s)
constexpr double drift_lasts_s = 1;          // ahead of the newest pose: gusts come and go
constexpr double first_drift_sigma_mps = 0.03, first_velocity_sigma_mps = 0.2;
constexpr double max_drift_mps = 0.5;

// One step of the model with a constant commanded velocity; exact for it.
void step(const Response& r, const Eigen::Vector3d& sent, const Eigen::Vector3d& drift, double dt_s,
          Eigen::Vector3d& position, Eigen::Vector3d& velocity) {
  const Eigen::Vector3d end = r.gain * sent + drift;
  const double rest = std::exp(-dt_s / r.lag_s);
  position += end * dt_s + (velocity - end) * r.lag_s * (1 - rest);
  velocity = end + (velocity - end) * rest;
}

}  // namespace

void Rollout::move(const Eigen::Vector3d& sent, double dt_s) {
  step(response_, sent, drift_, dt_s, motion_.position_m, motion_.velocity_mps);
  drift_ *= std::exp(-dt_s / drift_lasts_s);
  motion_.stamp_ns += from_seconds(dt_s);
}

void Rollout::send(const Eigen::Vector3d& velocity_mps, double yaw_rate_radps, TimeNs until_ns,
                   double acceleration_mps2) {
  while (sent_ns_ < until_ns) {
    const TimeNs dt_ns = std::min(cell_ns, until_ns - sent_ns_);
    const double dt_s = to_seconds(dt_ns);
    const Eigen::Vector3d change = velocity_mps - sent_;
    const double most = acceleration_mps2 * dt_s;
    const Eigen::Vector3d before = sent_;
    sent_ = change.norm() <= most ? velocity_mps : Eigen::Vector3d(sent_ + change * (most / change.norm()));
    move(0.5 * (before + sent_), dt_s);
    motion_.yaw_rad += yaw_rate_radps * dt_s;
    sent_ns_ += dt_ns;
  }
}

bool MotionFilter::add_sent(const SentVelocity& sent) {
  if (count_ != 0 && sent.stamp_ns <= sent_back().stamp_ns) return false;
  if (count_ == kept) {
    first_ = (first_ + 1) % kept;
    --count_;
  }
  sent_[(first_ + count_++) % kept] = sent;
  return true;
}

bool MotionFilter::add_pose(const Motion& measured) {
  const bool gap = !ready() || measured.stamp_ns - motion_.stamp_ns > pause_ns;
  if (!gap) propagate(measured.stamp_ns);
  const bool restarts = gap || (measured.position_m - motion_.position_m).norm() > jump_m;
  if (restarts) {
    start(measured);
  } else {
    correct(measured);
  }
  motion_.yaw_rad = measured.yaw_rad;
  return restarts;
}

void MotionFilter::start(const Motion& measured) {
  motion_ = measured;
  drift_.setZero();
  covariance_.setZero();
  covariance_.diagonal() << position_sigma_m * position_sigma_m, first_velocity_sigma_mps * first_velocity_sigma_mps,
      first_drift_sigma_mps * first_drift_sigma_mps;
}

SentVelocity MotionFilter::sent_at(TimeNs t_ns) const {
  if (count_ == 0) return {};
  std::size_t next = 0;  // the first that is not before t_ns
  for (std::size_t end = count_; next < end;) {
    const std::size_t middle = next + (end - next) / 2;
    if (sent_item(middle).stamp_ns < t_ns) {
      next = middle + 1;
    } else {
      end = middle;
    }
  }
  if (next == 0) return sent_item(0);
  if (next == count_) return sent_back();
  const SentVelocity &before = sent_item(next - 1), &after = sent_item(next);
  const double share =
      static_cast<double>(t_ns - before.stamp_ns) / static_cast<double>(after.stamp_ns - before.stamp_ns);
  return {t_ns, before.velocity_mps + share * (after.velocity_mps - before.velocity_mps),
          before.yaw_rate_radps + share * (after.yaw_rate_radps - before.yaw_rate_radps)};
}

void MotionFilter::propagate(TimeNs to_ns) {
  const TimeNs dead_ns = from_seconds(response_.dead_s);
  TimeNs& stamp_ns = motion_.stamp_ns;
  while (stamp_ns < to_ns) {
    const TimeNs until_ns = std::min(to_ns, stamp_ns + cell_ns);
    const double dt = to_seconds(until_ns - stamp_ns);
    step(response_, sent_at((stamp_ns + until_ns) / 2 - dead_ns).velocity_mps, drift_, dt, motion_.position_m,
         motion_.velocity_mps);
    const double rest = std::exp(-dt / response_.lag_s), moved = response_.lag_s * (1 - rest);
    Eigen::Matrix3d f;
    f << 1, moved, dt - moved,  //
        0, rest, 1 - rest,      //
        0, 0, 1;
    covariance_ = f * covariance_ * f.transpose();
    covariance_(1, 1) += acceleration_noise * acceleration_noise * dt;
    covariance_(2, 2) += drift_noise * drift_noise * dt;
    stamp_ns = until_ns;
  }
}

void MotionFilter::correct(const Motion& measured) {
  Eigen::Matrix<double, 2, 3> h;
  h << 1, 0, 0, 0, 1, 0;
  Eigen::Matrix2d noise = Eigen::Matrix2d::Zero();
  noise.diagonal() << position_sigma_m * position_sigma_m, velocity_sigma_mps * velocity_sigma_mps;
  const Eigen::Matrix2d innovation = h * covariance_ * h.transpose() + noise;
  const Eigen::Matrix<double, 3, 2> gain = covariance_ * h.transpose() * innovation.inverse();
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector2d error(measured.position_m[axis] - motion_.position_m[axis],
                                measured.velocity_mps[axis] - motion_.velocity_mps[axis]);
    const Eigen::Vector3d change = gain * error;
    motion_.position_m[axis] += change[0];
    motion_.velocity_mps[axis] += change[1];
    drift_[axis] = std::clamp(drift_[axis] + change[2], -max_drift_mps, max_drift_mps);
  }
  covariance_ = (Eigen::Matrix3d::Identity() - gain * h) * covariance_;
  covariance_ = 0.5 * (covariance_ + covariance_.transpose().eval());
}

Rollout MotionFilter::rollout(TimeNs until_ns) const {
  Rollout out;
  out.response_ = response_;
  out.drift_ = drift_;
  out.motion_ = motion_;
  out.sent_ns_ = motion_.stamp_ns - from_seconds(response_.dead_s);
  while (out.sent_ns_ < until_ns) {
    const TimeNs dt_ns = std::min(cell_ns, until_ns - out.sent_ns_);
    const SentVelocity sent = sent_at(out.sent_ns_ + dt_ns / 2);
    out.move(sent.velocity_mps, to_seconds(dt_ns));
    out.sent_ns_ += dt_ns;
    // Yaw follows at once: what was sent before the pose is in it.
    const TimeNs turned_ns = std::clamp<TimeNs>(out.sent_ns_ - motion_.stamp_ns, 0, dt_ns);
    out.motion_.yaw_rad += sent.yaw_rate_radps * to_seconds(turned_ns);
  }
  out.sent_ = sent_at(out.sent_ns_).velocity_mps;
  return out;
}

}  // namespace ledgerline::estimation
