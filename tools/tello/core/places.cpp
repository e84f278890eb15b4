#include "tools/tello/core/asking.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "common/base/text.hpp"

namespace ledgerline::tello {
namespace {

constexpr int max_prefix = 32, min_prefix = 24;
// IEEE 802.11: a name has up to 32 bytes, a WPA2 password 8 to 63 characters.
constexpr std::size_t max_ssid = 32, min_password = 8, max_password = 63;

bool one_word(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c <= '~'; });
}

}  // namespace

Result<std::vector<std::uint32_t>> hosts_of(const std::string& cidr) {
  const std::size_t slash = cidr.find('/');
  const auto base = parse_ipv4(cidr.substr(0, slash));
  if (!base) return base.error();
  int prefix = 0;
  const char* const from = slash == std::string::npos ? nullptr : cidr.data() + slash + 1;
  const char* const to = cidr.data() + cidr.size();
  if (from == nullptr || std::from_chars(from, to, prefix).ptr != to || from == to || prefix < min_prefix ||
      prefix > max_prefix)
    return Error{fmt::format("'{}' is no subnet of /{} to /{}, such as 192.168.1.0/24", cidr, min_prefix, max_prefix)};
  const std::uint32_t size = std::uint32_t{1} << (max_prefix - prefix);
  const std::uint32_t first = *base & ~(size - 1);
  std::vector<std::uint32_t> hosts;
  for (std::uint32_t i = 0; i < size; ++i) {
    if (size > 2 && (i == 0 || i == size - 1)) continue;
    hosts.push_back(first + i);
  }
  return hosts;
}

Status check_wifi(const std::string& ssid, const std::string& password) {
  if (ssid.empty() || ssid.size() > max_ssid || !one_word(ssid))
    return Error{fmt::format(
        "the network's name must be 1 to {} characters without blanks, since the drone takes a blank for its "
        "end",
        max_ssid)};
  if (password.size() < min_password || password.size() > max_password || !one_word(password))
    return Error{fmt::format("the password must be {} to {} characters without blanks", min_password, max_password)};
  return done;
}

}  // namespace ledgerline::tello
