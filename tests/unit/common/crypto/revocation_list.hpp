#pragma once
#include <gtest/gtest.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <cstdint>
#include <ctime>
#include <memory>
#include <string>

#include "common/crypto/openssl.hpp"

/// Revocation lists for tests.
namespace ledgerline::crypto {

enum class NamedKey { issuers, none, unreadable, by_name_alone };
/// How new a list says that it is.
struct ListAge {
  std::int64_t number = -1;  ///< CRL number; below 0: none
  std::int64_t before_now_s = 0;
};

/// The list's authority key identifier (RFC 5280, 4.2.1.1).
inline void name_key(X509_CRL* list, X509* issuer, NamedKey named) {
  if (named == NamedKey::none) return;
  if (named == NamedKey::unreadable) {
    const std::unique_ptr<ASN1_OCTET_STRING, Freed<ASN1_OCTET_STRING_free>> text(ASN1_OCTET_STRING_new());
    ASN1_OCTET_STRING_set(text.get(), reinterpret_cast<const unsigned char*>("?"), 1);
    const std::unique_ptr<X509_EXTENSION, Freed<X509_EXTENSION_free>> damaged(
        X509_EXTENSION_create_by_NID(nullptr, NID_authority_key_identifier, 0, text.get()));
    EXPECT_EQ(X509_CRL_add_ext(list, damaged.get(), -1), 1);
    return;
  }
  const std::unique_ptr<AUTHORITY_KEYID, Freed<AUTHORITY_KEYID_free>> key(AUTHORITY_KEYID_new());
  if (named == NamedKey::issuers) key->keyid = ASN1_OCTET_STRING_dup(X509_get0_subject_key_id(issuer));
  EXPECT_EQ(X509_CRL_add1_ext_i2d(list, NID_authority_key_identifier, key.get(), 0, 0), 1);
}

/// X.509 CRL of `issuer` with the certificate's serial number; PEM.
inline std::string list_of(const KeyAndCertificate& issuer, const std::string& certificate,
                           NamedKey named = NamedKey::issuers, ListAge age = {}) {
  const X509Ptr ca = *read_certificate(issuer.certificate_pem), revoked = *read_certificate(certificate);
  const BioPtr key_text = bio_of(issuer.key_pem);
  const KeyPtr key(PEM_read_bio_PrivateKey(key_text.get(), nullptr, no_pass_phrase, nullptr));
  const CrlPtr list(X509_CRL_new());
  const std::unique_ptr<ASN1_TIME, Freed<ASN1_TIME_free>> now(
      ASN1_TIME_set(nullptr, std::time(nullptr) - age.before_now_s));
  X509_CRL_set_version(list.get(), 1);
  X509_CRL_set_issuer_name(list.get(), X509_get_subject_name(ca.get()));
  X509_CRL_set1_lastUpdate(list.get(), now.get());
  X509_CRL_set1_nextUpdate(list.get(), now.get());  // over at once, which nobody asks for
  X509_REVOKED* entry = X509_REVOKED_new();
  X509_REVOKED_set_serialNumber(entry, X509_get_serialNumber(revoked.get()));
  X509_REVOKED_set_revocationDate(entry, now.get());
  X509_CRL_add0_revoked(list.get(), entry);
  X509_CRL_sort(list.get());
  name_key(list.get(), ca.get(), named);
  if (age.number >= 0) {
    const std::unique_ptr<ASN1_INTEGER, Freed<ASN1_INTEGER_free>> number(ASN1_INTEGER_new());
    ASN1_INTEGER_set_int64(number.get(), age.number);
    EXPECT_EQ(X509_CRL_add1_ext_i2d(list.get(), NID_crl_number, number.get(), 0, 0), 1);
  }
  EXPECT_GT(X509_CRL_sign(list.get(), key.get(), EVP_sha256()), 0);
  const BioPtr out(BIO_new(BIO_s_mem()));
  PEM_write_bio_X509_CRL(out.get(), list.get());
  return text_of(out.get());
}

}  // namespace ledgerline::crypto
