#include "onboard/link/core/separation.hpp"

#include <gtest/gtest.h>

#include <cstdio>

#include "tests/unit/campaign.hpp"
#include "tests/unit/onboard/link/core/separation/traffic_world.hpp"

/// Every path is finished, and nobody comes nearer than SeparationSettings::min_m.
namespace ledgerline::link {
namespace {

constexpr double min_m = SeparationSettings{}.min_m;

TEST(Separation, DronesThatAreFarFromEachOtherFlyTheirSetpoints) {
  TrafficWorld world;
  world.add({0, 0, 1}, {4, 0, 1});
  world.add({0, 1.5, 1}, {4, 1.5, 1});
  world.add({2, 0.7, 2.2}, {2, -3, 2.2}).speed = 0.5;  // over the first one's path
  while (!world.all_arrived()) {
    world.step();
    for (const PointDrone& drone : world.drones) ASSERT_EQ(drone.clearance.kind, Clearance::Kind::unchanged);
  }
}

TEST(Separation, HeadOnTheHigherNumberGetsOutOfTheWayAndTheLowerOneIsNotHeldUp) {
  TrafficWorld world;
  PointDrone& first = world.add({0, 0, 1}, {6, 0, 1});
  PointDrone& second = world.add({6, 0, 1}, {0, 0, 1});
  bool parted = false;
  const double begin = to_seconds(world.now);
  for (int i = 0; i < 6000 && !world.all_arrived(); ++i) {
    world.step();
    parted = parted || second.clearance.kind == Clearance::Kind::give_way;
    EXPECT_NE(first.clearance.kind, Clearance::Kind::give_way);
  }
  EXPECT_TRUE(world.all_arrived());
  EXPECT_TRUE(parted);
  EXPECT_GE(world.nearest_m, min_m);
  TrafficWorld alone;
  PointDrone& only = alone.add({0, 0, 1}, {6, 0, 1});
  ASSERT_TRUE(alone.fly(60));
  EXPECT_LT(first.arrived_s - begin, only.arrived_s - begin + 0.5);
}

TEST(Separation, AtACrossingTheHigherNumberWaitsAndGoesOn) {
  TrafficWorld world;
  PointDrone& first = world.add({0, 0, 1}, {6, 0, 1});
  PointDrone& second = world.add({3, -3, 1}, {3, 3, 1});
  bool waited = false;
  for (int i = 0; i < 6000 && !world.all_arrived(); ++i) {
    world.step();
    waited = waited || second.clearance.kind == Clearance::Kind::hold;
    EXPECT_EQ(first.clearance.kind, Clearance::Kind::unchanged);
  }
  EXPECT_TRUE(world.all_arrived());
  EXPECT_TRUE(waited);
  EXPECT_GE(world.nearest_m, min_m);
}

TEST(Separation, ADroneThatOvertakesFinishesWhicheverNumberItHas) {
  for (const bool slow_first : {true, false}) {
    TrafficWorld world;
    world.add({0, 0, 1}, {6, 0, 1}).speed = slow_first ? 1 : 0.3;
    world.add({1, 0, 1}, {8, 0, 1}).speed = slow_first ? 0.3 : 1;
    if (!slow_first) std::swap(world.drones[0].place, world.drones[1].place);
    if (!slow_first) std::swap(world.drones[0].goal, world.drones[1].goal);
    for (PointDrone& drone : world.drones) drone.pose.place = drone.place;
    EXPECT_TRUE(world.fly(60));
    EXPECT_GE(world.nearest_m, min_m);
  }
}

TEST(Separation, ADroneThatKeepsHoveringIsPassedWhicheverNumberItHas) {
  for (const auto kind : {Neighbour::Kind::steered, Neighbour::Kind::held}) {
    for (const DroneNumber hovering : {DroneNumber{1}, DroneNumber{2}}) {
      for (const double height_m : {0.4, 1.0, 1.6, 2.7}) {
        TrafficWorld world;
        const Vec3 place{3, 0, height_m};
        for (DroneNumber n = 1; n <= 2; ++n) {
          PointDrone& drone = n == hovering ? world.add(place, place) : world.add({0, 0, 1}, {6, 0, 1});
          if (n == hovering) drone.kind = kind;
        }
        EXPECT_TRUE(world.fly(30)) << hovering << " at " << height_m;
        EXPECT_GE(world.nearest_m, min_m);
      }
    }
  }
}

TEST(Separation, ThreeInACircleDoNotWaitForEachOther) {
  TrafficWorld world;
  const std::array<Vec3, 3> places{{{0, 0, 1}, {1.5, 0, 1}, {0.75, 1.3, 1}}};
  for (std::size_t i = 0; i < 3; ++i) world.add(places[i], places[(i + 1) % 3]);
  EXPECT_TRUE(world.fly(60));
  EXPECT_GE(world.nearest_m, min_m);
}

TEST(Separation, AtTheCeilingTheOneInTheWaySinksAndAtTheFloorItClimbs) {
  for (const double height_m : {2.9, 0.35}) {
    TrafficWorld world;
    world.add({0, 0, height_m}, {6, 0, height_m});
    world.add({6, 0, height_m}, {0, 0, height_m});
    bool apart_the_right_way = false;
    for (int i = 0; i < 6000 && !world.all_arrived(); ++i) {
      world.step();
      for (const PointDrone& drone : world.drones) {
        ASSERT_LE(drone.place[2], world.ceiling_m);
        ASSERT_GE(drone.place[2], 0.25);
      }
      const double off = world.drones[1].place[2] - height_m;
      apart_the_right_way = apart_the_right_way || (height_m > 1.5 ? off < -0.5 : off > 0.5);
    }
    EXPECT_TRUE(world.all_arrived());
    EXPECT_TRUE(apart_the_right_way);
    EXPECT_GE(world.nearest_m, min_m);
  }
}

TEST(Separation, BetweenFloorAndCeilingWithNoRoomForTwoThePassIsBeside) {
  TrafficWorld world;
  world.floor_m = 0.8;
  world.ceiling_m = 1.4;
  world.add({0, 0, 1.1}, {6, 0, 1.1});
  world.add({6, 0, 1.1}, {0, 0, 1.1});
  EXPECT_TRUE(world.fly(60));
  EXPECT_GE(world.nearest_m, min_m);
}

TEST(Separation, OneAboveTheOthersGoalComesDownBesideIt) {
  TrafficWorld world;
  world.add({0.1, 0, 2.4}, {0.2, 0, 0.6});
  const Vec3 place{0, 0, 1.5};
  world.add(place, place).kind = Neighbour::Kind::held;
  EXPECT_TRUE(world.fly(60));
  EXPECT_GE(world.nearest_m, min_m);
}

TEST(Separation, WhoHoversBelowOneThatComesDownGetsOutOfItsWay) {
  for (const double height_m : {2.5, 1.9}) {
    TrafficWorld world;
    const Vec3 place{0, 0, 1};
    world.add(place, place);
    PointDrone& sinking = world.add({0.2, 0, height_m}, {0.2, 0, 0});
    sinking.kind = Neighbour::Kind::sinking;
    sinking.gust = {0, 0, -0.5};
    for (int i = 0; i < 800; ++i) {  // until it is on the ground
      if (sinking.place[2] <= 0.05) sinking.gust = {};
      world.step();
    }
    EXPECT_GE(world.nearest_m, min_m) << height_m;
  }
}

TEST(Separation, OneThatIsToLandAboveAnotherComesDownBesideIt) {
  using Kind = Neighbour::Kind;
  for (const auto& [kind, height_m] : {std::pair{Kind::steered, 1.0}, {Kind::held, 1.0}, {Kind::standing, 0.0}}) {
    for (const DroneNumber landing : {DroneNumber{1}, DroneNumber{2}}) {
      TrafficWorld world;
      for (DroneNumber n = 1; n <= 2; ++n) {
        const Vec3 place = n == landing ? Vec3{0.1, 0, 2.2} : Vec3{0, 0, height_m};
        PointDrone& drone = world.add(place, place);
        drone.lands = n == landing;
        if (n != landing) drone.kind = kind;
      }
      const PointDrone& drone = world.drones[landing - 1U];
      const TimeNs begin = world.now;
      while (drone.kind != Kind::sinking && world.now - begin < 20 * ns_per_s) world.step();
      EXPECT_LT(to_seconds(world.now - begin), SeparationSettings{}.landing_wait_s);
      for (int i = 0; i < 1000; ++i) world.step();
      EXPECT_LT(drone.place[2], 0.2);
      EXPECT_GE(world.nearest_m, min_m) << landing << " above one at " << height_m;
    }
  }
}

TEST(Separation, OneThatIsToLandAboveAPathWaitsUntilTheOtherHasPassed) {
  for (const DroneNumber landing : {DroneNumber{1}, DroneNumber{2}}) {
    TrafficWorld world;
    for (DroneNumber n = 1; n <= 2; ++n) {
      const Vec3 place{3, 0, 2};
      if (n == landing) world.add(place, place).lands = true;
      if (n != landing) world.add({2.5, 0, 1}, {7, 0, 1}).speed = 0.5;
    }
    bool waited = false;
    for (int i = 0; i < 4000; ++i) {
      world.step();
      waited = waited || world.drones[landing - 1U].clearance.landing_blocked;
    }
    EXPECT_TRUE(waited);
    EXPECT_LT(world.drones[landing - 1U].place[2], 0.2);
    EXPECT_TRUE(world.drones[2U - landing].arrived());
    EXPECT_GE(world.nearest_m, min_m) << landing;
  }
}

TEST(Separation, ALandingDoesNotWaitForWhoIsBesideItOrAbove) {
  const auto waits = [](const Vec3& other, Neighbour::Kind kind) {
    Separation separation(SeparationSettings{}, 4);
    const std::array neighbours{Neighbour{.number = 1, .kind = kind, .motion = {.position_m = other}, .ceiling_m = 3},
                                Neighbour{.number = 2,
                                          .kind = Neighbour::Kind::steered,
                                          .motion = {.position_m = {0, 0, 1}},
                                          .lands = true,
                                          .ceiling_m = 3}};
    const Clearance clearance = separation.step(0.001, neighbours)[1];
    EXPECT_EQ(clearance.other, clearance.landing_blocked ? 1 : 0);
    return clearance.landing_blocked;
  };
  using Kind = Neighbour::Kind;
  EXPECT_TRUE(waits({0.3, 0, 0.2}, Kind::steered));
  EXPECT_FALSE(waits({0.7, 0, 0.2}, Kind::steered));
  EXPECT_FALSE(waits({0.3, 0, 1.8}, Kind::held));
  EXPECT_FALSE(waits({0.62, 0, 1}, Kind::held)) << "nearer than the margin already, and no nearer by it";
  EXPECT_TRUE(waits({0.55, 0, 0}, Kind::standing));
  EXPECT_FALSE(waits({0.6, 0, 0}, Kind::standing));
}

TEST(Separation, NobodyHoversAboveAnother) {
  for (const double height_m : {1.8, 2.4}) {
    TrafficWorld world;
    const Vec3 lower{0, 0, 1}, upper{0.1, 0, height_m};
    world.add(lower, lower);
    world.add(upper, upper);
    double stacked_s = 0;
    for (int i = 0; i < 4000; ++i) {
      world.step();
      const Vec3 &a = world.drones[0].place, &b = world.drones[1].place;
      if (std::hypot(a[0] - b[0], a[1] - b[1]) < 0.6) stacked_s += to_seconds(world.tick_);
    }
    EXPECT_LT(stacked_s, 8) << "of 20 s, with its goal above the other: it may try again";
    EXPECT_GE(world.nearest_m, min_m);
    EXPECT_LT(std::hypot(world.drones[0].place[0], world.drones[0].place[1]), 0.1) << "the lower number stays";
  }
}

TEST(Separation, TwoMayHoverOneAboveTheOtherFartherApartThanTheWashReaches) {
  TrafficWorld world;
  const Vec3 lower{0, 0, 0.8}, upper{0.1, 0, 2.4};
  world.add(lower, lower);
  world.add(upper, upper);
  for (int i = 0; i < 1000; ++i) {
    world.step();
    for (const PointDrone& drone : world.drones) ASSERT_EQ(drone.clearance.kind, Clearance::Kind::unchanged);
  }
}

TEST(Separation, APassAboveOneThatHoversIsNotHeldUp) {
  TrafficWorld world;
  world.add({0, 0, 1}, {0, 0, 1});
  world.add({-2, 0, 1.9}, {2, 0, 1.9}).speed = 0.4;
  for (int i = 0; i < 4000 && !world.all_arrived(); ++i) {
    world.step();
    for (const PointDrone& drone : world.drones) ASSERT_EQ(drone.clearance.kind, Clearance::Kind::unchanged);
  }
  EXPECT_TRUE(world.all_arrived());
}

TEST(Separation, OfOneThatCannotBeSteeredTheOtherGetsBeside) {
  TrafficWorld world;
  PointDrone& first = world.add({0, 0, 1.9}, {0, 0, 1.9});
  world.add({0.1, 0, 1}, {0.1, 0, 1}).kind = Neighbour::Kind::held;
  for (int i = 0; i < 800; ++i) world.step();
  EXPECT_GT(std::abs(first.place[0] - 0.1), 0.6);
  EXPECT_GE(world.nearest_m, min_m);
}

TEST(Separation, OneThatAGustBringsTooNearIsLeft) {
  TrafficWorld world;
  world.add({0, 0, 1}, {0, 0, 1});
  PointDrone& drifting = world.add({1, 0, 1}, {0, 0, 1});
  drifting.kind = Neighbour::Kind::held;
  drifting.gust = {-0.1, 0, 0};
  for (int i = 0; i < 2000; ++i) world.step();
  EXPECT_GE(world.nearest_m, min_m);
}

TEST(Separation, ADroneThatIsNotSteeredIsSentNothing) {
  Separation separation(SeparationSettings{}, 4);
  const std::array neighbours{
      Neighbour{.number = 1, .kind = Neighbour::Kind::held, .motion = {.position_m = {0, 0, 1}}, .ceiling_m = 3},
      Neighbour{.number = 2, .kind = Neighbour::Kind::sinking, .motion = {.position_m = {0.3, 0, 1}}, .ceiling_m = 3}};
  for (const Clearance& clearance : separation.step(0.001, neighbours)) {
    EXPECT_EQ(clearance.kind, Clearance::Kind::unchanged);
    EXPECT_EQ(clearance.velocity_mps, (Vec3{}));
  }
}

bool refused(const Neighbour& other) {
  Separation separation(SeparationSettings{}, 4);
  const std::array neighbours{other,
                              Neighbour{.number = 2, .kind = Neighbour::Kind::standing, .motion = {}, .ceiling_m = 3}};
  const Clearance clearance = separation.step(0.001, neighbours)[1];
  EXPECT_EQ(clearance.other, clearance.takeoff_refused ? other.number : 0);
  return clearance.takeoff_refused;
}

TEST(Separation, ATakeOffIsRefusedBesideAndBelowAnother) {
  using Kind = Neighbour::Kind;
  const auto other = [](Kind kind, const Vec3& place) {
    return Neighbour{.number = 1, .kind = kind, .motion = {.position_m = place}, .ceiling_m = 3};
  };
  EXPECT_TRUE(refused(other(Kind::standing, {0.45, 0, 0})));
  EXPECT_FALSE(refused(other(Kind::standing, {0.55, 0, 0})));
  EXPECT_TRUE(refused(other(Kind::steered, {0.3, 0, 1})));
  EXPECT_TRUE(refused(other(Kind::held, {0, 0.6, 1.8})));
  EXPECT_FALSE(refused(other(Kind::held, {0, 0.8, 1.8})));
  EXPECT_TRUE(refused(other(Kind::sinking, {0, 0.3, 2.9}))) << "it comes down here";
  EXPECT_TRUE(refused(other(Kind::rising, {0, 0.6, 0.1})));
}

TEST(Separation, WithADistanceOfZeroNobodyIsKeptApart) {
  SeparationSettings settings;
  settings.min_m = 0;
  TrafficWorld world(5 * ns_per_ms, settings);
  world.add({0, 0, 1}, {6, 0, 1});
  world.add({6, 0, 1}, {0, 0, 1});
  EXPECT_TRUE(world.fly(60));
  EXPECT_LT(world.nearest_m, 0.1);
}

TEST(Separation, SixteenOnRandomPathsNeverComeTooNearAndAllArrive) {
  const int last = seeds(20, 1000);
  double nearest = 10, slowest_s = 0;
  for (int seed = 1; seed <= last; ++seed) {
    TrafficWorld world = random_traffic(static_cast<std::uint64_t>(seed), 10 * ns_per_ms);
    const TimeNs begin = world.now;
    EXPECT_TRUE(world.fly(180)) << "seed " << seed;
    EXPECT_GE(world.nearest_m, min_m) << "seed " << seed;
    nearest = std::min(nearest, world.nearest_m);
    slowest_s = std::max(slowest_s, to_seconds(world.now - begin));
  }
  std::printf("%d seeds: nearest %.3f m, the last arrived after %.1f s\n", last, nearest, slowest_s);
}

}  // namespace
}  // namespace ledgerline::link
