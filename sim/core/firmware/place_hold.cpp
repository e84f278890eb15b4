#include "sim/core/firmware/place_hold.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::sim {
namespace {

constexpr double rest_mps = 0.15;  // [A] slower than this with centred sticks: hold this position
// [A] What the integral may add: a Tello holds its position in wind up to some 4 m/s. More would only wind up.
constexpr double max_learned_mps = 1.0;

}  // namespace

void PlaceHold::release() {
  release_sideways();
  height_m_.reset();
  learned_up_mps_ = 0;
}

void PlaceHold::release_sideways() {
  position_.reset();
  learned_mps_.setZero();
  centred_s_ = 0;
}

void PlaceHold::hold(const Eigen::Vector2d& position) {
  release_sideways();
  position_ = position;
}

void PlaceHold::shift(const Eigen::Vector2d& by) {
  if (position_) *position_ += by;
}

void PlaceHold::hold_height(double height_m) {
  height_m_ = height_m;
  learned_up_mps_ = 0;
}

Eigen::Vector2d PlaceHold::sideways(const Eigen::Vector2d& wanted, const Vector& position, const Vector& velocity) {
  if (wanted.squaredNorm() > 0) {
    release_sideways();
    return wanted;
  }
  centred_s_ += step_s;
  if (!position_ && (velocity.head<2>().norm() < rest_mps || centred_s_ > p_.hold_after_s))
    position_ = position.head<2>() + velocity.head<2>() * p_.velocity_lag_s;
  if (!position_) return wanted;
  const Eigen::Vector2d error = *position_ - position.head<2>();
  learned_mps_ += p_.hold_integral_per_s2 * error * step_s;
  if (const double length = learned_mps_.norm(); length > max_learned_mps) learned_mps_ *= max_learned_mps / length;
  return p_.position_gain_per_s * error + learned_mps_;
}

double PlaceHold::upward(double wanted_mps, const Vector& position, const Vector& velocity) {
  if (wanted_mps != 0) {
    height_m_.reset();
    learned_up_mps_ = 0;
    return wanted_mps;
  }
  if (!height_m_ && std::abs(velocity.z()) < rest_mps) hold_height(position.z() + velocity.z() * p_.velocity_lag_s);
  if (!height_m_) return wanted_mps;
  const double error = *height_m_ - position.z();
  learned_up_mps_ =
      std::clamp(learned_up_mps_ + p_.hold_integral_per_s2 * error * step_s, -max_learned_mps, max_learned_mps);
  return p_.position_gain_per_s * error + learned_up_mps_;
}

Vector PlaceHold::position() const {
  const Eigen::Vector2d xy = position_.value_or(Eigen::Vector2d::Zero());
  return {xy.x(), xy.y(), height_m_.value_or(0)};
}

}  // namespace ledgerline::sim
