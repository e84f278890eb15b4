#include "ground/service/operators/ended_sessions.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/access/access.hpp"
#include "common/access/stops.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground::service {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

const HeldDrones flown{{0, 2}, {2}}, landed{{0, 2}, {}};

TEST(LeavingOperators, WhatIsInTheAirIsAskedToLandEachSecondAndThenAllIsGivenBack) {
  EndedSessions leaving;
  leaving.add(1, 0);
  EXPECT_TRUE(leaving.has(1));
  EXPECT_FALSE(leaving.has(0));
  const auto first = leaving.step(0, 1, flown);
  EXPECT_THAT(first.land, ElementsAre(2));
  EXPECT_FALSE(first.give_back);
  EXPECT_THAT(leaving.step(ns_per_s / 2, 1, flown).land, IsEmpty()) << "it was asked just now";
  EXPECT_THAT(leaving.step(ns_per_s, 1, flown).land, ElementsAre(2));
  const auto down = leaving.step(2 * ns_per_s, 1, landed);
  EXPECT_TRUE(down.give_back);
  EXPECT_FALSE(down.last) << "if too much waits to be signed, it is tried again";
  EXPECT_THAT(down.land, IsEmpty());
  leaving.remove(1);
  EXPECT_TRUE(leaving.empty());
}

TEST(LeavingOperators, BehindTheLimitItIsGivenBackInTheAirToo) {
  EndedSessions leaving;
  leaving.add(0, 0);
  EXPECT_FALSE(leaving.step(EndedSessions::limit_ns - 1, 0, flown).give_back);
  const auto last = leaving.step(EndedSessions::limit_ns, 0, flown);
  EXPECT_TRUE(last.give_back && last.last);
}

TEST(LeavingOperators, BehindARestartOneMayComeBackForWhatHeHolds) {
  EndedSessions leaving;
  leaving.add(0, 900 * ns_per_s);
  const auto early = leaving.step(899 * ns_per_s, 0, flown);
  EXPECT_FALSE(early.give_back);
  EXPECT_THAT(early.land, IsEmpty());
  EXPECT_FALSE(leaving.step(899 * ns_per_s, 0, landed).give_back);
  EXPECT_THAT(leaving.step(900 * ns_per_s, 0, flown).land, ElementsAre(2));
  leaving.remove(0);
  EXPECT_FALSE(leaving.step(2'000 * ns_per_s, 0, landed).give_back) << "he has come back";
}

TEST(LeavingOperators, WhoSignsOutAgainLeavesFromThatMomentOn) {
  EndedSessions leaving;
  leaving.add(0, 0);
  leaving.add(0, 50 * ns_per_s);
  EXPECT_THAT(leaving.all(), ElementsAre(0));
  EXPECT_FALSE(leaving.step(EndedSessions::limit_ns, 0, flown).last);
}

/// Of three drones alice holds two: tello1 we command for her, tello2 is commanded from elsewhere.
class TwoDronesOfAlice : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(world.core.set_control(delegated_record("tello1", alice.subject, 2).SerializeAsString()));
    ASSERT_TRUE(world.core.set_control(control_record("tello2", alice, 2).SerializeAsString()));
  }
  static FlightConfig manual_config() {
    FlightConfig config = config_for(3);
    config.manual = true;
    return config;
  }
  FlightWorld world{manual_config()};
  const crypto::IdentityName alice{operator_name.msp_id, "CN=alice"};
};

TEST_F(TwoDronesOfAlice, HoldWhatTheLedgerSaysThatWeCommandForThem) {
  world.run(1);
  EXPECT_THAT(drones_held_by(world.core, alice).drones, ElementsAre(0))
      << "tello2 is hers, and commanded from elsewhere";
  EXPECT_THAT(drones_held_by(world.core, alice).aloft, IsEmpty());
  EXPECT_THAT(drones_held_by(world.core, outsider_name).drones, IsEmpty());
  world.drones[0].phase = LinkPhase::flying;
  world.run(1);
  EXPECT_THAT(drones_held_by(world.core, alice).aloft, ElementsAre(0));
  EXPECT_THAT(aloft_of(world.core), ElementsAre(0));
}

TEST_F(TwoDronesOfAlice, OfALeaseItIsKnownWhoHoldsItAndWhetherWeCommand) {
  Control free = control_record("tello3", alice, 2);
  free.clear_holder();
  ASSERT_TRUE(world.core.set_control(free.SerializeAsString()));
  const std::vector<LeaseState> leases = leases_of(world.core);
  ASSERT_EQ(leases.size(), 3U);
  EXPECT_TRUE(leases[0].ours && leases[0].holder == alice);
  EXPECT_FALSE(leases[1].ours);
  EXPECT_EQ(leases[1].words, "its lease is held by CN=alice");
  EXPECT_FALSE(leases[2].ours || leases[2].holder);
  EXPECT_EQ(leases[2].words, "nobody holds its lease");
}

TEST(LeavingOperators, WhatWasNeverSeenIsNotKnownToBeDown) {
  FlightConfig config = config_for(2);
  config.manual = true;
  const FlightWorld world(config);
  EXPECT_THAT(aloft_of(world.core), ElementsAre(0, 1));
}

TEST(LeavingOperators, GroundsOwnStopIsKnownWhereItIsTheOnlyOne) {
  FlightConfig config = config_for(2);
  config.manual = true;
  FlightWorld world(config);
  const auto stopped = [&](const char* drone, std::initializer_list<crypto::IdentityName> stoppers) {
    Control record = control_record(drone, config.self, 2);
    for (const crypto::IdentityName& who : stoppers) {
      Stop stop;
      *stop.mutable_stopper() = to_message(who);
      add_stop(record, stop);
    }
    ASSERT_TRUE(world.core.set_control(record.SerializeAsString()));
  };
  EXPECT_THAT(stopped_by_ground(world.core), IsEmpty());
  stopped("tello1", {world.core.config().self});
  stopped("tello2", {world.core.config().self, outsider_name});
  EXPECT_THAT(stopped_by_ground(world.core), ElementsAre(0)) << "of tello2 another one is a stopper, too";
}

}  // namespace
}  // namespace ledgerline::ground::service
