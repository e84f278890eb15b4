#include "ground/core/lease/pilot_stops.hpp"

#include <gtest/gtest.h>

#include "common/access/stops.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using Kind = fabric::Outcome::Kind;

class PilotStopsTest : public ::testing::Test {
 protected:
  void submit(TimeNs now) { stops.submit(now, leases, id, sent); }
  DronesCall newest() const {
    DronesCall call;
    EXPECT_TRUE(call.ParseFromString(sent.back().call.args.at(0)));
    return call;
  }

  const FlightConfig config = config_for(1);
  FlightTransactions counters;
  LeaseBook leases{config, counters};
  PilotStops stops{config.drones, operator_name};
  std::uint64_t id = 1;
  std::vector<Submission> sent;
};

TEST_F(PilotStopsTest, EachStopperHasAStopOfHisOwn) {
  const crypto::IdentityName alice{"Org2MSP", "CN=alice"};
  stops.request(0, 0, false);
  stops.request(0, 0, false, alice);
  stops.request(1, 0, false, alice);
  submit(1);
  ASSERT_EQ(sent.size(), 2U);
  EXPECT_FALSE(sent[0].by);
  EXPECT_EQ(sent[1].by, alice);
  const auto ended = stops.on_outcome(2, fabric::Outcome::failed(Kind::committed, ""), sent[1].id);
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->drone, 0U);
  EXPECT_TRUE(stops.pending()) << "ours is in flight";
}

TEST_F(PilotStopsTest, AStopGoesAgainUntilTheLedgerHasItAndACutReplacesIt) {
  stops.request(0, 0, false);
  submit(0);
  submit(1);
  ASSERT_EQ(sent.size(), 1u);
  EXPECT_TRUE(sent[0].urgent);
  stops.request(2, 0, true);
  submit(2);
  ASSERT_EQ(sent.size(), 2u);
  EXPECT_FALSE(stops.on_outcome(3, fabric::Outcome::failed(Kind::committed, ""), 1)) << "of the stop before";
  const auto again = stops.on_outcome(4, fabric::Outcome::failed(Kind::unavailable, "away"), 2);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->problem, "");
  EXPECT_TRUE(stops.pending());
  submit(ns_per_s);
  ASSERT_EQ(sent.size(), 3u);
  EXPECT_TRUE(stops.on_outcome(ns_per_s, fabric::Outcome::failed(Kind::committed, ""), 3));
  EXPECT_FALSE(stops.pending());
}

/// The record, with stops of these.
Control stopped_by(const std::vector<crypto::IdentityName>& all) {
  Control record = control_record("tello1", operator_name);
  for (const crypto::IdentityName& one : all) *record.add_stoppers() = stop_of("tello1", one);
  return record;
}

TEST_F(PilotStopsTest, OursIsClearedByACallOfItsOwn) {
  ASSERT_TRUE(leases.set(stopped_by({operator_name})));
  ASSERT_TRUE(stops.request_clear(0, 0));
  EXPECT_FALSE(stops.pending(0)) << "no stop is on its way";
  submit(0);
  ASSERT_EQ(sent.size(), 1u);
  EXPECT_EQ(sent[0].call.function, "clear_stop");
  EXPECT_EQ(newest().drones(0), "tello1");
  EXPECT_EQ(newest().clears_size(), 0);
  const auto refused =
      stops.on_outcome(5, fabric::Outcome::failed(Kind::refused, "chaincode response 500, not yours"), sent[0].id);
  EXPECT_EQ(refused->problem, "its stop is not cleared: not yours");
  EXPECT_FALSE(stops.pending());
}

TEST_F(PilotStopsTest, WhatIsNotOursAloneIsNotCleared) {
  for (const auto& all :
       {std::vector<crypto::IdentityName>{}, {{"Org1MSP", "CN=eve"}}, {operator_name, {"Org1MSP", "CN=eve"}}}) {
    ASSERT_TRUE(leases.set(stopped_by(all)));
    ASSERT_TRUE(stops.request_clear(0, 0));
    submit(0);
    EXPECT_TRUE(sent.empty()) << all.size();
    EXPECT_FALSE(stops.pending());
  }
}

TEST_F(PilotStopsTest, AStopBehindAClearInFlightGoesOutAndOnceMoreWhenThatWasTaken) {
  ASSERT_TRUE(leases.set(stopped_by({operator_name})));
  ASSERT_TRUE(stops.request_clear(0, 0));
  submit(0);
  stops.request(1, 0, true);
  submit(1);
  ASSERT_EQ(sent.size(), 2u);
  EXPECT_EQ(sent[1].call.function, "stop");
  EXPECT_FALSE(stops.request_clear(2, 0)) << "the stop goes first";
  EXPECT_TRUE(stops.on_outcome(3, fabric::Outcome::failed(Kind::committed, ""), sent[1].id));
  EXPECT_FALSE(stops.pending());
  EXPECT_TRUE(stops.on_outcome(4, fabric::Outcome::failed(Kind::committed, ""), sent[0].id)) << "the clear, behind it";
  submit(4);
  ASSERT_EQ(sent.size(), 3u);
  EXPECT_EQ(sent[2].call.function, "stop");
  EXPECT_TRUE(newest().cut());

  EXPECT_TRUE(stops.on_outcome(5, fabric::Outcome::failed(Kind::committed, ""), sent[2].id));
  ASSERT_TRUE(stops.request_clear(6, 0));
  submit(6);
  stops.request(7, 0, false);
  submit(7);
  EXPECT_TRUE(stops.on_outcome(8, fabric::Outcome::failed(Kind::refused, "chaincode response 500, no"), sent[3].id))
      << "the clear is refused";
  submit(8);
  EXPECT_EQ(sent.size(), 5u) << "its stop is on its way, and no second one is needed";
}

TEST_F(PilotStopsTest, ItSaysForHowManyClearsItIsAndOnceMoreWithoutWhereThatIsRefused) {
  Control record = control_record("tello1", operator_name);
  set_clears(record, stop_of("tello1", operator_name).stopper(), 4);
  ASSERT_TRUE(leases.set(record));
  stops.request(0, 0, false);
  submit(0);
  ASSERT_EQ(newest().clears_size(), 1);
  EXPECT_EQ(newest().clears(0), 4u);
  const auto refused = fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: cleared 5 times");
  EXPECT_EQ(stops.on_outcome(1, refused, 1)->problem, "");
  submit(1);
  ASSERT_EQ(sent.size(), 2u);
  EXPECT_EQ(newest().clears_size(), 0);
  EXPECT_EQ(stops.on_outcome(2, refused, 2)->problem, "no stop: tello1: cleared 5 times");
  EXPECT_FALSE(stops.pending());
}

TEST_F(PilotStopsTest, TheContractsMessageIsReportedWhenItRefuses) {
  stops.request(0, 0, false);
  submit(0);
  const auto ended =
      stops.on_outcome(1, fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: not enrolled"), 1);
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->problem, "no stop: tello1: not enrolled");
  EXPECT_FALSE(stops.pending());
}

}  // namespace
}  // namespace ledgerline::ground
