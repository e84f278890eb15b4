#pragma once
#include <array>
#include <optional>
#include <string>
#include <string_view>

/// ECDSA signatures over P-256 as bytes, shared by both libraries so that both refuse the same ones.
namespace ledgerline::crypto {

using Scalar = std::array<unsigned char, 32>;  ///< big-endian

struct EcdsaSignature {
  Scalar r{}, s{};
};

/// Strict DER, r and s in [1, n), s at most n/2 (as Fabric wants it: of the two valid signatures (r, s) and (r, n - s)
/// only one is accepted, so nobody on the way can change a signature). Anything else: nullopt.
std::optional<EcdsaSignature> decode_signature(std::string_view der);

/// Brings s below n/2 and writes DER.
std::string encode_signature(EcdsaSignature signature);

}  // namespace ledgerline::crypto
