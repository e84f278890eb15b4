#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"

/// IPv4 addresses as numbers in host order.
namespace ledgerline {

/// Of "192.168.10.1"; fails with words for a person.
Result<std::uint32_t> parse_ipv4(const std::string& text);
std::string ipv4_text(std::uint32_t address);

}  // namespace ledgerline
