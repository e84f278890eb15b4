#include "common/base/endpoint.hpp"

#include <fmt/format.h>

#include <charconv>

namespace ledgerline {

Status check_endpoint(std::string_view text, unsigned least_port) {
  const auto wrong = [&](std::string_view what) { return Error{fmt::format("\"{}\": {}", text, what)}; };
  if (text.find("//") != std::string_view::npos || text.find_first_of("/ \t\r\n\"'") != std::string_view::npos)
    return wrong("give HOST:PORT and nothing else: no grpc:// or https://, no path");
  const auto colon = text.rfind(':');
  if (colon == std::string_view::npos || colon == 0) return wrong("give HOST:PORT");
  const std::string_view host = text.substr(0, colon), digits = text.substr(colon + 1);
  const bool is_ipv6 = host.front() == '[' && host.back() == ']';
  if (!is_ipv6 && host.find_first_of(":[]") != std::string_view::npos)
    return wrong("an IPv6 address stands in brackets, as [::1]:7051");
  unsigned port = 0;
  const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (read.ec != std::errc() || read.ptr != digits.data() + digits.size() || port < least_port || port > 65535)
    return wrong(fmt::format("must end in a port from {} to 65535", least_port));
  return done;
}

}  // namespace ledgerline
