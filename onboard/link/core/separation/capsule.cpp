#include "onboard/link/core/separation/capsule.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {
namespace {

using Point = std::array<double, 2>;

Point minus(const Point& a, const Point& b) noexcept { return {a[0] - b[0], a[1] - b[1]}; }
double dot(const Point& a, const Point& b) noexcept { return a[0] * b[0] + a[1] * b[1]; }
double cross(const Point& a, const Point& b) noexcept { return a[0] * b[1] - a[1] * b[0]; }

double squared_to_segment(const Point& point, const Point& from, const Point& to) noexcept {
  const Point along = minus(to, from), there = minus(point, from);
  const double squared = dot(along, along);
  const double part = squared > 0 ? std::clamp(dot(there, along) / squared, 0.0, 1.0) : 0;
  const Point off{there[0] - part * along[0], there[1] - part * along[1]};
  return dot(off, off);
}

bool cross_each_other(const Capsule& a, const Capsule& b) noexcept {
  const Point along_a = minus(a.to_m, a.from_m), along_b = minus(b.to_m, b.from_m);
  const double a1 = cross(along_a, minus(b.from_m, a.from_m)), a2 = cross(along_a, minus(b.to_m, a.from_m));
  const double b1 = cross(along_b, minus(a.from_m, b.from_m)), b2 = cross(along_b, minus(a.to_m, b.from_m));
  return a1 * a2 < 0 && b1 * b2 < 0;
}

double level_distance_m(const Capsule& a, const Capsule& b) noexcept {
  if (cross_each_other(a, b)) return 0;
  return std::sqrt(
      std::min({squared_to_segment(a.from_m, b.from_m, b.to_m), squared_to_segment(a.to_m, b.from_m, b.to_m),
                squared_to_segment(b.from_m, a.from_m, a.to_m), squared_to_segment(b.to_m, a.from_m, a.to_m)}));
}

}  // namespace

double gap_m(const Capsule& one, const Capsule& other) noexcept {
  const double in_height = std::max(one.low_m - other.high_m, other.low_m - one.high_m);
  return std::max(in_height, level_distance_m(one, other) - one.radius_m - other.radius_m);
}

Coasting coasting(const Motion& motion, const Braking& braking) noexcept {
  Coasting out;
  out.blur_m = motion.blur_m;
  const double kept = std::exp(-motion.age_s / braking.response_s);
  for (std::size_t i = 0; i < 3; ++i) {
    // What it is sent now stands for that while the pose came: to a centimetre, by the limiter's 0.4 m/s in 0.1 s.
    const double position = motion.position_m[i] + motion.sent_mps[i] * motion.late_s;
    const double velocity = motion.sent_mps[i] + (motion.velocity_mps[i] - motion.sent_mps[i]) * kept;
    out.coasted_m[i] = position + braking.response_s * motion.velocity_mps[i];
    out.at_m[i] = out.coasted_m[i] - braking.response_s * velocity;
  }
  return out;
}

Capsule until_rest(const Coasting& coasting, const Braking& braking, const Vec3& sent_mps) noexcept {
  const double ramp_s = length(sent_mps) / (2 * braking.acceleration_mps2);
  const Vec3 &at = coasting.at_m, &coasted = coasting.coasted_m;
  Vec3 rest{};
  for (std::size_t i = 0; i < 3; ++i) rest[i] = coasted[i] + sent_mps[i] * (braking.reaction_s + ramp_s);
  const auto [low, high] = std::minmax({at[2], coasted[2], rest[2]});
  const double turn = std::sqrt(squared_to_segment({coasted[0], coasted[1]}, {at[0], at[1]}, {rest[0], rest[1]}));
  return {.from_m = {at[0], at[1]},
          .to_m = {rest[0], rest[1]},
          .low_m = low - coasting.blur_m,
          .high_m = high + coasting.blur_m,
          .radius_m = turn + coasting.blur_m};
}

Capsule stretched(const Capsule& capsule, const Vec3& way_m) noexcept {
  Capsule out = capsule;
  for (std::size_t i = 0; i < 2; ++i) out.to_m[i] += way_m[i];
  out.low_m += std::min(0.0, way_m[2]);
  out.high_m += std::max(0.0, way_m[2]);
  return out;
}

}  // namespace ledgerline::link
