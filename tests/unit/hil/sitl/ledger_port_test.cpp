#include "hil/sitl/ledger/ledger_port.hpp"

#include <gtest/gtest.h>

#include <tuple>

#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

using Kind = fabric::Outcome::Kind;

// Endorsed, ordered, written and delivered in a millisecond each.
const LedgerDelays even{ns_per_ms, ns_per_ms, ns_per_ms, ns_per_ms, 0, {}};
constexpr TimeNs undisturbed = 10 * ns_per_ms;  // a commit takes less

fabric::Call note(const std::string& text) {
  SetCall call;
  Asset* asset = call.add_assets();
  asset->set_id("Org1MSP/notes");
  asset->set_msg_type("std_msgs/msg/String");
  asset->set_msg_data(text);
  return {"set", {call.SerializeAsString()}};
}

/// A port that is stepped each millisecond, and what came out of it when.
class Port : public ::testing::Test {
 protected:
  struct Came {
    TimeNs at;
    SimulatedLedger::Ended ended;
  };

  Port() { port.begin(); }
  void submit(std::uint64_t id) { port.submit(now, id, note(std::to_string(id))); }
  void run(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) {
      now += ns_per_ms;
      ledger.step(now);
      port.step(now);
      for (auto& ended : port.pop_outcomes()) outcomes.push_back({now, ended});
      for (auto& block : port.pop_blocks()) blocks.emplace_back(now, block->number);
      if (const auto connected = port.pop_connection_change()) connections.emplace_back(now, *connected);
    }
  }
  std::vector<std::uint64_t> ids() const {
    std::vector<std::uint64_t> all;
    for (const Came& came : outcomes) all.push_back(came.ended.id);
    return all;
  }
  std::vector<std::uint64_t> numbers() const {
    std::vector<std::uint64_t> all;
    for (const auto& [at, number] : blocks) all.push_back(number);
    return all;
  }
  static std::optional<Distribution> delay(TimeNs time) { return Distribution::constant(time); }

  SimulatedLedger ledger{{}, even, 1};
  LedgerPort port{ledger, {"Org1MSP", "CN=User1@org1.ledgerline"}, 2};
  TimeNs now = 0;
  std::vector<Came> outcomes;
  std::vector<std::pair<TimeNs, std::uint64_t>> blocks;
  std::vector<std::pair<TimeNs, bool>> connections;
};

TEST_F(Port, BringsACallsOutcomeAndItsBlock) {
  submit(7);
  run(undisturbed);
  ASSERT_EQ(ids(), std::vector<std::uint64_t>{7});
  EXPECT_EQ(outcomes[0].ended.outcome.kind, Kind::committed);
  EXPECT_EQ(numbers(), std::vector<std::uint64_t>{1});
  EXPECT_EQ(port.acknowledged(), std::vector<std::string>{outcomes[0].ended.outcome.tx_id});
  EXPECT_EQ(port.in_flight(), 0U);
}

TEST_F(Port, ADelayOfOneDirectionDelaysThatOneOnly) {
  port.delay_to(delay(100 * ns_per_ms));
  submit(1);
  run(99 * ns_per_ms);
  EXPECT_EQ(ledger.height(), 1U);
  run(1 * ns_per_ms + undisturbed);
  EXPECT_EQ(ledger.height(), 2U);
  ASSERT_EQ(outcomes.size(), 1U);
  EXPECT_LE(outcomes[0].at, 100 * ns_per_ms + undisturbed);

  port.delay_to(std::nullopt);
  port.delay_from(delay(100 * ns_per_ms));
  const TimeNs begin = now;
  submit(2);
  run(undisturbed);
  EXPECT_EQ(ledger.height(), 3U);
  EXPECT_EQ(outcomes.size(), 1U);
  run(200 * ns_per_ms);
  ASSERT_EQ(outcomes.size(), 2U);
  ASSERT_EQ(blocks.size(), 2U);
  for (const TimeNs at : {outcomes[1].at, blocks[1].first}) {
    EXPECT_GE(at - begin, 100 * ns_per_ms);
    EXPECT_LE(at - begin, 100 * ns_per_ms + undisturbed);
  }
}

TEST_F(Port, WhatFollowsAShorterDelayOvertakesNothing) {
  for (const bool to : {true, false}) {
    outcomes.clear();
    blocks.clear();
    const auto set = [&](TimeNs time) { to ? port.delay_to(delay(time)) : port.delay_from(delay(time)); };
    set(200 * ns_per_ms);
    submit(1);
    run(undisturbed);
    set(0);
    submit(2);
    run(180 * ns_per_ms);
    EXPECT_TRUE(outcomes.empty()) << to;
    run(20 * ns_per_ms + undisturbed);
    EXPECT_EQ(ids(), (std::vector<std::uint64_t>{1, 2})) << to;
    ASSERT_EQ(blocks.size(), 2U) << to;
    EXPECT_EQ(blocks[0].second + 1, blocks[1].second) << to;
  }
}

TEST_F(Port, ARefusalDoesNotOvertakeAnothersBlockOnTheSameConnection) {
  const auto other = ledger.add_client({"Org1MSP", "CN=User2@org1.ledgerline"});
  port.delay_from(delay(200 * ns_per_ms));
  ledger.submit(now, other, 1, note("x"));
  run(undisturbed);
  port.delay_from(std::nullopt);
  port.submit(now, 2, {"nonsense", {}});
  run(180 * ns_per_ms);
  EXPECT_TRUE(outcomes.empty());
  run(20 * ns_per_ms);
  ASSERT_EQ(outcomes.size(), 1U);
  ASSERT_EQ(blocks.size(), 1U);
  EXPECT_EQ(outcomes[0].ended.outcome.kind, Kind::refused);
  EXPECT_GE(outcomes[0].at, blocks[0].first);
}

TEST_F(Port, AStallOfOneDirectionHoldsThatOneAndLosesNothing) {
  port.stall_to(true);
  submit(1);
  run(300 * ns_per_ms);
  EXPECT_EQ(ledger.height(), 1U);
  EXPECT_FALSE(port.reachable());
  port.stall_to(false);
  run(undisturbed);
  EXPECT_EQ(ids(), std::vector<std::uint64_t>{1});

  port.stall_from(true);
  submit(2);
  submit(3);
  run(300 * ns_per_ms);
  EXPECT_EQ(ledger.height(), 4U);
  EXPECT_EQ(ids(), std::vector<std::uint64_t>{1});
  EXPECT_EQ(numbers(), std::vector<std::uint64_t>{1});
  port.stall_from(false);
  run(undisturbed);
  EXPECT_EQ(ids(), (std::vector<std::uint64_t>{1, 2, 3}));
  EXPECT_EQ(numbers(), (std::vector<std::uint64_t>{1, 2, 3}));
}

TEST_F(Port, ACallEndsOnceWhenNoAnswerComesInTime) {
  port.stall_from(true);
  submit(1);
  run(LedgerPort::deadline_ns - ns_per_ms);
  EXPECT_TRUE(outcomes.empty());
  run(1 * ns_per_s);
  port.stall_from(false);
  run(1 * ns_per_s);
  ASSERT_EQ(ids(), std::vector<std::uint64_t>{1});
  EXPECT_EQ(outcomes[0].at, LedgerPort::deadline_ns);
  EXPECT_EQ(outcomes[0].ended.outcome.kind, Kind::unavailable);
  EXPECT_EQ(numbers(), std::vector<std::uint64_t>{1});  // it came about all the same
  EXPECT_TRUE(port.acknowledged().empty());
}

TEST_F(Port, ACutEndsWhatIsInFlightAndBlocksComeWithoutGapAfterIt) {
  submit(1);
  run(undisturbed);
  submit(2);
  run(3 * ns_per_ms);
  port.cut(now, true);
  submit(3);
  run(500 * ns_per_ms);
  EXPECT_EQ(ids(), (std::vector<std::uint64_t>{1, 2, 3}));
  for (const std::size_t i : {1U, 2U}) EXPECT_EQ(outcomes[i].ended.outcome.kind, Kind::unavailable) << i;
  EXPECT_FALSE(port.reachable());
  EXPECT_EQ(numbers(), std::vector<std::uint64_t>{1});  // the second one is there, and cannot come

  port.cut(now, false);
  const TimeNs back = now;
  run(LedgerPort::reconnect_ns - ns_per_ms);
  submit(4);
  run(1 * ns_per_ms);
  EXPECT_EQ(outcomes.back().ended.outcome.kind, Kind::unavailable);
  submit(5);
  run(undisturbed);
  EXPECT_EQ(ids(), (std::vector<std::uint64_t>{1, 2, 3, 4, 5}));
  EXPECT_EQ(outcomes.back().ended.outcome.kind, Kind::committed);
  EXPECT_EQ(numbers(), (std::vector<std::uint64_t>{1, 2, 3}));
  EXPECT_EQ(connections,
            (std::vector<std::pair<TimeNs, bool>>{{14 * ns_per_ms, false}, {back + LedgerPort::reconnect_ns, true}}));
}

TEST_F(Port, ARestartIsACutThatIsOverAtOnce) {
  submit(1);
  run(1 * ns_per_ms);
  port.restart(now);
  EXPECT_TRUE(port.reachable());
  run(LedgerPort::reconnect_ns);
  ASSERT_EQ(outcomes.size(), 1U);
  EXPECT_EQ(outcomes[0].ended.outcome.kind, Kind::unavailable);
  ASSERT_EQ(connections.size(), 2U);
  EXPECT_TRUE(connections[1].second);
}

TEST_F(Port, AStalePeerShowsItsLastFiveBlocksAndHidesTheNewOnes) {
  for (std::uint64_t id = 1; id <= 7; ++id) {
    submit(id);
    run(undisturbed);
  }
  port.stale(true);
  submit(8);
  blocks.clear();
  run(100 * ns_per_ms);
  EXPECT_EQ(ids().back(), 8U);    // only its blocks are stale
  ASSERT_EQ(blocks.size(), 25U);  // each 20 ms
  for (std::size_t i = 0; i < blocks.size(); ++i) EXPECT_EQ(blocks[i].second, 3 + i % 5) << i;

  port.stale(false);
  blocks.clear();
  run(undisturbed);
  submit(9);
  run(undisturbed);
  EXPECT_EQ(numbers(), (std::vector<std::uint64_t>{8, 9}));
}

TEST_F(Port, ANewReaderGetsNothingOfBefore) {
  port.delay_from(delay(50 * ns_per_ms));
  submit(1);
  run(20 * ns_per_ms);
  port.forget();
  port.begin();
  EXPECT_EQ(port.in_flight(), 0U);
  run(200 * ns_per_ms);
  EXPECT_TRUE(outcomes.empty());
  EXPECT_TRUE(blocks.empty());
  submit(2);
  run(200 * ns_per_ms);
  EXPECT_EQ(ids(), std::vector<std::uint64_t>{2});
  EXPECT_EQ(numbers(), std::vector<std::uint64_t>{2});
}

TEST_F(Port, ANewReaderGetsNoBlockThatWasCutBefore) {
  submit(1);
  while (ledger.height() < 2) run(ns_per_ms);
  ASSERT_TRUE(blocks.empty());
  port.forget();
  port.begin();
  run(undisturbed);
  EXPECT_TRUE(blocks.empty());
}

TEST_F(Port, WhoIsLiedToReadsAsIfItHadVerifiedAllBlocksAlone) {
  using Read = std::tuple<std::uint64_t, int, bool, std::string>;
  const auto read = [](bool alone) {
    SimulatedLedger ledger{{}, even, 1};
    const crypto::IdentityName name{"Org1MSP", "CN=User1@org1.ledgerline"};
    LedgerPort honest{ledger, name, 2}, lied_to{ledger, name, 3};
    if (alone) lied_to.restart(0);  // who connects again verifies for itself
    std::vector<Read> all;
    for (TimeNs now = ns_per_ms; now < 600 * ns_per_ms; now += ns_per_ms) {
      if (now > 200 * ns_per_ms && now % (20 * ns_per_ms) == 0) honest.submit(now, 1, note(std::to_string(now)));
      if (now == 400 * ns_per_ms) lied_to.serve(PeerTampering::hides_all);
      ledger.step(now);
      for (LedgerPort* port : {&honest, &lied_to}) port->step(now);
      for (const auto& block : honest.pop_blocks()) EXPECT_EQ(block->transactions.at(0).problem, "");
      for (const auto& block : lied_to.pop_blocks()) {
        const fabric::Transaction& tx = block->transactions.at(0);
        all.emplace_back(block->number, tx.code, tx.by_flag, tx.problem);
      }
    }
    return all;
  };
  const std::vector<Read> common = read(false);
  EXPECT_EQ(common, read(true));
  ASSERT_GT(common.size(), 15U);
  EXPECT_EQ(std::get<3>(common.front()), "");
  EXPECT_NE(std::get<3>(common.back()), "");
}

TEST_F(Port, TheSameSeedDrawsTheSameDelays) {
  const auto times = [](std::uint64_t seed) {
    SimulatedLedger ledger{{}, even, 1};
    LedgerPort port{ledger, {"Org1MSP", "CN=User1@org1.ledgerline"}, seed};
    port.delay_from(*parse_distribution("uniform 0ms 100ms"));
    port.submit(0, 1, note("x"));
    for (TimeNs now = ns_per_ms;; now += ns_per_ms) {
      ledger.step(now);
      port.step(now);
      if (!port.pop_outcomes().empty()) return now;
    }
  };
  EXPECT_EQ(times(3), times(3));
  EXPECT_NE(times(3), times(4));
}

}  // namespace
}  // namespace ledgerline::hil
