#include "onboard/agent/core/mocap.hpp"

#include <fmt/format.h>

#include <cmath>

#include "common/msg/ros.hpp"

namespace ledgerline::agent {
namespace {

/// Velocity is unknown at the start: a drone flies slower than this (m/s, one sigma).
constexpr double first_velocity_sigma_mps = 2.0;

bool is_finite(const std::array<double, 3>& v) {
  return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
}
bool is_finite(const MocapPose& m) { return is_finite(m.position_m) && std::isfinite(m.yaw_rad); }

}  // namespace

void Fusion::start(const MocapPose& measured) {
  position_m_ = measured.position_m;
  velocity_mps_ = {};
  pp_ = settings_.position_sigma_m * settings_.position_sigma_m;
  pv_ = 0;
  vv_ = first_velocity_sigma_mps * first_velocity_sigma_mps;
  started_ = true;
  outliers_in_a_row_ = 0;
}

// Whether the same place has come for too long.
bool Fusion::check_frozen(const MocapPose& measured) {
  const bool same = repeated_ && repeated_->position_m == measured.position_m && repeated_->yaw_rad == measured.yaw_rad;
  if (!same) repeated_ = measured;
  return measured.stamp_ns - repeated_->stamp_ns >= settings_.frozen_after_ns;
}

std::optional<Pose> Fusion::add(const MocapPose& measured, bool in_flight) {
  if (!is_finite(measured)) {
    ++counters_.not_finite;
    return std::nullopt;
  }
  if (started_ && measured.stamp_ns <= stamp_ns_) {
    ++counters_.not_newer;
    return std::nullopt;
  }
  if (check_frozen(measured) && in_flight) {
    ++counters_.frozen;
    return std::nullopt;
  }
  if (started_ && measured.stamp_ns - stamp_ns_ > settings_.max_gap_ns) {
    ++counters_.resets;
    started_ = false;
  }
  if (!started_) {
    start(measured);
  } else {
    const double dt = to_seconds(measured.stamp_ns - stamp_ns_);
    const double q = settings_.acceleration_sigma_mps2 * settings_.acceleration_sigma_mps2;
    const double r = settings_.position_sigma_m * settings_.position_sigma_m;
    const double pp = pp_ + 2 * dt * pv_ + dt * dt * vv_ + q * dt * dt * dt * dt / 4;
    const double pv = pv_ + dt * vv_ + q * dt * dt * dt / 2;
    const double vv = vv_ + q * dt * dt;
    const double s = pp + r;

    std::array<double, 3> predicted{};
    std::array<double, 3> innovation{};
    double squares = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      predicted[i] = position_m_[i] + dt * velocity_mps_[i];
      innovation[i] = measured.position_m[i] - predicted[i];
      squares += innovation[i] * innovation[i];
    }
    if (squares > settings_.gate_sigma * settings_.gate_sigma * s) {
      ++counters_.outliers;
      if (++outliers_in_a_row_ < settings_.outliers_before_reset) return std::nullopt;
      ++counters_.resets;
      start(measured);
    } else {
      const double gain_p = pp / s;
      const double gain_v = pv / s;
      for (std::size_t i = 0; i < 3; ++i) {
        position_m_[i] = predicted[i] + gain_p * innovation[i];
        velocity_mps_[i] += gain_v * innovation[i];
      }
      pp_ = (1 - gain_p) * pp;
      pv_ = (1 - gain_p) * pv;
      vv_ = vv - gain_v * pv;
      outliers_in_a_row_ = 0;
    }
  }
  stamp_ns_ = measured.stamp_ns;
  ++counters_.accepted;
  Pose pose;
  pose.stamp_ns = measured.stamp_ns;
  pose.position_m = position_m_;
  pose.velocity_mps = velocity_mps_;
  pose.yaw_rad = measured.yaw_rad;
  return pose;
}

namespace {

constexpr double norm_slack = 0.05;  // of the squared norm: mocap systems round, and none sends half a rotation

double squared_norm(const std::array<double, 4>& q) { return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]; }

// Not a number is not near 1, either.
bool is_unit(const std::array<double, 4>& q) { return std::abs(squared_norm(q) - 1) < norm_slack; }

}  // namespace

Status MocapIntake::check_numbers(const std::array<double, 3>& position_m, const std::array<double, 4>& orientation) {
  if (!is_finite(position_m)) return Error{"its position is not a number"};
  if (!is_unit(orientation))
    return Error{fmt::format("its orientation has the length {:.2f}, not 1", std::sqrt(squared_norm(orientation)))};
  return done;
}

Result<MocapPose> MocapIntake::check(const MocapMessage& message) {
  if (const Status numbers = check_numbers(message.position_m, message.orientation); !numbers) return numbers.error();
  const auto stamp_ns = stamps_of_this_host_ ? clock_.stamp(message.source_real_ns, message.arrived_ns)
                                             : std::optional(message.arrived_ns);
  if (!stamp_ns)
    return Error{
        fmt::format("its stamp is {:.0f} ms before its arrival: if its computer's clock differs from this one's, set "
                    "clock = \"arrival\" in [mocap]",
                    to_ms(message.arrived_ns - (message.source_real_ns - clock_.offset_ns())))};
  return MocapPose{*stamp_ns, message.position_m, yaw_from_quaternion(message.orientation)};
}

}  // namespace ledgerline::agent
