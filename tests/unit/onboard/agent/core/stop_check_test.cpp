#include <gtest/gtest.h>

#include "common/access/stops.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

/// Stops of which a peer, an orderer or a wrong clock says that they are none: who may stop is obeyed, once.
namespace ledgerline::agent::stops {
namespace {

using agent::testing::control;
using agent::testing::LedgerOfTests;
using agent::testing::stop_of;
using Tx = LedgerOfTests::Tx;

constexpr TimeNs now = 100 * ns_per_s;
constexpr std::int64_t now_s = 1'700'000'000;
constexpr std::uint64_t epoch = 5;
constexpr int conflict = 11, not_endorsed = 10, duplicate = 9;  // protos.TxValidationCode
const crypto::IdentityName holder = LedgerOfTests::operator_name();
const crypto::IdentityName guard{"Org1MSP", "CN=Guard@org1.ledgerline"};
const crypto::IdentityName host{"Org1MSP", "CN=User1@org1.ledgerline"};
const crypto::IdentityName outsider{"Org3MSP", "CN=User1@org3.ledgerline"};
const crypto::IdentityName peer3{"Org3MSP", "CN=peer0.org3.ledgerline"};

class StopCheckTest : public ::testing::Test {
 protected:
  StopCheckTest() { start(control("tello1", epoch)); }
  void start(const Control& record) {
    check_.emplace(CommandCheckSettings{}, std::vector<DroneName>{{1, "tello1"}}, *registry_);
    check_->control().set_control(record);
    verification::RolesByOrganisation roles;
    for (const auto& who : {holder, guard, outsider}) roles.apply({to_message(who), OPERATOR});
    check_->control().set_roles(std::move(roles));
  }
  /// As an honest client and contract make it.
  static Tx stop(const crypto::IdentityName& by, int code = 0, std::optional<std::uint64_t> clears = {},
                 bool cut = false) {
    DronesCall call;
    call.add_drones("tello1");
    call.set_cut(cut);
    if (clears) call.add_clears(*clears);
    Stops reported;
    *reported.add_stops() = stop_of("tello1", cut);
    *reported.mutable_stops(0)->mutable_stopper() = to_message(by);
    reported.mutable_stops(0)->set_clears(clears.value_or(0));
    Tx tx;
    tx.creator = by;
    tx.event_name = "stop";
    tx.event_payload = reported.SerializeAsString();
    tx.asked = fabric::Call{"stop", {call.SerializeAsString()}};
    tx.code = code;
    return tx;
  }
  static Tx control_event(const std::string& function, const Control& after, const crypto::IdentityName& by) {
    Controls reported;
    *reported.add_controls() = after;
    Tx tx;
    tx.creator = by;
    tx.event_name = function;
    tx.event_payload = reported.SerializeAsString();
    return tx;
  }
  CheckedBlock give(const Tx& one) { return check_->check(now, now_s, ledger_.block({one})); }
  /// The same transaction again, in a block of its own.
  CheckedBlock give_again(const fabric::Transaction& one, int code) {
    fabric::Block block = ledger_.block({});
    block.transactions.push_back(one);
    block.transactions[0].code = code;
    return check_->check(now, now_s, block);
  }
  void expect_refused(const Tx& one, const char* what) {
    const auto checked = give(one);
    EXPECT_TRUE(checked.plans.empty()) << what;
    ASSERT_EQ(checked.refused.size(), 1U) << what;
    EXPECT_EQ(checked.refused[0].why, RefusalReason::may_not_stop) << what;
    EXPECT_FALSE(is_stopped_now()) << what;
  }
  bool is_stopped_now() const { return check_->standing_stop(now, 1).has_value(); }

  std::unique_ptr<crypto::MspRegistry> registry_ =
      crypto::make_test_registry({"Org1MSP", "Org2MSP", "Org3MSP", "Org4MSP"});
  LedgerOfTests ledger_;
  std::optional<CommandCheck> check_;
};

TEST_F(StopCheckTest, WhoMayStopIsObeyedWhateverTheFlag) {
  for (const int code : {1, 2, 4, not_endorsed, conflict, 12, 254, 255, -1}) {
    start(control("tello1", epoch));
    const auto checked = give(stop(guard, code));
    ASSERT_EQ(checked.plans.size(), 1U) << code;
    EXPECT_EQ(checked.plans[0].action, PlanAction::stop);
    ASSERT_EQ(checked.unconfirmed.size(), 1U) << code;
    EXPECT_EQ(checked.unconfirmed[0].stopper, guard);
    EXPECT_EQ(checked.unconfirmed[0].code, code);
    EXPECT_TRUE(is_stopped_now());
    CommandCall call;
    call.add_plans()->set_drone("tello1");
    Tx command;
    command.event_payload = call.SerializeAsString();
    EXPECT_EQ(give(command).refused.at(0).why, RefusalReason::stopped) << code;
  }
}

TEST_F(StopCheckTest, TheRolesOfAnOrganisationThatADroneIsGrantedToAreReadThen) {
  Control granted = control("tello1", epoch);
  EXPECT_TRUE(check_->control().await_roles().empty()) << "all that matter are here";
  granted.add_grants()->mutable_to()->set_msp_id("Org4MSP");
  granted.mutable_grants()->rbegin()->set_stop(true);
  check_->control().set_control(granted);
  EXPECT_EQ(check_->control().await_roles(), verification::Organisations{"Org4MSP"});
  EXPECT_TRUE(check_->control().await_roles().empty()) << "once";
  const crypto::IdentityName far{"Org4MSP", "CN=User1@org4.ledgerline"};
  expect_refused(stop(far, conflict), "nobody knows yet what it may");
  verification::RolesByOrganisation read;
  read.apply({to_message(far), OPERATOR});
  check_->control().add_roles(read);
  EXPECT_EQ(give(stop(far, conflict)).plans.size(), 1U);
}

// Of a fork, of a block that no orderer signed, of a stream behind a contradiction.
TEST_F(StopCheckTest, OfARefusedBlockStopsAreTakenAndNothingElse) {
  CommandCall call;
  auto* plan = call.add_plans();
  plan->set_drone("tello1");
  plan->set_action(LAND);
  plan->set_epoch(epoch);
  Tx command;
  command.event_payload = call.SerializeAsString();
  ledger_.lose_a_block();
  const fabric::Block block =
      ledger_.block({command, stop(guard), control_event("acquire", control("tello1", epoch + 1), outsider)});
  const std::uint64_t height = check_->height();
  const auto checked = check_->check_refused(now, block);
  ASSERT_EQ(checked.plans.size(), 1U);
  EXPECT_EQ(checked.plans[0].action, PlanAction::stop);
  EXPECT_EQ(checked.unconfirmed.size(), 1U) << "an alarm: nobody's flag says that the ledger has it";
  EXPECT_EQ(check_->height(), height);
  EXPECT_EQ(check_->control().lease(1), epoch);
  EXPECT_TRUE(check_->check_refused(now, block).plans.empty()) << "a stream that begins again brings it again";
}

TEST_F(StopCheckTest, OfARefusedBlockAForgedStopOrOneByNobodyWhoMayIsNone) {
  Tx forged = stop(guard);
  forged.spoil.creator_signature = true;
  fabric::Block block = ledger_.block({forged, stop(peer3)});
  for (fabric::Transaction& tx : block.transactions) tx.signature_verified = true;  // as the reader found
  EXPECT_TRUE(check_->check_refused(now, block).plans.empty());
  EXPECT_FALSE(is_stopped_now());
}

TEST_F(StopCheckTest, WithAnyEndorserItIsObeyedAndOnTheLedgerWithoutAnAlarm) {
  for (const auto& endorser : {peer3, holder}) {
    start(control("tello1", epoch));
    Tx valid = stop(guard);
    valid.endorser = endorser;
    const auto checked = give(valid);
    EXPECT_EQ(checked.plans.size(), 1U);
    EXPECT_TRUE(checked.refused.empty());
    EXPECT_TRUE(checked.unconfirmed.empty());
    EXPECT_FALSE(check_->no_stop(now, 1));
  }
}

TEST_F(StopCheckTest, AnEventThatSaysSomethingElseHidesNoStop) {
  for (const char* name : {"", "command", "set", "clear_stop", "stop"}) {
    start(control("tello1", epoch));
    Tx bent = stop(guard);
    bent.event_name = name;
    bent.event_payload = "something";
    const auto checked = give(bent);
    EXPECT_EQ(checked.plans.size(), 1U) << name;
    EXPECT_EQ(checked.unconfirmed.size(), 1U) << name;
  }
}

TEST_F(StopCheckTest, ADuplicateIsNoStop) {
  EXPECT_TRUE(give(stop(guard, duplicate)).plans.empty());
  EXPECT_FALSE(is_stopped_now());
  Tx reported = stop(guard, duplicate);
  reported.by_flag = true;
  EXPECT_FALSE(give(reported).plans.empty()) << "a peer alone says that it was there before";
}

TEST_F(StopCheckTest, WhoMayNotStopIsNotObeyedAndAlarmed) {
  const crypto::IdentityName nobody{"Org1MSP", "CN=Nobody@org1.ledgerline"};
  expect_refused(stop(nobody, conflict), "of the drone's organisation, without a role");
  expect_refused(stop(outsider, conflict), "an operator of another organisation, without a grant");
  Tx own_endorser = stop(outsider);
  own_endorser.endorser = peer3;
  expect_refused(own_endorser, "the same flagged valid, which our own peer did not endorse");
  Tx forged = stop(guard, conflict);
  forged.spoil.creator_signature = true;
  EXPECT_EQ(give(forged).refused.at(0).why, RefusalReason::bad_signature);
  Tx elsewhere = stop(guard, conflict);
  elsewhere.contract = "another";
  EXPECT_EQ(give(elsewhere).refused.at(0).why, RefusalReason::wrong_channel);
  Control revoked = control("tello1", epoch);
  *revoked.add_revoked() = to_message(holder);
  start(revoked);
  expect_refused(stop(holder, conflict), "revoked");
  EXPECT_EQ(check_->control().unconfirmed_stops(), 0U);
}

TEST_F(StopCheckTest, AGrantLetsOneOfAnotherOrganisationStop) {
  Control granted = control("tello1", epoch);
  granted.add_grants()->mutable_to()->set_msp_id("Org3MSP");
  granted.mutable_grants(granted.grants_size() - 1)->set_stop(true);
  start(granted);
  EXPECT_EQ(give(stop(outsider, conflict)).plans.size(), 1U);
}

TEST_F(StopCheckTest, ARoleThatIsGivenOrTakenInABlockCountsFromThereOn) {
  const crypto::IdentityName fresh{"Org1MSP", "CN=Fresh@org1.ledgerline"};
  expect_refused(stop(fresh, conflict), "before");
  EnrollCall call;
  *call.mutable_identity() = to_message(fresh);
  call.set_role(OPERATOR);
  Controls reported;
  *reported.mutable_identity() = call.identity();
  reported.set_role(OPERATOR);
  Tx enrolled;
  enrolled.creator = {"Org1MSP", "CN=Admin@org1.ledgerline"};
  enrolled.event_name = "enroll";
  enrolled.event_payload = reported.SerializeAsString();
  enrolled.asked = fabric::Call{"enroll", {call.SerializeAsString()}};
  EXPECT_TRUE(give(enrolled).refused.empty());
  EXPECT_EQ(give(stop(fresh, conflict)).plans.size(), 1U);
}

TEST_F(StopCheckTest, ARoleIsTrustedByAPeerOfItsOwnOrganisation) {
  Control granted = control("tello1", epoch);
  granted.add_grants()->mutable_to()->set_msp_id("Org3MSP");
  granted.mutable_grants(granted.grants_size() - 1)->set_stop(true);
  start(granted);
  RevokeCall call;
  *call.mutable_identity() = to_message(outsider);
  Controls reported;
  *reported.mutable_identity() = call.identity();
  reported.set_role(REVOKED);
  Tx revoked;
  revoked.creator = {"Org3MSP", "CN=Admin@org3.ledgerline"};
  revoked.endorser = {"Org2MSP", "CN=peer0.org2.ledgerline"};
  revoked.event_name = "revoke";
  revoked.event_payload = reported.SerializeAsString();
  revoked.asked = fabric::Call{"revoke", {call.SerializeAsString()}};
  EXPECT_EQ(give(revoked).refused.at(0).why, RefusalReason::not_endorsed) << "by a third organisation's";
  revoked.endorser = peer3;
  EXPECT_TRUE(give(revoked).refused.empty());
  expect_refused(stop(outsider, conflict), "revoked by its own organisation");
}

TEST_F(StopCheckTest, AnOldOneIsNotObeyedHoweverOftenAndUnderWhateverFlag) {
  Control cleared = control("tello1", epoch);
  set_clears(cleared, to_message(guard), 2);
  start(cleared);
  for (int i = 0; i < 1'000; ++i) {
    const int code = i % 2 == 0 ? conflict : 0;
    ASSERT_TRUE(give(stop(guard, code, 1)).plans.empty());
    ASSERT_TRUE(give(stop(guard, code)).plans.empty()) << "its event says that nothing was cleared yet";
  }
  EXPECT_FALSE(is_stopped_now());
  EXPECT_EQ(give(stop(guard, conflict, 2)).plans.size(), 1U);
}

TEST_F(StopCheckTest, EachIsObeyedOnce) {
  Tx one = stop(guard, conflict);
  const fabric::Transaction tx = ledger_.transaction(one);
  EXPECT_EQ(give_again(tx, conflict).plans.size(), 1U);
  for (const int code : {conflict, not_endorsed, duplicate}) EXPECT_TRUE(give_again(tx, code).plans.empty()) << code;
}

TEST_F(StopCheckTest, ItStandsUntilTheDroneIsDownAndApplyStopsDoesNotShowIt) {
  (void)give(stop(guard, conflict));
  check_->control().on_landed(1);
  EXPECT_TRUE(is_stopped_now()) << "the ledger may have it all the same";
  EXPECT_FALSE(check_->no_stop(now, 1));
  EXPECT_TRUE(give(control_event("apply_stops", control("tello1", epoch), host)).refused.empty());
  EXPECT_TRUE(is_stopped_now()) << "it may still be in the air";
  check_->control().on_landed(1);
  EXPECT_FALSE(is_stopped_now());
  EXPECT_TRUE(check_->no_stop(now, 1));
}

TEST_F(StopCheckTest, AHiddenOneStaysWhereApplyStopsShowsIt) {
  (void)give(stop(guard, conflict));
  Control stopped = control("tello1", epoch);
  Stop one = stop_of("tello1");
  *one.mutable_stopper() = to_message(guard);
  add_stop(stopped, one);
  EXPECT_EQ(give(control_event("apply_stops", stopped, host)).refused.at(0).why, RefusalReason::altered) << "an alarm";
  check_->control().on_landed(1);
  EXPECT_TRUE(is_stopped_now());
  EXPECT_FALSE(check_->no_stop(now, 1));
}

TEST_F(StopCheckTest, ACutThatIsFlaggedInvalidLands) {
  const auto checked = give(stop(guard, conflict, {}, true));
  ASSERT_EQ(checked.plans.size(), 1U);
  EXPECT_EQ(checked.plans[0].action, PlanAction::stop);
  EXPECT_EQ(give(stop(guard, 0, {}, true)).plans.at(0).action, PlanAction::cut);
}

TEST_F(StopCheckTest, ABrokenChainStopsNothingButIsSilence) {
  ledger_.lose_a_block();
  (void)give(stop(guard));
  start(control("tello1", epoch));
  (void)check_->check(now, now_s, ledger_.block({}));
  ledger_.lose_a_block();
  const auto checked = give(stop(guard, conflict));
  EXPECT_FALSE(checked.chain_ok);
  EXPECT_TRUE(checked.plans.empty());
}

}  // namespace
}  // namespace ledgerline::agent::stops
