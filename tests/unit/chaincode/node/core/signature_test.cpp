#include <gmock/gmock.h>

#include <memory>

#include "chaincode/node/core/node_core.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "msp/identities.pb.h"
#include "peer/proposal.pb.h"
#include "tests/unit/chaincode/node/core/high_s.hpp"

/// The core with real keys: what test identities cannot show.
namespace ledgerline::node {
namespace {

using ::testing::HasSubstr;

crypto::SigningIdentity identity(const crypto::KeyAndCertificate& ca, const std::string& msp_id,
                                 const std::string& name, const std::string& unit = "client") {
  crypto::CertificateRequest request;
  request.common_name = name;
  request.organization = "org1";
  request.unit = unit;
  const auto issued = crypto::issue(ca, request);
  EXPECT_TRUE(issued.ok());
  msp::SerializedIdentity serialized;
  serialized.set_mspid(msp_id);
  serialized.set_id_bytes(issued->certificate_pem);
  return {{msp_id, crypto::parse_certificate(issued->certificate_pem)->subject},
          serialized.SerializeAsString(),
          *crypto::make_signer(crypto::Library::libcrypto, issued->key_pem)};
}

class SignatureTest : public ::testing::Test {
 protected:
  SignatureTest() {
    std::vector<crypto::MspRoot> roots{{"Org1MSP", ca.certificate_pem}};
    CoreConfig config;
    config.organisations = roots;
    config.max_waiting = 16;
    core = std::make_unique<NodeCore>(config, crypto::make_msp_registry(crypto::Library::libcrypto, roots),
                                      std::vector{identity(ca, "Org1MSP", "peer0", "peer")},
                                      identity(ca, "Org1MSP", "orderer", "orderer"), nullptr);
    core->apply(core->genesis());
  }

  Reply endorse(const crypto::SigningIdentity& who, const std::function<void(std::string&)>& change = {}) {
    const auto proposal = fabric::make_proposal(who, {}, {"set", {R"({"id":"Org1MSP/a","msgType":"t"})"}}, now.real_ns,
                                                std::string(24, 'n'));
    protos::SignedProposal signed_proposal;
    signed_proposal.ParseFromString(proposal->signed_proposal);
    if (change) change(*signed_proposal.mutable_signature());
    return core->endorse(signed_proposal.SerializeAsString(), now);
  }

  const crypto::KeyAndCertificate ca = *crypto::make_ca("ca.org1", "org1");
  const crypto::SigningIdentity user = identity(ca, "Org1MSP", "User1");
  std::unique_ptr<NodeCore> core;
  Now now{0, realtime_ns()};
};

TEST_F(SignatureTest, ARealSignatureIsAccepted) {
  const Reply reply = endorse(user);
  ASSERT_EQ(reply.code, Code::ok) << reply.detail;
  ASSERT_EQ(core->order(*fabric::sign_envelope(user, reply.bytes), now).code, Code::ok);
  EXPECT_EQ(core->cut(now)->transactions.at(0).code, 0);
}

/// A client that writes its certificate in another layout each time has one share of what waits for a block.
TEST_F(SignatureTest, OneCertificateInManyLayoutsIsOneIdentityToTheOrderer) {
  crypto::SigningIdentity again = user;
  std::size_t taken = 0;
  for (int i = 0; i < 12; ++i) {
    msp::SerializedIdentity serialized;
    ASSERT_TRUE(serialized.ParseFromString(user.serialized));
    serialized.set_id_bytes(std::string(static_cast<std::size_t>(i), '\n') + serialized.id_bytes());
    again.serialized = serialized.SerializeAsString();
    common::Payload payload;
    common::ChannelHeader channel_header;
    channel_header.set_channel_id("teleop");
    channel_header.set_type(common::ENDORSER_TRANSACTION);
    common::SignatureHeader signature_header;
    signature_header.set_creator(again.serialized);
    payload.mutable_header()->set_channel_header(channel_header.SerializeAsString());
    payload.mutable_header()->set_signature_header(signature_header.SerializeAsString());
    common::Envelope envelope;
    envelope.set_payload(payload.SerializeAsString());
    taken += core->order(*fabric::sign_envelope(again, envelope.SerializeAsString()), now).code == Code::ok ? 1U : 0U;
  }
  EXPECT_EQ(taken, 4U) << "a quarter of all places";
}

TEST_F(SignatureTest, AHighSIsRefusedThoughItsMathIsRight) {
  const Reply reply = endorse(user, [](std::string& signature) { signature = with_high_s(signature); });
  EXPECT_EQ(reply.code, Code::aborted);
  EXPECT_THAT(reply.detail, HasSubstr("access denied"));
  EXPECT_EQ(endorse(user, [](std::string& signature) { signature = with_high_s(with_high_s(signature)); }).code,
            Code::ok)
      << "the test turns s around rightly";
}

TEST_F(SignatureTest, ASignatureOfAnotherMessageIsRefused) {
  EXPECT_THAT(endorse(user, [&](std::string& signature) { signature = *user.signer->sign("other"); }).detail,
              HasSubstr("access denied"));
}

TEST_F(SignatureTest, ACertificateOfAnotherAuthorityIsRefused) {
  const auto other = crypto::make_ca("ca.org1", "org1");
  EXPECT_THAT(endorse(identity(*other, "Org1MSP", "User1")).detail, HasSubstr("access denied"));
}

TEST_F(SignatureTest, AnExpiredCertificateIsRefused) {
  now.real_ns += 20LL * 365 * 24 * 3600 * ns_per_s;
  EXPECT_THAT(endorse(user).detail, HasSubstr("access denied"));
}

}  // namespace
}  // namespace ledgerline::node
