#include <algorithm>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

/// The order n of a curve's group (FIPS 186-4, D.1.2.3 and D.1.2.4), its half, and its length in bytes.
struct Order {
  explicit constexpr Order(std::string_view digits) : bytes(digits.size() / 2) {
    const auto value = [](char digit) { return digit <= '9' ? digit - '0' : digit - 'a' + 10; };
    for (std::size_t i = 0, at = n.size() - bytes; i < digits.size(); i += 2, ++at)
      n[at] = static_cast<unsigned char>(value(digits[i]) * 16 + value(digits[i + 1]));
    for (std::size_t i = 0; i < n.size(); ++i)
      half[i] = static_cast<unsigned char>(n[i] / 2 + (i > 0 && n[i - 1] % 2 == 1 ? 128 : 0));
  }
  Scalar n{}, half{};
  std::size_t bytes;
};
constexpr Order p256("ffffffff00000000ffffffffffffffffbce6faada7179e84f3b9cac2fc632551");
constexpr Order p384(
    "ffffffffffffffffffffffffffffffffffffffffffffffffc7634d81f4372ddf581a0db248b0a77aecec196accc52973");

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

/// Reads one positive INTEGER in its shortest form off the front.
bool read_integer(std::string_view& der, std::size_t max_bytes, Scalar& out) {
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
  if (!read_integer(der, order.bytes, out.r) || !read_integer(der, order.bytes, out.s) || !der.empty())
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
