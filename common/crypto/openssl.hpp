#pragma once
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/x509.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"

/// OpenSSL's objects as owners, for sources that link it.
namespace ledgerline::crypto {

template <auto Free>
struct Freed {
  template <typename T>
  void operator()(T* p) const {
    Free(p);
  }
};
using BioPtr = std::unique_ptr<BIO, Freed<BIO_free_all>>;
using KeyPtr = std::unique_ptr<EVP_PKEY, Freed<EVP_PKEY_free>>;
using X509Ptr = std::unique_ptr<X509, Freed<X509_free>>;
using CrlPtr = std::unique_ptr<X509_CRL, Freed<X509_CRL_free>>;
using MdContextPtr = std::unique_ptr<EVP_MD_CTX, Freed<EVP_MD_CTX_free>>;

/// The oldest error of this thread's queue, which is then emptied: gRPC's TLS on the same thread reads that queue too.
std::string openssl_error();

/// Read-only view of `text`, which must outlive it.
BioPtr bio_of(std::string_view text);
std::string text_of(BIO* bio);
std::string text_of(const ASN1_STRING* bytes);

/// For every reader of PEM: without it libcrypto would ask for the pass phrase of an encrypted text at the terminal, or
/// read it from standard input, and so wait for ever.
inline int no_pass_phrase(char*, int, int, void*) { return -1; }

/// Adds a field to a name; an empty value adds none.
bool add_name(X509_NAME* name, const char* field, const std::string& value);

Result<X509Ptr> read_certificate(std::string_view pem);
/// All of a PEM text up to what is none.
std::vector<X509Ptr> read_certificates(std::string_view pem);
std::vector<CrlPtr> read_lists(std::string_view pem);
Result<Certificate> describe(X509* certificate);
Result<std::int64_t> unix_time(const ASN1_TIME* time);
/// The key that a revocation list says has signed it, by its authority key identifier (RFC 5280, 5.2.1); empty: by name
/// and number alone. nullopt: it has no such extension, or one that cannot be read.
std::optional<std::string> authority_key_of(X509_CRL* list);
// ECDSA signatures as bytes, shared by both libraries so that both refuse the same ones.

enum class Curve { p256, p384 };  ///< NIST's, of FIPS 186-4: those that Fabric's organisations use

using Scalar = std::array<unsigned char, 48>;  ///< big-endian; of P-256 the first 16 bytes are zero

struct EcdsaSignature {
  Scalar r{}, s{};
};

/// Strict DER, r and s in [1, n), s at most n/2 (as Fabric wants it: of the two valid signatures (r, s) and (r, n - s)
/// only one is accepted, so nobody on the way can change a signature). Anything else: nullopt.
std::optional<EcdsaSignature> decode_signature(std::string_view der, Curve curve);

/// Brings s below n/2 and writes DER.
std::string encode_signature(EcdsaSignature signature, Curve curve);

struct PublicPoint {
  Curve curve;
  std::string bytes;  ///< 4, x, y
};
/// Refuses keys on other curves than P-256 and P-384.
Result<PublicPoint> public_point(X509* certificate);

Result<std::unique_ptr<Verifier>> make_verifier(Library library, X509* certificate);
Result<std::unique_ptr<Verifier>> make_libcrypto_verifier(X509* certificate);
/// The key in PEM as it was before lock_key(). An error: it is not locked, or by another phrase.
Result<std::string> unlock_key(const std::string& locked_pem, const std::string& pass_phrase);
Result<std::unique_ptr<Signer>> make_libcrypto_signer(const std::string& pem_key);
Result<std::unique_ptr<Verifier>> make_mbedtls_verifier(const PublicPoint& point);
Result<std::unique_ptr<Signer>> make_mbedtls_signer(const std::string& pem_key);

}  // namespace ledgerline::crypto
