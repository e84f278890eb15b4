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
    EXPECT_FALSE(response.has_endorsement());
    return response;
  }
  protos::Response of_chain(std::vector<std::string> args) {
    args.insert(args.begin() + 1, "teleop");
    return ask({"teleop", "qscc"}, args).response();
  }
};

TEST_F(SystemContractsTest, HeightAndHashesAreTold) {
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

TEST_F(SystemContractsTest, WhoIsNoMemberIsNotAnsweredAndNothingIsEndorsed) {
  const auto stranger = crypto::make_test_identity({"Org9MSP", "CN=x"});
  const auto propose = [&](const crypto::SigningIdentity& who) {
    return fabric::make_proposal(who, {"teleop", "qscc"}, {"GetChainInfo", {"teleop"}}, 0, std::string(24, 'n'))
        ->signed_proposal;
  };
  EXPECT_EQ(net.core->process_proposal(propose(stranger), net.now).code, Code::unknown);
  EXPECT_EQ(net.core->evaluate(propose(net.host), net.now).code, Code::ok);
  EXPECT_EQ(net.core->endorse(propose(net.host), net.now).code, Code::failed_precondition);
}

}  // namespace
}  // namespace ledgerline::node
