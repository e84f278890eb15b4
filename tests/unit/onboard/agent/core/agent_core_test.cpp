#include "onboard/agent/core/agent_core.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "common/access/stops.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace ledgerline::agent {
namespace {

using testing::control;
using testing::LedgerOfTests;
using Kind = fabric::Outcome::Kind;

constexpr TimeNs start = 100 * ns_per_s;

class AgentCoreTest : public ::testing::Test {
 protected:
  static AgentCoreSettings settings() {
    AgentCoreSettings c;
    c.drones = {{1, "tello1"}, {2, "tello2"}};
    return c;
  }

  AgentCoreTest() { core_.set_control(start, control("tello1", 1)); }

  static StateSample state(std::uint64_t sequence, TimeNs stamp, DroneNumber drone = 1) {
    StateSample s;
    s.drone = drone;
    s.boot_id = 9;
    s.sequence = sequence;
    s.stamp_ns = stamp;
    return s;
  }

  LedgerOfTests::Tx command(std::uint64_t sequence, TimeNs stamp) {
    CommandCall call;
    auto* plan = call.add_plans();
    plan->set_drone("tello1");
    plan->set_action(TAKEOFF);
    plan->set_boot_id(9);
    plan->set_state_stamp_ns(stamp);
    plan->set_sequence(sequence);
    plan->set_epoch(1);
    LedgerOfTests::Tx tx;
    tx.event_payload = call.SerializeAsString();
    return tx;
  }

  void commit(TimeNs now) {
    fabric::Outcome outcome;
    outcome.kind = Kind::committed;
    core_.on_outcome(now, out_.submits.back().call_number, outcome, out_);
  }

  void hear_poses(TimeNs now) {
    for (DroneNumber drone = 1; drone <= 2; ++drone) core_.on_mocap(now, drone, {.stamp_ns = now}, out_);
  }

  std::size_t traces(TraceKind kind) const {
    return static_cast<std::size_t>(
        std::count_if(out_.traces.begin(), out_.traces.end(), [&](const TraceRecord& r) { return r.kind == kind; }));
  }

  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  LedgerOfTests ledger_;
  AgentOutputs out_;
  AgentCore core_{settings(), *registry_};
};

TEST_F(AgentCoreTest, AStateIsSubmittedAndItsCommandComesOutAsAPlanWithTheTwoWayLatency) {
  core_.on_state(start, state(1, start), out_);
  core_.step(start, out_);
  ASSERT_EQ(out_.submits.size(), 1U);
  EXPECT_EQ(out_.submits[0].call.function, "set");
  commit(start + 5 * ns_per_ms);
  core_.on_block(start + 12 * ns_per_ms, ledger_.block({command(1, start)}), out_);
  EXPECT_TRUE(out_.plans.empty()) << "a plan is handed over by step(), which knows the time of it";
  core_.step(start + 13 * ns_per_ms, out_);
  ASSERT_EQ(out_.plans.size(), 1U);
  EXPECT_EQ(out_.plans[0].verified_ns - out_.plans[0].state_stamp_ns, 13 * ns_per_ms);
  const auto report = core_.report(1);
  EXPECT_EQ(report.two_way.count(), 1U);
  EXPECT_NEAR(to_ms(report.two_way.quantile(0.5)), 13, 0.3);
  EXPECT_EQ(report.commands.verified, 1U);
  EXPECT_EQ(report.states.on_ledger, 1U);
  EXPECT_EQ(traces(TraceKind::batch_submitted), 1U);
  EXPECT_EQ(traces(TraceKind::batch_committed), 1U);
  EXPECT_EQ(traces(TraceKind::command_verified), 1U);
}

TEST_F(AgentCoreTest, EveryPlaceThatASampleComesByIsInTheTrace) {
  core_.on_state(start, state(7, start - 1), out_);
  core_.step(start + 1, out_);
  ASSERT_EQ(out_.submits.size(), 1U);
  fabric::Outcome outcome;
  outcome.kind = Kind::committed;
  outcome.endorsed_ns = start + 2;
  outcome.ordered_ns = start + 3;
  core_.on_outcome(start + 4, out_.submits[0].call_number, outcome, out_);
  auto block = ledger_.block({command(1, start - 1)});
  block.received_ns = start + 5;
  core_.on_block(start + 6, block, out_);
  core_.step(start + 7, out_);
  const auto expect = [&](TraceKind kind, TimeNs t_ns, std::uint64_t id, TimeNs stamp_ns, std::uint32_t extra = 0) {
    const auto it =
        std::find_if(out_.traces.begin(), out_.traces.end(), [&](const TraceRecord& r) { return r.kind == kind; });
    ASSERT_NE(it, out_.traces.end());
    EXPECT_EQ(traces(kind), 1U);
    EXPECT_EQ(it->t_ns, t_ns);
    EXPECT_EQ(it->id, id);
    EXPECT_EQ(it->stamp_ns, stamp_ns);
    EXPECT_EQ(it->extra, extra);
  };
  constexpr std::uint64_t batch = 1;
  expect(TraceKind::state_taken, start, 7, start - 1);
  expect(TraceKind::state_batched, start + 1, 7, start - 1, batch);
  expect(TraceKind::call_endorsed, start + 2, batch, start + 1);
  expect(TraceKind::call_ordered, start + 3, batch, start + 1);
  expect(TraceKind::command_in_block, start + 5, 1, start - 1);
  expect(TraceKind::command_taken, start + 6, 1, start - 1);
  expect(TraceKind::command_verified, start + 7, 1, start - 1);
}

TEST_F(AgentCoreTest, ARefusedCommandLeavesATraceWithItsReasonAndNoPlan) {
  core_.on_block(start, ledger_.block({command(1, start)}), out_);
  core_.step(start, out_);
  EXPECT_TRUE(out_.plans.empty());
  ASSERT_EQ(traces(TraceKind::refused), 1U);
  const auto it = std::find_if(out_.traces.begin(), out_.traces.end(),
                               [](const TraceRecord& r) { return r.kind == TraceKind::refused; });
  EXPECT_EQ(it->extra, static_cast<std::uint32_t>(RefusalReason::foreign_boot));
  EXPECT_EQ(it->drone, 1);
}

TEST_F(AgentCoreTest, AStopOnTheLedgerIsRepeatedUntilLinkObeys) {
  Control stopped = control("tello1", 1);  // as an agent reads it that starts after the stop
  add_stop(stopped, testing::stop_of("tello1"));
  core_.set_control(start, stopped);
  StateSample flying = state(1, start);
  flying.phase = LinkPhase::on_ground;
  core_.on_state(start, flying, out_);
  ASSERT_EQ(out_.plans.size(), 1U) << "a link that restarted on the ground knows of none";
  EXPECT_EQ(out_.plans.back().action, PlanAction::stop);
  core_.on_state(start + 999 * ns_per_ms, flying, out_);
  EXPECT_EQ(out_.plans.size(), 1U) << "once a second there";
  flying.cause = FailsafeCause::stopped;
  core_.on_state(start + 2 * ns_per_s, flying, out_);
  EXPECT_EQ(out_.plans.size(), 1U) << "link has it";
  out_.plans.clear();
  flying.cause = FailsafeCause::none;
  flying.phase = LinkPhase::flying;
  for (int i = 0; i < 30; ++i) core_.on_state(start + 2 * ns_per_s + i * 33 * ns_per_ms, flying, out_);
  ASSERT_GE(out_.plans.size(), 8U);
  ASSERT_LE(out_.plans.size(), 11U) << "at most ten a second";
  EXPECT_EQ(out_.plans.back().action, PlanAction::stop);
  out_.plans.clear();
  flying.mode = FailsafeMode::land;
  core_.on_state(start + 4 * ns_per_s, flying, out_);
  EXPECT_TRUE(out_.plans.empty());
  add_stop(stopped, testing::stop_of("tello1", true));
  core_.set_control(start, stopped);
  core_.on_state(start + 5 * ns_per_s, flying, out_);
  ASSERT_EQ(out_.plans.size(), 1U);
  EXPECT_EQ(out_.plans[0].action, PlanAction::cut);
}

TEST_F(AgentCoreTest, ALinkThatHoldsOnToAStopThatNobodyHasOnTheLedgerIsReportedOnceASecondOnTheGround) {
  StateSample stopped = state(1, start);
  stopped.phase = LinkPhase::landed;
  stopped.cause = FailsafeCause::stopped;
  for (int i = 0; i < 30; ++i) core_.on_state(start + i * 100 * ns_per_ms, stopped, out_);
  ASSERT_EQ(out_.plans.size(), 3U);
  EXPECT_EQ(out_.plans[0].action, PlanAction::stop_cleared) << "its own stop stands: that is the owner's word";
  EXPECT_EQ(out_.plans[0].verified_ns, start);
  out_.plans.clear();
  stopped.phase = LinkPhase::landing;
  core_.on_state(start + 5 * ns_per_s, stopped, out_);
  EXPECT_TRUE(out_.plans.empty()) << "it lands";
  StateSample other = state(1, start, 2);
  other.phase = LinkPhase::landed;
  other.cause = FailsafeCause::stopped;
  core_.on_state(start + 5 * ns_per_s, other, out_);
  EXPECT_TRUE(out_.plans.empty()) << "no record of it was read";
}

TEST_F(AgentCoreTest, AStopInABlockIsAppliedUntilTheLedgerHasIt) {
  Stops stops;
  *stops.add_stops() = testing::stop_of("tello1");
  LedgerOfTests::Tx stop;
  stop.event_name = "stop";
  stop.event_payload = stops.SerializeAsString();
  core_.on_block(start, ledger_.block({stop}), out_);
  core_.step(start, out_);
  ASSERT_EQ(out_.plans.size(), 1U) << "obeyed at once";
  ASSERT_EQ(out_.submits.size(), 1U);
  EXPECT_EQ(out_.submits[0].call.function, "apply_stops");
  EXPECT_TRUE(out_.submits[0].urgent);
  EXPECT_TRUE(core_.has_calls_in_flight());
  fabric::Outcome lost;
  lost.kind = Kind::invalidated;
  lost.code = 12;
  core_.on_outcome(start, out_.submits.back().call_number, lost, out_);
  for (TimeNs now = start; now < start + ns_per_s && out_.submits.size() == 1; now += ns_per_ms) core_.step(now, out_);
  ASSERT_EQ(out_.submits.size(), 2U) << "another stop overtook it";
  commit(start + ns_per_s);
  core_.step(start + 3 * ns_per_s, out_);
  EXPECT_EQ(out_.submits.size(), 2U);
  EXPECT_FALSE(core_.has_calls_in_flight());
  EXPECT_EQ(core_.stop_applier().applied(), 1U);
}

TEST_F(AgentCoreTest, ABatchThatLacksEndorsementsHasTheRecordsRenewed) {
  core_.on_state(start, state(1, start), out_);
  core_.step(start, out_);
  fabric::Outcome outcome;
  outcome.kind = Kind::invalidated;
  outcome.code = 11;
  core_.on_outcome(start + ns_per_ms, out_.submits.back().call_number, outcome, out_);
  EXPECT_FALSE(core_.stop_applier().pending()) << "it has read what changed: the next one reads it again";
  core_.on_state(start + 50 * ns_per_ms, state(2, start + 50 * ns_per_ms), out_);
  core_.step(start + 50 * ns_per_ms, out_);
  outcome.code = 10;
  core_.on_outcome(start + 51 * ns_per_ms, out_.submits.back().call_number, outcome, out_);
  out_.submits.clear();
  core_.step(start + 52 * ns_per_ms, out_);
  const auto calls = std::count_if(out_.submits.begin(), out_.submits.end(),
                                   [](const auto& submit) { return submit.call.function == "apply_stops"; });
  EXPECT_EQ(calls, 2) << "of each drone";
}

class IdleHolderTest : public AgentCoreTest {
 protected:
  /// States of the drone ten times a second, each on the ledger at once; evictions on the way.
  std::size_t until(TimeNs end, LinkPhase phase) {
    std::size_t evictions = 0;
    for (; now_ < end; now_ += 100 * ns_per_ms) {
      StateSample sample = state(++sequence_, now_);
      sample.phase = phase;
      out_.clear();
      core_.on_state(now_, sample, out_);
      core_.step(now_, out_);
      for (const auto& submit : std::exchange(out_.submits, {})) {
        fabric::Outcome outcome;
        outcome.kind = Kind::committed;
        if (submit.call.function == "evict") {
          eviction_ = submit.call_number;
          ++evictions;
        } else {
          core_.on_outcome(now_, submit.call_number, outcome, out_);
        }
      }
    }
    return evictions;
  }
  /// To take off, for the newest state.
  void command_takeoff() {
    core_.on_block(now_, ledger_.block({command(++commands_, now_ - 100 * ns_per_ms)}), out_);
    core_.step(now_, out_);
  }

  TimeNs now_ = start;
  std::uint64_t sequence_ = 0, commands_ = 0, eviction_ = 0;
};

TEST_F(IdleHolderTest, LosesTheLeaseOnTheGroundAfterTheIdleTime) {
  EXPECT_EQ(until(start + usual_idle_ns, LinkPhase::on_ground), 0U);
  EXPECT_EQ(until(start + usual_idle_ns + ns_per_s, LinkPhase::landed), 1U);
  ASSERT_TRUE(core_.has_calls_in_flight());
  core_.on_outcome(now_, eviction_, fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: no"), out_);
  ASSERT_EQ(out_.evictions.size(), 1U);
  EXPECT_EQ(out_.evictions[0].drone, "tello1");
  EXPECT_EQ(out_.evictions[0].ended, fabric::Repeat::Next::refused);
  EXPECT_FALSE(core_.has_calls_in_flight());
}

TEST_F(IdleHolderTest, KeepsItInTheAirAndWithoutFreshState) {
  EXPECT_EQ(until(start + 2 * usual_idle_ns, LinkPhase::flying), 0U);
  EXPECT_EQ(until(now_ + 2 * usual_idle_ns, LinkPhase::disconnected), 0U);
  EXPECT_EQ(until(now_ + usual_idle_ns / 2, LinkPhase::on_ground), 0U);
  out_.clear();
  for (const TimeNs end = now_ + usual_idle_ns; now_ < end; now_ += 100 * ns_per_ms) core_.step(now_, out_);
  EXPECT_TRUE(out_.submits.empty()) << "a link that is gone says nothing: its drone may be anywhere";
}

TEST_F(IdleHolderTest, KeepsItWithACommandNowAndThenAndDoesNotTakeOffWhileItIsTaken) {
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(until(now_ + usual_idle_ns - ns_per_s, LinkPhase::on_ground), 0U);
    command_takeoff();
    EXPECT_EQ(out_.plans.size(), 1U);
  }
  EXPECT_EQ(until(now_ + usual_idle_ns + ns_per_s, LinkPhase::on_ground), 1U);
  command_takeoff();
  EXPECT_TRUE(out_.plans.empty()) << "it would be taken from him in the air";
  EXPECT_EQ(core_.report(1).commands.reasons[static_cast<std::size_t>(RefusalReason::evicting)], 1U);
  core_.on_outcome(now_, eviction_, fabric::Outcome::failed(Kind::unavailable, "away"), out_);
  EXPECT_EQ(until(now_ + 10 * ns_per_s, LinkPhase::on_ground), 0U) << "he is not idle any more";
  out_.clear();
  command_takeoff();
  EXPECT_EQ(out_.plans.size(), 1U);
}

TEST_F(AgentCoreTest, AStopFromBeforeItsStartIsAppliedToo) {
  Control stopped = control("tello1", 1);
  add_stop(stopped, testing::stop_of("tello1"));
  core_.set_control(start, stopped);
  core_.step(start, out_);
  ASSERT_EQ(out_.submits.size(), 1U);
  EXPECT_EQ(out_.submits[0].call.function, "apply_stops");
}

TEST_F(AgentCoreTest, ALinkThatDoesNotSeeItsDroneGetsAStopOnceASecondUntilItLandsBlindly) {
  Control stopped = control("tello1", 1);
  add_stop(stopped, testing::stop_of("tello1"));
  core_.set_control(start, stopped);
  StateSample lost = state(1, start);
  lost.phase = LinkPhase::disconnected;
  for (int i = 0; i < 300; ++i) core_.on_state(start + i * 10 * ns_per_ms, lost, out_);
  EXPECT_EQ(out_.plans.size(), 3U);
  lost.mode = FailsafeMode::land;
  out_.plans.clear();
  core_.on_state(start + 5 * ns_per_s, lost, out_);
  EXPECT_TRUE(out_.plans.empty());
}

TEST_F(AgentCoreTest, AStateThatWaitsWasNotSentAndIsNotAnswered) {
  core_.on_state(start, state(1, start), out_);
  core_.step(start, out_);
  core_.on_state(start + 1, state(2, start + 1), out_);
  core_.step(start + 1, out_);
  core_.on_block(start + 2, ledger_.block({command(1, start + 1)}), out_);
  core_.step(start + 2, out_);
  EXPECT_TRUE(out_.plans.empty());
  EXPECT_EQ(core_.report(1).commands.reasons[static_cast<std::size_t>(RefusalReason::unknown_stamp)], 1U);
}

TEST_F(AgentCoreTest, SendsHeartbeatsTwentyTimesASecond) {
  hear_poses(start);
  int heartbeats = 0;
  for (TimeNs t = 0; t < ns_per_s; t += ns_per_ms) {
    out_.clear();
    core_.step(start + t, out_);
    heartbeats += out_.heartbeat.has_value();
  }
  EXPECT_EQ(heartbeats, 20);
}

// Link would take a heartbeat without a pose for the loss of the pose.
TEST_F(AgentCoreTest, TheFirstHeartbeatWaitsForAPoseOfEveryDrone) {
  core_.on_mocap(start, 1, {.stamp_ns = start}, out_);
  core_.step(start, out_);
  core_.step(start + 50 * ns_per_ms, out_);
  EXPECT_FALSE(out_.heartbeat);
  core_.on_mocap(start + 60 * ns_per_ms, 2, {.stamp_ns = start + 60 * ns_per_ms}, out_);
  core_.step(start + 60 * ns_per_ms, out_);
  EXPECT_TRUE(out_.heartbeat);
}

TEST_F(AgentCoreTest, TheFirstHeartbeatWaitsForPosesNoLongerThanSetAndLaterOnesNeverDo) {
  core_.step(start, out_);
  core_.step(start + 199 * ns_per_ms, out_);
  EXPECT_FALSE(out_.heartbeat);
  core_.step(start + 200 * ns_per_ms, out_);
  EXPECT_TRUE(out_.heartbeat);
  out_.clear();
  core_.step(start + 250 * ns_per_ms, out_);
  EXPECT_TRUE(out_.heartbeat);
}

TEST_F(AgentCoreTest, APoseThatStandsStillToTheLastBitIsTrustedOnTheGroundAndNotInFlight) {
  for (const LinkPhase phase : {LinkPhase::on_ground, LinkPhase::flying}) {
    StateSample sample = state(phase == LinkPhase::flying ? 2 : 1, start);
    sample.phase = phase;
    core_.on_state(start, sample, out_);
    out_.clear();
    const TimeNs from = start + (phase == LinkPhase::flying ? 10 : 1) * ns_per_s;
    for (int i = 0; i < 50; ++i)
      core_.on_mocap(from, 1, {.stamp_ns = from + i * 10 * ns_per_ms, .position_m = {1, 2, 3}}, out_);
    EXPECT_EQ(out_.poses.empty(), phase == LinkPhase::flying);
  }
}

TEST_F(AgentCoreTest, AfterAPauseItSendsAHeartbeatAtOnceAndMakesUpForNone) {
  hear_poses(start);
  core_.step(start, out_);
  int heartbeats = 0;
  for (TimeNs t = 5 * ns_per_s; t < 5 * ns_per_s + 100 * ns_per_ms; t += ns_per_ms) {
    out_.clear();
    core_.step(start + t, out_);
    heartbeats += out_.heartbeat.has_value();
  }
  EXPECT_LE(heartbeats, 4);
  EXPECT_GE(heartbeats, 2);
}

TEST_F(AgentCoreTest, TheLedgerIsNotAliveBeforeItsFirstSign) {
  EXPECT_FALSE(core_.ledger_alive(start));
  core_.on_block(start, ledger_.block({}), out_);
  EXPECT_TRUE(core_.ledger_alive(start));
}

TEST_F(AgentCoreTest, ALedgerThatDoesNotAnswerWhatWasSentIsSilentAfterASecond) {
  core_.on_block(start, ledger_.block({}), out_);
  EXPECT_TRUE(core_.ledger_alive(start + 10 * ns_per_s)) << "nothing was sent: nothing to answer";
  const TimeNs sent = start + 10 * ns_per_s;
  core_.on_state(sent, state(1, sent), out_);
  core_.step(sent, out_);
  EXPECT_TRUE(core_.ledger_alive(sent + ns_per_s));
  EXPECT_FALSE(core_.ledger_alive(sent + ns_per_s + 1));
  commit(sent + 2 * ns_per_s);
  EXPECT_TRUE(core_.ledger_alive(sent + 2 * ns_per_s));
}

TEST_F(AgentCoreTest, BatchesThatFailDoNotKeepASilentLedgerAlive) {
  core_.on_block(start, ledger_.block({}), out_);
  TimeNs now = start;
  for (std::uint64_t k = 1; k <= 2000; ++k) {
    now += ns_per_ms;
    core_.on_state(now, state(k, now), out_);
    out_.submits.clear();
    core_.step(now, out_);
    if (!out_.submits.empty()) core_.on_outcome(now, out_.submits.back().call_number, {}, out_);
  }
  EXPECT_FALSE(core_.ledger_alive(now));
}

TEST_F(AgentCoreTest, ALostBlockStreamIsASilentLedgerEvenIfNothingWasSent) {
  core_.on_block(start, ledger_.block({}), out_);
  core_.on_connection(start, false);
  EXPECT_FALSE(core_.ledger_alive(start + ns_per_s + 1));
  core_.on_connection(start + 2 * ns_per_s, true);
  EXPECT_TRUE(core_.ledger_alive(start + 2 * ns_per_s));
}

TEST_F(AgentCoreTest, ABlockThatBreaksTheChainIsNoSignOfLife) {
  core_.on_block(start, ledger_.block({}), out_);
  core_.on_state(start, state(1, start), out_);
  core_.step(start, out_);
  ledger_.lose_a_block();
  core_.on_block(start + ns_per_s, ledger_.block({}), out_);
  EXPECT_FALSE(core_.ledger_alive(start + ns_per_s + 1));
  EXPECT_EQ(core_.blocks(), 1U);
  EXPECT_FALSE(core_.last_chain_error().empty());
}

TEST_F(AgentCoreTest, MocapBecomesAPoseOfItsDroneAndUnknownDronesAreIgnored) {
  core_.on_mocap(start, 2, MocapPose{start, {1, 2, 3}, 0}, out_);
  core_.on_mocap(start, 7, MocapPose{start, {1, 2, 3}, 0}, out_);
  core_.on_state(start, state(1, start, 7), out_);
  core_.step(start, out_);
  ASSERT_EQ(out_.poses.size(), 1U);
  EXPECT_EQ(out_.poses[0].drone, 2);
  EXPECT_TRUE(out_.submits.empty());
}

TEST_F(AgentCoreTest, TheSameInputsGiveTheSameBytes) {
  const auto run = [this] {
    AgentCore core(settings(), *registry_);
    AgentOutputs out;
    std::string bytes;
    Random random(5);
    for (std::uint64_t k = 1; k <= 500; ++k) {
      const TimeNs now = start + static_cast<TimeNs>(k) * ns_per_ms;
      out.clear();
      core.on_state(now, state(k, now, static_cast<DroneNumber>(1 + k % 2)), out);
      core.step(now, out);
      for (const auto& submit : out.submits) {
        bytes += submit.call.args.at(0);
        fabric::Outcome outcome;
        outcome.kind = static_cast<Kind>(random.next() % 5);
        core.on_outcome(now, submit.call_number, outcome, out);
      }
    }
    return bytes;
  };
  const std::string once = run();
  EXPECT_FALSE(once.empty());
  EXPECT_EQ(once, run());
}

TEST_F(AgentCoreTest, ItSaysWhenTheNextBatchOrHeartbeatIsDue) {
  core_.step(start, out_);
  EXPECT_EQ(core_.due_ns(), INT64_MAX) << "the first heartbeat waits for poses, and nothing else is there";
  hear_poses(start + 1);
  core_.step(start + 2, out_);
  ASSERT_TRUE(out_.heartbeat);
  const TimeNs next_heartbeat_ns = core_.due_ns();
  EXPECT_GT(next_heartbeat_ns, start + 2);
  EXPECT_LE(next_heartbeat_ns, start + 2 + settings().heartbeat_period_ns);
  for (DroneNumber drone = 1; drone <= 2; ++drone) core_.on_state(start + 3, state(1, start, drone), out_);
  core_.step(start + 3, out_);
  commit(start + 4);
  core_.on_state(start + 5, state(2, start + 5), out_);
  core_.step(start + 5, out_);
  ASSERT_EQ(out_.submits.size(), 1U) << "it lingers for the other drone";
  EXPECT_EQ(core_.due_ns(), start + 5 + settings().batch.linger_ns);
  core_.step(core_.due_ns(), out_);
  EXPECT_EQ(out_.submits.size(), 2U);
  EXPECT_EQ(core_.due_ns(), next_heartbeat_ns);
}

}  // namespace
}  // namespace ledgerline::agent
