#include "ground/service/core/blocks.hpp"

#include <gtest/gtest.h>

#include <ctime>

#include "msp/identities.pb.h"

namespace ledgerline::ground::service {
namespace {

using Weight = crypto::Renewal::Weight;

const crypto::KeyAndCertificate& authority() {
  static const auto ca = crypto::make_ca("ca.org1", "org1").value();
  return ca;
}

std::string identity_of(const std::string& name, int days) {
  const crypto::CertificateRequest request{
      .common_name = name, .organization = "", .unit = "client", .sans = {}, .days = days};
  msp::SerializedIdentity identity;
  identity.set_mspid("Org1MSP");
  identity.set_id_bytes(crypto::issue(authority(), request).value().certificate_pem);
  return identity.SerializeAsString();
}

fabric::Block block_of(const std::string& function, const std::string& creator, int code = 0) {
  fabric::Transaction tx;
  tx.function = function;
  tx.creator = creator;
  tx.code = code;
  fabric::Block block;
  block.transactions = {tx};
  return block;
}

class CertificateEndsOfAgents : public testing::Test {
 protected:
  const std::int64_t now_s_ = std::time(nullptr) + 60;  // days begin at the issue
  CertificateEnds ends_;
};

TEST_F(CertificateEndsOfAgents, AreReportedByWhatTheyWrite) {
  ends_.add(block_of("set", identity_of("raven", 20)));
  ends_.add(block_of("set", identity_of("crow", 100)));
  const auto words = ends_.pop_due(now_s_);
  ASSERT_EQ(words.size(), 1U);
  EXPECT_EQ(words[0].words, "the certificate of agent Org1MSP CN=raven,OU=client ends in 19 days");
  EXPECT_EQ(words[0].weight, Weight::warning);
  EXPECT_TRUE(ends_.pop_due(now_s_).empty()) << "once a day";
  EXPECT_EQ(ends_.pop_due(now_s_ + 18 * crypto::day_s).at(0).weight, Weight::alarm);
}

TEST_F(CertificateEndsOfAgents, EndWithARenewalThoughTheOldOneIsSeenOnceMore) {
  const std::string old = identity_of("raven", 20);
  ends_.add(block_of("set", old));
  EXPECT_EQ(ends_.pop_due(now_s_).size(), 1U);
  ends_.add(block_of("set", identity_of("raven", 100)));
  ends_.add(block_of("set", old));
  EXPECT_TRUE(ends_.pop_due(now_s_ + crypto::day_s).empty());
}

// Authorities backdate: one that is made within minutes of another may begin before it.
TEST_F(CertificateEndsOfAgents, AreOfTheCertificateInUseThoughItBeganBeforeTheOldOne) {
  const std::string shorter = identity_of("raven", 1);
  ends_.add(block_of("set", identity_of("raven", 100)));
  for (std::size_t i = 1; i < CertificateEnds::sets_of_old; ++i) ends_.add(block_of("set", shorter));
  EXPECT_TRUE(ends_.pop_due(now_s_).empty());
  ends_.add(block_of("set", shorter));
  const auto words = ends_.pop_due(now_s_);
  ASSERT_EQ(words.size(), 1U);
  EXPECT_EQ(words[0].words, "the certificate of agent Org1MSP CN=raven,OU=client ends in 23 hours");
  EXPECT_EQ(words[0].weight, Weight::alarm);
}

TEST_F(CertificateEndsOfAgents, AreNotTakenFromWhatIsInvalidOrNoState) {
  ends_.add(block_of("set", identity_of("raven", 2), 10));
  ends_.add(block_of("command", identity_of("crow", 2)));
  ends_.add(block_of("set", "no identity"));
  EXPECT_TRUE(ends_.pop_due(now_s_).empty());
}

}  // namespace
}  // namespace ledgerline::ground::service
