#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/pkcs12.h>
#include <openssl/x509.h>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

constexpr int rounds = 600'000;

using Pkcs8Ptr = std::unique_ptr<PKCS8_PRIV_KEY_INFO, Freed<PKCS8_PRIV_KEY_INFO_free>>;
using LockedPtr = std::unique_ptr<X509_SIG, Freed<X509_SIG_free>>;

}  // namespace

Result<std::string> lock_key(const std::string& pem_key, const std::string& pass_phrase) {
  const KeyPtr key(PEM_read_bio_PrivateKey(bio_of(pem_key).get(), nullptr, no_pass_phrase, nullptr));
  if (!key) return Error{"not a private key in PEM: " + openssl_error()};
  const Pkcs8Ptr plain(EVP_PKEY2PKCS8(key.get()));
  const LockedPtr locked(plain ? PKCS8_encrypt(NID_hmacWithSHA256, EVP_aes_256_cbc(), pass_phrase.data(),
                                               static_cast<int>(pass_phrase.size()), nullptr, 0, rounds, plain.get())
                               : nullptr);
  const BioPtr text(BIO_new(BIO_s_mem()));
  if (!locked || PEM_write_bio_PKCS8(text.get(), locked.get()) != 1)
    return Error{"cannot lock the key: " + openssl_error()};
  return text_of(text.get());
}

Result<std::string> unlock_key(const std::string& locked_pem, const std::string& pass_phrase) {
  const LockedPtr locked(PEM_read_bio_PKCS8(bio_of(locked_pem).get(), nullptr, no_pass_phrase, nullptr));
  if (!locked) {
    openssl_error();
    return Error{"it is not locked by a pass phrase (ENCRYPTED PRIVATE KEY)"};
  }
  const Pkcs8Ptr plain(PKCS8_decrypt(locked.get(), pass_phrase.data(), static_cast<int>(pass_phrase.size())));
  if (!plain) {
    openssl_error();
    return Error{"another pass phrase locks it"};
  }
  const BioPtr text(BIO_new(BIO_s_secmem()));
  if (PEM_write_bio_PKCS8_PRIV_KEY_INFO(text.get(), plain.get()) != 1)
    return Error{"cannot unlock the key: " + openssl_error()};
  return text_of(text.get());
}

}  // namespace ledgerline::crypto
