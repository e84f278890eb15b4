#include "ground/motion/predictor.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace ledgerline::ground::motion {
namespace {

constexpr TimeNs cell_ns = 10 * ns_per_ms;
constexpr TimeNs pause_ns = ns_per_s;     // between states: after it the filter restarts
constexpr double jump_m = 0.5;            // no drone is that far from where it was expected
constexpr std::size_t max_applied = 512;  // 2.5 s at 200 states a second
constexpr std::size_t sent_kept = 256;
// Measurements: agent's fused pose from optical mocap; its velocity lags by some 50 ms, so it counts little.
constexpr double position_sigma_m = 0.002, velocity_sigma_mps = 0.3;
// What the model leaves out, as white noise: of acceleration, and of the drift's change.
constexpr double acceleration_noise = 0.05;  // m/s2 / sqrt(Hz)
constexpr double drift_noise = 0.05;         // m/s / sqrt(s)
constexpr double drift_lasts_s = 1;          // ahead of the newest state: gusts come and go
constexpr double first_drift_sigma_mps = 0.03, first_velocity_sigma_mps = 0.2;
constexpr double max_drift_mps = 0.5;

// Link's: how long it flies the only setpoint of a plan, and the last one of any plan at most.
constexpr TimeNs default_hold_ns = 100 * ns_per_ms, max_hold_ns = 500 * ns_per_ms;

TimeNs end_of(const std::vector<Setpoint>& plan) {
  const TimeNs last_ns = plan.back().at_ns;
  if (plan.size() == 1) return last_ns + default_hold_ns;
  return last_ns + std::min(last_ns - plan[plan.size() - 2].at_ns, max_hold_ns);
}

Eigen::Vector3d vector(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

// One step of the model with a constant commanded velocity; exact for it.
void step(const Response& r, const Eigen::Vector3d& sent, const Eigen::Vector3d& drift, double dt_s,
          Eigen::Vector3d& position, Eigen::Vector3d& velocity) {
  const Eigen::Vector3d end = r.gain * sent + drift;
  const double rest = std::exp(-dt_s / r.lag_s);
  position += end * dt_s + (velocity - end) * r.lag_s * (1 - rest);
  velocity = end + (velocity - end) * rest;
}

}  // namespace

Predictor::Predictor(const PredictorConfig& config)
    : config_(config), estimator_(config.first), response_(config.first) {}

Motion Predictor::newest() const { return {stamp_ns_, position_, velocity_, yaw_rad_}; }

void Predictor::start(const StateSample& state) {
  stamp_ns_ = state.pose_stamp_ns;
  position_ = Eigen::Vector3d::Map(state.position_m.data());
  velocity_ = Eigen::Vector3d::Map(state.velocity_mps.data());
  drift_.setZero();
  covariance_.setZero();
  covariance_.diagonal() << position_sigma_m * position_sigma_m, first_velocity_sigma_mps * first_velocity_sigma_mps,
      first_drift_sigma_mps * first_drift_sigma_mps;
  estimator_.interrupt();
}

void Predictor::observe(const StateSample& state) {
  late_ns_ = state.playout_margin_ns;
  if (!applied_.empty() && state.stamp_ns <= applied_.back().stamp_ns) return;
  // What link sent the drone is news without a new pose, too: it brakes while mocap is away.
  applied_.push_back({state.stamp_ns, vector(state.sent_velocity_mps), static_cast<double>(state.sent_yaw_rate_radps)});
  if (applied_.size() > max_applied) applied_.pop_front();
  if (state.pose_stamp_ns <= stamp_ns_) return;
  const Eigen::Vector3d measured = Eigen::Vector3d::Map(state.position_m.data());
  const bool gap = stamp_ns_ == 0 || state.pose_stamp_ns - stamp_ns_ > pause_ns;
  if (!gap) propagate(state.pose_stamp_ns);
  if (gap || (measured - position_).norm() > jump_m) {
    start(state);
  } else {
    correct(state);
  }
  yaw_rad_ = state.yaw_rad;
  if (!config_.learn) return;
  estimator_.add(state.pose_stamp_ns, measured.head<2>(),
                 [this](TimeNs t) -> Eigen::Vector2d { return applied_at(t).velocity_mps.head<2>(); });
  response_ = estimator_.response();
}

// Between two of link's words: the line between them. A step somewhere between is half a period off at most, and as
// often early as late.
Predictor::AppliedVelocity Predictor::applied_at(TimeNs t_ns) const {
  if (applied_.empty()) return {};
  const auto next = std::lower_bound(applied_.begin(), applied_.end(), t_ns,
                                     [](const AppliedVelocity& sent, TimeNs t) { return sent.stamp_ns < t; });
  if (next == applied_.begin()) return *next;
  if (next == applied_.end()) return applied_.back();
  const AppliedVelocity& before = *(next - 1);
  const double share =
      static_cast<double>(t_ns - before.stamp_ns) / static_cast<double>(next->stamp_ns - before.stamp_ns);
  return {t_ns, before.velocity_mps + share * (next->velocity_mps - before.velocity_mps),
          before.yaw_rate_radps + share * (next->yaw_rate_radps - before.yaw_rate_radps)};
}

void Predictor::propagate(TimeNs to_ns) {
  const TimeNs dead_ns = from_seconds(response_.dead_s);
  while (stamp_ns_ < to_ns) {
    const TimeNs until_ns = std::min(to_ns, stamp_ns_ + cell_ns);
    const double dt = to_seconds(until_ns - stamp_ns_);
    step(response_, applied_at((stamp_ns_ + until_ns) / 2 - dead_ns).velocity_mps, drift_, dt, position_, velocity_);
    const double rest = std::exp(-dt / response_.lag_s), moved = response_.lag_s * (1 - rest);
    Eigen::Matrix3d f;
    f << 1, moved, dt - moved,  //
        0, rest, 1 - rest,      //
        0, 0, 1;
    covariance_ = f * covariance_ * f.transpose();
    covariance_(1, 1) += acceleration_noise * acceleration_noise * dt;
    covariance_(2, 2) += drift_noise * drift_noise * dt;
    stamp_ns_ = until_ns;
  }
}

void Predictor::correct(const StateSample& state) {
  Eigen::Matrix<double, 2, 3> h;
  h << 1, 0, 0, 0, 1, 0;
  Eigen::Matrix2d noise = Eigen::Matrix2d::Zero();
  noise.diagonal() << position_sigma_m * position_sigma_m, velocity_sigma_mps * velocity_sigma_mps;
  const Eigen::Matrix2d innovation = h * covariance_ * h.transpose() + noise;
  const Eigen::Matrix<double, 3, 2> gain = covariance_ * h.transpose() * innovation.inverse();
  for (int axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    const Eigen::Vector2d error(state.position_m[i] - position_[axis], state.velocity_mps[i] - velocity_[axis]);
    const Eigen::Vector3d change = gain * error;
    position_[axis] += change[0];
    velocity_[axis] += change[1];
    drift_[axis] = std::clamp(drift_[axis] + change[2], -max_drift_mps, max_drift_mps);
  }
  covariance_ = (Eigen::Matrix3d::Identity() - gain * h) * covariance_;
  covariance_ = 0.5 * (covariance_ + covariance_.transpose().eval());
}

void Predictor::sent(std::uint64_t id, std::span<const Setpoint> plan) {
  if (plan.empty()) return;
  sent_.push_back({id, {plan.begin(), plan.end()}});
  if (sent_.size() > sent_kept) sent_.pop_front();
  // What a newer plan replaced before the newest state is over.
  while (sent_.size() > 1 && sent_[1].plan.front().at_ns + late_ns_ < stamp_ns_ - ns_per_s) sent_.pop_front();
}

void Predictor::withdraw(std::uint64_t id) {
  std::erase_if(sent_, [&](const Sent& sent) { return sent.id == id; });
}

// What the newest plan that has begun by then wants, as link's playout has it: behind its end, zero. Nothing: none has
// begun.
std::optional<Setpoint> Predictor::planned(TimeNs at_ns) const {
  for (auto sent = sent_.rbegin(); sent != sent_.rend(); ++sent) {
    if (sent->plan.front().at_ns > at_ns) continue;
    if (end_of(sent->plan) <= at_ns) return Setpoint{};
    const auto next = std::upper_bound(sent->plan.begin(), sent->plan.end(), at_ns,
                                       [](TimeNs t, const Setpoint& s) { return t < s.at_ns; });
    return *(next - 1);
  }
  return std::nullopt;
}

void Predictor::Rollout::move(const Eigen::Vector3d& sent, double dt_s) {
  step(response_, sent, drift_, dt_s, motion_.position_m, motion_.velocity_mps);
  drift_ *= std::exp(-dt_s / drift_lasts_s);
  motion_.stamp_ns += from_seconds(dt_s);
}

void Predictor::Rollout::send(const Eigen::Vector3d& velocity_mps, double yaw_rate_radps, TimeNs until_ns) {
  while (sent_ns_ < until_ns) {
    const TimeNs dt_ns = std::min(cell_ns, until_ns - sent_ns_);
    const double dt_s = to_seconds(dt_ns);
    const Eigen::Vector3d change = velocity_mps - sent_;
    const double most = sent_acceleration_mps2_ * dt_s;
    const Eigen::Vector3d before = sent_;
    sent_ = change.norm() <= most ? velocity_mps : Eigen::Vector3d(sent_ + change * (most / change.norm()));
    move(0.5 * (before + sent_), dt_s);
    motion_.yaw_rad += yaw_rate_radps * dt_s;
    sent_ns_ += dt_ns;
  }
}

Predictor::Rollout Predictor::until(TimeNs meant_ns) const {
  Rollout out;
  out.response_ = response_;
  out.sent_acceleration_mps2_ = config_.sent_acceleration_mps2;
  out.drift_ = drift_;
  out.motion_ = newest();
  const TimeNs dead_ns = from_seconds(response_.dead_s);
  const TimeNs until_ns = std::min(meant_ns + late_ns_, stamp_ns_ + max_ns);
  // Up to the last of link's words they count, behind it what was planned.
  const TimeNs known_ns = applied_.empty() ? stamp_ns_ : std::max(stamp_ns_ - dead_ns, applied_.back().stamp_ns);
  out.sent_ns_ = stamp_ns_ - dead_ns;
  for (const TimeNs end_ns = std::min(known_ns, until_ns); out.sent_ns_ < end_ns;) {
    const TimeNs dt_ns = std::min(cell_ns, end_ns - out.sent_ns_);
    const AppliedVelocity sent = applied_at(out.sent_ns_ + dt_ns / 2);
    out.move(sent.velocity_mps, to_seconds(dt_ns));
    out.sent_ns_ += dt_ns;
    // Yaw follows at once: what was sent before the pose is in it.
    const TimeNs turned_ns = std::clamp<TimeNs>(out.sent_ns_ - stamp_ns_, 0, dt_ns);
    out.motion_.yaw_rad += sent.yaw_rate_radps * to_seconds(turned_ns);
  }
  out.sent_ = applied_at(out.sent_ns_).velocity_mps;
  while (out.sent_ns_ < until_ns) {
    const TimeNs to_ns = std::min(out.sent_ns_ + cell_ns, until_ns);
    const std::optional<Setpoint> setpoint = planned(out.sent_ns_ - late_ns_);
    if (setpoint) {
      out.send(vector(setpoint->velocity_mps), static_cast<double>(setpoint->yaw_rate_radps), to_ns);
    } else {
      out.send(out.sent_, 0, to_ns);
    }
  }
  return out;
}

}  // namespace ledgerline::ground::motion
