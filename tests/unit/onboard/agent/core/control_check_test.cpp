#include <gtest/gtest.h>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

/// Control events from a peer that has its real key and says what it likes: whatever somebody signed for something else
/// changes no record.
namespace ledgerline::agent::control_events {
namespace {

using agent::testing::control;
using agent::testing::LedgerOfTests;
using agent::testing::stop_of;
using Tx = LedgerOfTests::Tx;

constexpr TimeNs now = 100 * ns_per_s;
constexpr std::int64_t now_s = 1'700'000'000;
constexpr std::uint64_t epoch = 5;
const crypto::IdentityName holder = LedgerOfTests::operator_name();
const crypto::IdentityName rival{"Org2MSP", "CN=User2@org2.ledgerline"};
const crypto::IdentityName owner{"Org1MSP", "CN=User1@org1.ledgerline"};
const crypto::IdentityName own_guard{"Org1MSP", "CN=Guard@org1.ledgerline"};
const crypto::IdentityName admin{"Org1MSP", "CN=Admin@org1.ledgerline"};

class ControlCheckTest : public ::testing::Test {
 protected:
  ControlCheckTest() { start(record_); }
  void start(const Control& record) {
    record_ = record;
    check_.emplace(CommandCheckSettings{}, std::vector<DroneName>{{1, "tello1"}}, *registry_);
    check_->control().set_control(record_);
  }
  static std::string controls(const Control& record) {
    Controls event;
    *event.add_controls() = record;
    return event.SerializeAsString();
  }
  static Tx tx(const std::string& name, std::string payload, const crypto::IdentityName& by) {
    Tx tx;
    tx.creator = by;
    tx.event_name = name;
    tx.event_payload = std::move(payload);
    return tx;
  }
  /// As an honest peer makes it, with this record.
  static Tx event(const std::string& name, const Control& after, const crypto::IdentityName& by) {
    return tx(name, controls(after), by);
  }
  CheckedBlock give(const Tx& one) { return check_->check(now, now_s, ledger_.block({one})); }
  void expect_refused(const Tx& one, const char* what) {
    const std::uint64_t before = check_->control().refused_events();
    const auto checked = give(one);
    EXPECT_TRUE(checked.plans.empty()) << what;
    ASSERT_EQ(checked.refused.size(), 1U) << what;
    EXPECT_EQ(checked.refused[0].why, RefusalReason::altered) << what;
    EXPECT_EQ(check_->control().refused_events(), before + 1) << what;
  }
  void expect_taken(const Tx& one) {
    const auto checked = give(one);
    EXPECT_TRUE(checked.refused.empty());
  }
  static Control stopped(const std::vector<crypto::IdentityName>& by) {
    Control record = control("tello1", epoch);
    for (const auto& who : by) {
      Stop stop = stop_of("tello1");
      *stop.mutable_stopper() = to_message(who);
      add_stop(record, stop);
    }
    return record;
  }
  bool is_stopped_now() const { return check_->standing_stop(now, 1).has_value(); }

  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP", "Org3MSP"});
  LedgerOfTests ledger_;
  Control record_ = control("tello1", epoch);
  std::optional<CommandCheck> check_;
};

TEST_F(ControlCheckTest, AClearInsideAnotherCallClearsNoStop) {
  start(stopped({own_guard}));
  for (const char* function : {"set", "command", "stop", "acquire", "apply_stops", "get"}) {
    for (const auto& by : {owner, holder, own_guard}) {
      Tx lie = event("clear_stop", control("tello1", epoch), by);
      lie.asked = fabric::Call{function, {"tello1"}};
      expect_refused(lie, function);
    }
  }
  EXPECT_TRUE(is_stopped_now());
}

TEST_F(ControlCheckTest, AClearOfAnotherDroneClearsNoStop) {
  start(stopped({own_guard}));
  Tx lie = event("clear_stop", control("tello1", epoch), own_guard);
  lie.asked = fabric::Call{"clear_stop", {"tello2"}};
  expect_refused(lie, "other drone");
  lie.asked = fabric::Call{"clear_stop", {"tello1", "tello2"}};
  expect_refused(lie, "one of two drones");
  EXPECT_TRUE(is_stopped_now());
}

TEST_F(ControlCheckTest, ClearStopClearsItsCreatorsStopOrAllByTheOwnersOrganisation) {
  start(stopped({holder, own_guard}));
  Control none = control("tello1", epoch), his = stopped({own_guard});
  for (Control* record : {&none, &his}) set_clears(*record, to_message(holder), 1);
  set_clears(none, to_message(own_guard), 1);
  expect_refused(event("clear_stop", none, holder), "all of them by one of another organisation");
  expect_refused(event("clear_stop", stopped({holder}), holder), "another's in place of his own");
  expect_taken(event("clear_stop", his, holder));
  EXPECT_TRUE(is_stopped_now());
  expect_taken(event("clear_stop", none, admin));
  EXPECT_FALSE(is_stopped_now());
}

TEST_F(ControlCheckTest, AnAcquireMakesItsCreatorTheHolderAndNothingElse) {
  Control taken = control("tello1", epoch + 1);
  *taken.mutable_holder() = to_message(rival);
  taken.set_priority(1);
  expect_refused(event("acquire", taken, holder), "of somebody else");
  Control other_owner = taken;
  *other_owner.mutable_owner() = to_message(rival);
  expect_refused(event("acquire", other_owner, rival), "the owner with it");
  Control no_growth = taken;
  no_growth.set_epoch(epoch);
  expect_refused(event("acquire", no_growth, rival), "an epoch that does not grow");
  Control back = taken;
  back.set_epoch(epoch - 1);
  expect_refused(event("acquire", back, rival), "an epoch that goes back");
  Control own_back = control("tello1", epoch - 1);
  expect_refused(event("acquire", own_back, holder), "the holder's own epoch goes back");
  Control without_right = taken;
  without_right.set_priority(0);
  expect_refused(event("acquire", without_right, rival), "no higher priority");
  const auto lost = give(event("acquire", taken, rival));
  EXPECT_TRUE(lost.refused.empty());
  ASSERT_EQ(lost.plans.size(), 1U) << "the loser's plan is not flown to its end";
  EXPECT_EQ(lost.plans[0].action, PlanAction::fly);
  EXPECT_EQ(lost.plans[0].count, 0U);
  EXPECT_EQ(lost.plans[0].sequence, 0U) << "the first of the new holder is newer";
  EXPECT_EQ(lost.plans[0].epoch, epoch + 1);
  EXPECT_TRUE(give(event("acquire", taken, rival))
                  .plans.empty());  // had already, as by a record that was read beside the blocks
}

TEST_F(ControlCheckTest, AnAcquireClearsNoStop) {
  start(stopped({own_guard}));
  Control taken = control("tello1", epoch + 1);
  *taken.mutable_holder() = to_message(rival);
  taken.set_priority(1);
  expect_refused(event("acquire", taken, rival), "without the stop");
  *taken.mutable_stoppers() = record_.stoppers();
  expect_taken(event("acquire", taken, rival));
  EXPECT_TRUE(is_stopped_now());
}

TEST_F(ControlCheckTest, AReleaseIsItsHoldersOwn) {
  Control released = control("tello1", epoch + 1);
  released.clear_holder();
  expect_refused(event("release", released, rival), "by another");
  Control handed_on = control("tello1", epoch + 1);
  *handed_on.mutable_holder() = to_message(rival);
  expect_refused(event("release", handed_on, holder), "to somebody");
  expect_taken(event("release", released, holder));
}

TEST_F(ControlCheckTest, AnAcquireStaysWithinTheGrantsOfTheRecordBefore) {
  Control taken = control("tello1", epoch + 1);
  *taken.mutable_holder() = to_message(rival);
  taken.set_priority(10);
  expect_refused(event("acquire", taken, rival), "more than the priority that is granted");
  const crypto::IdentityName outsider{"Org3MSP", "CN=User1@org3.ledgerline"};
  *taken.mutable_holder() = to_message(outsider);
  taken.set_priority(1);
  expect_refused(event("acquire", taken, outsider), "nothing is granted");
  *taken.mutable_holder() = to_message(own_guard);
  taken.set_priority(10);
  expect_taken(event("acquire", taken, own_guard));
}

TEST_F(ControlCheckTest, AnEvictionIsOfTheOwnersOrganisationAndEndsTheLease) {
  Control free = control("tello1", epoch + 1);
  free.clear_holder();
  expect_refused(event("evict", free, rival), "by another organisation");
  expect_refused(event("evict", free, holder), "by the holder, who releases it");
  Control old = free;
  old.set_epoch(epoch);
  expect_refused(event("evict", old, owner), "under the same epoch");
  Control handed_on = control("tello1", epoch + 1);
  *handed_on.mutable_holder() = to_message(own_guard);
  expect_refused(event("evict", handed_on, own_guard), "to somebody");
  DronesCall call;
  call.add_drones("tello1");
  call.add_epochs(epoch - 1);
  Tx late = event("evict", free, owner);
  late.asked = fabric::Call{"evict", {call.SerializeAsString()}};
  expect_refused(late, "of a lease that was over");
  call.set_epochs(0, epoch);
  late.asked = fabric::Call{"evict", {call.SerializeAsString()}};
  expect_taken(late);
}

TEST_F(ControlCheckTest, AGrantIsOfAnAdministratorAndIsWhatWasAskedFor) {
  GrantCall call;
  call.add_drones("tello1");
  call.mutable_grant()->mutable_to()->set_msp_id("Org3MSP");
  call.mutable_grant()->set_fly(true);
  Control after = record_;
  *after.add_grants() = call.grant();
  const auto granted = [&](const Control& reported, const crypto::IdentityName& by) {
    Tx one = event("grant", reported, by);
    one.asked = fabric::Call{"grant", {call.SerializeAsString()}};
    return one;
  };
  expect_refused(granted(after, own_guard), "no administrator");
  expect_refused(granted(after, {"Org2MSP", "CN=Admin@org2.ledgerline"}), "of another organisation");
  Control more = after;
  more.mutable_grants(2)->set_cut(true);
  expect_refused(granted(more, admin), "more than was asked for");
  Control without_holder = after;
  without_holder.clear_holder();
  without_holder.set_epoch(epoch + 1);
  expect_refused(granted(without_holder, admin), "the lease with it");
  expect_taken(granted(after, admin));

  record_ = after;
  call.mutable_grant()->mutable_to()->set_msp_id("Org2MSP");
  call.mutable_grant()->set_fly(false);
  Control closed = control("tello1", epoch + 1);
  closed.clear_holder();
  closed.mutable_grants()->erase(closed.grants().begin());
  *closed.add_grants() = after.grants(2);
  Control still_held = closed;
  *still_held.mutable_holder() = to_message(holder);
  expect_refused(granted(still_held, admin), "the lease stays");
  expect_taken(granted(closed, admin));
  Control again = closed;
  *again.mutable_holder() = to_message(holder);
  again.set_epoch(epoch + 2);
  expect_refused(event("acquire", again, holder), "it is taken back");
}

TEST_F(ControlCheckTest, AnEnrolmentIsOfAnAdministratorOfTheSameOrganisation) {
  Control moved = control("tello1", epoch);
  *moved.mutable_owner() = to_message({"Org1MSP", "CN=Host2@org1.ledgerline"});
  const auto enrolled = [&](const Control& after, const crypto::IdentityName& by) {
    Controls reported;
    *reported.add_controls() = after;
    *reported.mutable_identity() = after.owner();
    return tx("enroll", reported.SerializeAsString(), by);
  };
  expect_refused(enrolled(moved, owner), "no administrator");
  expect_refused(enrolled(moved, {"Org2MSP", "CN=Admin@org2.ledgerline"}), "another organisation's administrator");
  Control stolen = control("tello1", epoch);
  *stolen.mutable_owner() = to_message(rival);
  expect_refused(enrolled(stolen, {"Org2MSP", "CN=Admin@org2.ledgerline"}), "to another organisation");
  Control with_holder = moved;
  *with_holder.mutable_holder() = to_message(rival);
  expect_refused(enrolled(with_holder, admin), "the holder with it");
  expect_taken(enrolled(moved, admin));
}

class HandOverTest : public ControlCheckTest {
 protected:
  static Tx answer(const char* function, const Control& after, const crypto::IdentityName& by,
                   const crypto::IdentityName& to = rival) {
    AnswerCall call;
    call.add_drones("tello1");
    *call.mutable_to() = to_message(to);
    Tx one = event(function, after, by);
    one.asked = fabric::Call{function, {call.SerializeAsString()}};
    return one;
  }
  static Control requested(const crypto::IdentityName& who, std::uint32_t priority = 3) {
    Control record = control("tello1", epoch);
    add_request(record, to_message(who), nullptr, priority);
    return record;
  }
  static Tx request(const Control& after, const crypto::IdentityName& by, std::uint32_t priority = 3) {
    LeaseCall call;
    call.add_drones("tello1");
    call.set_priority(priority);
    Tx one = event("request", after, by);
    one.asked = fabric::Call{"request", {call.SerializeAsString()}};
    return one;
  }
  static Control handed_over() {
    Control record = control("tello1", epoch + 1);
    *record.mutable_holder() = to_message(rival);
    record.set_priority(3);
    return record;
  }
};

TEST_F(HandOverTest, ARequestIsItsCreatorsOwnAndWithinItsGrant) {
  const crypto::IdentityName outsider{"Org3MSP", "CN=User1@org3.ledgerline"};
  expect_refused(request(requested(rival), holder), "in another's name");
  expect_refused(request(requested(rival, 4), rival), "of another priority than was asked for");
  expect_refused(request(requested(rival, 10), rival, 10), "of more than is granted");
  expect_refused(request(requested(outsider), outsider), "of what is not granted");
  Control with_lease = handed_over();
  expect_refused(request(with_lease, rival), "with the lease");
  expect_taken(request(requested(rival), rival));
}

TEST_F(HandOverTest, TheHolderGivesTheLeaseToOneWhoRequestedIt) {
  expect_refused(answer("hand_over", handed_over(), holder), "nobody has requested it");
  start(requested(rival));
  expect_refused(answer("hand_over", handed_over(), rival), "taken by the requester");
  expect_refused(answer("hand_over", handed_over(), own_guard), "by a third one");
  expect_refused(answer("hand_over", handed_over(), holder, own_guard), "asked for another");
  Control same_epoch = handed_over();
  same_epoch.set_epoch(epoch);
  expect_refused(answer("hand_over", same_epoch, holder), "under the same epoch");
  Control higher = handed_over();
  higher.set_priority(9);
  expect_refused(answer("hand_over", higher, holder), "at another priority than requested");
  Control revoked = requested(rival);
  apply_role(revoked, to_message(holder), REVOKED);
  start(revoked);
  expect_refused(answer("hand_over", handed_over(), holder), "of a revoked one");
  start(requested(rival));
  expect_taken(answer("hand_over", handed_over(), holder));
}

TEST_F(HandOverTest, ARequestIsDeniedByTheHolderOrWithdrawn) {
  for (const auto& by : {holder, rival}) {
    start(requested(rival));
    expect_refused(answer("deny", control("tello1", epoch), own_guard), "by a third one");
    expect_refused(answer("deny", control("tello1", epoch), holder, own_guard), "of another");
    expect_taken(answer("deny", control("tello1", epoch), by));
    expect_refused(answer("hand_over", handed_over(), holder), "it was denied");
  }
}

class RevocationTest : public ControlCheckTest {
 protected:
  static Tx revoke(const crypto::IdentityName& who, const crypto::IdentityName& by) {
    Controls reported;
    *reported.mutable_identity() = to_message(who);
    reported.set_role(REVOKED);
    RevokeCall call;
    *call.mutable_identity() = reported.identity();
    Tx one = tx("revoke", reported.SerializeAsString(), by);
    one.asked = fabric::Call{"revoke", {call.SerializeAsString()}};
    return one;
  }
  RefusalReason command_refused() {
    CommandCall call;
    DronePlan& plan = *call.add_plans();
    plan.set_drone("tello1");
    plan.set_epoch(epoch);
    const auto checked = give(tx("command", call.SerializeAsString(), holder));
    return checked.refused.empty() ? RefusalReason::none : checked.refused[0].why;
  }
  const crypto::IdentityName its_admin{"Org2MSP", "CN=Admin@org2.ledgerline"};
};

TEST_F(RevocationTest, ARevokedHolderFliesNothingFromThatBlockOn) {
  EXPECT_EQ(command_refused(), RefusalReason::unknown_stamp);
  const auto checked = give(revoke(holder, its_admin));
  EXPECT_TRUE(checked.refused.empty());
  EXPECT_EQ(checked.revoked, std::vector<DroneNumber>{1});
  EXPECT_EQ(command_refused(), RefusalReason::revoked);
}

TEST_F(RevocationTest, ItIsOfAnAdministratorOfItsOrganisationAndAsItWasAskedFor) {
  expect_refused(revoke(holder, admin), "by another organisation's administrator");
  expect_refused(revoke(holder, rival), "by no administrator");
  Tx other = revoke(rival, its_admin);
  other.event_payload = revoke(holder, its_admin).event_payload;
  expect_refused(other, "of another identity");
  Tx undone = revoke(holder, its_admin);
  Controls reported;
  *reported.mutable_identity() = to_message(holder);
  reported.set_role(OPERATOR);
  undone.event_payload = reported.SerializeAsString();
  expect_refused(undone, "as another role");
  EXPECT_EQ(command_refused(), RefusalReason::unknown_stamp);
}

TEST_F(RevocationTest, OfSomebodyWhomNoRecordNamesItIsNothing) {
  const auto checked = give(revoke(rival, its_admin));
  EXPECT_TRUE(checked.refused.empty());
  EXPECT_TRUE(checked.revoked.empty());
  EXPECT_EQ(command_refused(), RefusalReason::unknown_stamp);
}

TEST_F(RevocationTest, ApplyStopsOfTheHostEndsItsLeaseAndNothingElse) {
  Control ended = control("tello1", epoch + 1);
  ended.clear_holder();
  expect_refused(event("apply_stops", ended, owner), "nobody is revoked");
  ended.mutable_grants()->RemoveLast();  // which was to him alone
  (void)give(revoke(holder, its_admin));
  Control same_epoch = ended;
  same_epoch.set_epoch(epoch);
  expect_refused(event("apply_stops", same_epoch, owner), "under the same epoch");
  expect_refused(event("apply_stops", ended, own_guard), "by another than the host");
  Control handed_on = ended;
  *handed_on.mutable_holder() = to_message(rival);
  expect_refused(event("apply_stops", handed_on, owner), "to somebody");
  expect_taken(event("apply_stops", ended, owner));
  EXPECT_EQ(command_refused(), RefusalReason::not_holder);
}

TEST_F(RevocationTest, EnrolledAgainItFliesAgain) {
  (void)give(revoke(holder, its_admin));
  Controls reported;
  *reported.mutable_identity() = to_message(holder);
  reported.set_role(OPERATOR);
  EnrollCall call;
  *call.mutable_identity() = reported.identity();
  call.set_role(OPERATOR);
  Tx enrolled = tx("enroll", reported.SerializeAsString(), its_admin);
  enrolled.asked = fabric::Call{"enroll", {call.SerializeAsString()}};
  enrolled.creator = rival;
  expect_refused(enrolled, "by no administrator");
  enrolled.creator = its_admin;
  expect_taken(enrolled);
  EXPECT_EQ(command_refused(), RefusalReason::unknown_stamp);
}

TEST_F(ControlCheckTest, LinkLearnsWhenTheLastStopIsClearedAndWhetherTheOwnersOrganisationClearedIt) {
  start(stopped({holder, own_guard}));
  Control one_left = stopped({holder}), none = control("tello1", epoch);
  for (Control* record : {&one_left, &none}) set_clears(*record, to_message(own_guard), 1);
  set_clears(none, to_message(holder), 1);
  EXPECT_FALSE(check_->no_stop(now, 1));
  EXPECT_TRUE(give(event("clear_stop", one_left, own_guard)).plans.empty()) << "one is left";
  auto plans = give(event("clear_stop", none, holder)).plans;
  ASSERT_EQ(plans.size(), 1U);
  EXPECT_EQ(plans[0].action, PlanAction::stop_cleared) << "another organisation's clears no local stop";
  ASSERT_TRUE(check_->no_stop(now, 1));
  EXPECT_EQ(check_->no_stop(now, 1)->action, PlanAction::stop_cleared);
  EXPECT_TRUE(give(event("clear_stop", none, own_guard)).plans.empty()) << "nobody had it stopped";

  start(stopped({holder}));
  none = control("tello1", epoch);
  set_clears(none, to_message(holder), 1);
  plans = give(event("clear_stop", none, admin)).plans;
  ASSERT_EQ(plans.size(), 1U);
  EXPECT_EQ(plans[0].action, PlanAction::stop_cleared_by_owner);
}

TEST_F(ControlCheckTest, BlocksWrittenBeforeHoldTheOldNamesOfTheFunctions) {
  start(stopped({own_guard}));
  Control none = control("tello1", epoch);
  set_clears(none, to_message(own_guard), 1);
  expect_taken(event("fold", record_, owner));
  Tx mixed = event("resume", none, own_guard);
  mixed.asked = fabric::Call{"clear_stop", {"tello1"}};
  expect_refused(mixed, "an event of another name than its call");
  EXPECT_TRUE(is_stopped_now());
  const auto plans = give(event("resume", none, own_guard)).plans;
  ASSERT_EQ(plans.size(), 1U);
  EXPECT_EQ(plans[0].action, PlanAction::stop_cleared_by_owner);
}

TEST_F(ControlCheckTest, ApplyStopsChangesNothing) {
  start(stopped({own_guard}));
  expect_refused(event("apply_stops", control("tello1", epoch), owner), "a stop less");
  expect_refused(event("apply_stops", control("tello1", epoch + 1), owner), "a new epoch");
  expect_taken(event("apply_stops", record_, owner));
  EXPECT_TRUE(is_stopped_now());
}

TEST_F(ControlCheckTest, AStopIsItsCreatorsOwnAndCutsOnlyWhereItWasAskedTo) {
  Stops stops;
  *stops.add_stops() = stop_of("tello1", true);
  Tx cut = tx("stop", stops.SerializeAsString(), holder);
  cut.asked = fabric::Call{"stop", {"tello1"}};
  expect_refused(cut, "a cut that was not asked for");
  cut.asked = fabric::Call{"set", {"tello1"}};
  expect_refused(cut, "in a set");
  cut.asked.reset();
  cut.creator = rival;
  expect_refused(cut, "in another's name");
  *stops.mutable_stops(0)->mutable_stopper() = to_message(rival);
  cut.event_payload = stops.SerializeAsString();
  expect_refused(cut, "by one who may not cut");
  EXPECT_FALSE(is_stopped_now());
  *stops.mutable_stops(0)->mutable_stopper() = to_message(own_guard);
  cut.event_payload = stops.SerializeAsString();
  cut.creator = own_guard;
  EXPECT_EQ(give(cut).plans.at(0).action, PlanAction::cut);
}

/// A peer that calls an old stop valid, or bends the count that its stopper signed.
TEST_F(ControlCheckTest, AnOldStopSentAThousandTimesAfterAClearStopsNothing) {
  start(stopped({own_guard}));
  Control cleared = control("tello1", epoch);
  set_clears(cleared, to_message(own_guard), 1);
  expect_refused(event("clear_stop", control("tello1", epoch), own_guard), "a clear that is not counted");
  expect_taken(event("clear_stop", cleared, own_guard));
  DronesCall call;
  call.add_drones("tello1");
  call.add_clears(0);
  Stops stops;
  *stops.add_stops() = stop_of("tello1");
  *stops.mutable_stops(0)->mutable_stopper() = to_message(own_guard);
  Tx old = tx("stop", stops.SerializeAsString(), own_guard);
  old.asked = fabric::Call{"stop", {call.SerializeAsString()}};
  for (int i = 0; i < 1'000; ++i) ASSERT_TRUE(give(old).plans.empty());
  EXPECT_FALSE(is_stopped_now());
  stops.mutable_stops(0)->set_clears(1);
  old.event_payload = stops.SerializeAsString();
  expect_refused(old, "a count that was not asked for");
  EXPECT_FALSE(is_stopped_now());
  call.set_clears(0, 1);
  old.asked = fabric::Call{"stop", {call.SerializeAsString()}};
  EXPECT_EQ(give(old).plans.size(), 1U) << "one for this count";
}

TEST_F(ControlCheckTest, WithoutARecordBeforeOnlyAStopToLandIsTaken) {
  check_.emplace(CommandCheckSettings{}, std::vector<DroneName>{{1, "tello1"}}, *registry_);
  expect_refused(event("acquire", record_, holder), "from nothing");
  Stops stops;
  *stops.add_stops() = stop_of("tello1", true);
  expect_refused(tx("stop", stops.SerializeAsString(), holder), "whose drone it is is not known");
  stops.mutable_stops(0)->set_cut(false);
  EXPECT_EQ(give(tx("stop", stops.SerializeAsString(), holder)).plans.at(0).action, PlanAction::stop);
}

}  // namespace
}  // namespace ledgerline::agent::control_events
