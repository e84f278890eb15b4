#include "common/crypto/identities/list_origin.hpp"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <memory>

#include "common/crypto/crypto.hpp"
#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {

Result<ListOrigin> origin_of_list(const std::string& entry) {
  const auto pem = list_of_entry(entry);
  if (!pem) return pem.error();
  const BioPtr text = bio_of(*pem);
  const CrlPtr list{PEM_read_bio_X509_CRL(text.get(), nullptr, no_pass_phrase, nullptr)};
  if (!list) return Error{"a revocation list cannot be read: " + openssl_error()};
  ListOrigin origin;
  unsigned char* der = nullptr;
  const int size = i2d_X509_NAME(X509_CRL_get_issuer(list.get()), &der);
  if (size < 0) return Error{"a revocation list's issuer cannot be read: " + openssl_error()};
  origin.issuer.assign(reinterpret_cast<const char*>(der), static_cast<std::size_t>(size));
  OPENSSL_free(der);
  origin.key_id = authority_key_of(list.get());
  const std::unique_ptr<ASN1_INTEGER, Freed<ASN1_INTEGER_free>> number{
      static_cast<ASN1_INTEGER*>(X509_CRL_get_ext_d2i(list.get(), NID_crl_number, nullptr, nullptr))};
  ERR_clear_error();
  if (number) {
    origin.number.assign(reinterpret_cast<const char*>(ASN1_STRING_get0_data(number.get())),
                         static_cast<std::size_t>(ASN1_STRING_length(number.get())));
    origin.number.erase(0, origin.number.find_first_not_of('\0'));
    if (origin.number.empty()) origin.number.assign(1, '\0');
  }
  const auto made = unix_time(X509_CRL_get0_lastUpdate(list.get()));
  if (!made) return made.error();
  origin.made_s = *made;
  return origin;
}

bool is_of_same_authority(const ListOrigin& made, const ListOrigin& old) {
  return made.issuer == old.issuer && (!old.key_id || made.key_id == old.key_id);
}

bool is_older(const ListOrigin& made, const ListOrigin& other) {
  if (made.number.empty() || other.number.empty()) return made.made_s < other.made_s;
  if (made.number.size() != other.number.size()) return made.number.size() < other.number.size();
  return made.number < other.number;
}

}  // namespace ledgerline::crypto
