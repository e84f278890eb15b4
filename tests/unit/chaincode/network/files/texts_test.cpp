#include "chaincode/network/options.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::network {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

class TextsTest : public testing::Test {
 protected:
  TextsTest() { options.dir = "/net"; }
  ListenAddresses addresses() const { return listen_addresses_from(options, 7000); }
  /// The part of configtx.yaml between two of its lines.
  std::string between(const std::string& begin, const std::string& end) const {
    const std::string yaml = configtx_yaml(options, addresses());
    const auto from = yaml.find(begin), to = yaml.find(end, from);
    EXPECT_NE(from, std::string::npos) << begin;
    EXPECT_NE(to, std::string::npos) << end;
    return yaml.substr(from, to - from);
  }
  Options options;
};

TEST_F(TextsTest, WhoWritesToTheChannelIsOnePolicyWithOneSignature) {
  EXPECT_THAT(
      between("  Ledgerline:\n", "    Orderer:\n"),
      HasSubstr("      Writers: {Type: Signature, Rule: \"OR('OrdererMSP.member', 'Org1MSP.member', 'Org2MSP.member', "
                "'Org3MSP.member')\"}\n"));
}

TEST_F(TextsTest, WhoWritesToTheApplicationIsOnePolicyWithoutTheOrderers) {
  EXPECT_THAT(between("    Application:\n", "Capabilities"),
              HasSubstr("        Writers: {Type: Signature, Rule: \"OR('Org1MSP.member', 'Org2MSP.member', "
                        "'Org3MSP.member')\"}\n"));
}

TEST_F(TextsTest, OnlyTheOrderersSignBlocks) {
  const std::string ordering = between("    Orderer:\n", "    Application:\n");
  EXPECT_THAT(ordering, HasSubstr("        Writers: {Type: ImplicitMeta, Rule: \"ANY Writers\"}\n"));
  EXPECT_THAT(ordering, HasSubstr("        BlockValidation: {Type: ImplicitMeta, Rule: \"ANY Writers\"}\n"));
  EXPECT_THAT(ordering, Not(HasSubstr("Org1MSP")));
}

TEST_F(TextsTest, APeerAsksOrderersThatWereGoneForLongAgainWithinASecond) {
  EXPECT_THAT(peer_environment(options, addresses(), 1),
              Contains("CORE_PEER_DELIVERYCLIENT_RECONNECTBACKOFFTHRESHOLD=1s"));
}

TEST_F(TextsTest, APeerKeepsHistoryUnlessItIsTurnedOff) {
  EXPECT_THAT(peer_environment(options, addresses(), 1), Contains("CORE_LEDGER_HISTORY_ENABLEHISTORYDATABASE=true"));
  options.history = false;
  EXPECT_THAT(peer_environment(options, addresses(), 1), Contains("CORE_LEDGER_HISTORY_ENABLEHISTORYDATABASE=false"));
}

TEST_F(TextsTest, BurstsAreLongerThanFabricsDefaults) {
  EXPECT_THAT(peer_environment(options, addresses(), 1), Contains("CORE_PEER_GOSSIP_STATE_BLOCKBUFFERSIZE=200"));
  EXPECT_THAT(configtx_yaml(options, addresses()), HasSubstr("MaxInflightBlocks: 50,"));
}

TEST_F(TextsTest, AFolderWithQuotesAndBackslashesIsOneText) {
  options.dir = R"(/my "new", run\x)";
  EXPECT_THAT(configtx_yaml(options, addresses()),
              HasSubstr(R"(    MSPDir: "/my \"new\", run\\x/crypto/ordererOrganizations/)"));
  EXPECT_THAT(peer_environment(options, addresses(), 1),
              Contains(HasSubstr(R"([{name: ccaas, path: "/my \"new\", run\\x/builder", propagateEnvironment: [)")));
  options.dir = "/net";
  EXPECT_THAT(configtx_yaml(options, addresses()), HasSubstr("    MSPDir: /net/crypto/ordererOrganizations/"));
}

}  // namespace
}  // namespace ledgerline::network
