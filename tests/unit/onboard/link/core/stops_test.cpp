#include <gtest/gtest.h>

#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// A stop stands until it is cleared by name: the ledger's, and the one of the local stop key.
namespace ledgerline::link {
namespace {

class Stops : public ::testing::Test {
 protected:
  Stops() { w.take_off(); }

  void land_by(PlanAction action) {
    w.plan(action);
    pass_until_down();
  }
  /// SIGTERM, then the service manager restarts link with what it left.
  void land_by_the_local_key() {
    w.stop_all = true;
    pass_until_down();
    restart(w.core.local_stops());
  }
  void restart(const DroneSet& local_stops) {
    w.stop_all = false;
    w.core = LinkCore(w.settings_, ++boot_id_, 1, local_stops);
    w.pass(5 * ns_per_s);  // until the drone counts as standing on the ground
  }
  void pass_until_down() {
    for (int i = 0; i < 5000 && w.core.phase(1) != LinkPhase::landed; ++i) w.step();
    ASSERT_EQ(w.core.phase(1), LinkPhase::landed);
    w.pass(100 * ms);
  }
  /// Whether it takes off when a holder asks for it, under a newer lease each time.
  bool takes_off() {
    const auto before = w.tellos[0].count("takeoff");
    Plan& plan = w.plan(PlanAction::takeoff);
    plan.epoch = ++epoch_;
    w.pass(3 * ns_per_s);
    return w.tellos[0].count("takeoff") > before;
  }

  LinkWorld w;
  std::uint64_t boot_id_ = 100, epoch_ = 1;
};

TEST_F(Stops, TheLedgersStandsWhateverPlanOrEpochComesUntilItIsCleared) {
  land_by(PlanAction::stop);
  EXPECT_FALSE(takes_off());
  EXPECT_FALSE(takes_off());
  EXPECT_EQ(w.states.back().cause, FailsafeCause::stopped);
  w.plan(PlanAction::stop_cleared);
  w.pass(100 * ms);
  EXPECT_EQ(w.states.back().cause, FailsafeCause::none);
  EXPECT_TRUE(takes_off());
}

TEST_F(Stops, ACutStandsAsWell) {
  land_by(PlanAction::cut);
  EXPECT_FALSE(takes_off());
  w.plan(PlanAction::stop_cleared);
  EXPECT_TRUE(takes_off());
}

TEST_F(Stops, ARestartedAgentClearsNone) {
  land_by(PlanAction::stop);
  w.agent = false;
  w.pass(3 * ns_per_s);
  w.agent = true;
  w.pass(ns_per_s);
  EXPECT_FALSE(takes_off());
}

TEST_F(Stops, AClearThatIsOlderThanTheStopClearsNothing) {
  Plan late = w.plan(PlanAction::stop_cleared);
  w.pass(ms);
  land_by(PlanAction::stop);
  w.plans.push_back(late);
  EXPECT_FALSE(takes_off());
}

TEST_F(Stops, WhatIsClearedInTheAirCountsFromTheGroundOn) {
  w.plan(PlanAction::stop);
  w.pass(ms);
  w.plan(PlanAction::stop_cleared);
  w.pass(ms);
  EXPECT_EQ(w.core.mode(1), FailsafeMode::land) << "a landing is never taken back";
  pass_until_down();
  EXPECT_TRUE(takes_off());
}

TEST_F(Stops, AStopBehindAClearInTheAirStands) {
  w.plan(PlanAction::stop);
  w.plan(PlanAction::stop_cleared_by_owner);
  w.pass(ms);
  w.plan(PlanAction::stop);
  pass_until_down();
  EXPECT_FALSE(takes_off());
}

TEST_F(Stops, TheLocalOneOutlastsLinkAndNoOrdinaryCommandOfTheLedgerClearsIt) {
  land_by_the_local_key();
  EXPECT_FALSE(takes_off());
  w.plan(PlanAction::stop_cleared);  // that nobody has it stopped on the ledger says nothing about who stands beside it
  EXPECT_FALSE(takes_off());
  restart(w.core.local_stops());
  EXPECT_FALSE(takes_off());
  EXPECT_EQ(w.states.back().cause, FailsafeCause::stopped);
  w.plan(PlanAction::stop_cleared_by_owner);
  EXPECT_TRUE(takes_off());
  EXPECT_TRUE(w.core.local_stops().none());
}

TEST_F(Stops, TheLocalOneIsClearedAtThisHostAndTheLedgersIsNot) {
  land_by(PlanAction::stop);
  restart(DroneSet().set(1));
  w.plan(PlanAction::stop);  // agent says it again to a link that knows of none
  w.pass(ms);
  w.clear_local_stops = true;
  EXPECT_FALSE(takes_off());
  EXPECT_TRUE(w.core.local_stops().none());
  w.plan(PlanAction::stop_cleared);
  EXPECT_TRUE(takes_off());
}

TEST_F(Stops, ALinkThatEndsOnTheGroundHasStoppedNobody) {
  w.plan(PlanAction::land);
  pass_until_down();
  w.stop_all = true;
  w.pass(ns_per_s);
  EXPECT_TRUE(w.core.local_stops().none());
  restart(w.core.local_stops());
  EXPECT_TRUE(takes_off());
}

TEST(LocalStop, OfADroneThatWasNeverHeardIsNone) {
  LinkWorld w(2);
  w.tellos[1].hears = false;
  w.take_off();
  w.stop_all = true;
  w.pass(10 * ns_per_s);
  EXPECT_EQ(w.core.local_stops(), DroneSet().set(1));
}

TEST(LocalStop, ThatOutlastedLinkLandsADroneInTheAir) {
  LinkWorld w;
  w.take_off();
  w.core = LinkCore(w.settings_, 43, 1, DroneSet().set(1));
  w.pass(10 * ns_per_s);
  EXPECT_LT(w.tellos[0].position[2], 0.1);
  EXPECT_GE(w.tellos[0].count("land"), 1);
}

}  // namespace
}  // namespace ledgerline::link
