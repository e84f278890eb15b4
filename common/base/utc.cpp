#include "common/base/utc.hpp"

#include <algorithm>
#include <charconv>
#include <ctime>

#include "common/base/text.hpp"

namespace ledgerline {
namespace {

constexpr std::int64_t max_time_s = 9'000'000'000;  // in ns it fits 64 bits

}  // namespace

Result<std::int64_t> parse_time_s(const std::string& text) {
  std::int64_t seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error == std::errc() && end == text.data() + text.size() && seconds >= 0 && seconds <= max_time_s) return seconds;
  std::tm utc{};
  const char* const rest = ::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S%z", &utc);
  const std::int64_t east_s = utc.tm_gmtoff;
  const std::int64_t time_s = std::int64_t{::timegm(&utc)} - east_s;
  if (rest == nullptr || *rest != '\0' || utc.tm_year < 70 || utc.tm_year > 350 || time_s < 0)
    return Error{printable(text) + " is no time as 2026-11-29T01:02:03Z or 02:02:03+01:00, nor seconds since 1970"};
  return time_s;
}

Result<std::int64_t> parse_time_ns(const std::string& text) {
  constexpr std::size_t max_digits = 9;
  const std::size_t point = std::min(text.find('.'), text.size());
  std::string digits = text.substr(std::min(point + 1, text.size()));
  const std::string rest = digits.substr(std::min(digits.find_first_not_of("0123456789"), digits.size()));
  digits.resize(digits.size() - rest.size());
  // What is no fraction stays, and is refused with the whole text.
  const bool is_fraction =
      !digits.empty() && digits.size() <= max_digits && (rest.empty() || rest.find_first_of("Z+-") == 0);
  const auto time_s = parse_time_s(is_fraction ? text.substr(0, point) + rest : text);
  if (!time_s) return time_s;
  digits.resize(max_digits, '0');
  std::int64_t fraction_ns = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), fraction_ns);
  return *time_s * 1'000'000'000 + fraction_ns;
}

}  // namespace ledgerline
