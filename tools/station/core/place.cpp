#include "tools/station/core/place.hpp"

#include <fmt/format.h>

#include "common/base/text.hpp"

namespace ledgerline::station {
namespace {

constexpr std::size_t token_digits = 64;

/// Without TLS the token goes there as it is.
Result<Place> place_from(const std::string& text, bool tls) {
  auto at = web::host_port_from(text);
  if (!at) return at.error();
  if (!tls && at->host == "localhost") at->host = "127.0.0.1";
  if (!tls && !web::is_loopback(at->host))
    return Error{
        "must be this computer (127.0.0.1 or localhost) without TLS: https:// where the station has it, else an SSH "
        "tunnel"};
  return Place{*at, tls};
}

}  // namespace

std::string text_of(const Place& place) { return web::text_of(place.at); }

Result<Place> place_from_url(const std::string& url) {
  constexpr std::string_view plain = "http://", secure = "https://";
  const auto wrong = [&](const std::string& what) {
    // What stands behind # in a page's address is its token.
    return Error{fmt::format("the station's address \"{}\" {}", printable(url.substr(0, url.find('#')), 128), what)};
  };
  const bool tls = url.starts_with(secure);
  if (!tls && !url.starts_with(plain)) return wrong("must begin with http:// or https://");
  std::string place = url.substr(tls ? secure.size() : plain.size());
  if (place.ends_with('/')) place.pop_back();
  if (place.find_first_of("/#?@") != std::string::npos)
    return wrong("must end behind its port; the token is in a file of its own");
  auto parsed = place_from(place, tls);
  if (!parsed) return wrong(parsed.error().message);
  if (parsed->at.port == 0) return wrong("must end in a port from 1 to 65535");
  return parsed;
}

Result<Place> place_from_service(const ground::service::ServiceSettings& service) {
  auto parsed = place_from(service.listen, service.has_tls());
  if (!parsed) return parsed;
  if (parsed->at.port == 0)
    return Error{"has port 0, any that is free: which one it was ground says when it is ready; give it with --url"};
  if (!service.names.empty()) parsed->at.host = service.names.front();
  return parsed;
}

bool is_token(const std::string& text) {
  return text.size() == token_digits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace ledgerline::station
