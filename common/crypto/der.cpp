#include "common/crypto/der.hpp"

#include <algorithm>

namespace ledgerline::crypto {
namespace {

// The order n of P-256 (FIPS 186-4, D.1.2.3) and its half.
constexpr Scalar order{0xff, 0xff, 0xff, 0xff, 0x00, 0x00, 0x00, 0x00, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
                       0xbc, 0xe6, 0xfa, 0xad, 0xa7, 0x17, 0x9e, 0x84, 0xf3, 0xb9, 0xca, 0xc2, 0xfc, 0x63, 0x25, 0x51};
constexpr Scalar half_order{0x7f, 0xff, 0xff, 0xff, 0x80, 0x00, 0x00, 0x00, 0x7f, 0xff, 0xff,
                            0xff, 0xff, 0xff, 0xff, 0xff, 0xde, 0x73, 0x7d, 0x56, 0xd3, 0x8b,
                            0xcf, 0x42, 0x79, 0xdc, 0xe5, 0x61, 0x7e, 0x31, 0x92, 0xa8};

Scalar order_minus(const Scalar& s) {
  Scalar out{};
  int borrow = 0;
  for (std::size_t i = out.size(); i-- > 0;) {
    const int digit = order[i] - s[i] - borrow;
    borrow = digit < 0 ? 1 : 0;
    out[i] = static_cast<unsigned char>(digit + (borrow << 8));
  }
  return out;
}

/// Takes one positive INTEGER in its shortest form off the front.
bool take_integer(std::string_view& der, Scalar& out) {
  if (der.size() < 3 || der[0] != 0x02) return false;
  const auto length = static_cast<unsigned char>(der[1]);
  if (length < 1 || length > 33 || der.size() < length + 2U) return false;
  std::string_view digits = der.substr(2, length);
  der.remove_prefix(length + 2U);
  if (static_cast<unsigned char>(digits[0]) & 0x80) return false;  // negative
  if (digits[0] == 0) {
    if (digits.size() == 1 || !(static_cast<unsigned char>(digits[1]) & 0x80))
      return false;  // zero, or not the shortest form
    digits.remove_prefix(1);
  }
  if (digits.size() > out.size()) return false;
  std::copy(digits.begin(), digits.end(), out.end() - static_cast<std::ptrdiff_t>(digits.size()));
  return true;
}

void put_integer(std::string& der, const Scalar& value) {
  std::size_t first = 0;
  while (first < value.size() - 1 && value[first] == 0) ++first;
  const bool pad = (value[first] & 0x80) != 0;
  der.push_back(0x02);
  der.push_back(static_cast<char>(value.size() - first + (pad ? 1 : 0)));
  if (pad) der.push_back(0);
  der.append(value.begin() + static_cast<std::ptrdiff_t>(first), value.end());
}

}  // namespace

std::optional<EcdsaSignature> decode_signature(std::string_view der) {
  EcdsaSignature out;
  if (der.size() < 8 || der.size() > 72 || der[0] != 0x30 || static_cast<unsigned char>(der[1]) != der.size() - 2)
    return std::nullopt;
  der.remove_prefix(2);
  if (!take_integer(der, out.r) || !take_integer(der, out.s) || !der.empty()) return std::nullopt;
  if (out.r >= order || out.s > half_order) return std::nullopt;
  return out;
}

std::string encode_signature(EcdsaSignature signature) {
  if (signature.s > half_order) signature.s = order_minus(signature.s);
  std::string body;
  put_integer(body, signature.r);
  put_integer(body, signature.s);
  std::string der{0x30, static_cast<char>(body.size())};
  return der + body;
}

}  // namespace ledgerline::crypto
