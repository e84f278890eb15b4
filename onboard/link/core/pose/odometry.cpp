#include "onboard/link/core/pose/odometry.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {
namespace {

// Standard deviation of a value that is reported in whole steps.
constexpr double rounding(double step) { return step * std::numbers::inv_sqrt3 / 2; }
constexpr double velocity_step_mps = 0.1, h_step_m = 0.1, tof_step_m = 0.01;
constexpr double yaw_step_rad = std::numbers::pi / 180;

// Nobody knows where it is: first seen in the air. Larger than any room, small enough for the filter's numbers.
constexpr double anywhere_m = 100;
// At 0.10 m tof shows its least, whatever is below. 65.53 says that it sees nothing; a Tello's flow ends before that.
constexpr double min_tof_m = 0.15, max_tof_m = 6.0;
// A tof that is off by more than this, and by more than chance, has come over something else: half takes a tilt's error
// for a table, with double a drone climbs by a stair's height.
constexpr double new_floor_m = 0.15, new_floor_sigmas = 4;
// Of onboard odometry [A]: the tof sensor, the barometer, and how fast h and the barometer drift. Halved, the height
// follows the barometer's noise; doubled, it is tof's alone.
constexpr double tof_sigma_m = 0.015, barometer_sigma_m = 0.2, drift_m_per_sqrt_s = 0.03;
// One text in ten seconds may be that late. What is flown unmeasured for longer is not known any more.
constexpr double max_gap_s = 1.0;
// Fixes within 4 sigma pass: beyond is one in 16,000. Outliers in a row that agree are accepted, too: three for the
// place, within a second; fifty for the heading, five seconds' worth, since a pad that lies askew or another body is
// not seen for as long, and a gyroscope does not drift by that.
constexpr double fix_sigmas = 4;
constexpr int positions_that_agree = 3, headings_that_agree = 50;
// Two fixes of one place, a text apart: what a drone moves by meanwhile beyond what it reports.
constexpr double moved_between_m = 0.05;

constexpr int px = 0, flow = 2, scale = 4, heading = 5;  // of the plane
constexpr int z = 0, floor_z = 1, drift = 2, zero = 3;   // of the height

double square(double x) { return x * x; }

}  // namespace

bool FixAgreement::holds(const Eigen::Vector2d& off, double spread) noexcept {
  count_ = count_ > 0 && (off - off_).norm() <= spread ? count_ + 1 : 1;
  off_ = off;
  if (count_ < needed_) return false;
  count_ = 0;
  return true;
}

Odometry::Odometry(const OdometrySettings& settings) noexcept
    : settings_(settings), refused_positions_(positions_that_agree), refused_headings_(headings_that_agree) {}

void Odometry::start(const TelloState& state, bool at_start) noexcept {
  placed_ = at_start;
  refused_positions_.reset();
  refused_headings_.reset();
  last_fix_ = {};
  const double sigma = at_start ? settings_.start_sigma_m : anywhere_m;
  const double turn = at_start ? settings_.start_sigma_rad : std::numbers::pi;
  plane_ << settings_.start_m[0], settings_.start_m[1], 0, 0, 0, 0;
  plane_cov_.setZero();
  plane_cov_.diagonal() << square(sigma), square(sigma), square(settings_.flow_mps), square(settings_.flow_mps),
      square(settings_.flow_scale), square(turn) + square(rounding(yaw_step_rad));
  const double start_z = settings_.start_m[2];
  const double stands_z = at_start ? start_z : start_z + static_cast<double>(state.height_m);
  height_ << stands_z, start_z, 0, static_cast<double>(state.barometer_m) - stands_z;
  height_cov_.setZero();
  height_cov_.diagonal() << square(at_start ? settings_.start_sigma_m : 1.0), square(settings_.start_sigma_m), 0,
      square(barometer_sigma_m);
  drone_yaw_rad_ = static_cast<double>(attitude_rad(state)[2]);
  frame_yaw_rad_ = settings_.start_yaw_rad - drone_yaw_rad_;
  takeoff_z_m_ = start_z;
  held_back_m_.setZero();
}

Eigen::Vector3d Odometry::reported_velocity(const TelloState& state) const noexcept {
  Eigen::Vector3d velocity;
  for (int i = 0; i < 3; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double reported = static_cast<double>(settings_.velocity_signs[at] * state.velocity_dmps[at]) / 10;
    const double cut_off = settings_.velocity_truncated && reported != 0 ? velocity_step_mps / 2 : 0;
    velocity[i] = (i < 2 ? settings_.velocity_scale : 1) * (reported + std::copysign(cut_off, reported));
  }
  if (settings_.velocity_in_body)
    velocity.head<2>() = Eigen::Rotation2Dd(drone_yaw_rad_) * Eigen::Vector2d(velocity.head<2>());
  return velocity;
}

Eigen::Vector3d Odometry::in_map(const Eigen::Vector3d& velocity) const noexcept {
  const Eigen::Vector2d turned =
      Eigen::Rotation2Dd(frame_yaw_rad_ + plane_[heading]) * Eigen::Vector2d(velocity.head<2>());
  const Eigen::Vector2d level = (1 + plane_[scale]) * turned - plane_.segment<2>(flow);
  return {level.x(), level.y(), velocity.z()};
}

Eigen::Vector2d Odometry::velocity_mps() const noexcept {
  return in_map(last_velocity_mps_).head<2>() + plane_.segment<2>(flow);
}

double Odometry::scale_sigma() const noexcept { return std::sqrt(plane_cov_(scale, scale)); }

double Odometry::yaw() const noexcept {
  return std::remainder(frame_yaw_rad_ + plane_[heading] + drone_yaw_rad_, 2 * std::numbers::pi);
}

void Odometry::predict(double seconds, const Eigen::Vector3d& velocity, bool stands) noexcept {
  plane_cov_(heading, heading) += square(settings_.heading_rad_per_sqrt_s) * seconds;
  if (stands) return;
  const Eigen::Vector3d moved = in_map(velocity);
  const double c = moved.x() + plane_[flow], s = moved.y() + plane_[flow + 1];  // without the flow's error
  const double by = 1 + plane_[scale];
  const double keeps = std::exp(-seconds / settings_.flow_s);
  PlaneMatrix f = PlaneMatrix::Identity();
  f(px, flow) = f(px + 1, flow + 1) = -seconds;
  f(px, scale) = c / by * seconds;
  f(px + 1, scale) = s / by * seconds;
  f(px, heading) = -s * seconds;
  f(px + 1, heading) = c * seconds;
  f(flow, flow) = f(flow + 1, flow + 1) = keeps;
  plane_.head<2>() += moved.head<2>() * seconds;
  last_fix_.flown_s += seconds;
  last_fix_.flown_m += moved.head<2>().norm() * seconds;
  plane_.segment<2>(flow) *= keeps;
  plane_cov_ = f * plane_cov_ * f.transpose();
  for (int i = 0; i < 2; ++i) {
    plane_cov_(px + i, px + i) += square(rounding(velocity_step_mps) * seconds);
    plane_cov_(flow + i, flow + i) += square(settings_.flow_mps) * (1 - keeps * keeps);
  }

  height_[z] += velocity.z() * seconds;
  height_cov_(z, z) += square(2 * rounding(velocity_step_mps) * seconds);
  height_cov_(drift, drift) += square(drift_m_per_sqrt_s) * seconds;
  height_cov_(zero, zero) += square(drift_m_per_sqrt_s) * seconds;
}

void Odometry::update_height(const Height& by, double measured, double sigma) noexcept {
  const double innovation = measured - by.dot(height_);
  const double variance = by.dot(height_cov_ * by) + square(sigma);
  const Height gain = height_cov_ * by / variance;
  height_ += gain * innovation;
  height_cov_ -= gain * gain.transpose() * variance;
}

void Odometry::measure_height(const TelloState& state) noexcept {
  const std::array<float, 3> attitude = attitude_rad(state);
  const double upright = static_cast<double>(std::cos(attitude[0]) * std::cos(attitude[1]));
  const auto tof = static_cast<double>(state.tof_m);
  if (tof > min_tof_m && tof < max_tof_m && upright > 0.7) {
    const double measured = tof * upright;
    const Height by(1, -1, 0, 0);
    const double off = std::abs(measured - by.dot(height_));
    const double sigma = std::hypot(tof_sigma_m, rounding(tof_step_m));
    if (off > new_floor_m && off > new_floor_sigmas * std::sqrt(by.dot(height_cov_ * by) + square(sigma)))
      height_cov_(floor_z, floor_z) += square(off);  // what is below it has changed, not where it is
    update_height(by, measured, sigma);
  }
  const double h = takeoff_z_m_ + static_cast<double>(state.height_m);
  update_height(Height(1, 0, -1, 0), h, rounding(h_step_m));
  if (state.has_barometer) update_height(Height(1, 0, 0, 1), static_cast<double>(state.barometer_m), barometer_sigma_m);
}

void Odometry::widen(double metres) noexcept {
  plane_cov_(px, px) += square(metres);
  plane_cov_(px + 1, px + 1) += square(metres);
}

void Odometry::on_state(TimeNs now, const TelloState& state, bool stands) noexcept {
  const bool first = text_ns_ == 0;
  // Texts may overtake each other, so in the air a `time` that falls is only an old text.
  const bool switched_off = stands && state.motor_s < motor_s_;
  const bool only_now_seen_standing = stands && !placed_ && state.motor_s == motor_s_;
  motor_s_ = stands ? state.motor_s : std::max(motor_s_, state.motor_s);
  if (first || switched_off || only_now_seen_standing) start(state, stands);
  const double silence_s = first ? 0 : to_seconds(now - text_ns_);
  const double seconds = std::min(silence_s, max_gap_s);
  const double speed_mps = last_velocity_mps_.norm();
  // What it did meanwhile nobody saw: it may have gone on as fast as it flew, and landed somewhere.
  if (silence_s > max_gap_s && !(stands && stood_)) widen((speed_mps + 1) * silence_s);
  stood_ = stands;
  text_ns_ = now;
  drone_yaw_rad_ = static_cast<double>(attitude_rad(state)[2]);
  const bool usable = state.has_velocity && state.tof_m < static_cast<float>(max_tof_m);
  // Without a usable velocity it is taken to fly on as it did, and may as well not.
  const Eigen::Vector3d velocity = stands   ? Eigen::Vector3d::Zero()
                                   : usable ? reported_velocity(state)
                                            : last_velocity_mps_;
  const double unmeasured_m = usable || stands ? 0 : unmeasured_m_ + (speed_mps + 0.5) * seconds;
  if (unmeasured_m > 0) widen(std::sqrt(square(unmeasured_m) - square(unmeasured_m_)));  // as much as it may be by now
  unmeasured_m_ = unmeasured_m;
  predict(seconds, (last_velocity_mps_ + velocity) / 2, stands);
  last_velocity_mps_ = velocity;
  if (stands) {
    takeoff_z_m_ = height_[z];
  } else {
    measure_height(state);
  }
  const double let_in = settings_.correction_mps * seconds, held = held_back_m_.norm();
  held_back_m_ *= held > let_in ? 1 - let_in / held : 0;
  if (usable || stands) pose_.stamp_ns = now;
  update_pose(velocity);
}

bool Odometry::heading_fits(const Fix& fix) noexcept {
  const double off = std::remainder(fix.yaw_rad - yaw(), 2 * std::numbers::pi);
  const bool fits = square(off) < square(fix_sigmas) * (plane_cov_(heading, heading) + square(fix.sigma_rad));
  if (!fits && !refused_headings_.holds({off, 0}, fix_sigmas * std::numbers::sqrt2 * fix.sigma_rad)) return false;
  refused_headings_.reset();
  if (!fits) plane_cov_(heading, heading) += square(off);
  return true;
}

void Odometry::fix_heading(const Fix& fix) noexcept {
  const double innovation = std::remainder(fix.yaw_rad - yaw(), 2 * std::numbers::pi);
  const double variance = plane_cov_(heading, heading) + square(fix.sigma_rad);
  const Plane gain = plane_cov_.col(heading) / variance;
  plane_ += gain * innovation;
  plane_cov_ -= gain * gain.transpose() * variance;
}

Eigen::Vector2d Odometry::beside(const Fix& fix) const noexcept {
  return Eigen::Vector2d(fix.position_m[0], fix.position_m[1]) - place();
}

Eigen::Vector2d Odometry::place() const noexcept {
  return plane_.head<2>() + settings_.velocity_lag_s * speed_change();
}

Eigen::Vector2d Odometry::speed_change() const noexcept {
  if (last_velocity_mps_.isZero()) return -last_fix_.velocity_mps;
  return in_map(last_velocity_mps_).head<2>() - last_fix_.velocity_mps;
}

Eigen::Matrix2d Odometry::place_variance(const Fix& fix) const noexcept {
  Eigen::Matrix2d variance = plane_cov_.topLeftCorner<2, 2>();
  variance.diagonal().array() += square(fix.sigma_m);
  variance.diagonal() += (settings_.velocity_lag_sigma_s * speed_change()).cwiseAbs2();
  return variance;
}

void Odometry::fix(const Fix& fix) noexcept {
  if (text_ns_ == 0) return;
  const Eigen::Vector2d off = beside(fix);
  const bool plausible = off.dot(place_variance(fix).inverse() * off) < square(fix_sigmas);
  const double apart_m = fix_sigmas * std::numbers::sqrt2 * fix.sigma_m + moved_between_m;
  if (!plausible && !refused_positions_.holds(off, apart_m)) return;
  refused_positions_.reset();
  placed_ = true;
  if (!plausible) widen(off.norm());
  const auto place_now = [this] { return Eigen::Vector3d(place().x(), place().y(), height_[z]); };
  const Eigen::Vector3d before = place_now();
  if (heading_fits(fix)) fix_heading(fix);
  const Eigen::Vector2d innovation = beside(fix);
  const Eigen::Matrix2d variance = place_variance(fix);
  const Eigen::Matrix<double, 6, 2> gain = plane_cov_.leftCols<2>() * variance.inverse();
  plane_ += gain * innovation;
  plane_cov_ -= gain * variance * gain.transpose();
  plane_cov_ = (0.5 * (plane_cov_ + plane_cov_.transpose())).eval();
  update_height(Height(1, 0, 0, 0), fix.position_m[2], fix.sigma_m);
  plane_.head<2>() += settings_.velocity_lag_s * speed_change();
  last_fix_ = {.velocity_mps = last_fix_.velocity_mps + speed_change()};
  // On the ground nothing follows the reported pose, so nothing can jump.
  if (!stood_) held_back_m_ += before - place_now();
  update_pose(last_velocity_mps_);
}

void Odometry::update_pose(const Eigen::Vector3d& velocity) noexcept {
  const Eigen::Vector3d known = Eigen::Vector3d(place().x(), place().y(), height_[z]) + held_back_m_;
  const Eigen::Vector3d moves = velocity.isZero() ? Eigen::Vector3d::Zero() : in_map(velocity);
  for (int i = 0; i < 3; ++i) {
    const auto at = static_cast<std::size_t>(i);
    pose_.position_m[at] = known[i];
    pose_.velocity_mps[at] = moves[i];
    const double variance = i < 2 ? plane_cov_(px + i, px + i) : height_cov_(z, z);
    const double late_m = i < 2 ? settings_.velocity_lag_sigma_s * speed_change()[i] : 0;
    pose_.variance[at] = static_cast<float>(variance + square(held_back_m_[i]) + square(late_m));
  }
  pose_.yaw_rad = yaw();
  pose_.variance[3] = static_cast<float>(plane_cov_(heading, heading) + square(rounding(yaw_step_rad)));
}

}  // namespace ledgerline::link
