#include "common/crypto/der.hpp"

#include <algorithm>

namespace ledgerline::crypto {
namespace {

/// The order n of a curve's group (FIPS 186-4, D.1.2.3 and D.1.2.4), its half, and its length in bytes.
struct Order {
  Scalar n, half;
  std::size_t bytes;
};
constexpr Order p256{{0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
                      0xff, 0xff, 0xff, 0xff, 0x00, 0x00, 0x00, 0x00, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
                      0xbc, 0xe6, 0xfa, 0xad, 0xa7, 0x17, 0x9e, 0x84, 0xf3, 0xb9, 0xca, 0xc2, 0xfc, 0x63, 0x25, 0x51},
                     {0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
                      0x7f, 0xff, 0xff, 0xff, 0x80, 0x00, 0x00, 0x00, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
                      0xde, 0x73, 0x7d, 0x56, 0xd3, 0x8b, 0xcf, 0x42, 0x79, 0xdc, 0xe5, 0x61, 0x7e, 0x31, 0x92, 0xa8},
                     32};
constexpr Order p384{{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
                      0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xc7, 0x63, 0x4d, 0x81, 0xf4, 0x37, 0x2d, 0xdf,
                      0x58, 0x1a, 0x0d, 0xb2, 0x48, 0xb0, 0xa7, 0x7a, 0xec, 0xec, 0x19, 0x6a, 0xcc, 0xc5, 0x29, 0x73},
                     {0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
                      0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xe3, 0xb1, 0xa6, 0xc0, 0xfa, 0x1b, 0x96, 0xef,
                      0xac, 0x0d, 0x06, 0xd9, 0x24, 0x58, 0x53, 0xbd, 0x76, 0x76, 0x0c, 0xb5, 0x66, 0x62, 0x94, 0xb9},
                     48};

const Order& order_of(Curve curve) { return curve == Curve::p256 ? p256 : p384; }

Scalar order_minus(const Scalar& order, const Scalar& s) {
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
bool take_integer(std::string_view& der, std::size_t max_bytes, Scalar& out) {
  if (der.size() < 3 || der[0] != 0x02) return false;
  const auto length = static_cast<unsigned char>(der[1]);
  if (length < 1 || length > max_bytes + 1 || der.size() < length + 2U) return false;
  std::string_view digits = der.substr(2, length);
  der.remove_prefix(length + 2U);
  if (static_cast<unsigned char>(digits[0]) & 0x80) return false;  // negative
  if (digits[0] == 0) {
    if (digits.size() == 1 || !(static_cast<unsigned char>(digits[1]) & 0x80))
      return false;  // zero, or not the shortest form
    digits.remove_prefix(1);
  }
  if (digits.size() > max_bytes) return false;
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

std::optional<EcdsaSignature> decode_signature(std::string_view der, Curve curve) {
  const Order& order = order_of(curve);
  EcdsaSignature out;
  const std::size_t max_size = 2 + 2 * (2 + 1 + order.bytes);  // below 128, so each length is one byte
  if (der.size() < 8 || der.size() > max_size || der[0] != 0x30 || static_cast<unsigned char>(der[1]) != der.size() - 2)
    return std::nullopt;
  der.remove_prefix(2);
  if (!take_integer(der, order.bytes, out.r) || !take_integer(der, order.bytes, out.s) || !der.empty())
    return std::nullopt;
  if (out.r >= order.n || out.s > order.half) return std::nullopt;
  return out;
}

std::string encode_signature(EcdsaSignature signature, Curve curve) {
  const Order& order = order_of(curve);
  if (signature.s > order.half) signature.s = order_minus(order.n, signature.s);
  std::string body;
  put_integer(body, signature.r);
  put_integer(body, signature.s);
  std::string der{0x30, static_cast<char>(body.size())};
  return der + body;
}

}  // namespace ledgerline::crypto
