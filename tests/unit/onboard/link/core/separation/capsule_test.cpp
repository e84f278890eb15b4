#include "onboard/link/core/separation.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ledgerline::link {
namespace {

constexpr Braking braking{.acceleration_mps2 = 4, .response_s = 0.3, .reaction_s = 0};

double distance_m(const Capsule& capsule, double x, double y) {
  return gap_m(capsule, {.from_m = {x, y}, .to_m = {x, y}, .low_m = capsule.low_m, .high_m = capsule.high_m});
}

// A drone that turns while it is commanded to stop, in steps of a millisecond.
template <class Check>
void brake(Motion motion, const Check& check) {
  constexpr double dt = 0.001;
  for (int i = 0; i < 3000; ++i) {
    check(motion);
    const double sent = std::hypot(motion.sent_mps[0], motion.sent_mps[1], motion.sent_mps[2]);
    for (std::size_t k = 0; k < 3; ++k) {
      motion.sent_mps[k] *= sent > 0 ? std::max(0.0, sent - 4 * dt) / sent : 0;
      motion.velocity_mps[k] += (motion.sent_mps[k] - motion.velocity_mps[k]) * dt / 0.3;
      motion.position_m[k] += motion.velocity_mps[k] * dt;
    }
  }
}

constexpr Motion turning{.position_m = {1, 2, 1}, .velocity_mps = {0.8, -0.3, 0.2}, .sent_mps = {-0.2, 0.9, 0.4}};

TEST(Capsule, EndsWhereADroneThatIsOrderedToStopComesToRest) {
  const Capsule capsule = until_rest(coasting(turning, braking), braking, turning.sent_mps);
  Vec3 rest{};
  brake(turning, [&](const Motion& at) { rest = at.position_m; });
  EXPECT_NEAR(capsule.to_m[0], rest[0], 0.002);
  EXPECT_NEAR(capsule.to_m[1], rest[1], 0.002);
}

TEST(Capsule, HasTheWholeWayToRestInIt) {
  const Capsule capsule = until_rest(coasting(turning, braking), braking, turning.sent_mps);
  brake(turning, [&](const Motion& at) {
    EXPECT_LE(distance_m(capsule, at.position_m[0], at.position_m[1]), 0.002);
    EXPECT_GE(at.position_m[2], capsule.low_m - 0.002);
    EXPECT_LE(at.position_m[2], capsule.high_m + 0.002);
  });
}

TEST(Capsule, OfADroneThatIsOrderedToStopComesNoNearerToAnybody) {
  for (const auto& other : {std::pair{1.0, 4.0}, {2.5, 2.0}, {0.0, 2.0}, {1.3, 1.0}}) {
    double last = -1;
    brake(turning, [&](const Motion& at) {
      const double gap = distance_m(until_rest(coasting(at, braking), braking, at.sent_mps), other.first, other.second);
      EXPECT_GE(gap, last - 0.002);
      last = std::max(last, gap);
    });
  }
}

TEST(Capsule, OfAnOldPoseIsTheSameAsOfAFreshOne) {
  // Commanded the same for long: only the velocity's response continues meanwhile.
  Motion old{.position_m = {0, 0, 1}, .velocity_mps = {0.5, 0, 0}, .sent_mps = {1, 0, 0}, .late_s = 0.1, .age_s = 0.1};
  const double kept = std::exp(-0.1 / 0.3);
  Motion fresh = old;
  fresh.late_s = fresh.age_s = 0;
  fresh.velocity_mps[0] = 1 - 0.5 * kept;
  fresh.position_m[0] = 0.1 - 0.3 * 0.5 * (1 - kept);
  const Capsule a = until_rest(coasting(old, braking), braking, old.sent_mps);
  const Capsule b = until_rest(coasting(fresh, braking), braking, fresh.sent_mps);
  EXPECT_NEAR(a.from_m[0], b.from_m[0], 1e-9);
  EXPECT_NEAR(a.to_m[0], b.to_m[0], 1e-9);
}

TEST(Capsule, AreApartByTheLargerOfLevelAndHeight) {
  const Capsule one{.from_m = {0, 0}, .to_m = {1, 0}, .low_m = 1, .high_m = 1.2, .radius_m = 0.1};
  Capsule other{.from_m = {0.5, -1}, .to_m = {0.5, 1}, .low_m = 1.1, .high_m = 2, .radius_m = 0.1};
  EXPECT_NEAR(gap_m(one, other), -0.1, 1e-12) << "they cross, and overlap in height by that";
  other.low_m = 1.8;
  EXPECT_NEAR(gap_m(one, other), 0.6, 1e-12) << "one above the other";
  other.from_m[0] = other.to_m[0] = 2;
  EXPECT_NEAR(gap_m(one, other), 0.8, 1e-12) << "and further beside it";
  EXPECT_EQ(gap_m(one, other), gap_m(other, one));
}

}  // namespace
}  // namespace ledgerline::link
