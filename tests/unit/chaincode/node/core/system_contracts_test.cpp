#include <gmock/gmock.h>

#include "common/ledger.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/query.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/node/core/core_fixture.hpp"

namespace ledgerline::node {
namespace {

using ::testing::HasSubstr;

/// What `peer channel getinfo` and others ask.
class SystemContractsTest : public CoreTest {
 protected:
  protos::ProposalResponse ask(const fabric::ChannelAndContract& where, const std::vector<std::string>& args) {
    const auto proposal =
        fabric::make_proposal(net.host, where, {args[0], {args.begin() + 1, args.end()}}, 0, std::string(24, 'n'));
    const Reply reply = net.core->process_proposal(proposal->signed_proposal, net.now);
    EXPECT_EQ(reply.code, Code::ok) << reply.message;
    protos::ProposalResponse response;
    EXPECT_TRUE(response.ParseFromString(reply.bytes));
    return response;
  }
  protos::Response of_chain(std::vector<std::string> args) {
    args.insert(args.begin() + 1, "teleop");
    return ask({"teleop", "qscc"}, args).response();
  }
};

TEST_F(SystemContractsTest, HeightAndHashesAreReported) {
  net.submit(net.host, "set", note("tello1/a"));
  for (const char* channel : {"", "teleop"}) {
    common::BlockchainInfo info;
    ASSERT_TRUE(info.ParseFromString(ask({channel, "qscc"}, {"GetChainInfo", "teleop"}).response().payload()));
    EXPECT_EQ(info.height(), 3U);
    EXPECT_EQ(info.previousblockhash(), net.block(2).previous_hash);
    net.submit(net.host, "set", note("tello1/a"));
    EXPECT_EQ(info.currentblockhash(), net.block(3).previous_hash);
    net.chain.pop_back();
    net.restart();
  }
}

TEST_F(SystemContractsTest, BlocksAndTransactionsAreFound) {
  net.submit(net.host, "set", note("tello1/a"));
  const std::string id = net.block(2).transactions[0].tx_id;
  EXPECT_EQ(of_chain({"GetBlockByNumber", "2"}).payload(), net.chain[2]);
  EXPECT_EQ(of_chain({"GetBlockByTxID", id}).payload(), net.chain[2]);
  EXPECT_EQ(ask({"teleop", "cscc"}, {"GetConfigBlock", "teleop"}).response().payload(), net.chain[0]);
  protos::ProcessedTransaction transaction;
  ASSERT_TRUE(transaction.ParseFromString(of_chain({"GetTransactionByID", id}).payload()));
  EXPECT_EQ(transaction.validationcode(), protos::VALID);
  EXPECT_THAT(net.chain[2], HasSubstr(transaction.transactionenvelope().payload()));
  protos::ChannelQueryResponse channels;
  ASSERT_TRUE(channels.ParseFromString(ask({"", "cscc"}, {"GetChannels"}).response().payload()));
  ASSERT_EQ(channels.channels_size(), 1);
  EXPECT_EQ(channels.channels(0).channel_id(), "teleop");
}

TEST_F(SystemContractsTest, APeerSignsWhatItSaysOfTheChannelAndNothingElse) {
  net.submit(net.host, "set", note("tello1/a"));
  const std::string id = net.block(2).transactions[0].tx_id;
  for (std::size_t peer = 0; peer < 3; ++peer) {
    const auto proposal = fabric::make_proposal(net.host, {"teleop", "qscc"}, {"GetTransactionByID", {"teleop", id}}, 0,
                                                std::string(24, 'n'));
    protos::ProposalResponse response;
    ASSERT_TRUE(response.ParseFromString(net.core->process_proposal(proposal->signed_proposal, net.now, peer).bytes));
    const auto signer = crypto::make_test_identity({"Org" + std::to_string(peer + 1) + "MSP", "CN=peer0"});
    EXPECT_EQ(response.endorsement().endorser(), signer.serialized);
    EXPECT_EQ(response.endorsement().signature(), *signer.signer->sign(response.payload() + signer.serialized));
    protos::ProposalResponsePayload payload;
    protos::ChaincodeAction action;
    ASSERT_TRUE(payload.ParseFromString(response.payload()) && action.ParseFromString(payload.extension()));
    EXPECT_EQ(action.chaincode_id().name(), "qscc");
    EXPECT_EQ(action.chaincode_id().version(), "syscc");
    EXPECT_EQ(action.response().SerializeAsString(), response.response().SerializeAsString());
    EXPECT_TRUE(action.results().empty());
  }
  EXPECT_FALSE(ask({"", "qscc"}, {"GetChainInfo", "teleop"}).has_endorsement()) << "no channel was asked";
  EXPECT_FALSE(ask({"teleop", "qscc"}, {"GetTransactionByID", "teleop", "none"}).has_endorsement()) << "a refusal";
}

TEST_F(SystemContractsTest, WhatAPeerSignedOfTheChainIsNoTransaction) {
  const fabric::Proposal proposal =
      *fabric::make_proposal(net.host, {"teleop", "qscc"}, {"GetChainInfo", {"teleop"}}, 0, std::string(24, 'q'));
  std::vector<std::string> responses;
  for (std::size_t peer = 0; peer < 3; ++peer)
    responses.push_back(net.core->process_proposal(proposal.signed_proposal, net.now, peer).bytes);
  const auto envelope = fabric::assemble(proposal, responses);
  ASSERT_TRUE(envelope) << envelope.error().message;
  ASSERT_EQ(net.core->order(*fabric::sign_envelope(net.host, *envelope), net.now).code, Code::ok);
  EXPECT_EQ(net.commit(), std::vector<int>{protos::INVALID_CHAINCODE});
}

TEST_F(SystemContractsTest, WhatIsNotThereIsRefused) {
  for (const std::vector<std::string>& args : {std::vector<std::string>{"GetBlockByNumber", "3"},
                                               {"GetBlockByNumber", "-1"},
                                               {"GetBlockByNumber", "1x"},
                                               {"GetBlockByNumber"},
                                               {"GetTransactionByID", "none"},
                                               {"GetBlockByTxID"},
                                               {"Nothing"}}) {
    EXPECT_EQ(of_chain(args).status(), 500) << args[0];
  }
  EXPECT_THAT(ask({"teleop", "qscc"}, {"GetChainInfo", "other"}).response().message(), HasSubstr("Invalid chain ID"));
  EXPECT_EQ(ask({"teleop", "qscc"}, {"GetChainInfo"}).response().status(), 500);
  EXPECT_EQ(ask({"", "ledgerline"}, {"get"}).response().status(), 500) << "the contract has a channel";
}

TEST_F(SystemContractsTest, WhoIsNoMemberIsNotAnsweredAndTheGatewayEndorsesNothing) {
  const auto outsider = crypto::make_test_identity({"Org9MSP", "CN=x"});
  const auto propose = [&](const crypto::SigningIdentity& who) {
    return fabric::make_proposal(who, {"teleop", "qscc"}, {"GetChainInfo", {"teleop"}}, 0, std::string(24, 'n'))
        ->signed_proposal;
  };
  EXPECT_EQ(net.core->process_proposal(propose(outsider), net.now).code, Code::unknown);
  EXPECT_EQ(net.core->evaluate(propose(net.host), net.now).code, Code::ok);
  EXPECT_EQ(net.core->endorse(propose(net.host), net.now).code, Code::failed_precondition);
}

}  // namespace
}  // namespace ledgerline::node
