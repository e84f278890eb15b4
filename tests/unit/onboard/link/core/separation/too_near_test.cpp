#include <gtest/gtest.h>

#include <limits>

#include "tests/unit/onboard/link/core/failsafe_fixture.hpp"
#include "tests/unit/onboard/link/core/link_world.hpp"

/// What link makes of Separation's clearances: what is flown, what is said, and who may take off.
namespace ledgerline::link {
namespace {

TEST_F(FailsafeTest, FS60AnotherDroneInItsWayIsAWarningUntilItIsApartForAWhile) {
  pass(ns_per_s);
  inputs.too_near = true;
  pass(10 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::too_near);  // what of its plan leads past is flown on: it does not land
  inputs.too_near = false;
  pass(settings.clear_after_ns - 10 * ms);
  inputs.too_near = true;
  pass(10 * ms);
  inputs.too_near = false;
  pass(settings.clear_after_ns - 10 * ms);
  expect(FailsafeMode::none, FailsafeCause::too_near);
  pass(20 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  EXPECT_EQ(causes, 2);
  inputs.phase = LinkPhase::landed;
  inputs.too_near = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::too_near);  // as what speaks against a take-off
}

/// Two drones that change places, each commanded towards its goal ten times a second.
struct Crossing : LinkWorld {
  explicit Crossing(LinkSettings settings = {}) : LinkWorld(2, std::move(settings)) {
    take_off();
    pass(2 * ns_per_s);
  }
  bool fly(TimeNs max_duration) {
    const std::array goals{tellos[1].position, tellos[0].position};
    for (const TimeNs end = now + max_duration; now < end;) {
      double max_way = 0;
      for (std::size_t i = 0; i < 2; ++i) {
        std::array<float, 3> desired{};
        for (std::size_t k = 0; k < 3; ++k) {
          const double way = goals[i][k] - tellos[i].position[k];
          desired[k] = static_cast<float>(std::clamp(way, -0.8, 0.8));
          max_way = std::max(max_way, std::abs(way));
        }
        fly_plan(desired, 4, 0, i + 1);
      }
      if (max_way < 0.1) return true;
      for (int i = 0; i < 100; ++i) {
        step();
        const auto &a = tellos[0].position, &b = tellos[1].position;
        nearest_m = std::min(nearest_m, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
      }
    }
    return false;
  }
  bool said(DroneNumber drone) const {
    return std::any_of(transitions.begin(), transitions.end(), [&](const Transition &t) {
      return t.drone == drone && t.cause == FailsafeCause::too_near && t.mode == FailsafeMode::none;
    });
  }
  double nearest_m = std::numeric_limits<double>::infinity();
};

TEST(TooNear, TwoDronesThatChangePlacesPassEachOtherAndReportIt) {
  Crossing w;
  EXPECT_TRUE(w.fly(30 * ns_per_s));
  EXPECT_GE(w.nearest_m, w.settings_.separation.min_m);
  EXPECT_TRUE(w.said(2));
  EXPECT_EQ(w.core.mode(1), FailsafeMode::none);
  w.pass(ns_per_s);
  EXPECT_NE(w.states.back().cause, FailsafeCause::too_near);
}

TEST(TooNear, OneThatHoldsWithoutAPlanIsGoneRound) {
  Crossing w;
  const auto held = w.tellos[1].position;
  const auto goal = std::array{held[0] + 1.5, held[1], held[2]};
  for (int i = 0; i < 150; ++i) {  // tello2 holds, and lands in the end
    std::array<float, 3> desired{};
    for (std::size_t k = 0; k < 3; ++k)
      desired[k] = static_cast<float>(std::clamp(goal[k] - w.tellos[0].position[k], -0.8, 0.8));
    w.fly_plan(desired, 4);
    for (int k = 0; k < 100; ++k) {
      w.step();
      const auto &a = w.tellos[0].position, &b = w.tellos[1].position;
      w.nearest_m = std::min(w.nearest_m, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
    }
  }
  EXPECT_GE(w.nearest_m, w.settings_.separation.min_m);
  EXPECT_NEAR(w.tellos[0].position[0], goal[0], 0.1);
  EXPECT_TRUE(w.said(1));
}

TEST(TooNear, WithADistanceOfZeroOrOutsideTheCommonFrameNobodyIsKeptApart) {
  for (const bool off : {true, false}) {
    LinkSettings settings;
    if (off) settings.separation.min_m = 0;
    if (!off)
      settings.drones = {{.name = "tello1", .number = 1}, {.name = "tello2", .number = 2, .in_common_frame = false}};
    Crossing w(settings);
    EXPECT_TRUE(w.fly(30 * ns_per_s));
    EXPECT_LT(w.nearest_m, 0.2);
    EXPECT_FALSE(w.said(1) || w.said(2));
  }
}

TEST(TooNear, ATakeOffBesideAnotherDroneIsRefused) {
  for (const double distance_m : {0.4, 0.6}) {
    LinkWorld w(2);
    w.tellos[1].position = {distance_m, 0, 0};
    w.pass(ns_per_s);
    w.plan(PlanAction::takeoff, 1);
    w.pass(5 * ns_per_s);
    EXPECT_EQ(w.core.phase(1) == LinkPhase::flying, distance_m > 0.5);
    w.plan(PlanAction::takeoff, 2);
    w.pass(5 * ns_per_s);
    EXPECT_EQ(w.core.phase(2), LinkPhase::on_ground) << "beside one that flies, or stands too near";
    EXPECT_EQ(w.states.back().cause, FailsafeCause::too_near);
  }
}

/// One is a metre above the other, which hovers by plans of its own.
struct Above : LinkWorld {
  explicit Above(DroneNumber upper = 1, LinkSettings settings = {})
      : LinkWorld(2, std::move(settings)), upper_(upper), lower_(3U - upper) {
    take_off();
    pass(ns_per_s);
    // Within a second: what is elsewhere at once is no pose.
    const auto from = tellos[upper_ - 1U].position;
    for (int i = 1; i <= 100; ++i) {
      const double share = i / 100.0;
      auto &at = tellos[upper_ - 1U].position;
      at[0] = from[0] + share * (tellos[lower_ - 1U].position[0] - 0.1 - from[0]);
      at[1] = (1 - share) * from[1];
      at[2] = from[2] + share * (2 - from[2]);
      pass(10 * ns_per_ms);
    }
    hover(500 * ns_per_ms);
  }
  void hover(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) {
      fly_plan({}, 4, 0, lower_);
      for (int i = 0; i < 100; ++i) {
        step();
        const auto &a = tellos[0].position, &b = tellos[1].position;
        nearest_m = std::min(nearest_m, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
      }
    }
  }
  /// The holder's, as ground says it: until it is obeyed.
  void ask_to_land(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end && core.phase(upper_) == LinkPhase::flying;) {
      plan(PlanAction::land, upper_);
      hover(100 * ns_per_ms);
    }
  }
  FailsafeCause cause() const {
    const auto at =
        std::find_if(states.rbegin(), states.rend(), [&](const auto &state) { return state.drone == upper_; });
    return at->cause;
  }
  DroneNumber upper_, lower_;
  double nearest_m = std::numeric_limits<double>::infinity();
};

TEST(TooNear, ALandingAboveAnotherDroneIsMadeBesideItAndSaysWhatItWaitsFor) {
  Above w;
  w.ask_to_land(200 * ns_per_ms);
  EXPECT_EQ(w.core.phase(1), LinkPhase::flying);
  EXPECT_EQ(w.cause(), FailsafeCause::too_near);
  const TimeNs asked = w.now;
  w.hover(100 * ns_per_ms);  // whatever becomes of ground
  w.fly_plan({0, 0, 0.5}, 10);
  const std::uint64_t takeoff = w.plan(PlanAction::takeoff).sequence;
  w.hover(200 * ns_per_ms);
  for (const TraceRecord &record : w.trace)
    EXPECT_FALSE(record.kind == TraceKind::command_applied && record.id == takeoff) << "it takes no landing back";
  while (w.core.phase(1) == LinkPhase::flying && w.now - asked < 20 * ns_per_s) w.hover(100 * ns_per_ms);
  EXPECT_LT(to_seconds(w.now - asked), w.settings_.separation.landing_wait_s - 1);
  EXPECT_EQ(w.core.mode(1), FailsafeMode::none);
  EXPECT_LT(w.tellos[0].position[2], 2) << "nothing is flown any more but the way down";
  w.hover(6 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
  EXPECT_EQ(w.core.phase(2), LinkPhase::flying);
  EXPECT_GE(w.nearest_m, w.settings_.separation.min_m);
}

TEST(TooNear, ALandingInACornerIsMadeBesideTheOther) {
  LinkSettings settings;
  settings.fence.min_m = {-0.2, -0.2, 0};  // no room behind it, nor on its left
  Above w(2, settings);
  const TimeNs asked = w.now;
  w.ask_to_land(20 * ns_per_s);
  EXPECT_LT(to_seconds(w.now - asked), settings.separation.landing_wait_s - 1);
  w.hover(6 * ns_per_s);
  EXPECT_EQ(w.core.phase(2), LinkPhase::landed);
  EXPECT_GE(w.nearest_m, settings.separation.min_m);
}

TEST(TooNear, ALandingWithNobodyBelowIsSentInTheSameStep) {
  Above w;
  w.plan(PlanAction::land, 2);
  w.step();
  EXPECT_EQ(w.sent.back().second, "land");
  EXPECT_EQ(w.core.phase(2), LinkPhase::landing);
}

TEST(TooNear, AStopLandsAtOnceWhateverIsBelow) {
  Above w;
  w.ask_to_land(200 * ns_per_ms);
  w.plan(PlanAction::stop, 1);
  w.step();
  EXPECT_EQ(w.core.phase(1), LinkPhase::landing);
}

TEST(TooNear, ALandingWaitsNoLongerWhereItsPlaceIsLost) {
  Above w;
  w.ask_to_land(200 * ns_per_ms);
  w.mocap = false;
  w.hover(w.settings_.failsafe.pose_lost_ns + 100 * ns_per_ms);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landing);
}

TEST(TooNear, ALandingIsMadeWhenItsWaitIsOverWhateverIsBelow) {
  LinkSettings settings;
  settings.separation.landing_wait_s = 1;  // half of what it takes to get aside
  Above w(2, settings);
  const TimeNs asked = w.now;
  w.ask_to_land(5 * ns_per_s);
  EXPECT_NEAR(to_seconds(w.now - asked), settings.separation.landing_wait_s, 0.2);
  EXPECT_EQ(w.core.phase(2), LinkPhase::landing);
}

/// Both are flown by plans until the same moment; the failsafe lands both in one step.
struct BothLand : Above {
  using Above::Above;
  /// `until`: what makes the failsafe land both. False: one of them still flies after 20 s.
  bool land_both() {
    for (const TimeNs end = now + 20 * ns_per_s; now < end;) {
      step();
      const auto &a = tellos[0].position, &b = tellos[1].position;
      nearest_m = std::min(nearest_m, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
      if (core.all_on_ground()) return true;
    }
    return false;
  }
};

// FS-64: one station dies, both run out of plans at once (FS-10, FS-05).
TEST(TooNear, TwoThatTheFailsafeLandsAtOnceComeDownBesideEachOther) {
  for (const DroneNumber upper : {DroneNumber{1}, DroneNumber{2}}) {
    BothLand w(upper);
    EXPECT_TRUE(w.land_both());
    EXPECT_GE(w.nearest_m, w.settings_.separation.min_m) << "the upper one is " << upper;
  }
}

// FS-64: the same without the time of a hold, in which one would step aside (FS-03).
TEST(TooNear, TwoOfAnEmptyBatteryComeDownBesideEachOther) {
  BothLand w;
  for (FakeTello &tello : w.tellos) tello.battery = 8;
  w.pass(500 * ns_per_ms);
  EXPECT_EQ(w.core.mode(1), FailsafeMode::land);
  EXPECT_EQ(w.core.mode(2), FailsafeMode::land);
  EXPECT_EQ(w.core.phase(1), LinkPhase::flying);
  EXPECT_EQ(w.core.phase(2), LinkPhase::landing);
  EXPECT_EQ(w.cause(), FailsafeCause::battery_critical);
  EXPECT_TRUE(w.land_both());
  EXPECT_GE(w.nearest_m, w.settings_.separation.min_m);
}

TEST(TooNear, AStopDoesNotWaitBehindALandingOfTheFailsafe) {
  BothLand w;
  for (FakeTello &tello : w.tellos) tello.battery = 8;
  w.pass(500 * ns_per_ms);
  ASSERT_EQ(w.core.phase(1), LinkPhase::flying);
  w.plan(PlanAction::stop, 1);
  w.step();
  EXPECT_EQ(w.core.phase(1), LinkPhase::landing);
}

TEST(TooNear, ALandingOfTheFailsafeWithoutAPositionDoesNotWait) {
  BothLand w;
  for (FakeTello &tello : w.tellos) tello.battery = 8;
  w.pass(500 * ns_per_ms);
  ASSERT_EQ(w.core.phase(1), LinkPhase::flying);
  w.mocap = false;
  w.pass(w.settings_.failsafe.pose_lost_ns + 100 * ns_per_ms);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landing);
}

TEST(TooNear, ALandingOfTheFailsafeIsMadeWhenItsTimeIsOver) {
  LinkSettings settings;
  settings.separation.landing_wait_s = 1;
  BothLand w(1, settings);
  w.tellos[0].battery = 8;  // the lower one hovers on
  w.hover(500 * ns_per_ms);
  ASSERT_EQ(w.core.phase(1), LinkPhase::flying);
  w.hover(ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landing);
}

// Nobody hovers in another's wash: in a hold as well, which has 5 s for it.
TEST(TooNear, OneThatHoldsAboveAnotherStepsAside) {
  Above w;
  w.hover(2 * ns_per_s);
  const auto &upper = w.tellos[0].position, &lower = w.tellos[1].position;
  w.hover(2 * ns_per_s);
  EXPECT_GT(std::hypot(upper[0] - lower[0], upper[1] - lower[1]), 0.6);
  EXPECT_GE(w.nearest_m, w.settings_.separation.min_m);
}

TEST(TooNear, OneThatHoldsWithoutAPositionDoesNotStepAside) {
  Above w(2);
  w.mocap = false;
  const auto before = w.tellos[1].position;
  w.pass(2 * ns_per_s);  // it is not landed yet
  const auto &after = w.tellos[1].position;
  EXPECT_LT(std::hypot(after[0] - before[0], after[1] - before[1]), 0.1) << "the rest of what it flew";
}

}  // namespace
}  // namespace ledgerline::link
