#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <ctime>

#include "common/base/file.hpp"
#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

std::string utf8_of(const X509_NAME_ENTRY* entry) {
  unsigned char* text = nullptr;
  const int size = ASN1_STRING_to_UTF8(&text, X509_NAME_ENTRY_get_data(entry));
  if (size < 0) return {};
  std::string out(reinterpret_cast<const char*>(text), static_cast<std::size_t>(size));
  OPENSSL_free(text);
  return out;
}

std::vector<std::string> values_of(const X509_NAME* name, int nid) {
  std::vector<std::string> values;
  for (int at = X509_NAME_get_index_by_NID(name, nid, -1); at >= 0; at = X509_NAME_get_index_by_NID(name, nid, at)) {
    values.push_back(utf8_of(X509_NAME_get_entry(name, at)));
  }
  return values;
}

}  // namespace

std::string openssl_error() {
  char text[256] = "unknown";
  if (const unsigned long code = ERR_get_error(); code != 0) ERR_error_string_n(code, text, sizeof text);
  ERR_clear_error();
  return text;
}

BioPtr bio_of(std::string_view text) { return BioPtr(BIO_new_mem_buf(text.data(), static_cast<int>(text.size()))); }

std::string text_of(BIO* bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  return {data, static_cast<std::size_t>(size)};
}

std::string text_of(const ASN1_STRING* bytes) {
  return {reinterpret_cast<const char*>(ASN1_STRING_get0_data(bytes)),
          static_cast<std::size_t>(ASN1_STRING_length(bytes))};
}

std::vector<X509Ptr> read_certificates(std::string_view pem) {
  std::vector<X509Ptr> all;
  const BioPtr text = bio_of(pem);
  while (X509Ptr one{PEM_read_bio_X509(text.get(), nullptr, no_pass_phrase, nullptr)}) all.push_back(std::move(one));
  ERR_clear_error();  // the end of the PEM text
  return all;
}

std::vector<CrlPtr> read_lists(std::string_view pem) {
  std::vector<CrlPtr> all;
  const BioPtr text = bio_of(pem);
  while (CrlPtr one{PEM_read_bio_X509_CRL(text.get(), nullptr, no_pass_phrase, nullptr)}) all.push_back(std::move(one));
  ERR_clear_error();  // the end of the PEM text
  return all;
}

Result<X509Ptr> read_certificate(std::string_view pem) {
  unsigned char* der = nullptr;
  long size = 0;
  if (PEM_bytes_read_bio(&der, &size, nullptr, PEM_STRING_X509, bio_of(pem).get(), no_pass_phrase, nullptr) != 1) {
    return Error{"could not decode the PEM structure: " + openssl_error()};
  }
  const unsigned char* end = der;
  X509Ptr certificate(d2i_X509(nullptr, &end, size));
  const bool whole = end == der + size;
  OPENSSL_free(der);
  if (!certificate) return Error{"could not decode the PEM structure: " + openssl_error()};
  if (!whole) return Error{"x509: trailing data behind the certificate"};  // refused by Fabric's peers, too
  return certificate;
}

Result<std::int64_t> unix_time(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return Error{"a date cannot be read: " + openssl_error()};
  return static_cast<std::int64_t>(timegm(&parts));
}

namespace {

Result<std::string> name_in_words(const X509_NAME* name) {
  const BioPtr text(BIO_new(BIO_s_mem()));
  if (!text || X509_NAME_print_ex(text.get(), name, 0, XN_FLAG_RFC2253) < 0) {
    return Error{"a name in the certificate cannot be read: " + openssl_error()};
  }
  return text_of(text.get());
}

}  // namespace

Result<Certificate> describe(X509* certificate) {
  const X509_NAME* name = X509_get_subject_name(certificate);
  Certificate out;
  auto subject = name_in_words(name);
  if (!subject) return subject.error();
  auto issuer = name_in_words(X509_get_issuer_name(certificate));
  if (!issuer) return issuer.error();
  out.subject = std::move(*subject);
  out.issuer = std::move(*issuer);
  // The last one, which is the most specific: what RFC 2253 writes first.
  if (auto names = values_of(name, NID_commonName); !names.empty()) out.common_name = names.back();
  out.units = values_of(name, NID_organizationalUnitName);
  auto not_before = unix_time(X509_get0_notBefore(certificate));
  auto not_after = unix_time(X509_get0_notAfter(certificate));
  if (!not_before) return not_before.error();
  if (!not_after) return not_after.error();
  out.not_before_s = *not_before;
  out.not_after_s = *not_after;
  return out;
}

Result<Digest> certificate_hash(const std::string& pem) {
  auto certificate = read_certificate(pem);
  if (!certificate) return certificate.error();
  unsigned char* der = nullptr;
  const int size = i2d_X509(certificate->get(), &der);
  if (size < 0) return Error{"the certificate cannot be written: " + openssl_error()};
  const Digest hash = sha256({reinterpret_cast<const char*>(der), static_cast<std::size_t>(size)});
  OPENSSL_free(der);
  return hash;
}

Result<CertificateNumber> certificate_number(const std::string& pem) {
  auto certificate = read_certificate(pem);
  if (!certificate) return certificate.error();
  const ASN1_OCTET_STRING* key = X509_get0_authority_key_id(certificate->get());
  if (!key) return Error{"the certificate does not say which key of its authority has signed it"};
  return CertificateNumber{hex(text_of(X509_get0_serialNumber(certificate->get()))), hex(text_of(key))};
}

Result<Certificate> parse_certificate(const std::string& pem) {
  auto certificate = read_certificate(pem);
  if (!certificate) return certificate.error();
  return describe(certificate->get());
}

Result<std::string> read_certificate_file(const std::string& path) {
  auto pem = read_file(path);
  if (!pem) return pem.error();
  if (const auto certificate = read_certificate(*pem); !certificate)
    return Error{path + ": " + certificate.error().message};
  return pem;
}

}  // namespace ledgerline::crypto
