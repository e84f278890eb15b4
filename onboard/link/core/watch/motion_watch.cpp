#include "onboard/link/core/watch/motion_watch.hpp"

#include <algorithm>
#include <cmath>

#include "onboard/link/core/watch/held.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs max_pose_gap_ns = 500 * ns_per_ms;  // of poses: what was before a longer one says nothing of now
constexpr double at_rest_mps = 0.05;                 // commanded: it is to hover
constexpr double drag_per_s = 0.4;  // in still air, as the simulator's drone; 0.39 to 0.54 (docs/sources.md)

double follow(double seconds, double within_s) noexcept { return 1 - std::exp(-seconds / within_s); }

}  // namespace

double length_without(const std::array<double, 2>& v, const std::array<double, 2>& part) noexcept {
  const double square = part[0] * part[0] + part[1] * part[1];
  const double share = square > 0 ? std::clamp((v[0] * part[0] + v[1] * part[1]) / square, 0.0, 1.0) : 0;
  return std::hypot(v[0] - share * part[0], v[1] - share * part[1]);
}

void MotionWatch::tell(double seconds, const std::array<float, 3>& sent_mps) noexcept {
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

void MotionWatch::see(TimeNs now, const std::array<double, 3>& velocity_mps) noexcept {
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
  note_since(now, length_without(off_mps, drift_mps_) > limit, since_ns_);
  const std::array<double, 2> seen_mps{velocity_mps[0], velocity_mps[1]};
  note_since(now, length_without(seen_mps, drift_mps_) > expected_mps() + outrun_mps, outruns_since_ns_);
}

}  // namespace ledgerline::link
