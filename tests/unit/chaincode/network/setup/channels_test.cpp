#include "chaincode/network/setup/site.hpp"

#include "tests/unit/chaincode/network/setup/fake_tools.hpp"

namespace ledgerline::network {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

class ChannelsTest : public testing::Test {
 protected:
  ChannelsTest() {
    Options options = tools.options();
    options.channels = {"teleop", "yard"};
    site = std::make_unique<Site>(options);
    EXPECT_TRUE(site->open().ok());
  }
  FakeTools tools;
  std::unique_ptr<Site> site;
};

TEST_F(ChannelsTest, EachHasAFirstBlockThatIsMadeOnce) {
  ASSERT_TRUE(make_first_blocks(*site).ok());
  EXPECT_THAT(tools.calls(), ElementsAre(AllOf(StartsWith("configtxgen"), HasSubstr("-channelID teleop")),
                                         AllOf(StartsWith("configtxgen"), HasSubstr("-channelID yard"))));
  EXPECT_TRUE(read_file(site->in("config/configtx.yaml")).ok());
  ASSERT_TRUE(make_first_blocks(*site).ok());
  EXPECT_THAT(tools.calls(), IsEmpty());
}

TEST_F(ChannelsTest, TheOrdererAndEveryPeerJoinEach) {
  ASSERT_TRUE(join_orderers(*site).ok());
  EXPECT_THAT(tools.calls(), ElementsAre(StartsWith("osnadmin channel join --channelID teleop --config-block " +
                                                    site->in("teleop.block")),
                                         StartsWith("osnadmin channel join --channelID yard")));
  ASSERT_TRUE(join_peers(*site).ok());
  EXPECT_THAT(tools.calls(), SizeIs(6));
}

TEST_F(ChannelsTest, WhatHasJoinedAlreadyIsNoError) {
  tools.script("peer", "echo 'ledger [teleop] already exists' >&2; exit 1");
  EXPECT_TRUE(join_peers(*site).ok());
}

TEST_F(ChannelsTest, APeerThatDoesNotSayItsHeightIsReportedWithItsWords) {
  tools.script("peer", "echo 'Blockchain info: {}'");
  const auto counts = count_blocks(*site);
  ASSERT_FALSE(counts);
  EXPECT_THAT(counts.error().message, HasSubstr("a peer does not say its height: Blockchain info: {}"));
}

}  // namespace
}  // namespace ledgerline::network
