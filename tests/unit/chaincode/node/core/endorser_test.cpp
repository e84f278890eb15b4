#include <gmock/gmock.h>

#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/unit/chaincode/node/core/core_fixture.hpp"

namespace ledgerline::node {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

class EndorserTest : public CoreTest {};

TEST_F(EndorserTest, EveryOrganisationsPeerEndorses) {
  net.submit(net.host, "set", note("tello1/a"));
  std::vector<std::string> endorsers;
  const fabric::Block block = net.block(2);
  for (const auto& endorsement : block.transactions[0].endorsements) endorsers.push_back(endorsement.endorser);
  ASSERT_THAT(endorsers, SizeIs(3));
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string msp = "Org" + std::to_string(i + 1) + "MSP";
    EXPECT_EQ(endorsers[i], crypto::make_test_identity({msp, "CN=peer0"}).serialized);
  }
}

TEST_F(EndorserTest, ARefusalOfTheContractIsAbortedWithItsWords) {
  const Reply reply = net.core->endorse(net.propose(net.pilot, "set", note("tello1/a")).signed_proposal, net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("chaincode response 500, tello1: enrolled to Org1MSP CN=host"));
  const Reply missing = evaluate("get", "tello1/none");
  EXPECT_EQ(missing.code, Code::unknown);
  EXPECT_EQ(missing.detail, "chaincode response 500, tello1/none: not found");
}

TEST_F(EndorserTest, AnOrganisationStoresSoManyBytesAndNoMoreUntilItHasDeletedSome) {
  net.config.max_stored_bytes = 5'500;  // the first value beside each one's records
  net.restart();
  const auto set = [&](const crypto::SigningIdentity& who, const std::string& id, std::size_t bytes) {
    const std::string call = R"({"id":")" + id + R"(","msgType":"t","msgData":")" + std::string(bytes, 'A') + "\"}";
    const Reply reply = net.core->endorse(net.propose(who, "set", call).signed_proposal, net.now);
    if (reply.code == Code::ok) net.submit(who, "set", call);
    return reply.detail;
  };
  EXPECT_EQ(set(net.pilot, "Org2MSP/a", 4'000), "");
  EXPECT_THAT(set(net.pilot, "Org2MSP/b", 4'000), HasSubstr("the values that Org2MSP has written take"));
  EXPECT_EQ(set(net.pilot, "Org2MSP/a", 3'900), "") << "it grows no more";
  EXPECT_EQ(set(net.admin1, "Org1MSP/a", 4'000), "") << "others have a share of their own";
  net.restart();
  EXPECT_THAT(set(net.pilot, "Org2MSP/b", 4'000), HasSubstr("delete some of them")) << "nothing is forgotten";
  net.submit(net.pilot, "delete", "Org2MSP/a");
  EXPECT_EQ(set(net.pilot, "Org2MSP/b", 4'000), "");
}

TEST_F(EndorserTest, AWrongSignatureOfAProposalIsDenied) {
  protos::SignedProposal proposal;
  proposal.ParseFromString(net.propose(net.host, "set", note("tello1/a")).signed_proposal);
  proposal.set_signature("wrong");
  const Reply reply = net.core->endorse(proposal.SerializeAsString(), net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("error validating proposal: access denied: channel [teleop]"));
  EXPECT_EQ(net.core->evaluate(proposal.SerializeAsString(), net.now).code, Code::failed_precondition);
}

TEST_F(EndorserTest, AMemberOfAnUnknownOrganisationIsDenied) {
  const auto outsider = crypto::make_test_identity({"Org9MSP", "CN=x"});
  const Reply reply = net.core->endorse(net.propose(outsider, "get", "").signed_proposal, net.now);
  EXPECT_THAT(reply.detail, HasSubstr("access denied"));
}

TEST_F(EndorserTest, OtherChannelsAndContractsAreReported) {
  const auto propose = [&](const fabric::ChannelAndContract& where) {
    return fabric::make_proposal(net.host, where, {"get", {""}}, 0, std::string(24, 'n'))->signed_proposal;
  };
  EXPECT_EQ(net.core->endorse(propose({"other", "ledgerline"}), net.now).code, Code::failed_precondition);
  EXPECT_EQ(net.core->evaluate(propose({"other", "ledgerline"}), net.now).code, Code::unavailable);
  EXPECT_EQ(net.core->endorse(propose({"teleop", "other"}), net.now).code, Code::failed_precondition);
  for (const auto& [where, why] : std::map<std::string, std::string>{{"other", "channel 'other' not found"},
                                                                     {"teleop", "no contract named 'other'"}}) {
    const Reply reply = net.core->process_proposal(propose({where, "other"}), net.now);
    protos::ProposalResponse response;
    EXPECT_EQ(reply.code, Code::ok) << "the peer itself answers";
    ASSERT_TRUE(response.ParseFromString(reply.bytes));
    EXPECT_EQ(response.response().status(), 500);
    EXPECT_THAT(response.response().message(), HasSubstr(why));
  }
}

TEST_F(EndorserTest, TheDirectEndorserAnswersWithARefusalAsFabricDoes) {
  protos::ProposalResponse response;
  const Reply good =
      net.core->process_proposal(net.propose(net.host, "set", note("tello1/a")).signed_proposal, net.now);
  ASSERT_TRUE(response.ParseFromString(good.bytes));
  EXPECT_EQ(response.response().status(), 200);
  EXPECT_TRUE(response.has_endorsement());
  const Reply bad =
      net.core->process_proposal(net.propose(net.pilot, "set", note("tello1/a")).signed_proposal, net.now);
  EXPECT_EQ(bad.code, Code::ok);
  ASSERT_TRUE(response.ParseFromString(bad.bytes));
  EXPECT_EQ(response.response().status(), 500);
  EXPECT_FALSE(response.has_endorsement());
}

TEST_F(EndorserTest, AProposalIsNotEndorsedAgainAfterItsCommit) {
  const auto proposal = net.propose(net.host, "set", note("tello1/a"));
  net.core->order(*fabric::sign_envelope(net.host, net.core->endorse(proposal.signed_proposal, net.now).bytes),
                  net.now);
  net.commit();
  const Reply reply = net.core->endorse(proposal.signed_proposal, net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("duplicate transaction found"));
}

TEST_F(EndorserTest, EndorsingChangesNothingOfTheLedger) {
  const std::string first = net.endorsed(net.host, "set", note("tello1/a"));
  EXPECT_EQ(net.core->height(), 2U);
  EXPECT_EQ(evaluate("get", "tello1/a").code, Code::unknown);
  EXPECT_EQ(net.core->endorse(net.propose(net.host, "get", "tello1/a").signed_proposal, net.now).code, Code::aborted);
}

TEST_F(EndorserTest, APeerWhoseKeyIsGoneMakesTheEndorsementFailAndNamesItself) {
  struct NoSigner final : crypto::Signer {
    Result<std::string> sign(std::string_view) const override { return Error{"the key is gone"}; }
  };
  crypto::SigningIdentity peer = crypto::make_test_identity({"Org1MSP", "CN=peer0"});
  peer.signer = std::make_shared<NoSigner>();
  const Ledger ledger([](std::uint64_t) -> Result<std::string> { return Error{"no such block"}; });
  const CoreConfig config;
  Endorser endorser(config, MemberCheck(crypto::make_test_registry({"Org1MSP"}), config.channel), {peer}, ledger);
  const Reply reply = endorser.endorse(net.propose(net.host, "set", note("Org1MSP/a")).signed_proposal, net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_EQ(reply.detail, "signing with the key of CN=peer0: the key is gone");
}

}  // namespace
}  // namespace ledgerline::node
