#pragma once
#include <openssl/bn.h>
#include <openssl/ec.h>
#include <openssl/ecdsa.h>
#include <openssl/obj_mac.h>

#include <memory>
#include <string>

#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// The other signature of the same message, with s in the upper half of the order of P-256.
inline std::string with_high_s(const std::string& der) {
  const auto* in = reinterpret_cast<const unsigned char*>(der.data());
  std::unique_ptr<ECDSA_SIG, void (*)(ECDSA_SIG*)> signature(d2i_ECDSA_SIG(nullptr, &in, static_cast<long>(der.size())),
                                                             ECDSA_SIG_free);
  std::unique_ptr<EC_GROUP, void (*)(EC_GROUP*)> group(EC_GROUP_new_by_curve_name(NID_X9_62_prime256v1), EC_GROUP_free);
  BIGNUM* s = BN_new();
  BN_sub(s, EC_GROUP_get0_order(group.get()), ECDSA_SIG_get0_s(signature.get()));
  ECDSA_SIG_set0(signature.get(), BN_dup(ECDSA_SIG_get0_r(signature.get())), s);
  unsigned char* bytes = nullptr;
  const int size = i2d_ECDSA_SIG(signature.get(), &bytes);
  std::string result(reinterpret_cast<char*>(bytes), static_cast<std::size_t>(size));
  OPENSSL_free(bytes);
  return result;
}

class HighSSigner final : public crypto::Signer {
 public:
  explicit HighSSigner(std::shared_ptr<const crypto::Signer> signer) : signer_(std::move(signer)) {}
  Result<std::string> sign(std::string_view message) const override {
    auto signature = signer_->sign(message);
    if (!signature) return signature;
    return with_high_s(*signature);
  }

 private:
  std::shared_ptr<const crypto::Signer> signer_;
};

}  // namespace ledgerline::node
