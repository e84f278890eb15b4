#include <gmock/gmock.h>

#include "peer/chaincode_event.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/node/core/core_fixture.hpp"

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

/// Changes an envelope's transaction from the inside, then signs it again.
std::string forge(const crypto::SigningIdentity& who, const std::string& envelope_bytes,
                  const std::function<void(protos::ChaincodeActionPayload&)>& change) {
  common::Envelope envelope;
  common::Payload payload;
  protos::Transaction transaction;
  protos::ChaincodeActionPayload action;
  envelope.ParseFromString(envelope_bytes);
  payload.ParseFromString(envelope.payload());
  transaction.ParseFromString(payload.data());
  action.ParseFromString(transaction.actions(0).payload());
  change(action);
  transaction.mutable_actions(0)->set_payload(action.SerializeAsString());
  payload.set_data(transaction.SerializeAsString());
  envelope.set_payload(payload.SerializeAsString());
  return *fabric::sign_envelope(who, envelope.SerializeAsString());
}

/// Changes what the contract is said to have done; the endorsements stay as they were.
void change_action(protos::ChaincodeActionPayload& payload,
                   const std::function<void(protos::ChaincodeAction&)>& change) {
  protos::ProposalResponsePayload response;
  protos::ChaincodeAction action;
  response.ParseFromString(payload.action().proposal_response_payload());
  action.ParseFromString(response.extension());
  change(action);
  response.set_extension(action.SerializeAsString());
  payload.mutable_action()->set_proposal_response_payload(response.SerializeAsString());
}

class CommitterTest : public CoreTest {};

TEST_F(CommitterTest, OfTwoCallsThatReadWhatBothWriteOneIsInvalid) {
  net.submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
  net.submit(net.admin1, "grant", grant_call("Org2MSP", {"tello1"}));
  const std::string first = net.endorsed(net.pilot, "acquire", "tello1");
  const std::string second = net.endorsed(net.pilot, "acquire", "tello1");
  net.core->order(first, net.now);
  net.core->order(second, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(CommitterTest, TheSameHoldsWithinOneBlock) {
  net.submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, AUDITOR));
  net.config.batch_count = 2;
  net.restart();
  net.core->order(net.endorsed(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR)), net.now);
  net.core->order(net.endorsed(net.admin2, "enroll", enroll_call(net.pilot.name, {}, SUPERVISOR)), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(CommitterTest, ABatchInFlightIsInvalidatedByAChangeOfItsDronesRecord) {
  const std::string batch = net.endorsed(net.host, "set", note("tello1/a"));
  net.submit(net.admin1, "enroll", enroll_call({"Org1MSP", "CN=new"}, {"tello1"}));
  net.core->order(batch, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::MVCC_READ_CONFLICT));
}

TEST_F(CommitterTest, BatchesOfOneHostNeverConflict) {
  net.config.batch_count = 5;
  net.restart();
  for (int i = 0; i < 5; ++i) net.core->order(net.endorsed(net.host, "set", note("tello1/a")), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(0, 0, 0, 0, 0));
}

TEST_F(CommitterTest, ANewKeyInARangeThatWasReadIsAPhantom) {
  net.submit(net.host, "set", note("tello1/a"));
  const std::string listing = net.endorsed(net.host, "get", "tello1/*");
  const std::string again = net.endorsed(net.host, "get", "tello1/*");
  net.core->order(listing, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID));
  net.submit(net.host, "set", note("tello1/b"));
  net.core->order(again, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::PHANTOM_READ_CONFLICT));
}

TEST_F(CommitterTest, ATransactionIsAcceptedOnce) {
  const std::string envelope = net.endorsed(net.host, "set", note("tello1/a"));
  net.core->order(envelope, net.now);
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::DUPLICATE_TXID));
  net.restart();
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::DUPLICATE_TXID)) << "remembered across a restart";
}

TEST_F(CommitterTest, ATransactionTwiceInOneBlockIsAcceptedOnce) {
  net.config.batch_count = 2;
  net.restart();
  const std::string envelope = net.endorsed(net.host, "set", note("tello1/a"));
  net.core->order(envelope, net.now);
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::DUPLICATE_TXID));
}

TEST_F(CommitterTest, AnIdIsUsedUpWithinABlockByATransactionThatReadOldValues) {
  const std::string stale = net.endorsed(net.host, "set", note("tello1/a"));
  net.submit(net.admin1, "enroll", enroll_call({"Org1MSP", "CN=new"}, {"tello1"}));
  net.config.batch_count = 2;
  net.restart();
  net.core->order(stale, net.now);
  net.core->order(stale, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::MVCC_READ_CONFLICT, protos::DUPLICATE_TXID));
}

TEST_F(CommitterTest, AResultThatNobodyEndorsedIsInvalid) {
  const auto order = [&](const std::function<void(protos::ChaincodeActionPayload&)>& change) {
    net.core->order(forge(net.host, net.endorsed(net.host, "set", note("tello1/a")), change), net.now);
    return net.commit();
  };
  EXPECT_THAT(order([](auto&) {}), ElementsAre(protos::VALID)) << "the forger itself changes nothing";
  EXPECT_THAT(order([](auto& payload) { payload.mutable_action()->clear_endorsements(); }),
              ElementsAre(protos::ENDORSEMENT_POLICY_FAILURE));
  EXPECT_THAT(order([](auto& payload) {
                change_action(payload, [](auto& action) { action.mutable_response()->set_status(201); });
              }),
              ElementsAre(protos::ENDORSEMENT_POLICY_FAILURE));
  EXPECT_THAT(order([](auto& payload) { payload.set_chaincode_proposal_payload("other"); }),
              ElementsAre(protos::INVALID_ENDORSER_TRANSACTION));
}

TEST_F(CommitterTest, AClientCannotEndorseItself) {
  const std::string envelope = forge(net.host, net.endorsed(net.host, "set", note("tello1/a")), [&](auto& payload) {
    change_action(payload, [](auto& action) { action.mutable_response()->set_status(201); });
    payload.mutable_action()->clear_endorsements();
    auto& endorsement = *payload.mutable_action()->add_endorsements();
    endorsement.set_endorser(net.host.serialized);
    endorsement.set_signature(
        *net.host.signer->sign(payload.action().proposal_response_payload() + net.host.serialized));
  });
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::ENDORSEMENT_POLICY_FAILURE));
}

TEST_F(CommitterTest, OneGoodEndorsementIsEnough) {
  const std::string envelope = forge(net.host, net.endorsed(net.host, "set", note("tello1/a")), [](auto& payload) {
    payload.mutable_action()->mutable_endorsements(0)->set_signature("wrong");
  });
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID));
}

TEST_F(CommitterTest, AnEventInAFalseNameIsInvalidThoughAPeerEndorsedIt) {
  const crypto::SigningIdentity peer = crypto::make_test_identity({"Org1MSP", "CN=peer0"});
  const auto with_event = [&](const std::function<void(protos::ChaincodeEvent&)>& change) {
    return forge(net.host, net.endorsed(net.host, "set", note("tello1/a")), [&](auto& payload) {
      change_action(payload, [&](auto& action) {
        protos::ChaincodeEvent event;
        event.ParseFromString(action.events());
        change(event);
        action.set_events(event.SerializeAsString());
      });
      auto& endorsement = *payload.mutable_action()->mutable_endorsements(0);
      endorsement.set_endorser(peer.serialized);
      endorsement.set_signature(*peer.signer->sign(payload.action().proposal_response_payload() + peer.serialized));
    });
  };
  net.core->order(with_event([](auto&) {}), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID)) << "an endorsement like any other";
  net.core->order(with_event([](auto& event) { event.set_chaincode_id("other"); }), net.now);
  net.core->order(with_event([](auto& event) { event.set_tx_id("another"); }), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::INVALID_OTHER_REASON, protos::INVALID_OTHER_REASON));
}

TEST_F(CommitterTest, AnInvalidTransactionWritesNothing) {
  net.submit(net.host, "set", note("tello1/a", "good"));
  net.core->order(forge(net.host, net.endorsed(net.host, "set", note("tello1/a", "bad")),
                        [](auto& payload) { payload.mutable_action()->clear_endorsements(); }),
                  net.now);
  net.commit();
  EXPECT_EQ(value_of("tello1/a"), "good");
}

TEST_F(CommitterTest, AReplayedBlockThatDoesNotFitIsAnErrorThatNamesIt) {
  net.submit(net.host, "set", note("tello1/a"));
  const auto replay = [&](const std::vector<std::string>& chain) {
    FakeNetwork fresh;
    NodeCore core(fresh.config, crypto::make_test_registry({"Org1MSP"}), {net.host}, net.host, nullptr);
    for (const std::string& block : chain) {
      if (Status status = core.replay(block); !status) return status.error().message;
    }
    return std::string("fine");
  };
  EXPECT_EQ(replay(net.chain), "fine");
  EXPECT_THAT(replay({net.chain[0], net.chain[2]}), HasSubstr("block 1 is missing"));
  common::Block block;
  block.ParseFromString(net.chain[1]);
  block.mutable_data()->mutable_data(0)->back() ^= 1;
  EXPECT_THAT(replay({net.chain[0], block.SerializeAsString()}), HasSubstr("block 1: its data"));
  EXPECT_THAT(replay({net.chain[1]}), HasSubstr("block 0"));
}

TEST_F(CommitterTest, WaitersHearOfTheirTransactionOnce) {
  const auto proposal = net.propose(net.host, "set", note("tello1/a"));
  EXPECT_FALSE(net.core->watch(proposal.tx_id, 7));
  EXPECT_FALSE(net.core->watch(proposal.tx_id, 8));
  EXPECT_FALSE(net.core->watch(proposal.tx_id, 9));
  net.core->unwatch(proposal.tx_id, 8);
  net.core->order(*fabric::sign_envelope(net.host, net.core->endorse(proposal.signed_proposal, net.now).bytes),
                  net.now);
  const std::vector<WaiterAnswer> answers = net.keep(*net.core->cut(net.now));
  ASSERT_THAT(answers, SizeIs(2));
  EXPECT_EQ(answers[0].waiter, 7U);
  EXPECT_EQ(answers[1].waiter, 9U);
  EXPECT_EQ(answers[0].status.block, 2U);
  EXPECT_EQ(net.core->watch(proposal.tx_id, 10)->code, 0) << "a late one is answered at once";
}

}  // namespace
}  // namespace ledgerline::node
