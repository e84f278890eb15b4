#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::station {

/// Where a station listens.
struct Place {
  std::string address;  ///< "127.0.0.1"
  std::uint16_t port = 0;
};
std::string text_of(const Place& place);  ///< "127.0.0.1:8800"

/// Of "http://127.0.0.1:8800", with or without a "/" behind it. The token goes there as it is, so it must be this computer
/// (localhost or 127.x.x.x; the near end of an SSH tunnel is one).
Result<Place> place_from_url(const std::string& url);
/// Of [service] listen: "127.0.0.1:8800". Port 0 is one that nobody knows beforehand.
Result<Place> place_from_listen(const std::string& listen);

/// The token of a page or a session, as a file has it: 64 hex digits.
bool is_token(const std::string& text);

}  // namespace ledgerline::station
