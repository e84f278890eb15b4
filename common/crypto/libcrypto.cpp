#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/pem.h>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

std::optional<Curve> curve_of(const EVP_PKEY* key) {
  char group[32] = {};
  if (EVP_PKEY_get_base_id(key) != EVP_PKEY_EC || EVP_PKEY_get_group_name(key, group, sizeof group, nullptr) != 1)
    return std::nullopt;
  if (std::string_view(group) == "prime256v1") return Curve::p256;
  if (std::string_view(group) == "secp384r1") return Curve::p384;
  return std::nullopt;
}

const Error other_curve{"the certificate's key is on neither of the curves P-256 and P-384"};

const unsigned char* bytes_of(std::string_view text) { return reinterpret_cast<const unsigned char*>(text.data()); }

/// libcrypto writes signatures with either s; takes its DER (always well-formed) apart and lowers s.
std::string with_low_s(const unsigned char* der, std::size_t size, Curve curve) {
  const unsigned char* p = der;
  std::unique_ptr<ECDSA_SIG, Freed<ECDSA_SIG_free>> parsed(d2i_ECDSA_SIG(nullptr, &p, static_cast<long>(size)));
  EcdsaSignature signature;
  BN_bn2binpad(ECDSA_SIG_get0_r(parsed.get()), signature.r.data(), static_cast<int>(signature.r.size()));
  BN_bn2binpad(ECDSA_SIG_get0_s(parsed.get()), signature.s.data(), static_cast<int>(signature.s.size()));
  return encode_signature(signature, curve);
}

/// A context of a key's own, which libcrypto takes long to look up, is copied for each signature. Any thread may.
MdContextPtr copy_of(const MdContextPtr& prepared) {
  MdContextPtr context(EVP_MD_CTX_new());
  if (!context || EVP_MD_CTX_copy_ex(context.get(), prepared.get()) != 1) return nullptr;
  return context;
}

class LibcryptoSigner final : public Signer {
 public:
  LibcryptoSigner(const KeyPtr& key, Curve curve) : prepared_(EVP_MD_CTX_new()), curve_(curve) {
    if (prepared_ && EVP_DigestSignInit(prepared_.get(), nullptr, EVP_sha256(), nullptr, key.get()) != 1)
      prepared_.reset();
  }

  Result<std::string> sign(std::string_view message) const override {
    const MdContextPtr context = prepared_ ? copy_of(prepared_) : nullptr;
    unsigned char der[112];
    std::size_t size = sizeof der;
    if (!context || EVP_DigestSign(context.get(), der, &size, bytes_of(message), message.size()) != 1) {
      return Error{"libcrypto cannot sign: " + openssl_error()};
    }
    return with_low_s(der, size, curve_);
  }

 private:
  MdContextPtr prepared_;
  Curve curve_;
};

class LibcryptoVerifier final : public Verifier {
 public:
  LibcryptoVerifier(const KeyPtr& key, Curve curve) : prepared_(EVP_MD_CTX_new()), curve_(curve) {
    if (prepared_ && EVP_DigestVerifyInit(prepared_.get(), nullptr, EVP_sha256(), nullptr, key.get()) != 1)
      prepared_.reset();
  }

  bool verify(std::string_view message, std::string_view der) const override {
    if (!decode_signature(der, curve_)) return false;
    const MdContextPtr context = prepared_ ? copy_of(prepared_) : nullptr;
    const bool good =
        context && EVP_DigestVerify(context.get(), bytes_of(der), der.size(), bytes_of(message), message.size()) == 1;
    if (!good) ERR_clear_error();
    return good;
  }

 private:
  MdContextPtr prepared_;
  Curve curve_;
};

}  // namespace

Result<std::unique_ptr<Signer>> make_libcrypto_signer(const std::string& pem_key) {
  KeyPtr key(PEM_read_bio_PrivateKey(bio_of(pem_key).get(), nullptr, no_pass_phrase, nullptr));
  if (!key) return Error{"not a private key in PEM: " + openssl_error()};
  const auto curve = curve_of(key.get());
  if (!curve) return Error{"the private key is on neither of the curves P-256 and P-384"};
  return std::unique_ptr<Signer>(std::make_unique<LibcryptoSigner>(key, *curve));
}

Result<std::unique_ptr<Verifier>> make_libcrypto_verifier(X509* certificate) {
  KeyPtr key(X509_get_pubkey(certificate));
  if (!key) return Error{"the certificate has no usable key: " + openssl_error()};
  const auto curve = curve_of(key.get());
  if (!curve) return other_curve;
  return std::unique_ptr<Verifier>(std::make_unique<LibcryptoVerifier>(key, *curve));
}

Result<PublicPoint> public_point(X509* certificate) {
  EVP_PKEY* key = X509_get0_pubkey(certificate);
  if (!key) return Error{"the certificate has no usable key: " + openssl_error()};
  const auto curve = curve_of(key);
  if (!curve) return other_curve;
  unsigned char* encoded = nullptr;
  const std::size_t size = EVP_PKEY_get1_encoded_public_key(key, &encoded);
  PublicPoint point{*curve, std::string(reinterpret_cast<const char*>(encoded), size)};
  OPENSSL_free(encoded);
  if (size != (*curve == Curve::p256 ? 65U : 97U) || point.bytes[0] != 4)
    return Error{"the certificate's key is not an uncompressed point"};
  return point;
}

}  // namespace ledgerline::crypto
