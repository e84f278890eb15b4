#include <gtest/gtest.h>
#include <openssl/pem.h>

#include <ctime>

#include "common/crypto/openssl.hpp"
#include "msp/identities.pb.h"

/// Revocation lists of an organisation's authorities, as a channel's configuration holds them.
namespace ledgerline::crypto {
namespace {

/// X.509 CRL of `issuer` with the certificate's serial number; PEM.
std::string list_of(const KeyAndCertificate& issuer, const std::string& certificate) {
  const X509Ptr ca = *read_certificate(issuer.certificate_pem), revoked = *read_certificate(certificate);
  const BioPtr key_text = bio_of(issuer.key_pem);
  const KeyPtr key(PEM_read_bio_PrivateKey(key_text.get(), nullptr, no_pass_phrase, nullptr));
  const CrlPtr list(X509_CRL_new());
  const std::unique_ptr<ASN1_TIME, Freed<ASN1_TIME_free>> now(ASN1_TIME_set(nullptr, std::time(nullptr)));
  X509_CRL_set_version(list.get(), 1);
  X509_CRL_set_issuer_name(list.get(), X509_get_subject_name(ca.get()));
  X509_CRL_set1_lastUpdate(list.get(), now.get());
  X509_CRL_set1_nextUpdate(list.get(), now.get());  // over at once, which nobody asks for
  X509_REVOKED* entry = X509_REVOKED_new();
  X509_REVOKED_set_serialNumber(entry, X509_get_serialNumber(revoked.get()));
  X509_REVOKED_set_revocationDate(entry, now.get());
  X509_CRL_add0_revoked(list.get(), entry);
  X509_CRL_sort(list.get());
  EXPECT_GT(X509_CRL_sign(list.get(), key.get(), EVP_sha256()), 0);
  const BioPtr out(BIO_new(BIO_s_mem()));
  PEM_write_bio_X509_CRL(out.get(), list.get());
  return text_of(out.get());
}

class Revocation : public testing::Test {
 protected:
  std::string said_of(const KeyAndCertificate& user, const std::string& lists) {
    const auto registry = make_msp_registry(Library::libcrypto, {{"Org1MSP", ca_.certificate_pem, lists}});
    msp::SerializedIdentity identity;
    identity.set_mspid("Org1MSP");
    identity.set_id_bytes(user.certificate_pem);
    const auto member = registry->member(identity.SerializeAsString(), std::nullopt);
    return member ? "accepted" : member.error().what;
  }
  static KeyAndCertificate user_of(const KeyAndCertificate& ca, const std::string& name) {
    return *issue(ca, {.common_name = name, .organization = "", .unit = "peer", .sans = {}});
  }

  const KeyAndCertificate ca_ = *make_ca("ca.org1.ledgerline", "org1.ledgerline");
  const KeyAndCertificate other_ca_ = *make_ca("ca.org1.ledgerline", "org1.ledgerline");  // same name, other key
  const KeyAndCertificate peer_ = user_of(ca_, "peer0"), next_ = user_of(ca_, "peer1");
};

TEST_F(Revocation, AListOfTheAuthorityEndsACertificateAndNoOther) {
  const std::string list = list_of(ca_, peer_.certificate_pem);
  EXPECT_EQ(said_of(peer_, ""), "accepted");
  EXPECT_NE(said_of(peer_, list).find("revoked"), std::string::npos);
  EXPECT_EQ(said_of(next_, list), "accepted");
  const std::string both = list + list_of(ca_, next_.certificate_pem);
  EXPECT_NE(said_of(peer_, both).find("revoked"), std::string::npos);
  EXPECT_NE(said_of(next_, both).find("revoked"), std::string::npos);
}

TEST_F(Revocation, AListThatTheAuthorityHasNotSignedEndsNothing) {
  EXPECT_EQ(said_of(peer_, list_of(other_ca_, peer_.certificate_pem)), "accepted");
  EXPECT_EQ(said_of(peer_, "no list"), "accepted");
}

}  // namespace
}  // namespace ledgerline::crypto
