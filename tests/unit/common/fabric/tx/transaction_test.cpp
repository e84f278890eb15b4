#include <gtest/gtest.h>

#include "msp/identities.pb.h"
#include "orderer/ab.pb.h"
#include "peer/chaincode.pb.h"
#include "peer/proposal.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

namespace ledgerline::fabric {
namespace {

const crypto::SigningIdentity client = crypto::make_test_identity({"Org1MSP", "CN=User1@org1"});
const crypto::SigningIdentity peer = crypto::make_test_identity({"Org1MSP", "CN=peer0.org1"});
const auto registry = crypto::make_test_registry({"Org1MSP"});
const std::string nonce(24, 'n');

bool signed_by(const crypto::SigningIdentity& who, const std::string& message, const std::string& signature) {
  return registry->member(who.serialized, 0).value()->verifier->verify(message, signature);
}

TEST(Proposal, HasWhatFabricWants) {
  const auto proposal = make_proposal(client, {"teleop", "ledgerline"}, {"set", {"a", std::string("\0b", 2)}},
                                      1'700'000'000'123'456'789, nonce)
                            .value();
  EXPECT_EQ(proposal.tx_id, crypto::hex(crypto::sha256(nonce + client.serialized)));
  protos::SignedProposal outer;
  ASSERT_TRUE(outer.ParseFromString(proposal.signed_proposal));
  EXPECT_TRUE(signed_by(client, outer.proposal_bytes(), outer.signature()));
  protos::Proposal inner;
  common::Header header;
  common::ChannelHeader channel;
  common::SignatureHeader signature;
  protos::ChaincodeHeaderExtension extension;
  ASSERT_TRUE(inner.ParseFromString(outer.proposal_bytes()) && header.ParseFromString(inner.header()) &&
              channel.ParseFromString(header.channel_header()) &&
              signature.ParseFromString(header.signature_header()) && extension.ParseFromString(channel.extension()));
  EXPECT_EQ(channel.type(), common::ENDORSER_TRANSACTION);
  EXPECT_EQ(channel.channel_id(), "teleop");
  EXPECT_EQ(channel.tx_id(), proposal.tx_id);
  EXPECT_EQ(channel.timestamp().seconds(), 1'700'000'000);
  EXPECT_EQ(channel.timestamp().nanos(), 123'456'789);
  EXPECT_EQ(extension.chaincode_id().name(), "ledgerline");
  EXPECT_EQ(signature.creator(), client.serialized);
  EXPECT_EQ(signature.nonce(), nonce);
  const Call call = call_of(proposal.signed_proposal);
  EXPECT_EQ(call.function, "set");
  EXPECT_EQ(call.args, (std::vector<std::string>{"a", std::string("\0b", 2)}));
}

TEST(Proposal, SameInputsMakeTheSameBytes) {
  const auto make = [] { return make_proposal(client, {}, {"set", {"a"}}, 5, nonce).value().signed_proposal; };
  EXPECT_EQ(make(), make());
}

TEST(Seek, AsksForBlocksWithoutEnd) {
  for (const std::optional<std::uint64_t> start : {std::optional<std::uint64_t>(7), std::optional<std::uint64_t>()}) {
    common::Envelope envelope;
    ASSERT_TRUE(
        envelope.ParseFromString(make_seek(client, "teleop", start, ns_per_s, nonce, SeekStop::never, "hash").value()));
    EXPECT_TRUE(signed_by(client, envelope.payload(), envelope.signature()));
    common::Payload payload;
    common::ChannelHeader channel;
    orderer::SeekInfo seek;
    ASSERT_TRUE(payload.ParseFromString(envelope.payload()) &&
                channel.ParseFromString(payload.header().channel_header()) && seek.ParseFromString(payload.data()));
    EXPECT_EQ(channel.type(), common::DELIVER_SEEK_INFO);
    EXPECT_EQ(channel.channel_id(), "teleop");
    EXPECT_EQ(channel.tls_cert_hash(), "hash");
    EXPECT_EQ(seek.start().has_newest(), !start.has_value());
    EXPECT_EQ(seek.start().specified().number(), start.value_or(0));
    EXPECT_EQ(seek.stop().specified().number(), UINT64_MAX);
    EXPECT_EQ(seek.behavior(), orderer::SeekInfo::BLOCK_UNTIL_READY);
  }
}

TEST(Seek, AsksForASingleBlock) {
  for (const std::optional<std::uint64_t> start : {std::optional<std::uint64_t>(7), std::optional<std::uint64_t>()}) {
    common::Envelope envelope;
    common::Payload payload;
    orderer::SeekInfo seek;
    ASSERT_TRUE(
        envelope.ParseFromString(make_seek(client, "teleop", start, ns_per_s, nonce, SeekStop::at_start).value()) &&
        payload.ParseFromString(envelope.payload()) && seek.ParseFromString(payload.data()));
    for (const auto& position : {seek.start(), seek.stop()}) {
      EXPECT_EQ(position.has_newest(), !start.has_value());
      EXPECT_EQ(position.specified().number(), start.value_or(0));
    }
    EXPECT_EQ(seek.behavior(), orderer::SeekInfo::FAIL_IF_NOT_READY);
  }
}

class PreparedTransaction : public testing::Test {
 protected:
  std::string refusal(const common::Envelope& envelope) const {
    auto prepared = check_prepared(proposal_, envelope.SerializeAsString());
    return prepared ? "accepted" : prepared.error().message;
  }
  common::Envelope endorsed(const Proposal& proposal) const {
    return endorse(proposal.signed_proposal, {peer}, "answer", "set", "a");
  }

  Proposal proposal_ = make_proposal(client, {}, {"set", {"a"}}, 5, nonce).value();
};

TEST_F(PreparedTransaction, OurOwnIsAcceptedAndSigned) {
  const std::string envelope = endorsed(proposal_).SerializeAsString();
  EXPECT_EQ(check_prepared(proposal_, envelope).value(), "answer");
  common::Envelope whole;
  ASSERT_TRUE(whole.ParseFromString(sign_envelope(client, envelope).value()));
  EXPECT_EQ(whole.payload(), endorsed(proposal_).payload());
  EXPECT_TRUE(signed_by(client, whole.payload(), whole.signature()));
}

TEST_F(PreparedTransaction, AnotherCallIsRefused) {
  // Same header, other arguments: what a lying gateway would have us sign.
  protos::SignedProposal outer;
  protos::Proposal inner, other;
  outer.ParseFromString(proposal_.signed_proposal);
  inner.ParseFromString(outer.proposal_bytes());
  protos::SignedProposal forged;
  forged.ParseFromString(make_proposal(client, {}, {"set", {"b"}}, 5, nonce).value().signed_proposal);
  other.ParseFromString(forged.proposal_bytes());
  inner.set_payload(other.payload());
  outer.set_proposal_bytes(inner.SerializeAsString());
  EXPECT_NE(refusal(endorse(outer.SerializeAsString(), {peer}, "", "", "")).find("not the one that was asked for"),
            std::string::npos);
}

TEST_F(PreparedTransaction, AnEventThatTheCallerDoesNotExpectIsNotSigned) {
  const EventCheck is_the_call = [](std::string_view name, std::string_view payload) -> Status {
    if (name == "set" && payload == "a") return done;
    return Error{"its event is not the call"};
  };
  EXPECT_TRUE(check_prepared(proposal_, endorsed(proposal_).SerializeAsString(), is_the_call));
  for (const auto& [name, payload] : {std::pair("set", "b"), std::pair("command", "a"), std::pair("", "")}) {
    const auto envelope = endorse(proposal_.signed_proposal, {peer}, "answer", name, payload).SerializeAsString();
    EXPECT_TRUE(check_prepared(proposal_, envelope));  // a contract that nobody knows may emit what it likes
    const auto refused = check_prepared(proposal_, envelope, is_the_call);
    ASSERT_FALSE(refused) << name;
    EXPECT_EQ(refused.error().message,
              "the peer's result is not what was asked for: its event is not the call; it was not signed");
  }
}

TEST_F(PreparedTransaction, AnEventOfAnotherTransactionIsNeverSigned) {
  const auto refused = check_prepared(proposal_, with_foreign_event(endorsed(proposal_).SerializeAsString()));
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("names another transaction or contract"), std::string::npos);
}

TEST_F(PreparedTransaction, AnotherHeaderIsRefused) {
  EXPECT_NE(refusal(endorsed(make_proposal(client, {}, {"set", {"a"}}, 6, nonce).value())).find("not the one"),
            std::string::npos);
  EXPECT_NE(refusal(endorsed(make_proposal(client, {"other", "ledgerline"}, {"set", {"a"}}, 5, nonce).value()))
                .find("not the one"),
            std::string::npos);
  EXPECT_NE(refusal(endorsed(make_proposal(peer, {}, {"set", {"a"}}, 5, nonce).value())).find("not the one"),
            std::string::npos);
}

TEST_F(PreparedTransaction, GarbageIsRefused) {
  const std::string good = endorsed(proposal_).SerializeAsString();
  for (std::size_t cut = 0; cut + 1 < good.size(); cut += 3)
    EXPECT_FALSE(check_prepared(proposal_, good.substr(0, cut))) << cut;
  EXPECT_FALSE(sign_envelope(client, "\xff\xff"));
}

}  // namespace
}  // namespace ledgerline::fabric
