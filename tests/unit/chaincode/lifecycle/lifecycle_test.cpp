#include "chaincode/lifecycle/lifecycle.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "peer/policy.pb.h"

namespace ledgerline::chaincode_lifecycle {
namespace {

using testing::HasSubstr;

/// A channel whose policy asks for so many of its organisations' peers.
fabric::ChannelConfig channel_of(std::size_t organisations, std::size_t needed) {
  fabric::ChannelConfig out;
  for (std::size_t i = 1; i <= organisations; ++i) {
    const std::string msp_id = "Org" + std::to_string(i) + "MSP";
    out.organisations.push_back({msp_id, ""});
    out.endorsement.parts.push_back(fabric::peer_policy(msp_id));
  }
  out.endorsement.needed = needed;
  out.endorsement_words = "MAJORITY Endorsement";
  return out;
}

std::string channels_own() {
  protos::ApplicationPolicy policy;
  policy.set_channel_config_policy_reference("/Channel/Application/Endorsement");
  return policy.SerializeAsString();
}

TEST(Fitness, TheDirectPathGathersTwoOrganisationsAndNoMore) {
  for (const std::size_t organisations : {1U, 2U, 3U})
    EXPECT_TRUE(fitness_of(channel_of(organisations, organisations / 2 + 1), channels_own()).direct) << organisations;
  const Fitness four = fitness_of(channel_of(4, 3), channels_own());
  EXPECT_FALSE(four.direct);
  EXPECT_EQ(four.policy, "the channel's, MAJORITY Endorsement");
  EXPECT_THAT(four.direct_why, HasSubstr("do not suffice"));
}

TEST(Fitness, APolicyOfItsOwnCounts) {
  protos::ApplicationPolicy policy;
  ASSERT_TRUE(policy.mutable_signature_policy()->ParseFromString(fabric::peer_policy("Org1MSP")));
  const Fitness one = fitness_of(channel_of(3, 2), policy.SerializeAsString());
  EXPECT_FALSE(one.direct);
  EXPECT_EQ(one.direct_why, "only 2 of 3 pairs of organisations suffice");
  EXPECT_FALSE(fitness_of(channel_of(2, 2), "\xff").direct) << "what cannot be read satisfies nobody";
}

TEST(PeerCommands, SayWhatTheProgramWouldDo) {
  fabric::ClientConfig client;
  client.endpoint = "peer0.org1.example.com:7051";
  client.tls_ca_file = "/it's.pem";
  client.tls_pair = {"/own.crt", "own.key"};
  client.where = {"mychannel", "drones"};
  client.identity.name.msp_id = "Org1MSP";
  client.orderers = {{"orderer.example.com:7050", "/orderer.pem", "other.name"}};
  client.endorsers = {{"Org1MSP", client.endpoint, "/it's.pem"},
                      {"Org2MSP", "peer0.org2.example.com:9051", "/two.pem"}};
  const PeerCommands commands{client, "msp"};
  const std::string key = std::filesystem::absolute("own.key");
  EXPECT_THAT(commands.environment(), HasSubstr("export CORE_PEER_TLS_ROOTCERT_FILE='/it'\\''s.pem'\n"));
  EXPECT_THAT(commands.environment(), HasSubstr("export CORE_PEER_TLS_CLIENTKEY_FILE='" + key + "'\n"))
      << "`peer` would look below FABRIC_CFG_PATH";
  EXPECT_EQ(commands.approve({"2", 1}, "ledgerline_1:00", ""),
            "peer lifecycle chaincode approveformyorg -o 'orderer.example.com:7050' --tls --cafile '/orderer.pem' "
            "--ordererTLSHostnameOverride 'other.name' --clientauth --certfile '/own.crt' --keyfile '" +
                key +
                "' "
                "--channelID 'mychannel' --name 'drones' --version '2' --sequence 1 --package-id 'ledgerline_1:00'\n");
  EXPECT_THAT(commands.commit({"2", 1}),
              HasSubstr("--peerAddresses 'peer0.org2.example.com:9051' --tlsRootCertFiles '/two.pem'"));
}

}  // namespace
}  // namespace ledgerline::chaincode_lifecycle
