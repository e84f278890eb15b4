#pragma once
#include <array>
#include <optional>
#include <string>
#include <string_view>

/// ECDSA signatures as bytes, shared by both libraries so that both refuse the same ones.
namespace ledgerline::crypto {

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

}  // namespace ledgerline::crypto
