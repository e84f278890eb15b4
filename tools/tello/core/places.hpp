#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::tello {

/// IPv4 in host order: all hosts of "192.168.1.0/24" or a smaller subnet, without its own and its broadcast address
/// (but of /31 and /32). At most 254: a search for a drone sends nothing to networks beyond the user's room.
Result<std::vector<std::uint32_t>> hosts_of(const std::string& cidr);

/// What is wrong with a network's name or password for the word `ap`, which takes blanks for its ends; empty: nothing.
std::string wifi_refusal(const std::string& ssid, const std::string& password);

}  // namespace ledgerline::tello
