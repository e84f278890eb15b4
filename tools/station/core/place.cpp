#include "tools/station/core/place.hpp"

#include <fmt/format.h>

#include <charconv>

#include "common/base/ipv4.hpp"
#include "common/base/printable.hpp"

namespace ledgerline::station {
namespace {

constexpr std::size_t token_digits = 64;

Result<Place> place_from(const std::string& text) {
  const auto colon = text.rfind(':');
  const std::string host = text.substr(0, colon);
  const std::string address = host == "localhost" ? "127.0.0.1" : host;
  const auto parsed = parse_ipv4(address);
  if (!parsed || *parsed >> 24 != 127)
    return Error{"must be this computer (127.0.0.1 or localhost): there is no TLS; from elsewhere take an SSH tunnel"};
  unsigned port = 0;
  const char* const end = text.data() + text.size();
  const char* const begin = colon == std::string::npos ? end : text.data() + colon + 1;
  const auto read = std::from_chars(begin, end, port);
  if (begin == end || read.ec != std::errc() || read.ptr != end || port > 65'535)
    return Error{"must end in a port up to 65535, as 127.0.0.1:8800"};
  return Place{address, static_cast<std::uint16_t>(port)};
}

}  // namespace

std::string text_of(const Place& place) { return fmt::format("{}:{}", place.address, place.port); }

Result<Place> place_from_url(const std::string& url) {
  constexpr std::string_view scheme = "http://";
  const auto wrong = [&](const std::string& what) {
    // What stands behind # in a page's address is its token.
    return Error{fmt::format("the station's address \"{}\" {}", printable(url.substr(0, url.find('#')), 128), what)};
  };
  if (!url.starts_with(scheme)) return wrong("must begin with http://");
  std::string place = url.substr(scheme.size());
  if (place.ends_with('/')) place.pop_back();
  if (place.find_first_of("/#?@") != std::string::npos)
    return wrong("must end behind its port; the token is in a file of its own");
  auto parsed = place_from(place);
  if (!parsed) return wrong(parsed.error().what);
  if (parsed->port == 0) return wrong("must end in a port from 1 to 65535");
  return parsed;
}

Result<Place> place_from_listen(const std::string& listen) {
  auto parsed = place_from(listen);
  if (!parsed) return parsed;
  if (parsed->port == 0)
    return Error{"has port 0, any that is free: which one it was ground says when it is ready; give it with --url"};
  return parsed;
}

bool is_token(const std::string& text) {
  return text.size() == token_digits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace ledgerline::station
