#include "common/web/host_port.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <array>
#include <charconv>

#include "common/base/text.hpp"

namespace ledgerline::web {
namespace {

constexpr std::size_t max_name = 253;  // RFC 1035, 2.3.4

/// As inet_ntop writes it, which is how browsers do, too; nothing: it is no IPv6 address.
std::optional<std::string> canonical_ipv6(const std::string& text) {
  in6_addr address{};
  std::array<char, INET6_ADDRSTRLEN> written{};
  if (::inet_pton(AF_INET6, text.c_str(), &address) != 1) return std::nullopt;
  if (::inet_ntop(AF_INET6, &address, written.data(), written.size()) == nullptr) return std::nullopt;
  return written.data();
}

bool is_name(const std::string& text) {
  constexpr const char* allowed = "abcdefghijklmnopqrstuvwxyz0123456789-.";
  if (text.empty() || text.size() > max_name || text.find_first_not_of(allowed) != std::string::npos) return false;
  if (text.front() == '.' || text.front() == '-' || text.back() == '-' || text.find("..") != std::string::npos)
    return false;
  // What ends in a number is an address, and then a wrong one.
  const std::string last = text.substr(text.rfind('.') + 1);
  return last.find_first_not_of("0123456789") != std::string::npos;
}

}  // namespace

Result<HostPort> host_port_from(const std::string& text) {
  const auto colon = text.rfind(':');
  const Error shape{"must be HOST:PORT, as 127.0.0.1:8800 or [::1]:8800"};
  if (colon == std::string::npos) return shape;
  HostPort at{.host = text.substr(0, colon)};
  if (at.host.starts_with('[') && at.host.ends_with(']')) {
    auto ipv6 = canonical_ipv6(at.host.substr(1, at.host.size() - 2));
    if (!ipv6) return shape;
    at.host = std::move(*ipv6);
  } else if (at.host.find(':') != std::string::npos || !host_kind(at.host)) {
    return shape;
  }
  const char* const end = text.data() + text.size();
  const char* const begin = text.data() + colon + 1;
  const auto read = std::from_chars(begin, end, at.port);
  if (begin == end || read.ec != std::errc() || read.ptr != end) return Error{"must end in a port up to 65535"};
  return at;
}

std::string url_host(const std::string& host) {
  return host.find(':') == std::string::npos ? host : fmt::format("[{}]", host);
}

std::string text_of(const HostPort& at) { return fmt::format("{}:{}", url_host(at.host), at.port); }

std::optional<HostKind> host_kind(const std::string& host) {
  if (parse_ipv4(host)) return HostKind::ipv4;
  if (canonical_ipv6(host) == host) return HostKind::ipv6;
  if (is_name(host)) return HostKind::name;
  return std::nullopt;
}

bool is_loopback(const std::string& host) {
  const auto ipv4 = parse_ipv4(host);
  return ipv4 ? *ipv4 >> 24 == 127 : host == "::1";
}

bool is_any_address(const std::string& host) { return host == "0.0.0.0" || host == "::"; }

}  // namespace ledgerline::web
