#include "ground/core/flight/pilot_stops.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using Kind = fabric::Outcome::Kind;

TEST(PilotStops, AStopGoesAgainUntilTheLedgerHasItAndACutReplacesIt) {
  PilotStops stops(config_for(1).drones, operator_name);
  std::uint64_t id = 1;
  std::vector<Submission> sent;
  stops.want(0, 0, false);
  stops.submit(0, id, sent);
  stops.submit(1, id, sent);
  ASSERT_EQ(sent.size(), 1u);
  EXPECT_TRUE(sent[0].urgent);
  stops.want(2, 0, true);
  stops.submit(2, id, sent);
  ASSERT_EQ(sent.size(), 2u);
  EXPECT_FALSE(stops.take_outcome(3, fabric::Outcome::failed(Kind::committed, ""), 1)) << "of the stop before";
  const auto again = stops.take_outcome(4, fabric::Outcome::failed(Kind::unavailable, "away"), 2);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->problem, "");
  EXPECT_TRUE(stops.pending());
  stops.submit(ns_per_s, id, sent);
  ASSERT_EQ(sent.size(), 3u);
  EXPECT_TRUE(stops.take_outcome(ns_per_s, fabric::Outcome::failed(Kind::committed, ""), 3));
  EXPECT_FALSE(stops.pending());
}

TEST(PilotStops, TheContractsWordsAreSaidWhenItRefuses) {
  PilotStops stops(config_for(1).drones, operator_name);
  std::uint64_t id = 1;
  std::vector<Submission> sent;
  stops.want(0, 0, false);
  stops.submit(0, id, sent);
  const auto ended =
      stops.take_outcome(1, fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: not enrolled"), 1);
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->problem, "no stop: tello1: not enrolled");
  EXPECT_FALSE(stops.pending());
}

}  // namespace
}  // namespace ledgerline::ground
