#include "ground/mission/corridor.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/unit/campaign.hpp"
#include "tests/unit/ground/mission/missions.hpp"

namespace ledgerline::ground::mission {
namespace {

struct Flown {
  Timetable table;
  bool lands;
  Corridor corridor;
};

constexpr double landing_mps = 0.5;

Flown flown(const Eigen::Vector3d& here, std::vector<Waypoint> way, bool lands = false) {
  Timetable table =
      timetable_of({here.head<2>(), here.z()}, flown_by("d", std::move(way), lands), ControllerConfig{}, 780);
  const auto landing_s = lands ? std::optional(table.moments.back().at_m.z() / landing_mps) : std::nullopt;
  Corridor corridor(table, here.z(), here.z(), landing_s, ControllerConfig{});
  return {std::move(table), lands, std::move(corridor)};
}

std::optional<Corridor::Meeting> meeting(const Flown& one, const Flown& other, const Apart& apart = {}) {
  std::size_t visits = 1'000'000;
  const auto found = one.corridor.meets(other.corridor, apart, visits);
  EXPECT_GT(visits, 0U);
  return found;
}

TEST(Corridor, PathsThatCrossMeetOnlyIfBothAreThereAtOneTime) {
  const Flown east = flown({-2, 0, 1}, {at(2, 0)});
  const auto met = meeting(east, flown({0, -2, 1}, {at(0, 2)}));
  ASSERT_TRUE(met);
  EXPECT_GT(met->t_s, 0);
  EXPECT_LT(met->t_s, east.table.end_s());
  EXPECT_FALSE(meeting(east, flown({0, -8, 1}, {at(0, 2)}))) << "it comes 12 s later";
  EXPECT_FALSE(meeting(east, flown({0, -2, 2}, {at(0, 2, 2)}))) << "a metre above";
}

TEST(Corridor, LatenessIsAllowedFor) {
  const Flown first = flown({-2, 0, 1}, {at(2, 0)}), later = flown({0, -4, 1}, {at(0, 2)});
  EXPECT_FALSE(meeting(first, later, {.late_s = 0.5}));
  EXPECT_TRUE(meeting(first, later, {.late_s = 2}));
}

TEST(Corridor, WhoHoversAtItsEndOrWaitsAtItsStartIsThereAllTheTime) {
  EXPECT_TRUE(meeting(flown({0, 0, 1}, {at(3, 0)}), flown({20, 0, 1}, {at(3.3, 0)}))) << "long after it came there";
  EXPECT_TRUE(meeting(flown({0, 0, 1}, {at(3, 0)}), flown({0, 0.5, 1}, {at(0, 3)})))
      << "side by side before they begin";
  EXPECT_LT(meeting(flown({0, 0, 1}, {at(3, 0)}), flown({0, 0.5, 1}, {at(0, 3)}))->t_s, 0);
}

TEST(Corridor, WhoHasLandedStandsThereAndIsFlownOver) {
  const Flown lands = flown({0, 0, 2}, {at(1, 0, 2)}, true);
  EXPECT_FALSE(meeting(lands, flown({20, 0, 1}, {at(-3, 0, 1)}))) << "a metre above it, after it has landed";
  EXPECT_TRUE(meeting(lands, flown({3, 0, 1}, {at(-3, 0, 1)}))) << "below it, while it comes down";
  EXPECT_TRUE(meeting(lands, flown({20, 0, 0.5}, {at(-3, 0, 0.5)}))) << "half a metre above it";
}

TEST(Corridor, AChangeOfHeightAtTheStartTakesUpAllHeightsBetween) {
  const Flown climbs = flown({0, 0, 1}, {at(0, 0, 3), at(3, 0, 3)});
  EXPECT_TRUE(meeting(climbs, {flown({0.3, 0, 2}, {at(5, 5, 2)})}));
  std::size_t visits = 10'000;
  EXPECT_TRUE(climbs.corridor.meets(Corridor({1.3, 0}, 2, 2), {}, visits)) << "it flies on before it is up";
  EXPECT_FALSE(climbs.corridor.meets(Corridor({3.2, 0}, 2, 2), {}, visits)) << "it is up";
}

TEST(Corridor, AnUnfinishedSearchFindsNothingAndSaysSo) {
  std::size_t visits = 3;
  EXPECT_FALSE(flown({-2, 0, 1}, {at(2, 0)}).corridor.meets(flown({0, -2, 1}, {at(0, 2)}).corridor, {}, visits));
  EXPECT_EQ(visits, 0U);
}

// By sampling both ways every 50 ms, and as often between them: how near they come by the measure of Apart, as a share
// of what must be.
double nearest(const Flown& one, const Flown& other, const Apart& apart) {
  constexpr double dt_s = 0.05;
  const auto place = [](const Flown& flown, double t_s) -> Eigen::Vector3d {
    const auto& moments = flown.table.moments;
    if (t_s <= 0) return moments.front().at_m;
    if (t_s >= flown.table.end_s()) return moments.back().at_m;
    const auto next = std::upper_bound(moments.begin(), moments.end(), t_s,
                                       [](double t, const Timetable::Moment& moment) { return t < moment.t_s; });
    const auto before = next - 1;
    return before->at_m + (t_s - before->t_s) / (next->t_s - before->t_s) * (next->at_m - before->at_m);
  };
  double least = std::numeric_limits<double>::infinity();
  const double end_s = std::max(one.table.end_s(), other.table.end_s()) + apart.late_s;
  for (double t_s = -apart.late_s; t_s < end_s; t_s += dt_s) {
    const Eigen::Vector3d here = place(one, t_s);
    for (double late_s = -apart.late_s; late_s <= apart.late_s; late_s += dt_s) {
      const Eigen::Vector3d between = here - place(other, t_s + late_s);
      least =
          std::min(least, std::max(between.head<2>().norm() / apart.level_m, std::abs(between.z()) / apart.height_m));
    }
  }
  return least;
}

std::vector<Waypoint> random_way(Random& random) {
  std::vector<Waypoint> way;
  for (std::size_t n = 1 + below(random, 3); n-- > 0;)
    way.push_back(
        at(between(random, -3, 3), between(random, -3, 3), between(random, 0.6, 2.6), between(random, 0.2, 1)));
  return way;
}

Eigen::Vector3d random_start(Random& random) {
  return {between(random, -3, 3), between(random, -3, 3), between(random, 0.6, 2.6)};
}

// Wherever fine sampling finds two too near, the corridors meet; and they meet nowhere else than for a passage that is
// almost too near, or almost late enough.
TEST(Corridor, RandomPairsMeetExactlyWhereFineSamplingFindsThemTooNear) {
  int met_pairs = 0, apart_pairs = 0;
  for (int seed = 1; seed <= seeds(60, 2'000); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    const Apart apart{.late_s = between(random, 0, 2)};
    const Flown one = flown(random_start(random), random_way(random));
    const Flown other = flown(random_start(random), random_way(random));
    const bool met = meeting(one, other, apart).has_value();
    const double share = nearest(one, other, apart);
    if (share < 0.98) {
      EXPECT_TRUE(met) << "seed " << seed << ": " << share;
    }
    if (met) {
      const double wider = nearest(one, other, {apart.level_m, apart.height_m, apart.late_s + 2 * Timetable::step_s});
      EXPECT_LT(wider, 1.2) << "seed " << seed << ": nowhere near";
    }
    EXPECT_EQ(meeting(other, one, apart).has_value(), met) << "seed " << seed;
    ++(met ? met_pairs : apart_pairs);
  }
  EXPECT_GT(met_pairs, 10);
  EXPECT_GT(apart_pairs, 10);
}

}  // namespace
}  // namespace ledgerline::ground::mission
