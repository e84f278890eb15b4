#include "tests/unit/onboard/link/core/failsafe_fixture.hpp"

/// Rows of what a drone senses by itself, and of a person who flies it in its own frame.
namespace ledgerline::link {
namespace {

TEST_F(FailsafeTest, FS37ALostVelocityMeansBrakeUntilItIsBackForAWhile) {
  inputs.by_odometry = true;
  pass(ns_per_s);
  poses = false;
  pass(settings.velocity_lost_ns);
  expect(FailsafeMode::none, FailsafeCause::none);
  pass(2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::velocity_lost);
  poses = true;
  pass(settings.clear_after_ns - 20 * ms);
  expect(FailsafeMode::brake, FailsafeCause::velocity_lost);
  pass(40 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS47InTheDarkTheSticksGoToZeroAtOnceAndItLandsAfterHalfASecond) {
  for (const bool by_odometry : {true, false}) {  // or motion capture is away
    state = {};
    inputs.by_odometry = by_odometry;
    inputs.phase = LinkPhase::flying;
    inputs.dark_since_ns = 0;
    pass(ns_per_s);
    inputs.dark_since_ns = now + ms;
    pass(ms);
    expect(FailsafeMode::brake, FailsafeCause::velocity_lost);
    pass(settings.dark_land_after_ns - ms);
    expect(FailsafeMode::brake, FailsafeCause::velocity_lost);
    pass(ms);
    expect(FailsafeMode::land, FailsafeCause::velocity_lost);
    inputs.dark_since_ns = 0;  // a landing is never taken back
    pass(ns_per_s);
    expect(FailsafeMode::land, FailsafeCause::velocity_lost);
  }
}

TEST_F(FailsafeTest, OneThatSeesAgainWithinHalfASecondFliesOn) {
  inputs.by_odometry = true;
  pass(ns_per_s);
  inputs.dark_since_ns = now + ms;
  pass(settings.dark_land_after_ns - ms);
  inputs.dark_since_ns = 0;
  pass(settings.clear_after_ns);
  expect(FailsafeMode::brake, FailsafeCause::velocity_lost);
  pass(2 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, APilotWhoMayDoWithoutAPositionFliesOnInTheDark) {
  inputs.needs_position = false;
  inputs.dark_since_ns = now;
  pass(10 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS48ALostHeightMeansBrakeAndKeepsItsLongerTime) {
  inputs.by_odometry = inputs.height_lost = true;
  pass(ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);  // its pose goes on
  poses = false;
  pass(settings.velocity_lost_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::height_lost);
  pass(settings.land_after_ns - 10 * ms);
  expect(FailsafeMode::brake, FailsafeCause::height_lost);
  pass(20 * ms);
  expect(FailsafeMode::land, FailsafeCause::height_lost);
}

TEST_F(FailsafeTest, ALostVelocityNeedsNoAgentToBeKnown) {
  inputs.by_odometry = true;
  pass(ns_per_s);
  poses = heartbeats = false;
  pass(settings.velocity_lost_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::velocity_lost);
}

TEST_F(FailsafeTest, FS19AnUncertainPositionMeansBrakeUntilItFitsTheFenceForAWhile) {
  fence.min_m = {-2, -2, 0};
  fence.max_m = {2, 2, 3};
  inputs.sigma_m = {0.5, 0.5, 0.1};  // 4 m less 2 x 3 x 0.5
  pass(ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.sigma_m[1] = 0.6;
  pass(ms);
  expect(FailsafeMode::brake, FailsafeCause::position_uncertain);
  inputs.sigma_m[1] = 0.5;  // measured at half the limit
  pass(ns_per_s);
  expect(FailsafeMode::brake, FailsafeCause::position_uncertain);
  inputs.sigma_m = {0.2, 0.2, 0.1};
  pass(settings.clear_after_ns + 2 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS44SourcesThatDifferMeanBrakeUntilTheyAgreeForAWhile) {
  pass(ns_per_s);
  inputs.sources_differ = true;
  pass(ms);
  expect(FailsafeMode::brake, FailsafeCause::sources_differ);
  inputs.sources_differ = false;
  pass(settings.clear_after_ns - 20 * ms);
  expect(FailsafeMode::brake, FailsafeCause::sources_differ);
  pass(40 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.sources_differ = true;
  inputs.needs_position = false;  // a pilot who sees it
  pass(ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS43SourcesThatStillDifferLandWhereNothingStandsIn) {
  pass(ns_per_s);
  inputs.sources_differ = inputs.sources_unresolved = true;
  inputs.needs_position = false;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.needs_position = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::sources_differ);
}

TEST_F(FailsafeTest, AVagueHeadingIsAnUncertainPosition) {
  pass(ns_per_s);
  inputs.sigma_yaw_rad = settings.max_yaw_sigma_rad + 0.01;
  pass(ms);
  expect(FailsafeMode::brake, FailsafeCause::position_uncertain);
  inputs.phase = LinkPhase::on_ground;
  EXPECT_EQ(takeoff_refusal(settings, fence, now, inputs), FailsafeCause::position_uncertain);
}

TEST_F(FailsafeTest, ByHandAPoseThatIsKnownHoldsTheFenceHoweverNarrowTheRoom) {
  inputs.needs_position = false;
  inputs.sigma_m = {0.5, 0.5, 0.1};
  fence.min_m = {-1, -1, 0};
  fence.max_m = {1, 1, 3};
  pass(ns_per_s);
  const FenceSettings holds = fence_for(settings, fence, state, now, inputs);
  EXPECT_DOUBLE_EQ(holds.max_m[0], 1);
  inputs.sigma_m = {50, 50, 0.1};
  EXPECT_GT(fence_for(settings, fence, state, now, inputs).max_m[0], 1000);
}

TEST_F(FailsafeTest, FS17ATiltedDroneLands) {
  pass(ns_per_s);
  inputs.tilted = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::tilted);
}

TEST_F(FailsafeTest, FS16AnOverturnedDronesMotorsAreCut) {
  pass(ns_per_s);
  inputs.tilted = true;
  pass(ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::tilted);
  inputs.overturned = true;
  pass(ms);
  expect(FailsafeMode::cut, FailsafeCause::overturned);
}

TEST_F(FailsafeTest, FS18ADroneThatMovesOtherwiseThanItIsCommandedLands) {
  pass(ns_per_s);
  inputs.motion_differs = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::motion_differs);
}

TEST_F(FailsafeTest, ByHandNeitherPoseNorVelocityNorACertainPositionIsNeeded) {
  for (const bool by_odometry : {false, true}) {
    inputs.by_odometry = by_odometry;
    inputs.needs_position = false;
    inputs.sigma_m = by_odometry ? std::array{50.0, 50.0, 0.1} : std::array{0.0, 0.0, 0.0};
    poses = false;
    inputs.position_m = {100, 0, 1};  // nobody knows
    pass(3 * ns_per_s);
    expect(FailsafeMode::none, FailsafeCause::none);
    inputs.needs_position = true;  // a path
    pass(ms);
    EXPECT_EQ(state.mode, FailsafeMode::brake);
    inputs.needs_position = false;
    pass(settings.clear_after_ns + 2 * ms);
    expect(FailsafeMode::none, FailsafeCause::none);
  }
}

TEST_F(FailsafeTest, ByHandWithoutAPositionTheCeilingHoldsByTheDronesOwnHeight) {
  inputs.needs_position = false;
  poses = false;
  inputs.height_m = static_cast<float>(fence.max_m[2]) + 0.3F;
  pass(ns_per_s + settings.fence_land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, TheFenceIsDrawnInByTheUncertaintyOfThePosition) {
  pass(ns_per_s);
  inputs.sigma_m = {0.5, 0.1, 0.1};
  const FenceSettings holds = fence_for(settings, fence, state, now, inputs);
  EXPECT_DOUBLE_EQ(holds.max_m[0], fence.max_m[0] - 1.5);
  EXPECT_DOUBLE_EQ(holds.min_m[1], fence.min_m[1] + 0.3);
  EXPECT_DOUBLE_EQ(holds.max_m[2], fence.max_m[2]);
}

TEST_F(FailsafeTest, ABatteryThatEmptiesFastLandsWhileThereIsEnoughForIt) {
  inputs.battery = 0.25F;
  pass(ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.landing_battery = 0.25;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::battery_critical);
}

TEST_F(FailsafeTest, NoTakeOffTiltedOrOutsideTheFenceOrWithoutKnowingWhere) {
  inputs.phase = LinkPhase::on_ground;
  inputs.heartbeat_ns = inputs.state_ns = inputs.pose_ns = now;
  const auto refusal = [&](auto spoil) {
    FailsafeInputs spoiled = inputs;
    spoil(spoiled);
    return takeoff_refusal(settings, fence, now, spoiled);
  };
  EXPECT_EQ(refusal([](FailsafeInputs&) {}), FailsafeCause::none);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.tilt_rad = 0.5; }), FailsafeCause::tilted);
  EXPECT_EQ(refusal([&](FailsafeInputs& f) { f.position_m[0] = fence.max_m[0] + 0.1; }), FailsafeCause::fence);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.sigma_m = {50, 50, 1}; }), FailsafeCause::position_uncertain);
  const auto by_hand = [](FailsafeInputs& f) {
    f.needs_position = false;
    f.by_odometry = true;
    f.sigma_m = {0.02, 0.02, 0.02};
  };
  EXPECT_EQ(refusal([&](FailsafeInputs& f) {
              by_hand(f);
              f.too_near = true;
            }),
            FailsafeCause::too_near);
  EXPECT_EQ(refusal([&](FailsafeInputs& f) {
              by_hand(f);
              f.position_m[0] = fence.max_m[0] + 0.1;
            }),
            FailsafeCause::fence);
  const auto own = [](FailsafeInputs& f) {
    f.by_odometry = true;
    f.pose_ns -= ns_per_s;
  };
  EXPECT_EQ(refusal(own), FailsafeCause::velocity_lost);
  EXPECT_EQ(refusal([&](FailsafeInputs& f) {
              own(f);
              f.height_lost = true;
            }),
            FailsafeCause::height_lost);
  EXPECT_EQ(refusal([&](FailsafeInputs& f) {
              own(f);
              f.needs_position = false;
            }),
            FailsafeCause::none);
}

}  // namespace
}  // namespace ledgerline::link
