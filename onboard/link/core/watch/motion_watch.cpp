#include "onboard/link/core/watch/motion_watch.hpp"

#include <algorithm>
#include <cmath>

#include "onboard/link/core/watch/held.hpp"

namespace ledgerline::link {
namespace {

constexpr double response_s = 0.3;                   // as the simulator's drone, assumed (docs/sources.md)
constexpr TimeNs max_pose_gap_ns = 500 * ns_per_ms;  // of poses: what was before a longer one says nothing of now

}  // namespace

void MotionWatch::tell(double seconds, const std::array<float, 3>& told_mps) noexcept {
  const double share = 1 - std::exp(-seconds / response_s);
  for (std::size_t i = 0; i < 2; ++i) expected_mps_[i] += share * (static_cast<double>(told_mps[i]) - expected_mps_[i]);
}

double MotionWatch::expected_mps() const noexcept { return std::hypot(expected_mps_[0], expected_mps_[1]); }

void MotionWatch::see(TimeNs now, const std::array<double, 3>& velocity_mps) noexcept {
  const TimeNs gap = now - seen_ns_;
  if (gap > max_pose_gap_ns) {
    since_ns_ = 0;
    smooth_mps_ = {velocity_mps[0], velocity_mps[1]};
  }
  seen_ns_ = now;
  const double share = 1 - std::exp(-to_seconds(std::min(gap, max_pose_gap_ns)) / response_s);
  for (std::size_t i = 0; i < 2; ++i) smooth_mps_[i] += share * (velocity_mps[i] - smooth_mps_[i]);
  const double off = std::hypot(smooth_mps_[0] - expected_mps_[0], smooth_mps_[1] - expected_mps_[1]);
  const double limit = std::max(limit_mps, limit_share * expected_mps());
  note_since(now, off > limit, since_ns_);
}

}  // namespace ledgerline::link
