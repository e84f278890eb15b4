#include <gmock/gmock.h>

#include <utility>

#include "common/base/random.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/command_call.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// Leases that change hands while their holder's commands are in flight, in the ledger's own check of what was read
/// (MVCC): from the block on that gives a drone to somebody, nothing that the loser says is valid.
namespace ledgerline::node {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;

class LeaseConflicts : public ::testing::Test {
 protected:
  LeaseConflicts() {
    net.config.batch_count = 10;  // so that the time-out cuts: what a test orders together is one block
    net.restart();
    submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"}));
    submit(net.admin1, "grant", grant_call("Org2MSP", {"tello1"}));
    submit(net.admin1, "enroll", enroll_call(chief.name, {}, SUPERVISOR));
    submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
    submit(net.admin2, "enroll", enroll_call(rival.name, {}, OPERATOR));
    submit(net.pilot, "acquire", "tello1");
    epoch = 1;
  }

  std::vector<int> in_one_block(const std::vector<std::string>& envelopes) {
    for (const std::string& envelope : envelopes) EXPECT_EQ(net.core->order(envelope, net.now).code, Code::ok);
    net.now.monotonic_ns += ns_per_s;
    return net.commit();
  }
  void submit(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    EXPECT_THAT(in_one_block({net.endorsed(who, function, arg)}), ElementsAre(protos::VALID)) << function;
  }
  std::string answer_to(const crypto::SigningIdentity& who) const {
    AnswerCall call;
    call.add_drones("tello1");
    call.mutable_to()->set_msp_id(who.name.msp_id);
    call.mutable_to()->set_subject(who.name.subject);
    return call.SerializeAsString();
  }
  static std::string lease_by_station() {
    LeaseCall call;
    call.add_drones("tello1");
    call.mutable_delegate()->set_msp_id("Org2MSP");
    call.mutable_delegate()->set_subject("CN=station");
    return call.SerializeAsString();
  }
  static std::string plan(std::uint64_t epoch) { return command_call(epoch).SerializeAsString(); }
  std::string command(const crypto::SigningIdentity& who) { return net.endorsed(who, "command", plan(epoch)); }
  /// The contract says no, under the epoch of now and under that of before.
  void expect_refused(const crypto::SigningIdentity& who) {
    for (const std::uint64_t at : {epoch, epoch - 1}) {
      const Reply reply = net.core->endorse(net.propose(who, "command", plan(at)).signed_proposal, net.now);
      EXPECT_NE(reply.code, Code::ok);
    }
  }

  FakeNetwork net;
  std::uint64_t epoch = 0;
  const crypto::SigningIdentity rival = crypto::make_test_identity({"Org2MSP", "CN=rival"});
  const crypto::SigningIdentity station = crypto::make_test_identity({"Org2MSP", "CN=station"});
  const crypto::SigningIdentity chief = crypto::make_test_identity({"Org1MSP", "CN=chief"});
};

TEST_F(LeaseConflicts, OfAThousandHandOversAndTwoHundredEvictionsNoneLeavesTwoHolders) {
  const crypto::SigningIdentity* holder = &net.pilot;
  const crypto::SigningIdentity* next = &rival;
  Random random(1);
  int hand_overs = 0, evictions = 0;
  while (hand_overs < 1'000 || evictions < 200) {
    const bool evicts = hand_overs >= 1'000 || (evictions < 200 && random.next() % 6 == 0);
    if (!evicts) submit(*next, "request", "tello1");
    const std::string before = command(*holder), after = command(*holder);
    const std::string change =
        evicts ? net.endorsed(chief, "evict", "tello1") : net.endorsed(*holder, "hand_over", answer_to(*next));
    ASSERT_THAT(in_one_block({before, change, after}),
                ElementsAre(protos::VALID, protos::VALID, protos::MVCC_READ_CONFLICT));
    ++epoch;
    ++(evicts ? evictions : hand_overs);
    expect_refused(*holder);
    if (evicts) submit(*next, "acquire", "tello1"), ++epoch;
    // Never nobody: who was handed the drone flies it in the very next block.
    ASSERT_THAT(in_one_block({command(*next)}), ElementsAre(protos::VALID));
    std::swap(holder, next);
  }
}

TEST_F(LeaseConflicts, OfTwoWhoChangeTheHolderInOneBlockOneIsValid) {
  submit(rival, "request", "tello1");
  const std::string given = net.endorsed(net.pilot, "hand_over", answer_to(rival));
  const std::string taken = net.endorsed(chief, "evict", "tello1");
  const std::string released = net.endorsed(net.pilot, "release", "tello1");
  const std::string denied = net.endorsed(net.pilot, "deny", answer_to(rival));
  EXPECT_THAT(
      in_one_block({given, taken, released, denied}),
      ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT, protos::MVCC_READ_CONFLICT, protos::MVCC_READ_CONFLICT));
}

TEST_F(LeaseConflicts, ARequestLeavesTheHoldersCommandsAlone) {
  const std::string early = command(net.pilot);
  const std::string request = net.endorsed(rival, "request", "tello1");
  EXPECT_THAT(in_one_block({request, early}), Each(protos::VALID));
}

TEST_F(LeaseConflicts, CommandsOfADelegateNeverConflictWithEachOther) {
  submit(net.pilot, "acquire", lease_by_station()), ++epoch;
  std::vector<std::string> block{net.endorsed(rival, "request", lease_by_station())};
  for (int i = 0; i < 8; ++i) block.push_back(command(station));
  EXPECT_THAT(in_one_block(block), Each(protos::VALID));
  expect_refused(net.pilot);
}

TEST_F(LeaseConflicts, BetweenTwoHoldersOfOneDelegateEachCommandIsOfOneLease) {
  submit(net.pilot, "acquire", lease_by_station()), ++epoch;
  const crypto::SigningIdentity* holder = &net.pilot;
  const crypto::SigningIdentity* next = &rival;
  for (int i = 0; i < 200; ++i) {
    submit(*next, "request", lease_by_station());
    const std::string before = command(station), after = command(station);
    const std::string change = net.endorsed(*holder, "hand_over", answer_to(*next));
    ASSERT_THAT(in_one_block({before, change, after}),
                ElementsAre(protos::VALID, protos::VALID, protos::MVCC_READ_CONFLICT));
    const std::string old = plan(epoch++);
    EXPECT_NE(net.core->endorse(net.propose(station, "command", old).signed_proposal, net.now).code, Code::ok);
    ASSERT_THAT(in_one_block({command(station)}), ElementsAre(protos::VALID)) << "flown on in the next block";
    std::swap(holder, next);
  }
}

TEST_F(LeaseConflicts, ApplyStopsAfterTheDelegatesRevocationInvalidatesWhatIsInFlight) {
  submit(net.pilot, "acquire", lease_by_station()), ++epoch;
  RevokeCall call;
  call.mutable_identity()->set_msp_id("Org2MSP");
  call.mutable_identity()->set_subject("CN=station");
  submit(net.admin2, "revoke", call.SerializeAsString());
  const std::string early = command(station);
  const std::string applied = net.endorsed(net.host, "apply_stops", "tello1");
  EXPECT_THAT(in_one_block({applied, early}), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(LeaseConflicts, ALeaseForADelegateWhomARevocationOvertookIsInvalid) {
  const std::string acquire = net.endorsed(net.pilot, "acquire", lease_by_station());
  RevokeCall call;
  call.mutable_identity()->set_msp_id("Org2MSP");
  call.mutable_identity()->set_subject("CN=station");
  const std::string revoke = net.endorsed(net.admin2, "revoke", call.SerializeAsString());
  EXPECT_THAT(in_one_block({revoke, acquire}), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(LeaseConflicts, ApplyStopsAfterARevocationInvalidatesWhatIsInFlight) {
  RevokeCall call;
  call.mutable_identity()->set_msp_id(net.pilot.name.msp_id);
  call.mutable_identity()->set_subject(net.pilot.name.subject);
  submit(net.admin2, "revoke", call.SerializeAsString());
  const std::string early = command(net.pilot);
  const std::string applied = net.endorsed(net.host, "apply_stops", "tello1");
  EXPECT_THAT(in_one_block({applied, early}), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(LeaseConflicts, AnAcquireThatARevocationOvertookIsInvalid) {
  submit(net.pilot, "release", "tello1");
  const std::string acquire = net.endorsed(net.pilot, "acquire", "tello1");
  RevokeCall call;
  call.mutable_identity()->set_msp_id(net.pilot.name.msp_id);
  call.mutable_identity()->set_subject(net.pilot.name.subject);
  const std::string revoke = net.endorsed(net.admin2, "revoke", call.SerializeAsString());
  EXPECT_THAT(in_one_block({revoke, acquire}), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

}  // namespace
}  // namespace ledgerline::node
