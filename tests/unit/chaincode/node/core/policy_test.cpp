#include <gmock/gmock.h>

#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/command_call.hpp"
#include "tests/unit/chaincode/node/core/core_fixture.hpp"

/// Whose endorsement the committer asks for; what Fabric says to the same is in
/// tests/system/conformance/test_identities.py.
namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;

class PolicyTest : public CoreTest {
 protected:
  PolicyTest() {
    net.submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
    net.submit(net.admin1, "grant", grant_call("Org2MSP", {"tello1"}));
  }
  /// Endorsed by the peers of these organisations alone, from 0.
  int submit(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg,
             const std::vector<std::size_t>& peers) {
    EXPECT_EQ(net.core->order(endorsed_by(who, function, arg, peers), net.now).code, Code::ok);
    return net.commit().at(0);
  }
  std::string endorsed_by(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg,
                          const std::vector<std::size_t>& peers) {
    const auto proposal = net.propose(who, function, arg);
    std::vector<std::string> answers;
    for (const std::size_t peer : peers) {
      answers.push_back(net.core->process_proposal(proposal.signed_proposal, net.now, peer).bytes);
    }
    const auto envelope = fabric::assemble(proposal, answers);
    EXPECT_TRUE(envelope.ok()) << envelope.error().message;
    return *fabric::sign_envelope(who, *envelope);
  }
  static std::string batch() {
    SetCall call;
    EXPECT_TRUE(call.ParseFromString(note("tello1/odom")));
    call.set_stream(true);
    return call.SerializeAsString();
  }
  static std::string command(std::uint64_t epoch) { return command_call(epoch, LAND).SerializeAsString(); }
};

TEST_F(PolicyTest, AStateAndACommandNeedThePeerOfTheDronesOrganisationAndNoOther) {
  EXPECT_EQ(submit(net.host, "set", batch(), {1}), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(submit(net.host, "set", batch(), {1, 2}), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(submit(net.host, "set", batch(), {0}), protos::VALID);
  EXPECT_EQ(submit(net.pilot, "acquire", "tello1", {0, 2}), protos::VALID);
  EXPECT_EQ(submit(net.pilot, "command", command(1), {1}), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(submit(net.pilot, "command", command(1), {0}), protos::VALID);
}

TEST_F(PolicyTest, WhatMakesKeysNeedsAMajority) {
  EXPECT_EQ(submit(net.pilot, "acquire", "tello1", {0}), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(submit(net.pilot, "acquire", "tello1", {1, 2}), protos::ENDORSEMENT_POLICY_FAILURE) << "Org1 keeps it";
  EXPECT_EQ(submit(net.pilot, "acquire", "tello1", {0, 0}), protos::ENDORSEMENT_POLICY_FAILURE) << "one, twice";
  EXPECT_EQ(submit(net.pilot, "acquire", "tello1", {0, 1}), protos::VALID);
  EXPECT_EQ(submit(net.pilot, "stop", "tello1", {1}), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(submit(net.pilot, "stop", "tello1", {1, 2}), protos::VALID) << "it loses to nobody, not even to its owner";
}

TEST_F(PolicyTest, WhatFollowsANewPolicyInItsBlockIsInvalid) {
  net.config.batch_count = 2;
  net.restart();
  net.core->order(endorsed_by(net.pilot, "acquire", "tello1", {0, 1}), net.now);
  net.core->order(endorsed_by(net.pilot, "acquire", "tello1", {0, 1}), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::ENDORSEMENT_POLICY_FAILURE));
}

TEST_F(PolicyTest, PoliciesAreThereAgainAfterARestart) {
  net.restart();
  EXPECT_EQ(submit(net.host, "set", batch(), {1, 2}), protos::ENDORSEMENT_POLICY_FAILURE);
  EXPECT_EQ(submit(net.host, "set", batch(), {0}), protos::VALID);
}

}  // namespace
}  // namespace ledgerline::node
