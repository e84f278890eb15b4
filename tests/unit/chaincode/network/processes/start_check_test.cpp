#include <gtest/gtest.h>

#include "chaincode/network/processes/orderer_watch.hpp"

namespace ledgerline::network {
namespace {

using Verdict = StartCheck::Verdict;

const char* const metrics = R"(HTTP/1.0 200 OK

# HELP consensus_etcdraft_is_leader The leadership status of the current node: 1 if it is the leader else 0.
# TYPE consensus_etcdraft_is_leader gauge
consensus_etcdraft_is_leader{channel="teleop"} 0
consensus_etcdraft_is_leader{channel="yard"} 1
consensus_etcdraft_data_persist_duration_bucket{channel="teleop",le="0.005"} 17
consensus_etcdraft_data_persist_duration_count{channel="teleop"} 18
consensus_etcdraft_data_persist_duration_count{channel="yard"} 1.2e+06
)";

TEST(StartCheck, AnOrderersMetricsSayWhatItDoesOnEachChannel) {
  const auto signs = raft_signs(metrics);
  ASSERT_EQ(signs.size(), 2U);
  EXPECT_FALSE(signs.at("teleop").leads);
  EXPECT_EQ(signs.at("teleop").stored, 18U);
  EXPECT_TRUE(signs.at("yard").leads);
  EXPECT_EQ(signs.at("yard").stored, 1'200'000U);
  EXPECT_TRUE(raft_signs("no metrics at all").empty());
}

TEST(StartCheck, OneThatLeadsOrWritesTakesPart) {
  StartCheck leader({"teleop"}, 10 * ns_per_s), follower({"teleop"}, 10 * ns_per_s);
  EXPECT_EQ(leader.update(0, {{"teleop", {true, 1}}}), Verdict::takes_part);
  EXPECT_EQ(follower.update(0, {{"teleop", {false, 1}}}), Verdict::not_known);
  EXPECT_EQ(follower.update(ns_per_s, {{"teleop", {false, 2}}}), Verdict::not_known);
  EXPECT_EQ(follower.update(2 * ns_per_s, {{"teleop", {false, 3}}}), Verdict::takes_part);
}

TEST(StartCheck, OneThatDoesNeitherHangsOnceItsTimeIsOver) {
  StartCheck check({"teleop"}, 10 * ns_per_s);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(check.update(i * ns_per_s, {{"teleop", {false, 2}}}), Verdict::not_known);
  EXPECT_EQ(check.update(10 * ns_per_s, {{"teleop", {false, 2}}}), Verdict::hangs);
}

TEST(StartCheck, TheTimeBeginsWithTheFirstAnswer) {
  StartCheck check({"teleop"}, 10 * ns_per_s);
  EXPECT_EQ(check.update(0, {}), Verdict::not_known);
  EXPECT_EQ(check.update(60 * ns_per_s, {}), Verdict::not_known) << "a slow start is no hang";
  EXPECT_EQ(check.update(61 * ns_per_s, {{"teleop", {false, 2}}}), Verdict::not_known);
  EXPECT_EQ(check.update(71 * ns_per_s, {{"teleop", {false, 2}}}), Verdict::hangs);
}

TEST(StartCheck, OneChannelThatHangsIsEnough) {
  StartCheck check({"teleop", "yard"}, 10 * ns_per_s);
  EXPECT_EQ(check.update(0, {{"teleop", {true, 2}}, {"yard", {false, 2}}}), Verdict::not_known);
  EXPECT_EQ(check.update(10 * ns_per_s, {{"teleop", {true, 9}}, {"yard", {false, 2}}}), Verdict::hangs);
}

TEST(StartCheck, WhoDoesNotListenIsAnError) { EXPECT_FALSE(fetch_metrics("127.0.0.1:1").ok()); }

}  // namespace
}  // namespace ledgerline::network
