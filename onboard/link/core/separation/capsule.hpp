#pragma once
#include <array>
#include <cmath>

namespace ledgerline::link {

using Vec3 = std::array<double, 3>;

/// Of metres or metres per second; std::hypot's care for huge numbers costs six times as much.
inline double length(const Vec3& v) noexcept { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/// Where something may be: all within `radius_m` of a level segment, between two heights. Metres, map frame.
struct Capsule {
  std::array<double, 2> from_m{}, to_m{};
  double low_m = 0, high_m = 0;
  double radius_m = 0;
};

/// How far apart two are, by a cylinder's measure: the level distance or the one in height, whichever is larger.
/// Negative where both overlap. Any point of one is at least so far from any of the other. Pure.
double gap_m(const Capsule& one, const Capsule& other) noexcept;

/// What is known of a flying drone, which follows what it is sent as a first-order response of `response_s`.
struct Motion {
  Vec3 position_m{};    ///< the newest pose's, moved on by what was sent since it came
  Vec3 velocity_mps{};  ///< of that pose
  Vec3 sent_mps{};      ///< what it is sent now
  double late_s = 0;    ///< so old was the pose when it came
  double age_s = 0;     ///< so old is it now
  double blur_m = 0;    ///< it may be so far from there
};

/// What the limiter does with what a drone is sent, and what comes of it.
struct Braking {
  double acceleration_mps2;  ///< of the limiter
  double response_s;         ///< of the drone
  double reaction_s;         ///< until a new command takes effect
};

/// Where a drone is, and where it would come to rest if it were sent zero at once: x and x + T·v.
///
/// With v' = (u - v)/T the way from now on is ∫v = T·v + ∫u, so the place that it comes to rest at is known from place,
/// velocity and what it is sent: x + T·v + u·|u|/2a, where u is ramped to zero by a. For the same reason x + T·v moves
/// by what is sent alone: that of an old pose needs no guess of how the velocity went since.
struct Coasting {
  Vec3 at_m{}, coasted_m{};
  double blur_m = 0;
};
Coasting coasting(const Motion& motion, const Braking& braking) noexcept;

/// Where it is until it hovers, if it is sent `sent_mps` now and to stop from the next step on. On its way to rest a
/// drone stays in the triangle of x, x + T·v and its rest, since the answer to u lags the decay of v; the capsule has
/// that triangle in it. Commanded to stop it shrinks into itself, which is what separation.hpp's invariant rests on.
Capsule until_rest(const Coasting& coasting, const Braking& braking, const Vec3& sent_mps) noexcept;

/// The capsule, stretched by a way: where it goes on.
Capsule stretched(const Capsule& capsule, const Vec3& way_m) noexcept;

}  // namespace ledgerline::link
