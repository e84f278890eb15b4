#include "onboard/link/core/pose/source_check.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ledgerline::link {
namespace {

constexpr double max_text_gap_s = 1.0;      // as the odometry has it: what is flown unmeasured for longer is not known
constexpr double max_extrapolated_s = 0.2;  // two texts
// A drone that is pushed flies 3 m/s before its own velocity says so, for a text at most; below 0.3 m it may be noise.
constexpr double jump_m = 0.3, pushed_mps = 3, pushed_s = 0.1;
constexpr double kick_mps = 1.5;           // from one text to the next: at 4 m/s2 0.4 m/s, and three times that
constexpr double drift_mps = 0.1;          // of its own velocity, as gusts and rounding have it
constexpr double unmeasured_mps = 1;       // whose own velocity is not usable flies as fast as rc tells it at most
constexpr double climb_mps = 1;            // PlayoutSettings::max_vertical_mps
constexpr double own_height_step_m = 0.3;  // h has steps of 0.1 m, and is 0.2 s old in a climb of 0.5 m/s
constexpr double turn_rad = 0.09, turn_rad_per_s = 2.2;  // 5 degrees of noise; a Tello turns by 100 degrees/s
constexpr double late_s = 0.3;                           // as late as a text may say its heading
constexpr int texts_in_a_row = 3;                        // one that is torn or late is no contradiction
constexpr int max_texts_unusable = 3;
constexpr double scale_sigmas = 1.5, rounded_mps = 0.15;
constexpr double lag_sigmas = 1.5;     // 0.3 s of a drone that nobody measured
constexpr int max_texts_repeated = 3;  // nothing that flies has the same air pressure, to a centimetre, for longer
constexpr double alike_share = 0.5;    // what was apart must do better to be accepted again
constexpr TimeNs alike_for_ns = 2 * ns_per_s;
constexpr double one_place_m = 0.15, one_place_sigmas = 3;

double angle(double rad) { return std::remainder(rad, 2 * std::numbers::pi); }

Eigen::Vector2d in_plane(const Pose& pose) { return {pose.position_m[0], pose.position_m[1]}; }

}  // namespace

void OwnPath::advance(TimeNs now, const OwnMotion& own) noexcept {
  const double seconds = text_ns == 0 ? 0 : std::clamp(to_seconds(now - text_ns), 0.0, max_text_gap_s);
  if (own.usable) {
    // A text that is torn or another drone's: what nobody flies is taken when three in a row say the same.
    const bool unlikely_now = text_ns != 0 && (own.velocity_mps - velocity_mps).norm() > kick_mps;
    const bool again = unlikely > 0 && (own.velocity_mps - unlikely_mps).norm() <= kick_mps;
    unlikely = !unlikely_now ? 0 : again ? unlikely + 1 : 1;
    unlikely_mps = own.velocity_mps;
    const bool torn = unlikely_now && unlikely < texts_in_a_row;
    const Eigen::Vector2d velocity = torn ? velocity_mps : own.velocity_mps;
    // It was pushed, and flew so from the first of them on.
    if (unlikely == 1) pushed_m.setZero();
    if (torn) pushed_m += (own.velocity_mps - velocity_mps) * seconds;
    if (unlikely == texts_in_a_row) position_m += pushed_m;
    const Eigen::Vector2d moved = (velocity_mps + velocity) / 2 * seconds;
    position_m += moved;
    length_m += moved.norm();
    velocity_mps = velocity;
  } else {
    unmeasured_s += seconds;
    velocity_mps.setZero();
  }
  height_m = own.height_m;
  heading_rad = own.heading_rad;
  text_ns = now;
}

Eigen::Vector2d OwnPath::position_at(TimeNs now) const noexcept {
  return position_m + velocity_mps * std::clamp(to_seconds(now - text_ns), -max_extrapolated_s, max_extrapolated_s);
}

bool PoseGate::accepts(const Pose& pose, const OwnPath& own, double scale_sigma, bool in_flight) noexcept {
  if (in_flight && last_.stamp_ns != 0) {
    const double seconds = to_seconds(pose.stamp_ns - last_.stamp_ns);
    const double share = std::max(SourceCheck::apart_share, scale_sigmas * scale_sigma);
    const double allowed = jump_m + pushed_mps * std::clamp(seconds, 0.0, pushed_s) + drift_mps * seconds +
                           share * (own.length_m - own_.length_m) +
                           unmeasured_mps * (own.unmeasured_s - own_.unmeasured_s);
    const Eigen::Vector2d by_own = own.position_at(pose.stamp_ns) - own_.position_at(last_.stamp_ns);
    const Eigen::Vector2d moved = in_plane(pose) - in_plane(last_);
    // Small jumps between close poses are accepted without odometry, which may itself be wrong.
    const double near = jump_m + pushed_mps * std::clamp(seconds, 0.0, pushed_s);
    if (moved.norm() > near && (moved - by_own).norm() > allowed) return false;
    const double rise = pose.position_m[2] - last_.position_m[2], own_rise = own.height_m - own_.height_m;
    if (std::abs(rise) > near + climb_mps * seconds && std::abs(rise - own_rise) > allowed + own_height_step_m)
      return false;
    const double turned = angle(pose.yaw_rad - last_.yaw_rad), own_turned = angle(own.heading_rad - own_.heading_rad);
    if (std::abs(turned) > turn_rad + turn_rad_per_s * std::clamp(seconds, 0.0, pushed_s) &&
        std::abs(angle(turned - own_turned)) > turn_rad + turn_rad_per_s * std::clamp(seconds, 0.0, late_s))
      return false;
  }
  last_ = pose;
  own_ = own;
  return true;
}

bool SourceCheck::accepts(const Pose& pose, bool in_flight) noexcept {
  return gate_.accepts(pose, path_, scale_sigma_, in_flight);
}

void SourceCheck::forget() noexcept {
  samples_.clear();
  texts_apart_ = texts_alike_ = 0;
  alike_since_ns_ = 0;
}

double SourceCheck::compared(const Sample& newest, const OwnMotion& own) noexcept {
  while (!samples_.empty() && newest.at_ns - samples_[0].at_ns > window_ns) samples_.erase_front(1);
  apart_now_m_ = 0;
  double share = 0;
  if (!samples_.empty()) {
    const Sample& oldest = samples_[0];
    apart_now_m_ = (newest.posed_m - oldest.posed_m - (newest.own_m - oldest.own_m)).norm();
    // Of a speed that changes by less than rounding and noise do, lag says nothing.
    const double speeds_up = std::max(0.0, (newest.velocity_mps - oldest.velocity_mps).norm() - rounded_mps);
    const double allowed = apart_m +
                           std::max(apart_share, scale_sigmas * own.scale_sigma) * (newest.length_m - oldest.length_m) +
                           lag_sigmas * own.lag_sigma_s * speeds_up;
    share = apart_now_m_ / allowed;
  }
  if (samples_.full()) samples_.erase_front(1);
  samples_.push(newest);
  return share;
}

void SourceCheck::decide(TimeNs now, double share, const OwnMotion& own, const Pose& pose) noexcept {
  texts_apart_ = share > 1 ? texts_apart_ + 1 : 0;
  texts_alike_ = share < alike_share ? texts_alike_ + 1 : 0;
  if (texts_apart_ >= texts_in_a_row) {
    off_m_ = std::max(off_m_, apart_now_m_);
    if (verdict_ == Verdict::agree) {
      verdict_ = Verdict::differ;
      differs_since_ns_ = now;
    }
  }
  if (texts_alike_ == 0) alike_since_ns_ = 0;
  if (texts_alike_ >= texts_in_a_row && alike_since_ns_ == 0) alike_since_ns_ = now;
  if (alike_since_ns_ == 0) return;
  if (verdict_ == Verdict::differ) verdict_ = Verdict::agree;
  const bool one_place = (in_plane(pose) - own.position_m).norm() < one_place_m + one_place_sigmas * own.sigma_m;
  if (verdict_ == Verdict::unresolved && one_place && now - alike_since_ns_ >= alike_for_ns) {
    verdict_ = Verdict::agree;
    off_m_ = 0;
  }
}

void SourceCheck::on_state(TimeNs now, const OwnMotion& own, const Pose& pose, bool flying) noexcept {
  path_.advance(now, own);
  scale_sigma_ = own.scale_sigma;
  if (!flying) {
    forget();
    verdict_ = Verdict::agree;
    off_m_ = 0;
    return;
  }
  texts_repeated_ = own.barometer_m == barometer_m_ ? texts_repeated_ + 1 : 0;
  barometer_m_ = own.barometer_m;
  const bool usable = own.usable && texts_repeated_ < max_texts_repeated;
  texts_unusable_ = usable ? 0 : texts_unusable_ + 1;
  const TimeNs age_ns = now - pose.stamp_ns;
  if (pose.stamp_ns == 0 || age_ns > pose_lost_ns_ || texts_unusable_ >= max_texts_unusable) {
    forget();  // nothing to compare; what differed goes on to do so
  } else if (usable) {
    const Eigen::Vector2d velocity(pose.velocity_mps[0], pose.velocity_mps[1]);
    const Sample sample{now, in_plane(pose) + velocity * to_seconds(age_ns),
                        path_.position_m + own.lag_s * own.velocity_mps, own.velocity_mps, path_.length_m};
    decide(now, compared(sample, own), own, pose);
  }
  if (verdict_ == Verdict::differ && now - differs_since_ns_ >= unresolved_after_ns) verdict_ = Verdict::unresolved;
}

}  // namespace ledgerline::link
