#include <gmock/gmock.h>

#include "chaincode/node/core/block.hpp"
#include "common/ledger.pb.h"
#include "gateway/gateway.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/query.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
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

class CoreTest : public ::testing::Test {
 protected:
  CoreTest() { net.submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"})); }

  Reply evaluate(const std::string& function, const std::string& arg) {
    return net.core->evaluate(net.propose(net.pilot, function, arg).signed_proposal, net.now);
  }

  std::string value_of(const std::string& id) {
    const Reply reply = evaluate("get", id);
    protos::Response response;
    if (reply.code != Code::ok || !response.ParseFromString(reply.bytes)) return reply.detail;
    Asset asset;
    EXPECT_TRUE(parse_message(response.payload(), asset).ok());
    return asset.msg_data();
  }

  FakeNetwork net;
};

TEST_F(CoreTest, WhatIsSubmittedIsInABlockAndInTheState) {
  EXPECT_THAT(net.submit(net.host, "set", note("tello1/a", "hello")), ElementsAre(protos::VALID));
  EXPECT_EQ(value_of("tello1/a"), "hello");
  const fabric::Block block = net.block(2);
  ASSERT_THAT(block.transactions, SizeIs(1));
  EXPECT_EQ(block.transactions[0].code, 0);
  EXPECT_EQ(block.transactions[0].event_name, "set");
}

TEST_F(CoreTest, EveryOrganisationsPeerEndorses) {
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

TEST_F(CoreTest, BlocksFormAChainThatAnIndependentReaderAccepts) {
  for (int i = 0; i < 5; ++i) net.submit(net.host, "set", note("tello1/a"));
  fabric::ChainCheck check;
  for (std::size_t i = 0; i < net.chain.size(); ++i) ASSERT_TRUE(check.add(net.block(i)).ok()) << i;
  EXPECT_EQ(check.height(), net.core->height());
}

TEST_F(CoreTest, HeaderHashesAreThoseThatClientsCompute) {
  for (const std::uint64_t number : {0ULL, 1ULL, 127ULL, 128ULL, 255ULL, 256ULL, 1ULL << 63}) {
    common::BlockHeader header;
    header.set_number(number);
    header.set_previous_hash(std::string(32, 'p'));
    header.set_data_hash(std::string(32, 'd'));
    EXPECT_EQ(header_hash(header), fabric::block_header_hash(number, header.previous_hash(), header.data_hash()));
  }
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

TEST_F(CoreTest, ARefusalOfTheContractIsAbortedWithItsWords) {
  const Reply reply = net.core->endorse(net.propose(net.pilot, "set", note("tello1/a")).signed_proposal, net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("chaincode response 500, tello1: enrolled to Org1MSP CN=host"));
  const Reply missing = evaluate("get", "tello1/none");
  EXPECT_EQ(missing.code, Code::unknown);
  EXPECT_EQ(missing.detail, "chaincode response 500, tello1/none: not found");
}

TEST_F(CoreTest, AWrongSignatureOfAProposalIsDenied) {
  protos::SignedProposal proposal;
  proposal.ParseFromString(net.propose(net.host, "set", note("tello1/a")).signed_proposal);
  proposal.set_signature("wrong");
  const Reply reply = net.core->endorse(proposal.SerializeAsString(), net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("error validating proposal: access denied: channel [teleop]"));
  EXPECT_EQ(net.core->evaluate(proposal.SerializeAsString(), net.now).code, Code::failed_precondition);
}

TEST_F(CoreTest, AMemberOfAnUnknownOrganisationIsDenied) {
  const auto stranger = crypto::make_test_identity({"Org9MSP", "CN=x"});
  const Reply reply = net.core->endorse(net.propose(stranger, "get", "").signed_proposal, net.now);
  EXPECT_THAT(reply.detail, HasSubstr("access denied"));
}

TEST_F(CoreTest, OtherChannelsAndContractsAreTold) {
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

/// What `peer channel getinfo` and others ask.
class SystemTest : public CoreTest {
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

TEST_F(SystemTest, HeightAndHashesAreTold) {
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

TEST_F(SystemTest, BlocksAndTransactionsAreFound) {
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

TEST_F(SystemTest, WhatIsNotThereIsRefused) {
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

TEST_F(SystemTest, WhoIsNoMemberIsNotAnsweredAndNothingIsEndorsed) {
  const auto stranger = crypto::make_test_identity({"Org9MSP", "CN=x"});
  const auto propose = [&](const crypto::SigningIdentity& who) {
    return fabric::make_proposal(who, {"teleop", "qscc"}, {"GetChainInfo", {"teleop"}}, 0, std::string(24, 'n'))
        ->signed_proposal;
  };
  EXPECT_EQ(net.core->process_proposal(propose(stranger), net.now).code, Code::unknown);
  EXPECT_EQ(net.core->evaluate(propose(net.host), net.now).code, Code::ok);
  EXPECT_EQ(net.core->endorse(propose(net.host), net.now).code, Code::failed_precondition);
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

TEST_F(CoreTest, TheDirectEndorserAnswersWithARefusalAsFabricDoes) {
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

TEST_F(CoreTest, AnUnsignedEnvelopeIsForbidden) {
  const Reply endorsed = net.core->endorse(net.propose(net.host, "set", note("tello1/a")).signed_proposal, net.now);
  const Reply reply = net.core->order(endorsed.bytes, net.now);
  EXPECT_EQ(reply.code, Code::permission_denied);
  EXPECT_THAT(reply.detail, HasSubstr("status=FORBIDDEN"));
  EXPECT_THAT(net.commit(), IsEmpty());
}

TEST_F(CoreTest, AnEnvelopeThatIsTooLargeIsTold) {
  const std::string bytes = net.endorsed(net.host, "set", note("tello1/a"));
  common::Envelope envelope;
  ASSERT_TRUE(envelope.ParseFromString(bytes));
  // As Fabric's orderer counts.
  const std::size_t size = envelope.payload().size() + envelope.signature().size();
  net.config.max_envelope_bytes = size - 1;
  net.restart();
  const Reply reply = net.core->order(bytes, net.now);
  EXPECT_EQ(reply.code, Code::invalid_argument);
  EXPECT_THAT(reply.detail, HasSubstr("status=BAD_REQUEST, info=message payload is " + std::to_string(size) +
                                      " bytes and exceeds maximum allowed " + std::to_string(size - 1) + " bytes"));
  net.config.max_envelope_bytes = size;
  net.restart();
  EXPECT_EQ(net.core->order(bytes, net.now).code, Code::ok);
}

TEST_F(CoreTest, TooManyWaitingEnvelopesAreRefused) {
  net.config.max_waiting = 2;
  net.restart();
  for (int i = 0; i < 2; ++i)
    EXPECT_EQ(net.core->order(net.endorsed(net.host, "set", note("tello1/a")), net.now).code, Code::ok);
  EXPECT_EQ(net.core->order(net.endorsed(net.host, "set", note("tello1/a")), net.now).code, Code::unavailable);
}

TEST_F(CoreTest, OfTwoCallsThatReadWhatBothWriteOneIsInvalid) {
  net.submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
  const std::string first = net.endorsed(net.pilot, "acquire", "tello1");
  const std::string second = net.endorsed(net.pilot, "acquire", "tello1");
  net.core->order(first, net.now);
  net.core->order(second, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(CoreTest, TheSameHoldsWithinOneBlock) {
  net.config.batch_count = 2;
  net.restart();
  net.core->order(net.endorsed(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR)), net.now);
  net.core->order(net.endorsed(net.admin2, "enroll", enroll_call(net.pilot.name, {}, SUPERVISOR)), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(CoreTest, AFrameInFlightIsInvalidatedByAChangeOfItsDronesRecord) {
  const std::string frame = net.endorsed(net.host, "set", note("tello1/a"));
  net.submit(net.admin1, "enroll", enroll_call({"Org1MSP", "CN=new"}, {"tello1"}));
  net.core->order(frame, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::MVCC_READ_CONFLICT));
}

TEST_F(CoreTest, FramesOfOneHostNeverConflict) {
  net.config.batch_count = 5;
  net.restart();
  for (int i = 0; i < 5; ++i) net.core->order(net.endorsed(net.host, "set", note("tello1/a")), net.now);
  EXPECT_THAT(net.commit(), ElementsAre(0, 0, 0, 0, 0));
}

TEST_F(CoreTest, ANewKeyInARangeThatWasReadIsAPhantom) {
  net.submit(net.host, "set", note("tello1/a"));
  const std::string listing = net.endorsed(net.host, "get", "tello1/*");
  const std::string again = net.endorsed(net.host, "get", "tello1/*");
  net.core->order(listing, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID));
  net.submit(net.host, "set", note("tello1/b"));
  net.core->order(again, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::PHANTOM_READ_CONFLICT));
}

TEST_F(CoreTest, ATransactionIsAcceptedOnce) {
  const std::string envelope = net.endorsed(net.host, "set", note("tello1/a"));
  net.core->order(envelope, net.now);
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::DUPLICATE_TXID));
  net.restart();
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::DUPLICATE_TXID)) << "remembered across a restart";
}

TEST_F(CoreTest, ATransactionTwiceInOneBlockIsAcceptedOnce) {
  net.config.batch_count = 2;
  net.restart();
  const std::string envelope = net.endorsed(net.host, "set", note("tello1/a"));
  net.core->order(envelope, net.now);
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID, protos::DUPLICATE_TXID));
}

TEST_F(CoreTest, AnIdIsUsedUpWithinABlockByATransactionThatReadOldValues) {
  const std::string stale = net.endorsed(net.host, "set", note("tello1/a"));
  net.submit(net.admin1, "enroll", enroll_call({"Org1MSP", "CN=new"}, {"tello1"}));
  net.config.batch_count = 2;
  net.restart();
  net.core->order(stale, net.now);
  net.core->order(stale, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::MVCC_READ_CONFLICT, protos::DUPLICATE_TXID));
}

TEST_F(CoreTest, AProposalIsNotEndorsedAgainAfterItsCommit) {
  const auto proposal = net.propose(net.host, "set", note("tello1/a"));
  net.core->order(*fabric::sign_envelope(net.host, net.core->endorse(proposal.signed_proposal, net.now).bytes),
                  net.now);
  net.commit();
  const Reply reply = net.core->endorse(proposal.signed_proposal, net.now);
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("duplicate transaction found"));
}

TEST_F(CoreTest, AResultThatNobodyEndorsedIsInvalid) {
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

TEST_F(CoreTest, AClientCannotEndorseItself) {
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

TEST_F(CoreTest, OneGoodEndorsementIsEnough) {
  const std::string envelope = forge(net.host, net.endorsed(net.host, "set", note("tello1/a")), [](auto& payload) {
    payload.mutable_action()->mutable_endorsements(0)->set_signature("wrong");
  });
  net.core->order(envelope, net.now);
  EXPECT_THAT(net.commit(), ElementsAre(protos::VALID));
}

TEST_F(CoreTest, AnEventInAFalseNameIsInvalidThoughAPeerEndorsedIt) {
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

TEST_F(CoreTest, AnInvalidTransactionWritesNothing) {
  net.submit(net.host, "set", note("tello1/a", "good"));
  net.core->order(forge(net.host, net.endorsed(net.host, "set", note("tello1/a", "bad")),
                        [](auto& payload) { payload.mutable_action()->clear_endorsements(); }),
                  net.now);
  net.commit();
  EXPECT_EQ(value_of("tello1/a"), "good");
}

TEST_F(CoreTest, HistoryIsReadFromTheBlocks) {
  for (const char* value : {"one", "two", "three"}) net.submit(net.host, "set", note("tello1/a", value));
  const auto history = [&] {
    protos::Response response;
    EXPECT_TRUE(response.ParseFromString(evaluate("history", "tello1/a").bytes));
    Versions versions;
    EXPECT_TRUE(parse_message(response.payload(), versions).ok());
    std::vector<std::string> values;
    for (const ledgerline::Version& version : versions.versions()) values.push_back(version.asset().msg_data());
    return values;
  };
  EXPECT_THAT(history(), ElementsAre("three", "two", "one"));
  net.restart();
  EXPECT_THAT(history(), ElementsAre("three", "two", "one"));
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

TEST_F(CoreTest, AReplayedBlockThatDoesNotFitIsAnErrorThatNamesIt) {
  net.submit(net.host, "set", note("tello1/a"));
  const auto replay = [&](const std::vector<std::string>& chain) {
    FakeNetwork fresh;
    NodeCore core(fresh.config, crypto::make_test_registry({"Org1MSP"}), {net.host}, net.host, nullptr);
    for (const std::string& block : chain) {
      if (Status status = core.replay(block); !status) return status.error().what;
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

TEST_F(CoreTest, WaitersHearOfTheirTransactionOnce) {
  const auto proposal = net.propose(net.host, "set", note("tello1/a"));
  EXPECT_FALSE(net.core->watch(proposal.tx_id, 7));
  EXPECT_FALSE(net.core->watch(proposal.tx_id, 8));
  EXPECT_FALSE(net.core->watch(proposal.tx_id, 9));
  net.core->unwatch(proposal.tx_id, 8);
  net.core->order(*fabric::sign_envelope(net.host, net.core->endorse(proposal.signed_proposal, net.now).bytes),
                  net.now);
  const Applied applied = net.keep(*net.core->cut(net.now));
  ASSERT_THAT(applied.answers, SizeIs(2));
  EXPECT_EQ(applied.answers[0].waiter, 7U);
  EXPECT_EQ(applied.answers[1].waiter, 9U);
  EXPECT_EQ(applied.answers[0].status.block, 2U);
  EXPECT_EQ(net.core->watch(proposal.tx_id, 10)->code, 0) << "a late one is answered at once";
}

class CutTest : public ::testing::Test {
 protected:
  void start(std::size_t count, std::size_t bytes) {
    CoreConfig config;
    config.batch_count = count;
    config.batch_bytes = bytes;
    config.batch_timeout_ns = 10 * ns_per_ms;
    net = std::make_unique<FakeNetwork>(config);
  }
  std::size_t order() {
    const std::string envelope = net->endorsed(net->host, "set", note("Org1MSP/a"));
    EXPECT_EQ(net->core->order(envelope, net->now).code, Code::ok);
    return envelope.size();
  }
  std::unique_ptr<FakeNetwork> net;
};

TEST_F(CutTest, NothingIsCutWhileNothingWaits) {
  start(1, 1'000'000);
  EXPECT_FALSE(net->core->next_cut());
  EXPECT_FALSE(net->core->cut(net->now));
}

TEST_F(CutTest, ABlockIsCutByCount) {
  start(3, 1'000'000);
  order();
  order();
  EXPECT_FALSE(net->core->cut(net->now));
  order();
  EXPECT_EQ(net->core->next_cut(), net->now.monotonic_ns);
  EXPECT_THAT(net->core->cut(net->now)->transactions, SizeIs(3));
}

TEST_F(CutTest, ABlockIsCutWhenTheOldestHasWaitedLongEnough) {
  start(100, 1'000'000);
  order();
  const TimeNs begin = net->now.monotonic_ns;
  net->now.monotonic_ns += 5 * ns_per_ms;
  order();
  EXPECT_EQ(net->core->next_cut(), begin + 10 * ns_per_ms);
  net->now.monotonic_ns = begin + 10 * ns_per_ms - 1;
  EXPECT_FALSE(net->core->cut(net->now));
  net->now.monotonic_ns += 1;
  EXPECT_THAT(net->core->cut(net->now)->transactions, SizeIs(2));
}

TEST_F(CutTest, ABlockIsCutByBytesAndKeepsWithinThem) {
  start(100, 1'000'000);
  const std::size_t size = order();
  start(100, 2 * size + size / 2);
  order();
  order();
  EXPECT_FALSE(net->core->cut(net->now));
  order();
  const auto block = net->core->cut(net->now);
  ASSERT_TRUE(block);
  EXPECT_THAT(block->transactions, SizeIs(2));
}

TEST_F(CutTest, AnEnvelopeLargerThanABlockGoesAlone) {
  start(100, 10);
  order();
  order();
  EXPECT_THAT(net->core->cut(net->now)->transactions, SizeIs(1));
}

TEST_F(CutTest, WhileABlockIsUnderWayNoneIsCutAndReadsSeeTheStateBefore) {
  start(1, 1'000'000);
  order();
  order();
  const auto block = net->core->cut(net->now);
  ASSERT_TRUE(block);
  EXPECT_FALSE(net->core->next_cut());
  EXPECT_FALSE(net->core->cut(net->now));
  const auto get = [&] {
    return net->core->evaluate(net->propose(net->host, "get", "Org1MSP/a").signed_proposal, net->now).code;
  };
  EXPECT_EQ(get(), Code::unknown) << "not on disk, not told";
  net->keep(*block);
  EXPECT_EQ(get(), Code::ok);
  EXPECT_TRUE(net->core->cut(net->now));
}

}  // namespace
}  // namespace ledgerline::node
