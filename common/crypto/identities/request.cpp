#include "common/crypto/crypto.hpp"

#include <openssl/ec.h>
#include <openssl/pem.h>

#include <algorithm>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

using RequestPtr = std::unique_ptr<X509_REQ, Freed<X509_REQ_free>>;

}  // namespace

Result<KeyAndRequest> make_request(const Subject& subject) {
  const KeyPtr key(EVP_EC_gen("P-256"));
  const RequestPtr request(X509_REQ_new());
  const BioPtr key_text(BIO_new(BIO_s_secmem())), request_text(BIO_new(BIO_s_mem()));
  X509_NAME* const name = request ? X509_REQ_get_subject_name(request.get()) : nullptr;
  const bool good =
      key && name && add_name(name, "O", subject.organization) && add_name(name, "OU", subject.unit) &&
      add_name(name, "CN", subject.common_name) && X509_REQ_set_pubkey(request.get(), key.get()) == 1 &&
      X509_REQ_sign(request.get(), key.get(), EVP_sha256()) != 0 &&
      PEM_write_bio_PKCS8PrivateKey(key_text.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) == 1 &&
      PEM_write_bio_X509_REQ(request_text.get(), request.get()) == 1;
  if (!good) return Error{"cannot make the request of \"" + subject.common_name + "\": " + openssl_error()};
  return KeyAndRequest{text_of(key_text.get()), text_of(request_text.get())};
}

Status check_fits(const std::string& key_pem, const std::string& certificate_pem) {
  auto certificate = read_certificate(certificate_pem);
  if (!certificate) return certificate.error();
  const KeyPtr key(PEM_read_bio_PrivateKey(bio_of(key_pem).get(), nullptr, no_pass_phrase, nullptr));
  if (!key) return Error{"the key cannot be read: " + openssl_error()};
  if (X509_check_private_key(certificate->get(), key.get()) == 1) return done;
  (void)openssl_error();
  return Error{"the certificate is of another key"};
}

std::vector<std::string> certificates_in(std::string_view pem) {
  constexpr std::string_view begin = "-----BEGIN CERTIFICATE-----", end = "-----END CERTIFICATE-----";
  std::vector<std::string> all;
  for (std::size_t at = 0; (at = pem.find(begin, at)) != std::string_view::npos;) {
    const std::size_t last = pem.find(end, at);
    if (last == std::string_view::npos) break;
    all.push_back(std::string(pem.substr(at, last + end.size() - at)) + "\n");
    at = last;
  }
  return all;
}

Result<std::string> own_first(const std::string& key_pem, const std::string& certificates_pem) {
  const Status first_fits = check_fits(key_pem, certificates_pem);
  if (first_fits) return certificates_pem;
  std::vector<std::string> all = certificates_in(certificates_pem);
  const auto own =
      std::find_if(all.begin(), all.end(), [&](const std::string& one) { return check_fits(key_pem, one).ok(); });
  if (own == all.end()) return first_fits.error();
  std::rotate(all.begin(), own, own + 1);
  std::string text;
  for (const std::string& one : all) text += one;
  return text;
}

}  // namespace ledgerline::crypto
