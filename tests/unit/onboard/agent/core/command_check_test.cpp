#include "onboard/agent/core/command_check.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "common/access/stops.hpp"
#include "common/msg/proto_json.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace ledgerline::agent {
namespace {

using testing::control;
using testing::LedgerOfTests;
using Tx = LedgerOfTests::Tx;

constexpr TimeNs stamp = 100 * ns_per_s;
constexpr TimeNs now = stamp + 20 * ns_per_ms;
constexpr std::int64_t now_s = 1'700'000'000;
constexpr std::uint64_t boot = 42;
constexpr std::uint64_t epoch = 5;

class CommandCheckTest : public ::testing::Test {
 protected:
  CommandCheckTest() {
    check_.control().set_control(control("tello1", epoch));
    check_.control().set_control(control("tello2", epoch));
    send_state(1, boot, stamp);
    send_state(2, boot, stamp);
  }

  void send_state(DroneNumber drone, std::uint64_t boot_id, TimeNs stamp_ns) {
    StateSample sample;
    sample.drone = drone;
    sample.boot_id = boot_id;
    sample.stamp_ns = stamp_ns;
    check_.add_sent_state(sample);
  }

  static DronePlan good_plan(std::uint64_t sequence = 1, const std::string& drone = "tello1") {
    DronePlan plan;
    plan.set_drone(drone);
    plan.set_boot_id(boot);
    plan.set_state_stamp_ns(stamp);
    plan.set_sequence(sequence);
    plan.set_epoch(epoch);
    for (int i = 1; i <= 3; ++i) {
      auto* s = plan.add_setpoints();
      s->set_at_ns(stamp + i * 50 * ns_per_ms);
      s->set_vx(0.5F);
      s->set_yaw_rate(0.1F);
    }
    return plan;
  }

  static Tx command(const std::vector<DronePlan>& plans) {
    CommandCall call;
    for (const auto& plan : plans) *call.add_plans() = plan;
    Tx tx;
    tx.event_payload = call.SerializeAsString();
    return tx;
  }
  static Tx command(const DronePlan& plan) { return command(std::vector{plan}); }

  /// By him whose event it is: the new holder's acquire, the old one's release, the administrator's enrolment.
  static Tx control_event(const std::string& name, const Control& record) {
    Controls event;
    *event.add_controls() = record;
    Tx tx;
    if (name == "acquire") tx.creator = {record.holder().msp_id(), record.holder().subject()};
    tx.event_name = name;
    tx.event_payload = event.SerializeAsString();
    return tx;
  }

  static Tx stop_event(bool cut = false) {
    Stops event;
    *event.add_stops() = testing::stop_of("tello1", cut);
    Tx tx;
    tx.event_name = "stop";
    tx.event_payload = event.SerializeAsString();
    return tx;
  }

  CheckedBlock give(const std::vector<Tx>& transactions, TimeNs at = now) {
    return check_.check(at, now_s, ledger_.block(transactions));
  }

  /// A block with this one transaction gives no plan and one refusal, for this reason, counted and reported.
  void expect_refused(const Tx& tx, RefusalReason why, TimeNs at = now) {
    const auto checked = give({tx}, at);
    EXPECT_TRUE(checked.plans.empty());
    ASSERT_EQ(checked.refused.size(), 1U);
    EXPECT_EQ(refusal_name(checked.refused[0].why), refusal_name(why));
    EXPECT_EQ(checked.refused[0].drone, 1);
    EXPECT_EQ(check_.counters(1).refused, 1U);
    EXPECT_EQ(check_.counters(1).reasons[static_cast<std::size_t>(why)], 1U);
    EXPECT_EQ(check_.counters(1).verified, 0U);
  }

  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  LedgerOfTests ledger_;
  CommandCheck check_{CommandCheckSettings{}, {{1, "tello1"}, {2, "tello2"}}, *registry_};
};

TEST_F(CommandCheckTest, AGoodCommandBecomesThePlanThatItSays) {
  const auto checked = give({command(good_plan(3))});
  ASSERT_EQ(checked.plans.size(), 1U);
  const Plan& plan = checked.plans[0];
  EXPECT_EQ(plan.drone, 1);
  EXPECT_EQ(plan.action, PlanAction::fly);
  EXPECT_EQ(plan.sequence, 3U);
  EXPECT_EQ(plan.epoch, epoch);
  EXPECT_EQ(plan.state_stamp_ns, stamp);
  ASSERT_EQ(plan.count, 3U);
  EXPECT_EQ(plan.setpoints[1].at_ns, stamp + 100 * ns_per_ms);
  EXPECT_FLOAT_EQ(plan.setpoints[1].velocity_mps[0], 0.5F);
  EXPECT_FLOAT_EQ(plan.setpoints[1].yaw_rate_radps, 0.1F);
  EXPECT_EQ(check_.counters(1).on_ledger, 1U);
  EXPECT_EQ(check_.counters(1).verified, 1U);
  EXPECT_TRUE(checked.refused.empty());
}

TEST_F(CommandCheckTest, ACommandInJsonIsReadLikeOneInProtobuf) {
  CommandCall call;
  *call.add_plans() = good_plan();
  Tx tx;
  tx.event_payload = to_json(call);
  EXPECT_EQ(give({tx}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, PlansOfOneCallGoToTheirDronesAndThoseOfOtherHostsAreLeftAlone) {
  const auto checked = give({command({good_plan(1, "tello2"), good_plan(1, "tello9"), good_plan(1, "tello1")})});
  ASSERT_EQ(checked.plans.size(), 2U);
  EXPECT_EQ(checked.plans[0].drone, 2);
  EXPECT_EQ(checked.plans[1].drone, 1);
  EXPECT_TRUE(checked.refused.empty());
}

TEST_F(CommandCheckTest, OneBadPlanInACallDoesNotTakeTheOthersDown) {
  auto bad = good_plan(1, "tello1");
  bad.set_epoch(epoch - 1);
  const auto checked = give({command({bad, good_plan(1, "tello2")})});
  ASSERT_EQ(checked.plans.size(), 1U);
  EXPECT_EQ(checked.plans[0].drone, 2);
  EXPECT_EQ(checked.refused.size(), 1U);
}

TEST_F(CommandCheckTest, ABlockThatBreaksTheChainIsNotTrusted) {
  (void)give({});
  ledger_.lose_a_block();
  const auto checked = give({command(good_plan())});
  EXPECT_FALSE(checked.chain_ok);
  EXPECT_FALSE(checked.chain_error.empty());
  EXPECT_TRUE(checked.plans.empty());
  ASSERT_EQ(checked.refused.size(), 1U);
  EXPECT_EQ(checked.refused[0].why, RefusalReason::broken_chain);
  EXPECT_EQ(check_.broken_blocks(), 1U);
  EXPECT_EQ(check_.counters(1).on_ledger, 0U);
}

TEST_F(CommandCheckTest, AControlEventInABlockThatBreaksTheChainHasNoEffect) {
  (void)give({});
  ledger_.lose_a_block();
  EXPECT_TRUE(give({stop_event()}).plans.empty());
}

TEST_F(CommandCheckTest, ATransactionFlaggedInvalidIsRefused) {
  auto tx = command(good_plan());
  tx.code = 11;
  expect_refused(tx, RefusalReason::invalid_transaction);
  EXPECT_EQ(check_.counters(1).on_ledger, 0U);
}

TEST_F(CommandCheckTest, ABlockWithoutFlagsIsRefused) {
  auto tx = command(good_plan());
  tx.code = -1;
  expect_refused(tx, RefusalReason::invalid_transaction);
}

TEST_F(CommandCheckTest, ATransactionOfAnotherChannelIsRefused) {
  auto tx = command(good_plan());
  tx.channel = "other";
  expect_refused(tx, RefusalReason::wrong_channel);
}

TEST_F(CommandCheckTest, AnEventOfAnotherContractIsRefused) {
  auto tx = command(good_plan());
  tx.contract = "impostor";
  expect_refused(tx, RefusalReason::wrong_channel);
}

TEST_F(CommandCheckTest, ACommandThatIsNoMessageIsRefused) {
  Tx tx;
  tx.event_payload = "\xff\xff nonsense";
  const auto checked = give({tx});
  ASSERT_EQ(checked.refused.size(), 1U);
  EXPECT_EQ(checked.refused[0].why, RefusalReason::malformed);
}

TEST_F(CommandCheckTest, AnUnknownActionIsRefused) {
  auto plan = good_plan();
  plan.set_action(static_cast<Action>(3));  // `stop` in shared memory: never to come from a command
  expect_refused(command(plan), RefusalReason::malformed);
}

TEST_F(CommandCheckTest, AFlyPlanWithoutSetpointsIsRefusedAndALandPlanWithoutIsNot) {
  auto land = good_plan(1);
  land.clear_setpoints();
  land.set_action(LAND);
  EXPECT_EQ(give({command(land)}).plans.size(), 1U);
  auto fly = good_plan(2);
  fly.clear_setpoints();
  EXPECT_EQ(give({command(fly)}).refused.at(0).why, RefusalReason::malformed);
}

TEST_F(CommandCheckTest, APlanThatItsSignerDidNotAskForIsRefused) {
  auto faster = good_plan();
  faster.mutable_setpoints(0)->set_vx(2.0F);
  auto tx = command(faster);
  tx.asked = fabric::Call{"command", {command(good_plan()).event_payload}};
  expect_refused(tx, RefusalReason::altered);
}

TEST_F(CommandCheckTest, ACommandOutOfACallOfAnotherFunctionIsRefused) {
  auto tx = command(good_plan());
  for (const char* function : {"set", "stop", "get", ""}) {
    tx.asked = fabric::Call{function, {tx.event_payload}};
    const auto checked = give({tx});
    EXPECT_TRUE(checked.plans.empty()) << function;
    EXPECT_EQ(checked.refused.at(0).why, RefusalReason::altered) << function;
  }
}

TEST_F(CommandCheckTest, APlanThatWasAddedOrLeftOutTakesTheWholeCallDown) {
  auto more = command({good_plan(), good_plan(1, "tello2")});
  auto less = command(good_plan());
  std::swap(more.event_payload, less.event_payload);
  more.asked = fabric::Call{"command", {less.event_payload}};
  less.asked = fabric::Call{"command", {more.event_payload}};
  for (const auto& tx : {more, less}) {
    const auto checked = give({tx});
    EXPECT_TRUE(checked.plans.empty());
    EXPECT_EQ(checked.refused.size(), 2U);  // of both drones, whichever side names them
    for (const auto& refused : checked.refused) EXPECT_EQ(refused.why, RefusalReason::altered);
  }
}

TEST_F(CommandCheckTest, TheSamePlanInAnotherFormIsTheSamePlan) {
  CommandCall call;
  *call.add_plans() = good_plan(1);
  Tx tx;
  tx.event_payload = to_json(call);
  tx.asked = fabric::Call{"command", {" \n"}};
  EXPECT_TRUE(give({tx}).plans.empty());
  tx.asked = fabric::Call{"command", {call.SerializeAsString()}};
  EXPECT_EQ(give({tx}).plans.size(), 1U);
  call.mutable_plans(0)->set_sequence(2);
  tx.event_payload = to_json(call);
  tx.asked = fabric::Call{"command", {"{ \"plans\" : " + to_json(call).substr(9)}};  // as a person writes it
  EXPECT_EQ(give({tx}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, ASecondArgumentIsNoCommandOfOurs) {
  auto tx = command(good_plan());
  tx.asked = fabric::Call{"command", {tx.event_payload, ""}};
  expect_refused(tx, RefusalReason::altered);
}

TEST_F(CommandCheckTest, ATransactionThatCannotBeTrustedIsCountedAndGivesNothing) {
  auto block = ledger_.block({command(good_plan()), command(good_plan(2))});
  block.transactions[0].code = fabric::code_unverified;
  block.transactions[0].problem = "its event is another's";
  block.transactions[1].code = 11;
  block.transactions[1].problem = "flagged 11, but valid";
  const auto checked = check_.check(now, now_s, block);
  EXPECT_TRUE(checked.plans.empty());
  EXPECT_EQ(checked.unverified, 2U);
  EXPECT_EQ(checked.unverified_problem, "transaction " + block.transactions[0].tx_id + ": its event is another's");
  EXPECT_EQ(check_.unverified_transactions(), 2U);
}

TEST_F(CommandCheckTest, ASignerOfAnUnknownOrganisationIsRefused) {
  auto tx = command(good_plan());
  tx.creator = {"Org9MSP", "CN=User1@org9.ledgerline"};
  expect_refused(tx, RefusalReason::unknown_signer);
}

TEST_F(CommandCheckTest, AForgedSignatureIsRefused) {
  auto tx = command(good_plan());
  tx.spoil.creator_signature = true;
  expect_refused(tx, RefusalReason::bad_signature);
}

TEST_F(CommandCheckTest, AnEndorsementByAnotherOrganisationAloneIsNotEnough) {
  auto tx = command(good_plan());
  tx.endorser = {"Org2MSP", "CN=peer0.org2.ledgerline"};
  expect_refused(tx, RefusalReason::not_endorsed);
}

TEST_F(CommandCheckTest, AnEndorsementByAClientOfOurOrganisationIsNotEnough) {
  auto tx = command(good_plan());
  tx.endorser = {"Org1MSP", "CN=User1@org1.ledgerline"};
  expect_refused(tx, RefusalReason::not_endorsed);
}

TEST_F(CommandCheckTest, AForgedEndorsementIsRefused) {
  auto tx = command(good_plan());
  tx.spoil.endorsement_signature = true;
  expect_refused(tx, RefusalReason::not_endorsed);
}

TEST_F(CommandCheckTest, AnEndorsementOfAnotherProposalIsRefused) {
  auto tx = command(good_plan());
  tx.spoil.proposal_hash = true;
  expect_refused(tx, RefusalReason::not_endorsed);
}

TEST_F(CommandCheckTest, ASignerWhoDoesNotHoldTheLeaseIsRefused) {
  auto tx = command(good_plan());
  tx.creator = {"Org2MSP", "CN=User2@org2.ledgerline"};
  expect_refused(tx, RefusalReason::not_holder);
}

TEST_F(CommandCheckTest, ADroneWithoutAKnownLeaseTakesNoCommand) {
  auto released = control("tello1", epoch + 1);
  released.clear_holder();
  check_.control().set_control(released);
  auto plan = good_plan();
  plan.set_epoch(epoch + 1);
  expect_refused(command(plan), RefusalReason::not_holder);
}

TEST_F(CommandCheckTest, AStoppedDroneTakesNoCommand) {
  auto stopped = control("tello1", epoch);
  add_stop(stopped, testing::stop_of("tello1"));
  check_.control().set_control(stopped);
  expect_refused(command(good_plan()), RefusalReason::stopped);
}

TEST_F(CommandCheckTest, AStoppedDroneMayStillBeLandedByItsHolder) {
  auto stopped = control("tello1", epoch);
  add_stop(stopped, testing::stop_of("tello1"));
  check_.control().set_control(stopped);
  auto land = good_plan();
  land.set_action(LAND);
  EXPECT_EQ(give({command(land)}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, ACommandOfAnOldLeaseIsRefused) {
  auto plan = good_plan();
  plan.set_epoch(epoch - 1);
  expect_refused(command(plan), RefusalReason::wrong_epoch);
}

TEST_F(CommandCheckTest, ACommandForAnotherBootIsRefused) {
  auto plan = good_plan();
  plan.set_boot_id(boot + 1);
  expect_refused(command(plan), RefusalReason::foreign_boot);
}

TEST_F(CommandCheckTest, AfterANewBootStampsOfTheOldOneAreForgotten) {
  send_state(1, boot + 1, stamp + ns_per_ms);
  auto plan = good_plan();
  plan.set_boot_id(boot + 1);  // with a stamp of the boot before
  expect_refused(command(plan), RefusalReason::unknown_stamp);
}

TEST_F(CommandCheckTest, AStampThatWasNeverSentIsRefused) {
  auto plan = good_plan();
  plan.set_state_stamp_ns(stamp - 1);
  expect_refused(command(plan), RefusalReason::unknown_stamp);
}

TEST_F(CommandCheckTest, StampsBeyondTheMemoryAreForgottenOldestFirst) {
  const TimeNs step = ns_per_ms;
  for (int i = 1; i <= 256; ++i) send_state(1, boot, stamp + i * step);
  expect_refused(command(good_plan()), RefusalReason::unknown_stamp);
  auto plan = good_plan();
  plan.set_state_stamp_ns(stamp + step);
  EXPECT_EQ(give({command(plan)}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, AReplayedSequenceIsRefused) {
  EXPECT_EQ(give({command(good_plan(4))}).plans.size(), 1U);
  EXPECT_EQ(give({command(good_plan(4))}).refused.at(0).why, RefusalReason::replayed);
  EXPECT_EQ(give({command(good_plan(3))}).refused.at(0).why, RefusalReason::replayed);
  EXPECT_EQ(give({command(good_plan(5))}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, SequencesRestartWithTheEpoch) {
  EXPECT_EQ(give({command(good_plan(4))}).plans.size(), 1U);
  auto plan = good_plan(1);
  plan.set_epoch(epoch + 2);
  Control free = control("tello1", epoch + 1);
  free.clear_holder();
  const auto checked =
      give({control_event("release", free), control_event("acquire", control("tello1", epoch + 2)), command(plan)});
  EXPECT_EQ(checked.plans.size(), 2U) << "the first one is empty";
}

TEST_F(CommandCheckTest, ACommandFromAnOldStateIsRefusedAtTheLimitExactly) {
  const CommandCheckSettings settings;
  EXPECT_EQ(give({command(good_plan(1))}, stamp + settings.max_age_ns).plans.size(), 1U);
  EXPECT_EQ(give({command(good_plan(2))}, stamp + settings.max_age_ns + 1).refused.at(0).why, RefusalReason::too_old);
}

TEST_F(CommandCheckTest, ASetpointFasterThanTheLimitIsRefused) {
  auto plan = good_plan();
  plan.mutable_setpoints(1)->set_vx(6.0F);
  plan.mutable_setpoints(1)->set_vy(6.0F);
  expect_refused(command(plan), RefusalReason::over_limits);
}

TEST_F(CommandCheckTest, ASetpointThatTurnsFasterThanTheLimitIsRefused) {
  auto plan = good_plan();
  plan.mutable_setpoints(1)->set_yaw_rate(-4.0F);
  expect_refused(command(plan), RefusalReason::over_limits);
}

TEST_F(CommandCheckTest, SetpointsThatAreNotFiniteAreRefused) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    auto velocity = good_plan();
    velocity.mutable_setpoints(2)->set_vz(bad);
    EXPECT_EQ(give({command(velocity)}).refused.at(0).why, RefusalReason::over_limits);
    auto yaw = good_plan();
    yaw.mutable_setpoints(2)->set_yaw_rate(bad);
    EXPECT_EQ(give({command(yaw)}).refused.at(0).why, RefusalReason::over_limits);
  }
}

TEST_F(CommandCheckTest, AReferenceIsTakenWithinItsLimitsAndNotInTheDronesFrame) {
  auto good = good_plan();
  for (PlannedSetpoint& s : *good.mutable_setpoints()) {
    s.mutable_reference()->set_x(1.5F);
    s.mutable_reference()->set_vy(0.5F);
    s.mutable_reference()->set_az(-0.25F);
  }
  good.mutable_response()->set_gain(0.5F);
  good.mutable_response()->set_lag_s(0.25F);
  const auto checked = give({command(good)});
  ASSERT_EQ(checked.plans.size(), 1U);
  EXPECT_EQ(checked.plans[0].response.gain, 0.5);
  ASSERT_TRUE(checked.plans[0].setpoints[2].has_reference);
  EXPECT_FLOAT_EQ(checked.plans[0].setpoints[2].reference.position_m[0], 1.5F);
  EXPECT_FLOAT_EQ(checked.plans[0].setpoints[2].reference.velocity_mps[1], 0.5F);
  EXPECT_FLOAT_EQ(checked.plans[0].setpoints[2].reference.acceleration_mps2[2], -0.25F);

  good.set_sequence(2);
  const auto expect_reason = [&](RefusalReason why, auto spoil) {
    DronePlan bad = good;
    spoil(bad, *bad.mutable_setpoints(1)->mutable_reference());
    EXPECT_EQ(give({command(bad)}).refused.at(0).why, why);
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  expect_reason(RefusalReason::over_limits, [](DronePlan&, PlannedReference& r) { r.set_vx(9); });
  expect_reason(RefusalReason::over_limits, [&](DronePlan&, PlannedReference& r) { r.set_x(nan); });
  expect_reason(RefusalReason::over_limits, [](DronePlan&, PlannedReference& r) { r.set_y(1e6F); });
  expect_reason(RefusalReason::over_limits, [](DronePlan&, PlannedReference& r) { r.set_ax(-1e6F); });
  expect_reason(RefusalReason::over_limits, [](DronePlan& p, PlannedReference&) { p.mutable_response()->set_gain(0); });
  expect_reason(RefusalReason::malformed, [](DronePlan& p, PlannedReference&) { p.set_body_frame(true); });
}

TEST_F(CommandCheckTest, MoreSetpointsThanAPlanHoldsAreRefused) {
  auto plan = good_plan();
  while (plan.setpoints_size() <= static_cast<int>(max_setpoints)) *plan.add_setpoints() = plan.setpoints(2);
  expect_refused(command(plan), RefusalReason::over_limits);
}

TEST_F(CommandCheckTest, SetpointsOutOfOrderAreRefused) {
  auto plan = good_plan();
  plan.mutable_setpoints(2)->set_at_ns(plan.setpoints(1).at_ns() - 1);
  expect_refused(command(plan), RefusalReason::over_limits);
}

TEST_F(CommandCheckTest, ASetpointBeyondTheHorizonIsRefused) {
  auto plan = good_plan();
  plan.mutable_setpoints(2)->set_at_ns(now + CommandCheckSettings{}.horizon_ns + 1);
  expect_refused(command(plan), RefusalReason::over_limits);
}

TEST_F(CommandCheckTest, ALeaseTakenInABlockCountsFromThereOn) {
  const crypto::IdentityName other{"Org2MSP", "CN=User2@org2.ledgerline"};
  auto taken = control("tello1", epoch + 1);
  *taken.mutable_holder() = to_message(other);
  taken.set_priority(1);
  auto old_plan = command(good_plan(1));
  auto new_plan = good_plan(1);
  new_plan.set_epoch(epoch + 1);
  auto new_tx = command(new_plan);
  new_tx.creator = other;
  const auto checked = give({old_plan, control_event("acquire", taken), command(good_plan(2)), new_tx});
  ASSERT_EQ(checked.plans.size(), 3U);
  EXPECT_EQ(checked.plans[0].epoch, epoch);
  EXPECT_EQ(checked.plans[1].count, 0U) << "the loser's plan ends";
  EXPECT_EQ(checked.plans[2].epoch, epoch + 1);
  ASSERT_EQ(checked.refused.size(), 1U);
  EXPECT_EQ(checked.refused[0].why, RefusalReason::not_holder);
}

TEST_F(CommandCheckTest, AControlEventWithoutOurEndorsementChangesNothing) {
  const crypto::IdentityName other{"Org2MSP", "CN=User2@org2.ledgerline"};
  auto taken = control("tello1", epoch);
  *taken.mutable_holder() = to_message(other);
  auto forged = control_event("acquire", taken);
  forged.creator = other;
  forged.endorser = {"Org2MSP", "CN=peer0.org2.ledgerline"};
  EXPECT_EQ(give({forged}).refused.at(0).why, RefusalReason::not_endorsed);
  EXPECT_EQ(check_.control().refused_events(), 1U);
  EXPECT_EQ(give({command(good_plan())}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, AnInvalidControlEventChangesNothing) {
  auto released = control("tello1", epoch + 1);
  released.clear_holder();
  auto tx = control_event("release", released);
  tx.code = 11;
  (void)give({tx});
  EXPECT_EQ(give({command(good_plan())}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, AStopGivesAStopPlanAtOnceThatIsNewerThanAllBefore) {
  (void)give({command(good_plan(7))});
  const auto checked = give({stop_event(), command(good_plan(8))});
  ASSERT_EQ(checked.plans.size(), 1U);
  EXPECT_EQ(checked.plans[0].action, PlanAction::stop);
  EXPECT_EQ(checked.plans[0].drone, 1);
  EXPECT_GT(checked.plans[0].sequence, 7U);
  EXPECT_EQ(checked.refused.at(0).why, RefusalReason::stopped);
}

TEST_F(CommandCheckTest, AStopThatNamesNoDroneOfOursStopsNothing) {
  Tx tx = stop_event();
  Stops event;
  *event.add_stops() = testing::stop_of("tello9");
  tx.event_payload = event.SerializeAsString();
  EXPECT_TRUE(give({tx}).plans.empty());
  EXPECT_EQ(give({command(good_plan())}).plans.size(), 1U);
}

TEST_F(CommandCheckTest, AStopByNameWithMotorsOffGivesACut) {
  EXPECT_EQ(give({stop_event(true)}).plans.at(0).action, PlanAction::cut);
}

TEST_F(CommandCheckTest, AfterAClearCommandsAreTakenAgain) {
  (void)give({stop_event()});
  Control cleared = control("tello1", epoch);
  set_clears(cleared, testing::stop_of("tello1").stopper(), 1);
  const auto checked = give({control_event("clear_stop", cleared), command(good_plan(1))});
  ASSERT_EQ(checked.plans.size(), 2U);
  EXPECT_TRUE(is_contract_action(checked.plans[0].action)) << "link is notified first";
  EXPECT_EQ(checked.plans[1].action, PlanAction::fly);
}

}  // namespace
}  // namespace ledgerline::agent
