#include <gmock/gmock.h>

#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/node/core/core_fixture.hpp"

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

TEST_F(CoreTest, WhatIsSubmittedIsInABlockAndInTheState) {
  EXPECT_THAT(net.submit(net.host, "set", note("tello1/a", "hello")), ElementsAre(protos::VALID));
  EXPECT_EQ(value_of("tello1/a"), "hello");
  const fabric::Block block = net.block(2);
  ASSERT_THAT(block.transactions, SizeIs(1));
  EXPECT_EQ(block.transactions[0].code, 0);
  EXPECT_EQ(block.transactions[0].event_name, "set");
}

TEST_F(CoreTest, BlocksFormAChainThatAnIndependentReaderAccepts) {
  for (int i = 0; i < 5; ++i) net.submit(net.host, "set", note("tello1/a"));
  fabric::ChainCheck check;
  for (std::size_t i = 0; i < net.chain.size(); ++i) ASSERT_TRUE(check.add(net.block(i)).ok()) << i;
  EXPECT_EQ(check.height(), net.core->height());
}

TEST_F(CoreTest, TheConfigBlockNamesChannelAndOrganisations) {
  const fabric::Block block = net.block(0);
  ASSERT_THAT(block.transactions, SizeIs(1));
  EXPECT_TRUE(block.transactions[0].config);
  EXPECT_EQ(block.transactions[0].channel, "teleop");
  for (const char* msp_id : {"Org1MSP", "Org2MSP", "Org3MSP"}) EXPECT_THAT(net.chain[0], HasSubstr(msp_id));
}

TEST_F(CoreTest, TheSameInputsGiveTheSameBytes) {
  FakeNetwork first, second;
  for (FakeNetwork* one : {&first, &second}) {
    one->submit(one->admin1, "enroll", enroll_call(one->host.name, {"tello1"}));
    one->submit(one->host, "set", note("tello1/a"));
  }
  EXPECT_EQ(first.chain, second.chain);
}

TEST_F(CoreTest, GarbageIsAnAnswerNotACrash) {
  for (const std::string& bytes :
       {std::string(), std::string("garbage"), std::string(1000, '\xff'), std::string("\x0a\x02\x08")}) {
    EXPECT_NE(net.core->endorse(bytes, net.now).code, Code::ok);
    EXPECT_NE(net.core->evaluate(bytes, net.now).code, Code::ok);
    EXPECT_NE(net.core->process_proposal(bytes, net.now).code, Code::ok);
    EXPECT_NE(net.core->order(bytes, net.now).code, Code::ok);
    EXPECT_FALSE(net.core->replay(bytes).ok());
  }
}

TEST_F(CoreTest, ARestartGoesOnWhereTheChainEnds) {
  net.submit(net.host, "set", note("tello1/a", "kept"));
  const auto before = net.core->counts();
  net.restart();
  EXPECT_EQ(net.core->height(), 3U);
  EXPECT_EQ(net.core->counts().transactions, before.transactions);
  EXPECT_EQ(value_of("tello1/a"), "kept");
  EXPECT_THAT(net.submit(net.host, "set", note("tello1/a", "more")), ElementsAre(protos::VALID));
  fabric::ChainCheck check;
  for (std::size_t i = 0; i < net.chain.size(); ++i) ASSERT_TRUE(check.add(net.block(i)).ok()) << i;
}

TEST_F(CoreTest, WhileABlockIsInProgressNoneIsCutAndReadsSeeTheStateBefore) {
  for (int i = 0; i < 2; ++i) net.core->order(net.endorsed(net.host, "set", note("tello1/a")), net.now);
  const auto block = net.core->cut(net.now);
  ASSERT_TRUE(block);
  EXPECT_FALSE(net.core->next_cut());
  EXPECT_FALSE(net.core->cut(net.now));
  EXPECT_EQ(evaluate("get", "tello1/a").code, Code::unknown) << "not on disk, not reported";
  net.keep(*block);
  EXPECT_EQ(evaluate("get", "tello1/a").code, Code::ok);
  EXPECT_TRUE(net.core->cut(net.now));
}

}  // namespace
}  // namespace ledgerline::node
