#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <algorithm>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

bool is_of(X509_CRL* list, X509* authority) {
  const bool signed_by_it = X509_NAME_cmp(X509_CRL_get_issuer(list), X509_get_subject_name(authority)) == 0 &&
                            X509_CRL_verify(list, X509_get0_pubkey(authority)) == 1;
  ERR_clear_error();
  return signed_by_it;
}

/// The MSP id of the authority that signed it; empty: none of these.
std::string signer_of(X509_CRL* list, const std::vector<MspRoot>& roots) {
  for (const MspRoot& root : roots) {
    for (const X509Ptr& authority : read_certificates(root.ca_pem))
      if (is_of(list, authority.get())) return root.msp_id;
  }
  return {};
}

Result<RevocationList> describe(X509_CRL* list, const std::vector<MspRoot>& roots) {
  RevocationList out;
  out.msp_id = signer_of(list, roots);
  if (out.msp_id.empty()) return Error{"a revocation list is signed by none of the named authorities"};
  const auto made = unix_time(X509_CRL_get0_lastUpdate(list));
  if (!made) return made.error();
  out.made_s = *made;
  return out;
}

}  // namespace

Result<std::vector<RevocationList>> read_revocation_lists(const std::string& pem, const std::vector<MspRoot>& roots) {
  std::vector<RevocationList> lists;
  const BioPtr text = bio_of(pem);
  while (const CrlPtr list{PEM_read_bio_X509_CRL(text.get(), nullptr, no_pass_phrase, nullptr)}) {
    auto described = describe(list.get(), roots);
    if (!described) return described.error();
    lists.push_back(std::move(*described));
  }
  const bool at_end = ERR_GET_REASON(ERR_peek_last_error()) == PEM_R_NO_START_LINE;
  const std::string why = openssl_error();
  if (!at_end) return Error{"a revocation list cannot be read: " + why};
  if (lists.empty()) return Error{"there is no revocation list in it (X.509 CRL, PEM)"};
  return lists;
}

std::optional<std::string> authority_key_of(X509_CRL* list) {
  const int at = X509_CRL_get_ext_by_NID(list, NID_authority_key_identifier, -1);
  if (at < 0) return std::nullopt;
  const std::unique_ptr<AUTHORITY_KEYID, Freed<AUTHORITY_KEYID_free>> said{
      static_cast<AUTHORITY_KEYID*>(X509V3_EXT_d2i(X509_CRL_get_ext(list, at)))};
  ERR_clear_error();
  if (!said) return std::nullopt;
  return said->keyid == nullptr ? std::string{} : text_of(said->keyid);
}

Result<std::string> list_of_entry(const std::string& entry) {
  const bool is_text = entry.starts_with("-----BEGIN X509 CRL");
  const BioPtr in = bio_of(entry);
  const CrlPtr list{is_text ? PEM_read_bio_X509_CRL(in.get(), nullptr, no_pass_phrase, nullptr)
                            : d2i_X509_CRL_bio(in.get(), nullptr)};
  if (!list) return Error{"a revocation list cannot be read: " + openssl_error()};
  const BioPtr out(BIO_new(BIO_s_mem()));
  PEM_write_bio_X509_CRL(out.get(), list.get());
  return text_of(out.get());
}

Result<bool> is_listed(const std::string& lists_pem, const std::string& certificate_pem) {
  const auto certificate = read_certificate(certificate_pem);
  if (!certificate) return certificate.error();
  return std::ranges::any_of(read_lists(lists_pem), [&](const CrlPtr& list) {
    X509_REVOKED* entry = nullptr;
    return X509_CRL_get0_by_cert(list.get(), &entry, certificate->get()) == 1;
  });
}

bool lists_name_key(const std::string& pem) {
  return std::ranges::all_of(read_lists(pem),
                             [](const CrlPtr& list) { return authority_key_of(list.get()).has_value(); });
}

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
    origin.number = text_of(number.get());
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
