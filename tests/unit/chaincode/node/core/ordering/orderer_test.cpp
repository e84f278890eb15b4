#include "chaincode/node/core/ordering/orderer.hpp"

#include <gmock/gmock.h>

#include "common/fabric/tx/transaction.hpp"

/// The orderer alone: it is given envelopes that no peer endorsed.
namespace ledgerline::node {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

struct NoSigner final : crypto::Signer {
  Result<std::string> sign(std::string_view) const override { return Error{"the key is gone"}; }
};

class OrdererTest : public ::testing::Test {
 protected:
  void start(std::size_t count = 1, std::size_t bytes = 1'000'000) {
    config.batch_count = count;
    config.batch_bytes = bytes;
    restart();
  }
  void restart() {
    orderer.emplace(config, MemberCheck(crypto::make_test_registry({"Org1MSP"}), config.channel), identity,
                    [](const std::string&) { return false; });
  }

  std::string unsigned_envelope(const std::string& channel = "teleop") const {
    common::ChannelHeader channel_header;
    channel_header.set_channel_id(channel);
    channel_header.set_type(common::ENDORSER_TRANSACTION);
    common::SignatureHeader signature_header;
    signature_header.set_creator(client.serialized);
    common::Payload payload;
    payload.mutable_header()->set_channel_header(channel_header.SerializeAsString());
    payload.mutable_header()->set_signature_header(signature_header.SerializeAsString());
    payload.set_data("whatever it is");
    common::Envelope envelope;
    envelope.set_payload(payload.SerializeAsString());
    return envelope.SerializeAsString();
  }
  std::string envelope() const { return *fabric::sign_envelope(client, unsigned_envelope()); }

  std::size_t order() {
    EXPECT_EQ(orderer->order(envelope(), now).code, Code::ok);
    return envelope().size();
  }
  int cut_size() {
    const auto cut = orderer->cut(now, {});
    return cut ? cut->block.data().data_size() : 0;
  }

  CoreConfig config;
  crypto::SigningIdentity identity = crypto::make_test_identity({"OrdererMSP", "CN=orderer"});
  const crypto::SigningIdentity client = crypto::make_test_identity({"Org1MSP", "CN=host"});
  Now now{ns_per_s, 1'700'000'000 * ns_per_s};
  std::optional<Orderer> orderer;
};

TEST_F(OrdererTest, AnUnsignedEnvelopeIsForbidden) {
  start();
  const Reply reply = orderer->order(unsigned_envelope(), now);
  EXPECT_EQ(reply.code, Code::permission_denied);
  EXPECT_THAT(reply.detail, HasSubstr("status=FORBIDDEN"));
  EXPECT_FALSE(orderer->next_cut());
}

TEST_F(OrdererTest, AnEnvelopeForAnotherChannelIsReported) {
  start();
  const Reply reply = orderer->order(*fabric::sign_envelope(client, unsigned_envelope("other")), now);
  EXPECT_EQ(reply.code, Code::not_found);
  EXPECT_THAT(reply.detail, HasSubstr("status=BAD_REQUEST, info=channel other not found"));
}

TEST_F(OrdererTest, AnEnvelopeThatIsTooLargeIsReported) {
  common::Envelope parts;
  ASSERT_TRUE(parts.ParseFromString(envelope()));
  // As Fabric's orderer counts.
  const std::size_t size = parts.payload().size() + parts.signature().size();
  config.max_envelope_bytes = size - 1;
  restart();
  const Reply reply = orderer->order(envelope(), now);
  EXPECT_EQ(reply.code, Code::invalid_argument);
  EXPECT_THAT(reply.detail, HasSubstr("status=BAD_REQUEST, info=message payload is " + std::to_string(size) +
                                      " bytes and exceeds maximum allowed " + std::to_string(size - 1) + " bytes"));
  config.max_envelope_bytes = size;
  restart();
  EXPECT_EQ(orderer->order(envelope(), now).code, Code::ok);
}

TEST_F(OrdererTest, TooManyWaitingEnvelopesAreRefused) {
  config.max_waiting = 8;  // a quarter of them for one identity
  restart();
  for (int i = 0; i < 2; ++i) order();
  EXPECT_EQ(orderer->order(envelope(), now).code, Code::unavailable);
}

TEST_F(OrdererTest, TooManyWaitingBytesAreRefusedButOneEnvelopeIsAlwaysTaken) {
  config.max_waiting_bytes = 10;
  restart();
  order();
  EXPECT_EQ(orderer->order(envelope(), now).code, Code::unavailable);
}

TEST_F(OrdererTest, NothingIsCutWhileNothingWaits) {
  start();
  EXPECT_FALSE(orderer->next_cut());
  EXPECT_FALSE(orderer->cut(now, {}));
}

TEST_F(OrdererTest, ABlockIsCutByCount) {
  start(3);
  order();
  order();
  EXPECT_EQ(cut_size(), 0);
  order();
  EXPECT_EQ(orderer->next_cut(), now.monotonic_ns);
  EXPECT_EQ(cut_size(), 3);
}

TEST_F(OrdererTest, ABlockIsCutWhenTheOldestHasWaitedLongEnough) {
  start(100);
  order();
  const TimeNs begin = now.monotonic_ns;
  now.monotonic_ns += 5 * ns_per_ms;
  order();
  EXPECT_EQ(orderer->next_cut(), begin + 10 * ns_per_ms);
  now.monotonic_ns = begin + 10 * ns_per_ms - 1;
  EXPECT_EQ(cut_size(), 0);
  now.monotonic_ns += 1;
  EXPECT_EQ(cut_size(), 2);
}

TEST_F(OrdererTest, ABlockIsCutByBytesAndKeepsWithinThem) {
  const std::size_t size = envelope().size();
  start(100, 2 * size + size / 2);
  order();
  order();
  EXPECT_EQ(cut_size(), 0);
  order();
  EXPECT_EQ(cut_size(), 2);
}

TEST_F(OrdererTest, AnEnvelopeLargerThanABlockGoesAlone) {
  start(100, 10);
  order();
  order();
  EXPECT_EQ(cut_size(), 1);
}

TEST_F(OrdererTest, ABlockFollowsTheEndThatItIsGivenAndIsSigned) {
  start();
  order();
  const auto cut = orderer->cut(now, {5, "hash of block 4"});
  ASSERT_TRUE(cut);
  EXPECT_EQ(cut->block.header().number(), 5U);
  EXPECT_EQ(cut->block.header().previous_hash(), "hash of block 4");
  EXPECT_FALSE(cut->block.metadata().metadata(common::SIGNATURES).empty());
  EXPECT_THAT(cut->warning, IsEmpty());
}

TEST_F(OrdererTest, WithoutItsKeyBlocksGoOutUnsignedWithAWarning) {
  identity.signer = std::make_shared<NoSigner>();
  start();
  order();
  const auto cut = orderer->cut(now, {});
  ASSERT_TRUE(cut);
  EXPECT_EQ(cut->warning, "the key is gone");
  EXPECT_THAT(cut->block.metadata().metadata(common::SIGNATURES), IsEmpty());
}

}  // namespace
}  // namespace ledgerline::node
