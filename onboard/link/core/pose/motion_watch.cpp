#include "onboard/link/core/pose/motion_watch.hpp"

#include <algorithm>
#include <cmath>

#include "common/rt/since.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs max_pose_gap_ns = 500 * ns_per_ms;  // of poses: what was before a longer one says nothing of now
constexpr double at_rest_mps = 0.05;                 // commanded: it is to hover
constexpr double drag_per_s = 0.4;  // in still air, as the simulator's drone; 0.39 to 0.54 (docs/sources.md)
constexpr TimeNs max_compared_gap_ns = 350 * ns_per_ms;  // of texts: what was before a longer one is not compared with
constexpr double steady_mps = 0.1;                       // a stick that stands still

double follow(double seconds, double within_s) noexcept { return 1 - std::exp(-seconds / within_s); }

// The length of what is left of `v` when as much of `part` is taken off as makes it shortest: none to all of it.
double length_without(const std::array<double, 2>& v, const std::array<double, 2>& part) noexcept {
  const double square = part[0] * part[0] + part[1] * part[1];
  const double share = square > 0 ? std::clamp((v[0] * part[0] + v[1] * part[1]) / square, 0.0, 1.0) : 0;
  return std::hypot(v[0] - share * part[0], v[1] - share * part[1]);
}

double part_along(const std::array<double, 2>& v, const std::array<double, 2>& direction) noexcept {
  const double length = std::hypot(direction[0], direction[1]);
  return length > 0 ? (v[0] * direction[0] + v[1] * direction[1]) / length : 0;
}

}  // namespace

void MotionWatch::on_sent(double seconds, const std::array<float, 3>& sent_mps) noexcept {
  const double share = follow(seconds, response_s);
  for (std::size_t i = 0; i < 2; ++i) expected_mps_[i] += share * (static_cast<double>(sent_mps[i]) - expected_mps_[i]);
  learn_drift(seconds);
}

void MotionWatch::learn_drift(double seconds) noexcept {
  const double share = follow(seconds, expected_mps() < at_rest_mps ? learns_at_rest_s : learns_s);
  for (std::size_t i = 0; i < 2; ++i) {
    const double against_wind = lean_mps2_[i] - drag_per_s * expected_mps_[i];
    drift_mps_[i] += share * (-response_s * against_wind - drift_mps_[i]);
  }
  const double drift = std::hypot(drift_mps_[0], drift_mps_[1]);
  if (drift <= max_drift_mps) return;
  for (double& part : drift_mps_) part *= max_drift_mps / drift;
}

double MotionWatch::expected_mps() const noexcept { return std::hypot(expected_mps_[0], expected_mps_[1]); }

void MotionWatch::on_pose(TimeNs now, const std::array<double, 3>& velocity_mps) noexcept {
  const TimeNs gap = now - seen_ns_;
  if (gap > max_pose_gap_ns) {
    since_ns_ = outruns_since_ns_ = 0;
    smooth_mps_ = {velocity_mps[0], velocity_mps[1]};
  }
  seen_ns_ = now;
  const double share = follow(to_seconds(std::min(gap, max_pose_gap_ns)), response_s);
  std::array<double, 2> off_mps{};
  for (std::size_t i = 0; i < 2; ++i) {
    smooth_mps_[i] += share * (velocity_mps[i] - smooth_mps_[i]);
    off_mps[i] = smooth_mps_[i] - expected_mps_[i];
  }
  const double limit = std::max(limit_mps, limit_share * expected_mps());
  update_since(now, length_without(off_mps, drift_mps_) > limit, since_ns_);
  const std::array<double, 2> seen_mps{velocity_mps[0], velocity_mps[1]};
  update_since(now, length_without(seen_mps, drift_mps_) > expected_mps() + outrun_mps, outruns_since_ns_);
}

void FlowWatch::update(TimeNs now, const TelloState& state, const Inputs& inputs) noexcept {
  const TimeNs step_ns = text_ns_ == 0 ? 0 : now - text_ns_;
  if (step_ns > max_compared_gap_ns) {
    count_ = 0;
    faded_ = 0;
  }
  text_ns_ = now;
  const auto& [response, drift] = inputs.expected;
  // As slow as the wind may make it, or not: where it holds its position it is not drifted.
  const double should_mps = length_without(response, {-drift[0], -drift[1]});
  const double leans_anyway = -part_along(drift, response) / MotionWatch::response_s;
  std::copy_backward(texts_.begin(), texts_.end() - 1, texts_.end());
  texts_[0] = {should_mps, part_along(inputs.lean_mps2, response) - std::max(0.0, leans_anyway), inputs.sent_mps};
  count_ = std::min(count_ + 1, kept);

  const double reported = static_cast<double>(std::hypot(state.velocity_dmps[0], state.velocity_dmps[1])) / 10;
  double at_least = should_mps;  // whichever of the last moments the text is of
  for (std::size_t i = 0; i < count_; ++i) at_least = std::min(at_least, texts_[i].should_mps);
  const bool fades = at_least > fading_mps && reported + rounding_mps < fade_share * at_least;
  const bool should_move = std::hypot(response[0], response[1]) > moving_mps;
  faded_ = fades ? faded_ + 1 : 0;
  zeros_ns_ = reported > 0 ? 0 : should_move ? zeros_ns_ + std::min(step_ns, max_compared_gap_ns) : zeros_ns_;

  if (since_ns_ != 0) {
    least_mps_ = std::min(least_mps_, reported);
    if (reported < least_mps_ + sees_again_mps) return;
    since_ns_ = 0;
    faded_ = 0;
    return;
  }
  const double lean = texts_[0].lean_mps2;
  const bool slow = reported + rounding_mps < at_least;
  const bool lost = (fades && (lean > lean_mps2 || faded_ >= fade_texts)) || zeros_ns_ >= zeros_for_ns ||
                    (lasting_lean() && ((slow && lean > far_lean_mps2) || (reported <= 0 && should_move)));
  if (!lost) return;
  since_ns_ = now;
  least_mps_ = reported;
}

bool FlowWatch::lasting_lean() const noexcept {
  if (count_ < 3) return false;
  const Text &newest = texts_[0], &before = texts_[2];
  const double changed = std::hypot(newest.sent_mps[0] - before.sent_mps[0], newest.sent_mps[1] - before.sent_mps[1]);
  return changed < steady_mps && newest.lean_mps2 > lean_mps2 && before.lean_mps2 > lean_mps2 &&
         newest.lean_mps2 > lasting_share * before.lean_mps2;
}

}  // namespace ledgerline::link
