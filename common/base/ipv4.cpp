#include "common/base/ipv4.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

namespace ledgerline {

Result<std::uint32_t> parse_ipv4(const std::string& text) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1) return Error{fmt::format("'{}' is no IPv4 address", text)};
  return ntohl(address.s_addr);
}

std::string ipv4_text(std::uint32_t address) {
  return fmt::format("{}.{}.{}.{}", address >> 24, (address >> 16) & 255, (address >> 8) & 255, address & 255);
}

}  // namespace ledgerline
