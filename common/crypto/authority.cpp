#include <arpa/inet.h>
#include <openssl/core_names.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

constexpr int ca_days = 3650;
/// Clocks of other machines may be a little behind (cryptogen uses the same five minutes).
constexpr long backdate_s = 300;

using ExtensionPtr = std::unique_ptr<X509_EXTENSION, Freed<X509_EXTENSION_free>>;

bool add_extension(X509* certificate, X509* issuer, int nid, const std::string& value) {
  X509V3_CTX context;
  X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
  const ExtensionPtr extension(X509V3_EXT_conf_nid(nullptr, &context, nid, value.c_str()));
  return extension && X509_add_ext(certificate, extension.get(), -1) == 1;
}

/// Fabric names a key by SHA-256 of its point, and writes that as the subject key identifier.
bool add_key_identifier(X509* certificate) {
  auto point = public_point(certificate);
  if (!point) return false;
  const Digest id = sha256(point->bytes);
  const std::unique_ptr<ASN1_OCTET_STRING, Freed<ASN1_OCTET_STRING_free>> text(ASN1_OCTET_STRING_new());
  return text && ASN1_OCTET_STRING_set(text.get(), id.data(), static_cast<int>(id.size())) == 1 &&
         X509_add1_ext_i2d(certificate, NID_subject_key_identifier, text.get(), 0, 0) == 1;
}

std::string subject_alternative_names(const std::vector<std::string>& sans) {
  std::string out;
  for (const std::string& san : sans) {
    in_addr v4{};
    in6_addr v6{};
    const bool ip = ::inet_pton(AF_INET, san.c_str(), &v4) == 1 || ::inet_pton(AF_INET6, san.c_str(), &v6) == 1;
    out += (out.empty() ? "" : ",") + std::string(ip ? "IP:" : "DNS:") + san;
  }
  return out;
}

bool set_serial(X509* certificate) {
  std::string bytes = random_bytes(16);
  bytes[0] = static_cast<char>((bytes[0] & 0x7f) | 0x40);  // positive and always of the same length
  const std::unique_ptr<BIGNUM, Freed<BN_free>> number(
      BN_bin2bn(reinterpret_cast<const unsigned char*>(bytes.data()), 16, nullptr));
  return number && BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(certificate)) != nullptr;
}

/// Signs until s is low (two tries on average): Fabric rewrites certificates with a high s when it reads them, so a
/// low one stays the same bytes everywhere.
bool sign_with_low_s(X509* certificate, EVP_PKEY* key) {
  for (;;) {
    if (X509_sign(certificate, key, EVP_sha256()) == 0) return false;
    const ASN1_BIT_STRING* signature = nullptr;
    X509_get0_signature(&signature, nullptr, certificate);
    if (decode_signature({reinterpret_cast<const char*>(signature->data), static_cast<std::size_t>(signature->length)},
                         Curve::p256))
      return true;
  }
}

struct Template {
  std::string common_name, organization, unit;
  int days = 0;
  std::vector<std::pair<int, std::string>> extensions;
};

/// Self-signed when there is no issuer.
Result<KeyAndCertificate> make(const Template& wanted, X509* issuer, EVP_PKEY* issuer_key) {
  const KeyPtr key(EVP_EC_gen("P-256"));
  const X509Ptr certificate(X509_new());
  if (!key || !certificate) return Error{"cannot make a key: " + openssl_error()};
  X509* const parent = issuer ? issuer : certificate.get();
  X509_NAME* name = X509_get_subject_name(certificate.get());
  bool good = X509_set_version(certificate.get(), X509_VERSION_3) == 1 && set_serial(certificate.get()) &&
              X509_gmtime_adj(X509_getm_notBefore(certificate.get()), -backdate_s) != nullptr &&
              X509_time_adj_ex(X509_getm_notAfter(certificate.get()), wanted.days, 0, nullptr) != nullptr &&
              add_name(name, "O", wanted.organization) && add_name(name, "OU", wanted.unit) &&
              add_name(name, "CN", wanted.common_name) &&
              X509_set_issuer_name(certificate.get(), X509_get_subject_name(parent)) == 1 &&
              X509_set_pubkey(certificate.get(), key.get()) == 1 && add_key_identifier(certificate.get());
  for (const auto& [nid, value] : wanted.extensions)
    good = good && add_extension(certificate.get(), parent, nid, value);
  good = good && sign_with_low_s(certificate.get(), issuer_key ? issuer_key : key.get());

  const BioPtr key_text(BIO_new(BIO_s_secmem())), certificate_text(BIO_new(BIO_s_mem()));
  good = good && PEM_write_bio_PKCS8PrivateKey(key_text.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) == 1 &&
         PEM_write_bio_X509(certificate_text.get(), certificate.get()) == 1;
  if (!good) return Error{"cannot make the certificate of " + wanted.common_name + ": " + openssl_error()};
  return KeyAndCertificate{text_of(key_text.get()), text_of(certificate_text.get())};
}

Result<KeyPtr> read_key(const KeyAndCertificate& ca) {
  KeyPtr key(PEM_read_bio_PrivateKey(bio_of(ca.key_pem).get(), nullptr, no_pass_phrase, nullptr));
  if (!key) return Error{"the CA's key is not a private key in PEM: " + openssl_error()};
  return key;
}

void remove_extension(X509* certificate, int nid) {
  for (int at; (at = X509_get_ext_by_NID(certificate, nid, -1)) >= 0;)
    const ExtensionPtr removed(X509_delete_ext(certificate, at));
}

}  // namespace

bool add_name(X509_NAME* name, const char* field, const std::string& value) {
  return value.empty() ||
         X509_NAME_add_entry_by_txt(name, field, MBSTRING_UTF8, reinterpret_cast<const unsigned char*>(value.data()),
                                    static_cast<int>(value.size()), -1, 0) == 1;
}

Result<KeyAndCertificate> make_ca(const std::string& common_name, const std::string& organization) {
  return make({common_name,
               organization,
               "",
               ca_days,
               {{NID_key_usage, "critical,digitalSignature,keyEncipherment,keyCertSign,cRLSign"},
                {NID_ext_key_usage, "clientAuth,serverAuth"},
                {NID_basic_constraints, "critical,CA:TRUE"}}},
              nullptr, nullptr);
}

Result<KeyAndCertificate> issue(const KeyAndCertificate& ca, const CertificateRequest& request) {
  auto issuer = read_certificate(ca.certificate_pem);
  if (!issuer) return issuer.error();
  auto issuer_key = read_key(ca);
  if (!issuer_key) return issuer_key.error();
  Template wanted{request.common_name, request.organization, request.unit.value_or(""), request.days, {}};
  wanted.extensions = {
      {NID_key_usage, request.tls ? "critical,digitalSignature,keyEncipherment" : "critical,digitalSignature"},
      {NID_basic_constraints, "critical,CA:FALSE"},
      {NID_authority_key_identifier, "keyid:always"}};
  if (request.tls) wanted.extensions.emplace_back(NID_ext_key_usage, "serverAuth,clientAuth");
  if (!request.sans.empty())
    wanted.extensions.emplace_back(NID_subject_alt_name, subject_alternative_names(request.sans));
  return make(wanted, issuer->get(), issuer_key->get());
}

Status check_issued_by(const std::string& ca_pem, const std::string& certificate_pem) {
  auto ca = read_certificate(ca_pem), certificate = read_certificate(certificate_pem);
  for (const auto* read : {&ca, &certificate}) {
    if (!*read) return read->error();
  }
  const bool issued = X509_check_issued(ca->get(), certificate->get()) == X509_V_OK &&
                      X509_verify(certificate->get(), X509_get0_pubkey(ca->get())) == 1;
  ERR_clear_error();
  if (issued) return done;
  return Error{"the certificate is of another authority"};
}

Result<std::string> make_document_authority(const KeyAndCertificate& ca) {
  auto certificate = read_certificate(ca.certificate_pem);
  if (!certificate) return certificate.error();
  auto key = read_key(ca);
  if (!key) return key.error();
  X509* const x509 = certificate->get();
  if (X509_check_private_key(x509, key->get()) != 1) return Error{"the CA's key is not its certificate's"};
  for (const int nid : {NID_ext_key_usage, NID_key_usage, NID_authority_key_identifier}) remove_extension(x509, nid);
  const BioPtr text(BIO_new(BIO_s_mem()));
  const bool good = set_serial(x509) && X509_set_issuer_name(x509, X509_get_subject_name(x509)) == 1 &&
                    add_extension(x509, x509, NID_key_usage, "critical,digitalSignature,keyCertSign,cRLSign") &&
                    sign_with_low_s(x509, key->get()) && PEM_write_bio_X509(text.get(), x509) == 1;
  if (!good) return Error{"cannot make the certificate that signs documents: " + openssl_error()};
  return text_of(text.get());
}

Result<std::string> sign_document(const KeyAndCertificate& ca, std::string_view text) {
  auto certificate = read_certificate(ca.certificate_pem);
  if (!certificate) return certificate.error();
  auto key = read_key(ca);
  if (!key) return key.error();
  constexpr int form = PKCS7_DETACHED | PKCS7_TEXT | PKCS7_STREAM;
  const BioPtr in = bio_of(text), out(BIO_new(BIO_s_mem()));
  const std::unique_ptr<PKCS7, Freed<PKCS7_free>> signature(
      PKCS7_sign(certificate->get(), key->get(), nullptr, in.get(), form));
  if (!signature || SMIME_write_PKCS7(out.get(), signature.get(), in.get(), form) != 1)
    return Error{"cannot sign a document: " + openssl_error()};
  return text_of(out.get());
}

}  // namespace ledgerline::crypto
