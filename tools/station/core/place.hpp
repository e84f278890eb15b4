#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/web/host_port.hpp"
#include "ground/service/core/guard.hpp"

namespace ledgerline::station {

/// Where a station listens.
struct Place {
  web::HostPort at;
  bool tls = false;
};
std::string text_of(const Place& place);  ///< "127.0.0.1:8800"

/// Of "http://127.0.0.1:8800" or "https://ground.example.org:8800", with or without a "/" behind it. Without TLS it
/// must be this computer (localhost or a loopback address; the near end of an SSH tunnel is one).
Result<Place> place_from_url(const std::string& url);
/// Of a ground's own settings: the first of its names, else what it listens on. Port 0 is one that nobody knows
/// beforehand.
Result<Place> place_from_service(const ground::service::ServiceSettings& service);

/// The token of a page or a session, as a file has it: 64 hex digits.
bool is_token(const std::string& text);

}  // namespace ledgerline::station
