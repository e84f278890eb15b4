#include "chaincode/endorser/core/endorser_core.hpp"

#include <gmock/gmock.h>

#include <random>

#include "chaincode/endorser/core/peer_follower.hpp"
#include "chaincode/node/core/tx/messages.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/proposal_response.pb.h"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

namespace ledgerline::endorser {
namespace {

using node::Code;
using node::enroll_call;
using node::note;
using node::Reply;
using ::testing::HasSubstr;

fabric::BlockValidator::MakeRegistry test_members() {
  return [](const std::vector<crypto::MspRoot>& roots) {
    std::vector<std::string> ids;
    for (const crypto::MspRoot& root : roots) ids.push_back(root.msp_id);
    return crypto::make_test_registry(ids);
  };
}

/// Beside the embedded node, whose blocks it takes.
class OwnEndorserTest : public ::testing::Test {
 protected:
  OwnEndorserTest() {
    net.submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"}));
    follow();
  }
  static node::CoreConfig with_orderers() {
    node::CoreConfig config;
    config.orderers = {"OrdererMSP", "ca of OrdererMSP"};
    return config;
  }

  void follow() {
    while (core.height() < net.chain.size()) {
      const std::string& raw = net.chain[core.height()];
      const Status taken = core.apply(*fabric::decode_block(raw), raw);
      ASSERT_TRUE(taken.ok()) << taken.error().message;
    }
  }
  Reply ask(const fabric::Proposal& proposal) { return core.process_proposal(proposal.signed_proposal, net.now); }
  Comparison beside_the_node(const fabric::Proposal& proposal) {
    const Reply own = ask(proposal), nodes = net.core->process_proposal(proposal.signed_proposal, net.now);
    EXPECT_EQ(own.code, nodes.code) << own.message << " " << nodes.message;
    return own.code == Code::ok ? compare_answers(own.bytes, nodes.bytes)
                                : (own.message == nodes.message ? Comparison::same : Comparison::differ);
  }

  node::FakeNetwork net{with_orderers()};
  const crypto::SigningIdentity identity = crypto::make_test_identity({"Org1MSP", "CN=peer1"});
  EndorserCore core{{{}, identity, test_members()}};
};

TEST_F(OwnEndorserTest, AnswersAsThePeerAndSignsItself) {
  const auto proposal = net.propose(net.host, "set", note("tello1/a"));
  EXPECT_EQ(beside_the_node(proposal), Comparison::same);
  protos::ProposalResponse response;
  ASSERT_TRUE(response.ParseFromString(ask(proposal).bytes));
  EXPECT_EQ(response.endorsement().endorser(), identity.serialized);
  // It counts where a majority endorses, beside another organisation's peer.
  protos::ProposalResponse second;
  second.ParseFromString(net.core->process_proposal(proposal.signed_proposal, net.now, 1).bytes);
  const auto envelope = fabric::assemble(proposal, {response.SerializeAsString(), second.SerializeAsString()});
  ASSERT_TRUE(envelope.ok()) << envelope.error().message;
  EXPECT_EQ(net.core->order(*fabric::sign_envelope(net.host, *envelope), net.now).code, Code::ok);
  EXPECT_EQ(net.commit(), std::vector<int>{0});
}

TEST_F(OwnEndorserTest, RandomProposalsAreAnsweredAsByThePeer) {
  std::mt19937 random(7);
  const std::vector<const crypto::SigningIdentity*> people{&net.host, &net.pilot, &net.admin1, &net.admin2};
  const std::vector<std::string> functions{"set",  "get",    "delete", "acquire", "release",
                                           "stop", "enroll", "grant",  "none"};
  const auto one_of = [&](const auto& all) { return all[random() % all.size()]; };
  int refused = 0;
  for (int i = 0; i < 1000; ++i) {
    const std::string function = one_of(functions),
                      id = std::string(random() % 4 == 0 ? "tello2" : "tello1") + "/x" + std::to_string(random() % 4);
    const std::string arg =
        function == "set" ? note(id, std::to_string(i)) : one_of(std::vector<std::string>{id, "tello1", "", "?"});
    const crypto::SigningIdentity& who = random() % 3 != 0 ? net.host : *one_of(people);
    const auto proposal = net.propose(who, function, arg);
    ASSERT_EQ(beside_the_node(proposal), Comparison::same) << function << " " << arg;
    const Reply reply = net.core->endorse(proposal.signed_proposal, net.now);
    if (reply.code != Code::ok) {
      ++refused;
      continue;
    }
    if (random() % 3 != 0) continue;
    net.core->order(*fabric::sign_envelope(who, reply.bytes), net.now);
    net.commit();
    follow();
    ASSERT_EQ(beside_the_node(proposal), Comparison::same) << "a transaction that was there before";
  }
  EXPECT_GT(refused, 100);
  EXPECT_LT(refused, 900);
}

TEST_F(OwnEndorserTest, ABehindStateIsOneThatHasReadOtherVersions) {
  net.submit(net.host, "set", note("tello1/a", "1"));
  follow();
  net.submit(net.host, "set", note("tello1/a", "2"));
  EXPECT_EQ(beside_the_node(net.propose(net.host, "get", "tello1/a")), Comparison::other_state);
  follow();
  EXPECT_EQ(beside_the_node(net.propose(net.host, "get", "tello1/a")), Comparison::same);
}

TEST_F(OwnEndorserTest, ATamperedAnswerDiffers) {
  const auto proposal = net.propose(net.host, "set", note("tello1/a"));
  const std::string own = ask(proposal).bytes;
  protos::ProposalResponse other;
  ASSERT_TRUE(other.ParseFromString(own));
  other.mutable_response()->set_message("all is well");
  EXPECT_EQ(compare_answers(own, other.SerializeAsString()), Comparison::differ);
  const std::string elsewhere = ask(net.propose(net.host, "set", note("tello1/b"))).bytes;
  EXPECT_EQ(compare_answers(own, "no message of any kind"), Comparison::differ);
  protos::ProposalResponse mixed;
  ASSERT_TRUE(mixed.ParseFromString(elsewhere));
  EXPECT_NE(compare_answers(own, elsewhere), Comparison::same);
}

TEST_F(OwnEndorserTest, HistoryIsAPeersToTell) {
  net.submit(net.host, "set", note("tello1/a"));
  follow();
  EXPECT_EQ(ask(net.propose(net.host, "history", "tello1/a")).code, Code::unavailable);
}

TEST_F(OwnEndorserTest, ABlockOutOfTurnIsRefused) {
  net.submit(net.host, "set", note("tello1/a"));
  net.submit(net.host, "set", note("tello1/b"));
  const std::string& last = net.chain.back();
  const Status taken = core.apply(*fabric::decode_block(last), last);
  ASSERT_FALSE(taken.ok());
  EXPECT_THAT(taken.error().message, HasSubstr("where 2 was due"));
  follow();
}

TEST_F(OwnEndorserTest, ABlockOfAnotherChainIsRefused) {
  net.submit(net.host, "set", note("tello1/a"));
  common::Block other;
  ASSERT_TRUE(other.ParseFromString(net.chain.back()));
  other.mutable_header()->set_previous_hash(std::string(32, 'f'));
  const std::string raw = other.SerializeAsString();
  const Status taken = core.apply(*fabric::decode_block(raw), raw);
  ASSERT_FALSE(taken.ok());
  EXPECT_THAT(taken.error().message, HasSubstr("of another chain"));
  EXPECT_FALSE(core.apply(*fabric::decode_block(net.chain.back()), net.chain.front()).ok()) << "bytes of another block";
  follow();
}

TEST_F(OwnEndorserTest, ATransactionOfAnIdThatWasUsedCountsForNobody) {
  net.submit(net.host, "set", note("tello1/a", "1"));
  follow();
  common::Block last;
  ASSERT_TRUE(last.ParseFromString(net.chain.back()));
  const auto before = net.propose(net.host, "get", "tello1/a");
  const std::string read = ask(before).bytes;
  // As an orderer's stream tells it to who does not have the ids of all blocks.
  common::Block again = node::make_block({core.height(), fabric::header_hash(last.header())}, {last.data().data(0)});
  again.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, std::string(1, '\0'));
  const std::string raw = again.SerializeAsString();
  const auto block = fabric::decode_block(raw);
  ASSERT_EQ(block->transactions.at(0).code, 0);
  ASSERT_TRUE(core.apply(*block, raw).ok());
  EXPECT_EQ(compare_answers(read, ask(before).bytes), Comparison::same) << "what it writes was written once";
}

TEST_F(OwnEndorserTest, AnotherCoreGoesOnWhereASnapshotWasTaken) {
  for (const char* id : {"tello1/a", "tello1/b", "tello1/a"}) net.submit(net.host, "set", note(id, "1"));
  follow();
  EndorserCore other{{{}, identity, test_members()}};
  ASSERT_TRUE(other.restore(core.snapshot()).ok());
  EXPECT_EQ(other.height(), core.height());
  EXPECT_EQ(other.snapshot().size(), core.snapshot().size()) << "ids are in any order";
  net.submit(net.host, "delete", "tello1/b");
  follow();
  ASSERT_TRUE(other.apply(*fabric::decode_block(net.chain.back()), net.chain.back()).ok());
  for (const auto& proposal : {net.propose(net.host, "get", "tello1/a"), net.propose(net.host, "get", "tello1/b"),
                               net.propose(net.host, "set", note("tello1/b")), net.propose(net.pilot, "stop", "tello1"),
                               net.propose(net.host, "history", "tello1/a")}) {
    const Reply one = ask(proposal), two = other.process_proposal(proposal.signed_proposal, net.now);
    EXPECT_EQ(one.code, two.code);
    EXPECT_EQ(one.message, two.message);
    if (one.code == Code::ok) {
      EXPECT_EQ(compare_answers(one.bytes, two.bytes), Comparison::same);
    }
  }
}

TEST_F(OwnEndorserTest, AStateAsItWasKeptBeforeIsReadAsOfTheWholeChain) {
  net.submit(net.host, "set", note("tello1/a"));
  follow();
  // Without the number of the first block that the history has.
  const std::string now = core.snapshot(), head = "ledgerline endorser ";
  const std::string before =
      head + "1" + now.substr(head.size() + 1, now.size() - head.size() - 1 - sizeof(std::uint64_t));
  EndorserCore other{{{}, identity, test_members()}};
  ASSERT_TRUE(other.restore(before).ok());
  EXPECT_EQ(other.snapshot().size(), now.size());
  const auto proposal = net.propose(net.host, "get", "tello1/a");
  EXPECT_EQ(compare_answers(other.process_proposal(proposal.signed_proposal, net.now).bytes, ask(proposal).bytes),
            Comparison::same);
}

TEST_F(OwnEndorserTest, ASnapshotThatIsNotWholeIsRefused) {
  for (int i = 0; i < 5; ++i) net.submit(net.host, "set", note("tello1/a" + std::to_string(i)));
  follow();
  const std::string whole = core.snapshot();
  for (std::size_t size = 0; size < whole.size(); size += 1 + size / 64) {
    EndorserCore other{{{}, identity, test_members()}};
    ASSERT_FALSE(other.restore(whole.substr(0, size)).ok()) << size;
    ASSERT_EQ(other.height(), 0U);
  }
  EndorserCore longer{{{}, identity, test_members()}};
  EXPECT_FALSE(longer.restore(whole + "x").ok());
  // Bytes that say anything: an error or a state, in the memory that they have.
  std::mt19937 random(3);
  for (int i = 0; i < 3000; ++i) {
    std::string bent = whole;
    for (int k = 0; k < 1 + static_cast<int>(random() % 4); ++k)
      bent[random() % bent.size()] = static_cast<char>(random());
    EndorserCore other{{{}, identity, test_members()}};
    (void)other.restore(bent);
  }
}

TEST_F(OwnEndorserTest, WithoutAPeersIdentityItSignsNothing) {
  EndorserCore client{{{}, crypto::make_test_identity({"Org1MSP", "CN=user"}), test_members()}};
  EndorserCore outsider{{{}, crypto::make_test_identity({"Org9MSP", "CN=peer1"}), test_members()}};
  for (EndorserCore* one : {&client, &outsider}) {
    for (const std::string& raw : net.chain) ASSERT_TRUE(one->apply(*fabric::decode_block(raw), raw).ok());
    const Reply reply = one->process_proposal(net.propose(net.host, "set", note("tello1/a")).signed_proposal, net.now);
    EXPECT_EQ(reply.code, Code::unavailable);
    EXPECT_THAT(reply.message, HasSubstr("no endorsement of this endorser counts"));
  }
}

TEST_F(OwnEndorserTest, OutsidersWrongSignaturesAndDuplicatesAreRefusedInThePeersWords) {
  const auto outsider = crypto::make_test_identity({"Org9MSP", "CN=x"});
  EXPECT_EQ(beside_the_node(net.propose(outsider, "get", "tello1/a")), Comparison::same);
  EXPECT_EQ(ask(net.propose(outsider, "get", "tello1/a")).code, Code::unknown);
  protos::SignedProposal wrong;
  wrong.ParseFromString(net.propose(net.host, "set", note("tello1/a")).signed_proposal);
  wrong.set_signature("wrong");
  EXPECT_EQ(core.process_proposal(wrong.SerializeAsString(), net.now).code, Code::unknown);
  EXPECT_EQ(core.process_proposal("no proposal", net.now).code, Code::unavailable);
}

TEST_F(OwnEndorserTest, OtherContractsAndChannelsAreAPeersToAnswer) {
  for (const fabric::ChannelAndContract& where : {fabric::ChannelAndContract{"teleop", "qscc"},
                                                  {"teleop", "other"},
                                                  {"\x01", "ledgerline"},
                                                  {"", "ledgerline"}}) {
    const auto proposal = fabric::make_proposal(net.host, where, {"get", {""}}, 0, std::string(24, 'n'));
    EXPECT_EQ(ask(*proposal).code, Code::unavailable) << where.channel << " " << where.contract;
  }
}

TEST_F(OwnEndorserTest, AProposalOfAnEpochIsNotSigned) {
  protos::SignedProposal outer;
  protos::Proposal inner;
  common::Header header;
  common::ChannelHeader channel;
  outer.ParseFromString(net.propose(net.host, "set", note("tello1/a")).signed_proposal);
  inner.ParseFromString(outer.proposal_bytes());
  header.ParseFromString(inner.header());
  channel.ParseFromString(header.channel_header());
  channel.set_epoch(1);
  header.set_channel_header(channel.SerializeAsString());
  inner.set_header(header.SerializeAsString());
  outer.set_proposal_bytes(inner.SerializeAsString());
  outer.set_signature(*net.host.signer->sign(outer.proposal_bytes()));
  EXPECT_EQ(core.process_proposal(outer.SerializeAsString(), net.now).code, Code::unavailable);
  const Reply nodes = net.core->process_proposal(outer.SerializeAsString(), net.now);
  EXPECT_EQ(nodes.code, Code::unknown);
  EXPECT_EQ(nodes.message, "epoch is non-zero");
}

TEST_F(OwnEndorserTest, AFieldThatNobodyKnowsIsNotSigned) {
  auto proposal = net.propose(net.host, "set", note("tello1/a"));
  protos::SignedProposal outer;
  protos::Proposal inner;
  outer.ParseFromString(proposal.signed_proposal);
  inner.ParseFromString(outer.proposal_bytes());
  const auto hash_of = [&] {
    outer.set_proposal_bytes(inner.SerializeAsString());
    outer.set_signature(*net.host.signer->sign(outer.proposal_bytes()));
    protos::ProposalResponse response;
    protos::ProposalResponsePayload payload;
    EXPECT_TRUE(response.ParseFromString(core.process_proposal(outer.SerializeAsString(), net.now).bytes));
    EXPECT_TRUE(payload.ParseFromString(response.payload()));
    return payload.proposal_hash();
  };
  const std::string before = hash_of();
  inner.set_payload(inner.payload() + "\x7a\x01x");  // field 15
  EXPECT_EQ(hash_of(), before) << "peers leave it out of what a transaction holds";
}

}  // namespace
}  // namespace ledgerline::endorser
