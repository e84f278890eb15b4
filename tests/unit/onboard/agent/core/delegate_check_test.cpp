#include <gtest/gtest.h>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

/// Who commands in a holder's place: its commands are flown, and a peer that lies makes nobody one.
namespace ledgerline::agent::delegates {
namespace {

using agent::testing::control;
using agent::testing::LedgerOfTests;
using Tx = LedgerOfTests::Tx;

constexpr TimeNs stamp = 100 * ns_per_s;
constexpr TimeNs now = stamp + 20 * ns_per_ms;
constexpr std::int64_t now_s = 1'700'000'000;
constexpr std::uint64_t boot = 42;
constexpr std::uint64_t epoch = 5;
const crypto::IdentityName holder = LedgerOfTests::operator_name();
const crypto::IdentityName rival{"Org2MSP", "CN=User2@org2.ledgerline"};
const crypto::IdentityName station{"Org2MSP", "CN=station"}, laptop{"Org2MSP", "CN=laptop"};
const crypto::IdentityName foreign{"Org1MSP", "CN=station"};
const crypto::IdentityName host{"Org1MSP", "CN=User1@org1.ledgerline"};
const crypto::IdentityName admin1{"Org1MSP", "CN=Admin@org1.ledgerline"};
const crypto::IdentityName admin2{"Org2MSP", "CN=Admin@org2.ledgerline"};

/// The holder's record; null: without a delegate.
Control with_delegate(const crypto::IdentityName* delegate, std::uint64_t at = epoch) {
  Control record = control("tello1", at);
  if (delegate != nullptr) *record.mutable_delegate() = to_message(*delegate);
  return record;
}
Control free_again(std::uint64_t at = epoch + 1) {
  Control record = control("tello1", at);
  record.clear_holder();
  return record;
}

class DelegateCheck : public ::testing::Test {
 protected:
  DelegateCheck() { start(with_delegate(&station)); }
  void start(const Control& record) {
    check_.emplace(CommandCheckSettings{}, std::vector<DroneName>{{1, "tello1"}}, *registry_);
    check_->control().set_control(record);
    StateSample sample;
    sample.drone = 1;
    sample.boot_id = boot;
    sample.stamp_ns = stamp;
    check_->add_sent_state(sample);
    sequence_ = 0;
  }
  CheckedBlock give(const Tx& one) { return check_->check(now, now_s, ledger_.block({one})); }
  CheckedBlock command(const crypto::IdentityName& by, std::uint64_t at = epoch, Action action = FLY) {
    CommandCall call;
    DronePlan& plan = *call.add_plans();
    plan.set_drone("tello1");
    plan.set_action(action);
    plan.set_boot_id(boot);
    plan.set_state_stamp_ns(stamp);
    plan.set_sequence(++sequence_);
    plan.set_epoch(at);
    if (action == FLY) plan.add_setpoints()->set_at_ns(stamp + 50 * ns_per_ms);
    Tx one;
    one.creator = by;
    one.event_payload = call.SerializeAsString();
    return give(one);
  }
  bool flies(const crypto::IdentityName& by, std::uint64_t at = epoch, Action action = FLY) {
    return command(by, at, action).plans.size() == 1;
  }
  RefusalReason refused(const crypto::IdentityName& by, std::uint64_t at = epoch) {
    const auto checked = command(by, at);
    return checked.refused.empty() ? RefusalReason::none : checked.refused[0].why;
  }
  static Tx event(const std::string& name, const Control& after, const crypto::IdentityName& by) {
    Controls reported;
    *reported.add_controls() = after;
    Tx one;
    one.creator = by;
    one.event_name = name;
    one.event_payload = reported.SerializeAsString();
    return one;
  }
  /// acquire or request, as its creator asked for it, with the record that a peer made of it.
  static Tx lease_call(const std::string& name, const Control& after, const crypto::IdentityName& by,
                       const crypto::IdentityName* asked, std::uint32_t priority = 0) {
    LeaseCall call;
    call.add_drones("tello1");
    call.set_priority(priority);
    if (asked != nullptr) *call.mutable_delegate() = to_message(*asked);
    Tx one = event(name, after, by);
    one.asked = fabric::Call{name, {call.SerializeAsString()}};
    return one;
  }
  static Tx hand_over(const Control& after, const crypto::IdentityName& by) {
    AnswerCall call;
    call.add_drones("tello1");
    *call.mutable_to() = to_message(rival);
    Tx one = event("hand_over", after, by);
    one.asked = fabric::Call{"hand_over", {call.SerializeAsString()}};
    return one;
  }
  static Tx revoke(const crypto::IdentityName& who) {
    Controls reported;
    *reported.mutable_identity() = to_message(who);
    reported.set_role(REVOKED);
    RevokeCall call;
    *call.mutable_identity() = reported.identity();
    Tx one;
    one.creator = who.msp_id == "Org1MSP" ? admin1 : admin2;
    one.event_name = "revoke";
    one.event_payload = reported.SerializeAsString();
    one.asked = fabric::Call{"revoke", {call.SerializeAsString()}};
    return one;
  }
  void expect_lie(const Tx& one, const char* what) {
    const auto checked = give(one);
    ASSERT_EQ(checked.refused.size(), 1U) << what;
    EXPECT_EQ(checked.refused[0].why, RefusalReason::altered) << what;
  }
  void expect_taken(const Tx& one) { EXPECT_TRUE(give(one).refused.empty()); }

  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  LedgerOfTests ledger_;
  std::optional<CommandCheck> check_;
  std::uint64_t sequence_ = 0;
};

TEST_F(DelegateCheck, TheDelegateCommandsAndNobodyElse) {
  EXPECT_TRUE(flies(station));
  for (const auto& who : {holder, rival, laptop, foreign})
    EXPECT_EQ(refused(who), RefusalReason::not_holder) << who.subject;
  EXPECT_EQ(refused(station, epoch - 1), RefusalReason::wrong_epoch);
  start(with_delegate(nullptr));
  EXPECT_TRUE(flies(holder)) << "of a record of before";
  EXPECT_EQ(refused(station), RefusalReason::not_holder);
  start(free_again(epoch));
  for (const auto& who : {holder, station, crypto::IdentityName{}}) EXPECT_FALSE(flies(who)) << who.subject;
}

TEST_F(DelegateCheck, ItsCommandsKeepTheHolderFromBeingIdle) {
  EXPECT_EQ(command(station).commanded, std::vector<DroneNumber>{1});
  EXPECT_TRUE(command(holder).commanded.empty());
}

TEST_F(DelegateCheck, OfAStoppedDroneItLandsAndNothingElse) {
  Control stopped = with_delegate(&station);
  add_stop(stopped, agent::testing::stop_of("tello1"));
  start(stopped);
  EXPECT_EQ(refused(station), RefusalReason::stopped);
  EXPECT_TRUE(flies(station, epoch, LAND));
  EXPECT_FALSE(flies(holder, epoch, LAND));
}

TEST_F(DelegateCheck, WithEitherRevokedNothingFliesUntilApplyStopsHasEndedTheLease) {
  for (const auto& who : {station, holder}) {
    start(with_delegate(&station));
    EXPECT_EQ(give(revoke(who)).revoked, std::vector<DroneNumber>{1}) << "apply_stops is due";
    EXPECT_EQ(refused(station), RefusalReason::revoked) << who.subject;
    Control ended = free_again();
    if (who == holder) ended.mutable_grants()->RemoveLast();  // which was to him alone
    Control kept = ended;
    *kept.mutable_delegate() = to_message(station);
    expect_lie(event("apply_stops", kept, host), "the delegate stays");
    expect_taken(event("apply_stops", ended, host));
    EXPECT_EQ(refused(station, epoch + 1), RefusalReason::not_holder);
  }
}

TEST_F(DelegateCheck, AnAcquireHasTheDelegateThatItsCreatorAskedFor) {
  start(free_again(epoch - 1));
  const Control alone = with_delegate(nullptr), ours = with_delegate(&station), theirs = with_delegate(&laptop);
  expect_lie(lease_call("acquire", ours, holder, nullptr), "a delegate whom nobody asked for");
  expect_lie(lease_call("acquire", theirs, holder, &station), "another delegate");
  expect_lie(lease_call("acquire", alone, holder, &station), "without the delegate");
  EXPECT_FALSE(flies(station) || flies(laptop) || flies(holder));
  expect_taken(lease_call("acquire", ours, holder, &station));
  EXPECT_TRUE(flies(station));
}

TEST_F(DelegateCheck, AnAcquireInAnotherFormHasItsDelegateToo) {
  start(free_again(epoch - 1));
  Tx one = event("acquire", with_delegate(&station), holder);
  one.asked =
      fabric::Call{"acquire", {R"({"drones":["tello1"],"delegate":{"mspId":"Org2MSP","subject":"CN=station"}})"}};
  expect_taken(one);
  EXPECT_TRUE(flies(station));
  start(free_again(epoch - 1));
  Tx plain = event("acquire", with_delegate(&station), holder);
  plain.asked = fabric::Call{"acquire", {"tello1", "delegate=CN=station"}};
  expect_lie(plain, "plain strings name none");
}

TEST_F(DelegateCheck, ADelegateIsAnotherOneOfItsHoldersOrganisation) {
  start(free_again(epoch - 1));
  const crypto::IdentityName nobody{"Org2MSP", ""};
  for (const auto& who : {foreign, holder, nobody}) {
    expect_lie(lease_call("acquire", with_delegate(&who), holder, &who), who.subject.c_str());
    Control record = control("tello1", epoch);
    start(record);
    Control after = record;
    add_request(after, to_message(rival), delegate_in(with_delegate(&who)), 0);
    if (who != holder) expect_lie(lease_call("request", after, rival, &who), who.subject.c_str());
    start(free_again(epoch - 1));
  }
}

TEST_F(DelegateCheck, ARevokedOneIsNoDelegate) {
  (void)give(revoke(station));
  Control same = with_delegate(&station);
  *same.add_revoked() = to_message(station);
  same.set_priority(1);
  expect_lie(lease_call("acquire", same, holder, &station, 1), "by the holder");
  Control taken = same;
  *taken.mutable_holder() = to_message(rival);
  taken.set_epoch(epoch + 1);
  taken.set_priority(0);
  expect_lie(lease_call("acquire", taken, rival, &station), "by another");
  expect_taken(lease_call("acquire", with_delegate(&laptop, epoch + 1), holder, &laptop));
  EXPECT_TRUE(flies(laptop, epoch + 1));
}

TEST_F(DelegateCheck, ALeaseOfARevokedDelegateKeepsNobodyOutAndIsNotHandedOn) {
  Control before = with_delegate(&station);
  before.set_priority(5);
  add_request(before, to_message(rival), delegate_in(with_delegate(&station)), 3);
  start(before);
  Control taken = before;
  taken.clear_delegate();
  *taken.mutable_holder() = to_message(rival);
  taken.set_epoch(epoch + 1);
  taken.set_priority(0);
  taken.clear_requests();
  expect_lie(lease_call("acquire", taken, rival, nullptr), "of a lower priority");
  (void)give(revoke(station));
  Control given = taken;
  *given.mutable_delegate() = to_message(station);
  *given.add_revoked() = to_message(station);
  given.set_priority(3);
  expect_lie(hand_over(given, holder), "with the revoked one");
  expect_taken(lease_call("acquire", taken, rival, nullptr));
  EXPECT_TRUE(flies(rival, epoch + 1));
}

TEST_F(DelegateCheck, AnotherDelegateIsAnotherEpochAndTheSameOneIsNot) {
  expect_lie(lease_call("acquire", with_delegate(&laptop), holder, &laptop), "another delegate under the same epoch");
  expect_lie(lease_call("acquire", with_delegate(nullptr), holder, nullptr), "none under the same epoch");
  expect_lie(lease_call("acquire", with_delegate(&station, epoch + 1), holder, &station),
             "the same under another epoch");
  expect_taken(lease_call("acquire", with_delegate(nullptr, epoch + 1), holder, nullptr));
  EXPECT_EQ(refused(station, epoch + 1), RefusalReason::not_holder);
  EXPECT_TRUE(flies(holder, epoch + 1));
}

TEST_F(DelegateCheck, ARequestHasTheDelegateThatItsCreatorAskedFor) {
  const auto requested = [](const crypto::IdentityName* delegate) {
    Control record = with_delegate(&station);
    const Control from = with_delegate(delegate);
    add_request(record, to_message(rival), delegate_in(from), 3);
    return record;
  };
  expect_lie(lease_call("request", requested(&laptop), rival, nullptr, 3), "a delegate whom nobody asked for");
  expect_lie(lease_call("request", requested(&laptop), rival, &station, 3), "another delegate");
  expect_lie(lease_call("request", requested(nullptr), rival, &station, 3), "without the delegate");
  expect_taken(lease_call("request", requested(&station), rival, &station, 3));
}

TEST_F(DelegateCheck, AHandOverGivesTheLeaseWithTheDelegateThatWasRequested) {
  Control before = with_delegate(&station);
  add_request(before, to_message(rival), delegate_in(with_delegate(&laptop)), 3);
  start(before);
  const auto given = [](const crypto::IdentityName* delegate) {
    Control record = with_delegate(delegate, epoch + 1);
    *record.mutable_holder() = to_message(rival);
    record.set_priority(3);
    return record;
  };
  expect_lie(hand_over(given(&station), holder), "with the former delegate");
  expect_lie(hand_over(given(nullptr), holder), "without one");
  expect_lie(hand_over(given(&laptop), station), "by the delegate");
  expect_taken(hand_over(given(&laptop), holder));
  EXPECT_EQ(refused(station, epoch + 1), RefusalReason::not_holder);
  EXPECT_TRUE(flies(laptop, epoch + 1));
}

TEST_F(DelegateCheck, TheSameDelegateOfANewHolderFliesUnderTheNewEpochAlone) {
  Control before = with_delegate(&station);
  add_request(before, to_message(rival), delegate_in(with_delegate(&station)), 0);
  start(before);
  EXPECT_TRUE(flies(station));
  Control after = with_delegate(&station, epoch + 1);
  *after.mutable_holder() = to_message(rival);
  expect_taken(hand_over(after, holder));
  EXPECT_EQ(refused(station), RefusalReason::wrong_epoch);
  EXPECT_TRUE(flies(station, epoch + 1));
}

TEST_F(DelegateCheck, OnlyTheHolderGivesTheLeaseBackAndItsDelegateGoesWithIt) {
  Control kept = free_again();
  *kept.mutable_delegate() = to_message(station);
  for (const char* end : {"release", "evict"}) {
    start(with_delegate(&station));
    const crypto::IdentityName& by = end == std::string("release") ? holder : host;
    expect_lie(event(end, free_again(), station), end);
    expect_lie(event(end, kept, by), end);
    expect_taken(event(end, free_again(), by));
    EXPECT_FALSE(flies(station, epoch + 1));
  }
}

TEST_F(DelegateCheck, ItDeniesNobody) {
  Control before = with_delegate(&station);
  add_request(before, to_message(rival), nullptr, 0);
  start(before);
  AnswerCall call;
  call.add_drones("tello1");
  *call.mutable_to() = to_message(rival);
  Tx one = event("deny", with_delegate(&station), station);
  one.asked = fabric::Call{"deny", {call.SerializeAsString()}};
  expect_lie(one, "by the delegate");
  one.creator = holder;
  expect_taken(one);
}

}  // namespace
}  // namespace ledgerline::agent::delegates
