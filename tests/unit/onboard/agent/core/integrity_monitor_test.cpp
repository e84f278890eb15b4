#include "onboard/agent/core/outbox/integrity.hpp"

#include <gtest/gtest.h>

#include <set>

#include "common/msg/ros.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace ledgerline::agent::integrity {
namespace {

using agent::testing::control;
using agent::testing::LedgerOfTests;
using Kind = fabric::Outcome::Kind;

constexpr TimeNs start = 100 * ns_per_s, lasts = 10 * ns_per_s;

TEST(IntegrityMonitor, StandsForAsLongAsAReasonCountsAndEachRestartsTheTime) {
  IntegrityMonitor monitor(lasts);
  EXPECT_FALSE(monitor.stands(start));
  monitor.add(start, IntegrityViolation::chain, 7, "block 9 came where 8 was due");
  EXPECT_TRUE(monitor.stands(start));
  EXPECT_TRUE(monitor.stands(start, IntegrityViolation::chain));
  EXPECT_FALSE(monitor.stands(start, IntegrityViolation::stop));
  EXPECT_TRUE(monitor.stands(start + lasts - 1));
  EXPECT_FALSE(monitor.stands(start + lasts));
  monitor.add(start + lasts - 1, IntegrityViolation::stop, 8, "x");
  EXPECT_TRUE(monitor.stands(start + lasts));
  EXPECT_FALSE(monitor.stands(start + 2 * lasts));
  EXPECT_EQ(monitor.count(), 2U);
  EXPECT_EQ(monitor.of(IntegrityViolation::chain).block, 7U);
}

TEST(IntegrityMonitor, StandsForAsLongAsRecordsDiffer) {
  IntegrityMonitor monitor(lasts);
  monitor.add(start, IntegrityViolation::records, 7, "tello1");
  monitor.records_differ(true);
  EXPECT_TRUE(monitor.stands(start + 3600 * ns_per_s));
  EXPECT_TRUE(monitor.stands(start + 3600 * ns_per_s, IntegrityViolation::records));
  monitor.records_differ(false);
  EXPECT_FALSE(monitor.stands(start + 3600 * ns_per_s));
}

TEST(IntegrityMonitor, ReportsTheFirstOfAKindAtOnceThenOncePerMinuteWithTheirCount) {
  IntegrityMonitor monitor(lasts);
  std::uint64_t words = 0;
  for (TimeNs now = start; now < start + 150 * ns_per_s; now += 10 * ns_per_ms) {
    monitor.add(now, IntegrityViolation::transaction, 7, "a", 3);
    for (const auto& word : monitor.pop_log_entries(now)) {
      EXPECT_EQ(word.since, words == 0 ? 3U : 3 * 6000U);
      ++words;
    }
  }
  EXPECT_EQ(words, 3U);
  monitor.add(start + 150 * ns_per_s, IntegrityViolation::stream, 7, "b");
  EXPECT_EQ(monitor.pop_log_entries(start + 150 * ns_per_s).at(0).kind, IntegrityViolation::stream)
      << "each kind for itself";
  const auto rest = monitor.pop_log_entries(start + 180 * ns_per_s);
  ASSERT_EQ(rest.size(), 1U) << "what came after the last report is reported without another reason";
  EXPECT_EQ(rest[0].since, 3 * 3000U - 3);
  EXPECT_TRUE(monitor.pop_log_entries(start + 1000 * ns_per_s).empty());
}

TEST(IntegrityMonitor, WordsFromOutsideAreCutAndPrintable) {
  IntegrityMonitor monitor(lasts);
  monitor.add(start, IntegrityViolation::stream, 0, "a\nb\x1b[31m" + std::string(10'000, 'x'));
  const std::string& words = monitor.of(IntegrityViolation::stream).words;
  EXPECT_LE(words.size(), IntegrityMonitor::max_text_bytes);
  EXPECT_EQ(words.substr(0, 5), "a?b?[");
}

TEST(IntegrityMonitor, EveryKindHasANameOfItsOwn) {
  std::set<std::string_view> names;
  for (std::size_t i = 0; i < violation_kinds; ++i) names.insert(name(static_cast<IntegrityViolation>(i)));
  EXPECT_EQ(names.size(), violation_kinds);
}

class IntegrityInCore : public ::testing::Test {
 protected:
  static AgentCoreSettings settings() {
    AgentCoreSettings c;
    c.drones = {{1, "tello1"}, {2, "tello2"}};
    c.first_heartbeat_wait_ns = 0;
    return c;
  }
  IntegrityInCore() {
    core_.set_control(start, control("tello1", 1));
    verification::RolesByOrganisation roles;
    roles.apply({to_message(LedgerOfTests::operator_name()), OPERATOR});
    core_.control().set_roles(std::move(roles));
  }
  bool untrusted(TimeNs now) {
    out_.clear();
    core_.step(now, out_);
    return out_.heartbeat.value().ledger_untrusted;
  }
  LedgerOfTests::Tx stop(int code) {
    DronesCall call;
    call.add_drones("tello1");
    LedgerOfTests::Tx tx;
    tx.event_name = "stop";
    tx.asked = fabric::Call{"stop", {call.SerializeAsString()}};
    tx.code = code;
    return tx;
  }
  std::uint64_t count(IntegrityViolation kind) const { return core_.integrity().of(kind).count; }

  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  LedgerOfTests ledger_;
  AgentOutputs out_;
  AgentCore core_{settings(), *registry_};
};

TEST_F(IntegrityInCore, AFailedCheckIsInEveryHeartbeatFromThenOn) {
  EXPECT_FALSE(untrusted(start));
  EXPECT_FALSE(out_.heartbeat->check_failed);
  core_.step(start - 1, out_);
  EXPECT_NE(core_.checks().first().find("time does not go back"), std::string::npos) << core_.checks().first();
  EXPECT_FALSE(untrusted(start + ns_per_s));
  EXPECT_TRUE(out_.heartbeat->check_failed);
}

TEST_F(IntegrityInCore, ABlockThatIsAsItShouldBeIsNoReasonNorIsAnInvalidTransaction) {
  LedgerOfTests::Tx invalid;
  invalid.code = 11;
  core_.on_block(start, ledger_.block({}), out_);
  core_.on_block(start, ledger_.block({invalid}), out_);
  EXPECT_FALSE(untrusted(start));
  EXPECT_TRUE(out_.submits.empty());
  EXPECT_EQ(core_.integrity().count(), 0U);
}

TEST_F(IntegrityInCore, EachReasonIsReportedToLinkInTheLogAndOnTheLedger) {
  auto block = ledger_.block({LedgerOfTests::Tx{}});
  block.transactions[0].code = 11;
  block.transactions[0].problem = "flagged 11, but valid by our own validation";
  core_.on_block(start, block, out_);
  EXPECT_EQ(count(IntegrityViolation::transaction), 1U);
  EXPECT_TRUE(untrusted(start));
  ASSERT_EQ(out_.violations.size(), 1U);
  EXPECT_EQ(out_.violations[0].kind, IntegrityViolation::transaction);
  ASSERT_EQ(out_.submits.size(), 1U);
  EXPECT_TRUE(out_.submits[0].urgent);
  SetCall call;
  ASSERT_TRUE(call.ParseFromString(out_.submits[0].call.args.at(0)));
  ASSERT_EQ(call.assets_size(), 2);
  EXPECT_EQ(call.assets(0).id(), "tello1/alarm");
  EXPECT_EQ(call.assets(1).id(), "tello2/alarm");
  const auto alarms = alarms_from_cdr(call.assets(1).msg_data());
  ASSERT_TRUE(alarms);
  ASSERT_EQ(alarms->size(), 1U);
  EXPECT_EQ((*alarms)[0].kind, "transaction_unverified");
  EXPECT_TRUE((*alarms)[0].stands);
  EXPECT_EQ((*alarms)[0].count, 1U);
  EXPECT_EQ((*alarms)[0].block, block.number);
  EXPECT_NE((*alarms)[0].words.find("valid by our own validation"), std::string::npos);

  core_.on_block(start, ledger_.block({stop(11)}), out_);
  EXPECT_EQ(count(IntegrityViolation::stop), 1U);
  ledger_.lose_a_block();
  core_.on_block(start, ledger_.block({}), out_);
  EXPECT_EQ(count(IntegrityViolation::chain), 1U);
  core_.on_violation(start, IntegrityViolation::stream, "another block 9");
  core_.on_violation(start, IntegrityViolation::records, "tello1: not held; there held");
  core_.integrity().records_differ(true);
  EXPECT_EQ(core_.integrity().count(), 5U);
  EXPECT_TRUE(untrusted(start + 3600 * ns_per_s)) << "the records still differ";
  core_.integrity().records_differ(false);
  EXPECT_FALSE(untrusted(start + 3601 * ns_per_s));
}

TEST_F(IntegrityInCore, AnAlarmThatIsCommittedIsASignOfLifeAndItsEndFollows) {
  core_.on_violation(start, IntegrityViolation::stream, "x");
  ASSERT_TRUE(untrusted(start));
  const auto number = out_.submits.at(0).call_number;
  EXPECT_TRUE(core_.has_calls_in_flight());
  fabric::Outcome outcome;
  outcome.kind = Kind::committed;
  core_.on_outcome(start, number, outcome, out_);
  EXPECT_FALSE(core_.has_calls_in_flight());
  EXPECT_TRUE(core_.ledger_alive(start));
  EXPECT_FALSE(untrusted(start + lasts));
  ASSERT_EQ(out_.submits.size(), 1U);
  SetCall call;
  ASSERT_TRUE(call.ParseFromString(out_.submits[0].call.args.at(0)));
  EXPECT_FALSE(alarms_from_cdr(call.assets(0).msg_data())->at(0).stands);
}

}  // namespace
}  // namespace ledgerline::agent::integrity
