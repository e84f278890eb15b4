#include "common/base/text.hpp"

#include <charconv>

#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <utility>

namespace ledgerline {
namespace {

// Bytes of the UTF-8 character (RFC 3629) at the front, which is not empty; 0: it is none.
std::size_t character_size(std::string_view text) {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U; };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t size = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
  if (first < 0xc2 || first > 0xf4) return 0;
  for (std::size_t i = 1; i < size; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
  }
  const bool overlong = (first == 0xe0 && byte(1) < 0xa0) || (first == 0xf0 && byte(1) < 0x90);
  const bool surrogate = first == 0xed && byte(1) >= 0xa0;
  const bool beyond = first == 0xf4 && byte(1) >= 0x90;
  return overlong || surrogate || beyond ? 0 : size;
}

// U+0080 to U+009F are controls as well (U+009B begins a terminal's commands), U+2028 and U+2029 end lines.
bool is_control(std::string_view character) {
  if (character.size() == 1) return character[0] < ' ' || character[0] == '\x7f';
  return (character.size() == 2 && character[0] == '\xc2' && static_cast<unsigned char>(character[1]) < 0xa0) ||
         character == "\xe2\x80\xa8" || character == "\xe2\x80\xa9";
}

}  // namespace

std::string printable(std::string_view text, std::size_t max_size) {
  constexpr std::string_view rest = "...";
  std::string out;
  std::size_t cut = 0;  // where the rest may begin
  while (!text.empty()) {
    const std::size_t size = character_size(text);
    const bool printable = size > 0 && !is_control(text.substr(0, size));
    out += printable ? text.substr(0, size) : "?";
    text.remove_prefix(size == 0 ? 1 : size);
    if (out.size() + rest.size() <= max_size) cut = out.size();
    if (out.size() > max_size) return out.replace(cut, std::string::npos, rest);
  }
  return out;
}

bool is_utf8(std::string_view text) {
  while (!text.empty()) {
    const std::size_t size = character_size(text);
    if (size == 0) return false;
    text.remove_prefix(size);
  }
  return true;
}

std::string xml_text(std::string_view text) {
  constexpr std::pair<char, std::string_view> escapes[] = {
      {'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}};
  std::string out;
  for (const char c : text) {
    const auto* const escape = std::ranges::find(escapes, c, &std::pair<char, std::string_view>::first);
    if (escape != std::end(escapes))
      out += escape->second;
    else
      out += static_cast<unsigned char>(c) < 32 && c != '\n' ? ' ' : c;
  }
  return out;
}

Result<std::uint32_t> parse_ipv4(const std::string& text) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1) return Error{fmt::format("'{}' is no IPv4 address", text)};
  return ntohl(address.s_addr);
}

std::string ipv4_text(std::uint32_t address) {
  return fmt::format("{}.{}.{}.{}", address >> 24, (address >> 16) & 255, (address >> 8) & 255, address & 255);
}

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

std::string environment_variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

}  // namespace ledgerline
