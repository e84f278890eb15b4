#include <google/protobuf/stubs/logging.h>
#include <gtest/gtest.h>

#include "common/base/random.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

namespace ledgerline::fabric {
namespace {

const crypto::SigningIdentity client = crypto::make_test_identity({"Org1MSP", "CN=User1@org1"});
const crypto::SigningIdentity peer = crypto::make_test_identity({"Org1MSP", "CN=peer0.org1"});

std::string transaction(const std::string& function, const std::string& event) {
  return make_transaction(client, peer, {function, {event}}, std::string(24, 'n') + function);
}

std::string hex_hash(std::uint64_t number, const std::string& previous, const std::string& data) {
  return crypto::hex(block_header_hash(number, previous, data));
}

TEST(BlockHeaderHash, IsThatOfTheAsn1) {
  // DER made by `openssl asn1parse -genconf` from SEQUENCE{INTEGER, OCTET STRING 11.., OCTET STRING 22..}.
  const std::pair<std::uint64_t, const char*> vectors[] = {
      {0U, "e9499908dd9bee5c08cb5ce778e7a913f0b4ade2be6ab5270cdcc242f2438588"},
      {1U, "2a44e23703a89329b8e1050c1fc8855c2b2e1fd990091e145a5cada75d513896"},
      {127U, "1e50be891d2475affbe8b2292d2f771d4ea0b0e853d52d0b341336d81fd27424"},
      {128U, "21255970fce2d8bd67c1b022cb7528f12d311fec7fc8ba34f5414d3983808260"},
      {255U, "0d69ddada34e9bb302ac09891b2bd3fd5f05763a8a364f2415e8b87a937e7e37"},
      {256U, "102f5fcde227f2fd991cf9af0ffa571244bf6cd2aee8d14fb8ff40a0a0d44e7c"},
      {4294967296ULL, "9e84e2beaf591c11efb4b51b2210805bf37c709da41b31108ea29b07d86eb657"},
      {9223372036854775808ULL, "2e0de14bd29f764b8865a34ee9a7ed5579668d9320917168311b1c33bb703204"},
      {18446744073709551615ULL, "6bd48f16ae9e5a452a33346c254ee299c24c94470654a897e60bbd94e2906e25"},
  };
  for (const auto& [number, expected] : vectors) {
    EXPECT_EQ(hex_hash(number, std::string(32, '\x11'), std::string(32, '\x22')), expected) << number;
  }
  EXPECT_EQ(hex_hash(0, "", std::string(32, '\x33')),
            "4ce5f211d57c2ec17d0209b7715b8acf1f1c59fac9d3ab4ea3a68867488a03b2");
  EXPECT_EQ(hex_hash(5, std::string(200, '\x44'), std::string(300, '\x55')),
            "8ec5f2aa05e8d54785606051f03a10087e885520661278bfaacc80da80763983");
}

TEST(DecodeBlock, TakesTransactionsApart) {
  const auto genesis = make_config_block("teleop");
  const auto sent = make_block(&genesis, {transaction("set", "event 1"), transaction("command", "event 2")},
                               std::string("\0\x0b", 2));
  const Block block = decode_block(sent.SerializeAsString()).value();
  EXPECT_EQ(block.number, 1U);
  EXPECT_EQ(block.previous_hash, block_header_hash(0, "", genesis.header().data_hash()));
  ASSERT_EQ(block.transactions.size(), 2U);
  const Transaction& first = block.transactions[0];
  EXPECT_EQ(first.code, 0);
  EXPECT_EQ(first.channel, "teleop");
  EXPECT_EQ(first.contract, "ledgerline");
  EXPECT_EQ(first.event_name, "set");
  EXPECT_EQ(first.event_payload, "event 1");
  EXPECT_EQ(first.function, first.event_name);
  EXPECT_EQ(first.args, std::vector<std::string>{"event 1"});
  EXPECT_EQ(first.creator, client.serialized);
  EXPECT_EQ(first.timestamp_ns, 1'700'000'000 * ns_per_s);
  EXPECT_EQ(first.tx_id, crypto::hex(crypto::sha256(std::string(24, 'n') + "set" + client.serialized)));
  EXPECT_FALSE(first.config);
  EXPECT_EQ(block.transactions[1].code, 11);
  EXPECT_EQ(block.transactions[1].event_name, "command");
}

TEST(DecodeBlock, KeepsWhatSignaturesAreCheckedOver) {
  const auto genesis = make_config_block("teleop");
  const Block block =
      decode_block(make_block(&genesis, {transaction("set", "e")}, std::string(1, '\0')).SerializeAsString()).value();
  const Transaction& t = block.transactions[0];
  const auto registry = crypto::make_test_registry({"Org1MSP"});
  EXPECT_TRUE(registry->member(t.creator, 0).value()->verifier->verify(t.payload, t.signature));
  ASSERT_EQ(t.endorsements.size(), 1U);
  const auto endorser = registry->member(t.endorsements[0].endorser, 0).value();
  EXPECT_TRUE(endorser->peer);
  EXPECT_TRUE(endorser->verifier->verify(t.response_payload + t.endorsements[0].endorser, t.endorsements[0].signature));
}

TEST(DecodeBlock, ConfigTransactionsAreNamedAsSuch) {
  const Block block = decode_block(make_config_block("teleop").SerializeAsString()).value();
  ASSERT_EQ(block.transactions.size(), 1U);
  EXPECT_TRUE(block.transactions[0].config);
  EXPECT_EQ(block.transactions[0].channel, "teleop");
}

TEST(DecodeBlock, TheOrderersBlocksHaveNoFlags) {
  const auto genesis = make_config_block("teleop");
  const Block block = decode_block(make_block(&genesis, {transaction("set", "e")}, "").SerializeAsString()).value();
  EXPECT_EQ(block.transactions[0].code, -1);
  EXPECT_EQ(block.transactions[0].event_name, "set");
}

TEST(DecodeBlock, DataThatDoesNotMatchItsHashIsRefused) {
  const auto genesis = make_config_block("teleop");
  auto sent = make_block(&genesis, {transaction("set", "e"), transaction("get", "e")}, std::string(2, '\0'));
  sent.mutable_data()->mutable_data()->SwapElements(0, 1);
  auto block = decode_block(sent.SerializeAsString());
  ASSERT_FALSE(block);
  EXPECT_EQ(block.error().message, "block 1: its data does not match its data hash");
}

TEST(DecodeBlock, AFlagForEachTransaction) {
  const auto genesis = make_config_block("teleop");
  for (const std::size_t flags : {1U, 3U}) {
    auto block =
        decode_block(make_block(&genesis, {transaction("a", "e"), transaction("b", "e")}, std::string(flags, '\0'))
                         .SerializeAsString());
    ASSERT_FALSE(block);
    EXPECT_NE(block.error().message.find("2 transactions"), std::string::npos);
  }
}

TEST(DecodeBlock, AMalformedTransactionStopsNobodyWhateverItsFlagSays) {
  const auto genesis = make_config_block("teleop");
  const std::vector<std::string> envelopes{transaction("set", "e"), "no envelope at all \xff"};
  const auto flagged = decode_block(make_block(&genesis, envelopes, std::string("\0\x02", 2)).SerializeAsString());
  ASSERT_TRUE(flagged) << flagged.error().message;
  EXPECT_EQ(flagged->transactions[1].code, 2);
  EXPECT_EQ(flagged->transactions[0].event_name, "set");
  const auto unflagged = decode_block(make_block(&genesis, envelopes, "").SerializeAsString());
  ASSERT_TRUE(unflagged);
  EXPECT_EQ(unflagged->transactions[1].code, protos::BAD_PAYLOAD);
  const auto valid = decode_block(make_block(&genesis, envelopes, std::string(2, '\0')).SerializeAsString());
  ASSERT_TRUE(valid);
  EXPECT_EQ(valid->transactions[0].code, 0);
  EXPECT_EQ(valid->transactions[1].code, code_unverified);
  EXPECT_EQ(valid->transactions[1].problem, "it is no envelope");
}

TEST(DecodeBlock, AnEventOfAnotherContractOrTransactionIsNotTrusted) {
  const auto genesis = make_config_block("teleop");
  for (const bool other_contract : {true, false}) {
    const auto proposal = make_proposal(client, {}, {"set", {"a"}}, 5, std::string(24, 'n')).value();
    const auto foreign =
        other_contract ? make_proposal(client, {"teleop", "evil"}, {"set", {"a"}}, 5, std::string(24, 'n')).value()
                       : make_proposal(client, {}, {"set", {"a"}}, 5, std::string(24, 'm')).value();
    // The response of one call under the header of another.
    common::Envelope envelope = endorse(proposal.signed_proposal, {peer}, "", "command", "payload");
    const common::Envelope donor = endorse(foreign.signed_proposal, {peer}, "", "command", "payload");
    common::Payload payload, donor_payload;
    payload.ParseFromString(envelope.payload());
    donor_payload.ParseFromString(donor.payload());
    payload.set_data(donor_payload.data());
    envelope.set_payload(payload.SerializeAsString());
    const auto block =
        decode_block(make_block(&genesis, {envelope.SerializeAsString()}, std::string(1, '\0')).SerializeAsString());
    ASSERT_TRUE(block) << block.error().message;
    const Transaction& left_out = block->transactions[0];
    EXPECT_EQ(left_out.code, code_unverified);
    EXPECT_EQ(left_out.tx_id, proposal.tx_id);
    EXPECT_EQ(left_out.event_name + left_out.event_payload + left_out.payload + left_out.response_payload, "");
    EXPECT_EQ(left_out.problem,
              other_contract ? "its event names another contract" : "its event names another transaction");
  }
}

TEST(DecodeBlock, HostileBytesNeverCrash) {
  const google::protobuf::LogSilencer silencer;
  const auto genesis = make_config_block("teleop");
  auto sent = make_block(&genesis, {transaction("set", "e")}, std::string(1, '\0'));
  const std::string good = sent.SerializeAsString();
  for (std::size_t cut = 0; cut < good.size(); ++cut) (void)decode_block(good.substr(0, cut));
  // Behind the data hash, as a peer would who lies on purpose.
  const std::string envelope = sent.data().data(0);
  Random random(1);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string bad = envelope;
    for (int flips = 0; flips <= i % 3; ++flips) bad[random.next() % bad.size()] = static_cast<char>(random.next());
    const auto valid = decode_block(make_block(&genesis, {bad}, std::string(1, '\0')).SerializeAsString());
    ASSERT_TRUE(valid);
    if (valid->transactions[0].code == code_unverified) ++refused;
    ASSERT_TRUE(decode_block(make_block(&genesis, {bad}, std::string(1, '\x02')).SerializeAsString()));
  }
  EXPECT_GT(refused, 100);
}

TEST(DecodeBlock, ATimeOutsideOurAgeCountsAsNone) {
  const auto genesis = make_config_block("teleop");
  common::Payload payload;
  common::ChannelHeader channel;
  channel.set_type(common::CONFIG);
  channel.mutable_timestamp()->set_seconds(INT64_MAX);
  payload.mutable_header()->set_channel_header(channel.SerializeAsString());
  common::Envelope envelope;
  envelope.set_payload(payload.SerializeAsString());
  EXPECT_EQ(decode_block(make_block(&genesis, {envelope.SerializeAsString()}, "").SerializeAsString())
                .value()
                .transactions[0]
                .timestamp_ns,
            0);
}

class Chain : public testing::Test {
 protected:
  Chain() {
    blocks_.push_back(make_config_block("teleop"));
    for (int i = 0; i < 4; ++i)
      blocks_.push_back(make_block(&blocks_.back(), {transaction("set", std::to_string(i))}, std::string(1, '\0')));
  }
  Block block(std::size_t number) const { return decode_block(blocks_[number].SerializeAsString()).value(); }
  std::vector<common::Block> blocks_;
};

TEST_F(Chain, IsFollowedFromAnywhere) {
  for (std::size_t start = 0; start < blocks_.size(); ++start) {
    ChainCheck check;
    for (std::size_t n = start; n < blocks_.size(); ++n) EXPECT_TRUE(check.add(block(n)));
    EXPECT_EQ(check.height(), blocks_.size());
  }
}

TEST_F(Chain, GapsDuplicatesAndForgeriesAreRefusedAndTheRightBlockStillFits) {
  ChainCheck check;
  ASSERT_TRUE(check.add(block(0)) && check.add(block(1)));
  EXPECT_EQ(check.add(block(3)).error().message, "block 3 came where 2 was due");
  EXPECT_FALSE(check.add(block(1)));
  common::Block forged = blocks_[2];
  forged.mutable_data()->set_data(0, transaction("set", "forged"));
  seal(forged, &blocks_[1]);
  common::Block outsider = blocks_[2];
  outsider.mutable_header()->set_previous_hash(std::string(32, 'x'));
  EXPECT_FALSE(check.add(decode_block(outsider.SerializeAsString()).value()));
  ASSERT_TRUE(check.add(block(2)));
  // A forged block 2 whose own hashes fit is found out by block 3.
  ChainCheck other;
  ASSERT_TRUE(other.add(block(1)) && other.add(decode_block(forged.SerializeAsString()).value()));
  EXPECT_NE(other.add(block(3)).error().message.find("does not follow block 2"), std::string::npos);
}

TEST_F(Chain, ACheckpointTakesUpWhereItWasLeft) {
  ChainCheck first;
  ASSERT_TRUE(first.add(block(0)) && first.add(block(1)));
  ChainCheck second = ChainCheck::behind(first.height() - 1, first.hash());
  EXPECT_FALSE(second.add(block(3)));
  EXPECT_TRUE(second.add(block(2)));
  ChainCheck wrong = ChainCheck::behind(1, std::string(32, 'x'));
  EXPECT_FALSE(wrong.add(block(2)));
}

}  // namespace
}  // namespace ledgerline::fabric
