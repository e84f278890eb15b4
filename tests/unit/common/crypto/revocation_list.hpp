#pragma once
#include <gtest/gtest.h>
#include <openssl/pem.h>

#include <ctime>
#include <memory>
#include <string>

#include "common/crypto/openssl.hpp"

/// Revocation lists for tests.
namespace ledgerline::crypto {

/// X.509 CRL of `issuer` with the certificate's serial number; PEM.
inline std::string list_of(const KeyAndCertificate& issuer, const std::string& certificate) {
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

}  // namespace ledgerline::crypto
