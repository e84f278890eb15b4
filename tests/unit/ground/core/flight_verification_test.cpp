#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using testing::HasSubstr;
using Kind = fabric::Outcome::Kind;

TEST(FlightVerification, StatesOfAnotherSignerThanTheDronesOwnerAreCountedAndIgnored) {
  FlightConfig config = config_for(1);
  config.trusted = crypto::make_test_registry({"Org1MSP", "Org3MSP"});
  FlightCore core(config);
  ASSERT_TRUE(core.set_control(control_record("tello1", operator_name).SerializeAsString()));
  StateSample sample;
  sample.phase = LinkPhase::on_ground;
  sample.stamp_ns = sample.pose_stamp_ns = ns_per_s;
  std::uint64_t sequence = 0;
  const auto give = [&](const crypto::IdentityName& who, bool spoilt) {
    sample.sequence = ++sequence;
    SetCall call;
    add_state(call, "tello1", sample);
    fabric::Block block;
    block.transactions.push_back(event("set", call.SerializeAsString()));
    const auto identity = crypto::make_test_identity(who);
    block.transactions[0].creator = identity.serialized;
    block.transactions[0].payload = "what was signed";
    block.transactions[0].signature = *identity.signer->sign("what was signed");
    if (spoilt) block.transactions[0].payload += "?";
    FlightInputs inputs;
    inputs.block = &block;
    const FlightOutputs out = core.step(ns_per_s, inputs);
    EXPECT_EQ(out.updates.empty(), out.traces.empty());
    return out.traces.size();
  };
  EXPECT_EQ(give(outsider_name, false), 0u);
  EXPECT_EQ(give(host_name, true), 0u);
  EXPECT_EQ(core.transactions().states_unverified, 4u) << "odometry and status of each";
  EXPECT_GT(give(host_name, false), 0u);
}

/// A ground that trusts signatures, and transactions rightly signed, with a peer's own event in them.
class FlightBesideALyingPeer : public testing::Test {
 protected:
  FlightBesideALyingPeer() {
    EXPECT_TRUE(core.set_control(record.SerializeAsString()));
    give(state(++sequence), host_name);
  }
  static FlightConfig config() {
    FlightConfig config = config_for(1);
    config.trusted = crypto::make_test_registry({"Org1MSP", "Org2MSP", "Org3MSP"});
    return config;
  }
  static fabric::Transaction state(std::uint64_t sequence, double x = 0) {
    StateSample sample;
    sample.phase = LinkPhase::on_ground;
    sample.sequence = sequence;
    sample.stamp_ns = sample.pose_stamp_ns = ns_per_s;
    sample.position_m = {x, 0, 0};
    SetCall call;
    add_state(call, "tello1", sample);
    return event("set", call.SerializeAsString());
  }
  fabric::Transaction record_event(const std::string& name, const Control& after) const {
    Controls controls;
    *controls.add_controls() = after;
    return control_event(name, {"tello1"}, controls.SerializeAsString());
  }
  FlightOutputs give(fabric::Transaction tx, const crypto::IdentityName& who) {
    const auto identity = crypto::make_test_identity(who);
    tx.creator = identity.serialized;
    tx.payload = "what was signed";
    tx.signature = *identity.signer->sign(tx.payload);
    fabric::Block block;
    block.transactions.push_back(std::move(tx));
    FlightInputs inputs;
    inputs.block = &block;
    return core.step(ns_per_s, inputs);
  }
  bool flies_on() const { return core.status(0).phase == GroundPhase::takeoff; }

  Control record = control_record("tello1", operator_name, 4);
  FlightCore core{config()};
  std::uint64_t sequence = 0;
};

TEST_F(FlightBesideALyingPeer, AStateThatItsOwnerDidNotSignIsNotShown) {
  ASSERT_TRUE(flies_on());
  fabric::Transaction other = state(++sequence, 5);
  other.args = state(sequence, 0).args;
  EXPECT_TRUE(give(other, host_name).traces.empty());
  EXPECT_EQ(core.transactions().altered, 1u);
  fabric::Transaction another_function = state(sequence);
  another_function.function = "stop";
  EXPECT_TRUE(give(another_function, host_name).traces.empty());
  EXPECT_FALSE(give(state(sequence), host_name).traces.empty());
}

TEST_F(FlightBesideALyingPeer, ARecordInACallForSomethingElseChangesNothing) {
  Control taken = control_record("tello1", outsider_name, 99);
  for (const char* name : {"enroll", "grant", "acquire", "release", "evict", "clear_stop", "apply_stops"}) {
    fabric::Transaction lie = record_event(name, taken);
    lie.function = "set";
    (void)give(lie, host_name);
    lie = record_event(name, taken);
    lie.function = "command";
    (void)give(lie, operator_name);
    (void)give(record_event(name, taken), operator_name);  // asked for, but not by him whom it makes the holder
  }
  EXPECT_EQ(core.transactions().altered, 21u);
  EXPECT_TRUE(flies_on());
}

TEST_F(FlightBesideALyingPeer, ARecordOfAnotherContractOrChannelChangesNothing) {
  for (const bool contract : {true, false}) {
    fabric::Transaction other = record_event("acquire", control_record("tello1", outsider_name, 99));
    (contract ? other.contract : other.channel) = "another";
    (void)give(other, outsider_name);
    EXPECT_TRUE(flies_on());
  }
}

TEST_F(FlightBesideALyingPeer, WhatFollowsFromTheCallAndTheRecordBeforeIsTrusted) {
  record = control_record("tello1", outsider_name, 5);
  record.set_priority(3);
  fabric::Transaction taken = record_event("acquire", record);
  (void)give(taken, outsider_name);  // with a priority that was not asked for
  EXPECT_TRUE(flies_on());
  taken.args.emplace_back("priority=3");
  (void)give(taken, outsider_name);
  EXPECT_EQ(core.status(0).phase, GroundPhase::failed);
}

TEST_F(FlightBesideALyingPeer, WhoIsRevokedFliesNoMore) {
  Controls reported;
  reported.mutable_identity()->set_msp_id(operator_name.msp_id);
  reported.mutable_identity()->set_subject(operator_name.subject);
  reported.set_role(REVOKED);
  RevokeCall call;
  *call.mutable_identity() = reported.identity();
  const auto revoke = control_event("revoke", {call.SerializeAsString()}, reported.SerializeAsString());
  (void)give(revoke, operator_name);
  EXPECT_EQ(core.transactions().altered, 1u) << "he is no administrator";
  EXPECT_TRUE(flies_on());
  (void)give(revoke, {operator_name.msp_id, "CN=Admin@" + operator_name.msp_id});
  EXPECT_EQ(core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(core.status(0).why, HasSubstr("is revoked"));
}

TEST_F(FlightBesideALyingPeer, NobodyCommandsForAHolderWhoDidNotAskForIt) {
  record = control_record("tello1", operator_name, 5);
  record.mutable_delegate()->set_msp_id(operator_name.msp_id);
  record.mutable_delegate()->set_subject("CN=station");
  (void)give(record_event("acquire", record), operator_name);  // for nobody
  EXPECT_EQ(core.transactions().altered, 1u);
  EXPECT_TRUE(flies_on());
  LeaseCall call;
  call.add_drones("tello1");
  *call.mutable_delegate() = record.delegate();
  fabric::Transaction asked = record_event("acquire", record);
  asked.args = {call.SerializeAsString()};
  (void)give(asked, operator_name);
  EXPECT_EQ(core.transactions().altered, 1u);
  EXPECT_EQ(core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(core.status(0).why, HasSubstr("who lets CN=station command it"));
}

/// Two operators of one station, which commands for whichever of them holds the drone.
class FlightOfTwoOperators : public testing::Test {
 protected:
  static constexpr const char* first = "CN=operator 1";
  static constexpr const char* second = "CN=operator 2";
  void start(bool manual) {
    FlightConfig config = config_for(1);
    config.manual = manual;
    world.emplace(config);
    (void)world->core.set_control(delegated_record("tello1", first, 2).SerializeAsString());
  }
  void give(const char* function, const Control& after) {
    Controls controls;
    *controls.add_controls() = after;
    AnswerCall call;
    call.add_drones("tello1");
    *call.mutable_to() = after.holder();
    const bool hand_over = function == std::string("hand_over");
    world->put_block(
        control_event(function, {hand_over ? call.SerializeAsString() : "tello1"}, controls.SerializeAsString()));
  }
  void revoke(const std::string& who) {
    Controls reported;
    reported.mutable_identity()->set_msp_id(operator_name.msp_id);
    reported.mutable_identity()->set_subject(who);
    reported.set_role(REVOKED);
    RevokeCall call;
    *call.mutable_identity() = reported.identity();
    world->put_block(control_event("revoke", {call.SerializeAsString()}, reported.SerializeAsString()));
  }
  const std::vector<DronePlan>& plans() const { return world->drones[0].plans; }

  std::optional<FlightWorld> world;
};

TEST_F(FlightOfTwoOperators, AHandOverBetweenThemIsFlownThroughUnderTheNewEpoch) {
  start(false);
  world->run(12);
  ASSERT_EQ(world->core.status(0).phase, GroundPhase::path);
  const double progress = world->core.status(0).progress;
  const std::size_t before = plans().size();
  ASSERT_EQ(plans().back().epoch(), 2u);
  give("hand_over", delegated_record("tello1", second, 3));
  const TimeNs given_ns = world->now_ns + world->one_way_ns;
  world->run(0.2);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::path);
  EXPECT_EQ(world->core.status(0).why, "");
  EXPECT_EQ(world->core.lease(0).holder->subject, second);
  std::size_t at = before;
  while (at < plans().size() && plans()[at].epoch() == 2) ++at;
  ASSERT_LT(at, plans().size()) << "it is commanded under the new epoch";
  EXPECT_EQ(plans()[at].sequence(), 1u);
  EXPECT_LT(plans()[at].state_stamp_ns() - given_ns, 40 * ns_per_ms) << "by the next state";
  for (; at < plans().size(); ++at) {
    EXPECT_EQ(plans()[at].epoch(), 3u);
    EXPECT_EQ(plans()[at].action(), FLY);
  }
  world->run(120);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::landed);
  EXPECT_EQ(world->core.status(0).why, "");
  EXPECT_GT(world->core.status(0).progress, progress);
}

TEST_F(FlightOfTwoOperators, ByHandItStaysByHand) {
  start(true);
  world->drones[0].phase = LinkPhase::flying;
  world->drones[0].model.motion.position_m.z() = 1;
  world->run(1);
  ASSERT_EQ(world->core.status(0).phase, GroundPhase::manual);
  give("hand_over", delegated_record("tello1", second, 3));
  world->run(0.5);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::manual);
  EXPECT_EQ(plans().back().epoch(), 3u);
}

TEST_F(FlightOfTwoOperators, TheHolderWhoTakesTheCommandBackEndsIt) {
  start(false);
  world->run(12);
  give("acquire", control_record("tello1", {operator_name.msp_id, first}, 3));
  world->run(0.5);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(world->core.status(0).why, HasSubstr("lost its lease to CN=operator 1"));
  EXPECT_EQ(plans().back().epoch(), 2u);
}

TEST_F(FlightOfTwoOperators, ByHandARevokedOneLeavesItToTheOther) {
  start(true);
  world->drones[0].phase = LinkPhase::flying;
  world->drones[0].model.motion.position_m.z() = 1;
  world->run(1);
  revoke(first);
  world->run(0.5);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::waiting);
  EXPECT_THAT(world->core.status(0).why, HasSubstr("its operator CN=operator 1 is revoked"));
  give("acquire", delegated_record("tello1", second, 3));
  world->run(0.5);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::manual);
}

TEST_F(FlightOfTwoOperators, TheStationRevokedFliesNothing) {
  start(true);
  world->drones[0].phase = LinkPhase::flying;
  world->drones[0].model.motion.position_m.z() = 1;
  world->run(1);
  revoke(operator_name.subject);
  world->run(0.1);
  EXPECT_EQ(world->core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(world->core.status(0).why, HasSubstr("CN=User1@org2, who commands it, is revoked"));
  const std::size_t then = plans().size();
  world->run(0.5);
  EXPECT_EQ(plans().size(), then);
}

TEST_F(FlightBesideALyingPeer, AStopIsItsCreatorsOwn) {
  Stops stops;
  *stops.add_stops() = stop_of("tello1", outsider_name);
  (void)give(control_event("stop", {"tello1"}, stops.SerializeAsString()), operator_name);
  EXPECT_TRUE(flies_on());
  (void)give(control_event("stop", {"tello1"}, stops.SerializeAsString()), outsider_name);
  EXPECT_EQ(core.status(0).phase, GroundPhase::landing);
}

}  // namespace
}  // namespace ledgerline::ground
