#include "hil/sensor_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "hil/words.hpp"

namespace ledgerline::hil {
namespace {

constexpr std::array<std::string_view, 16> fields{"pitch", "roll", "yaw", "vgx",  "vgy",  "vgz", "templ", "temph",
                                                  "tof",   "h",    "bat", "baro", "time", "agx", "agy",   "agz"};
constexpr std::array<std::string_view, 8> nonsense{"",      "nan",  "-",   "99999999999999999999",
                                                   "1e300", "0x10", "12;", "\xff\x00"};

// Where the value of a field is; npos: it is not there.
std::pair<std::size_t, std::size_t> place_of(const std::string& text, const std::string& field) {
  const std::string begin = field + ":";
  std::size_t at = text.find(begin);
  while (at != std::string::npos && at > 0 && text[at - 1] != ';') at = text.find(begin, at + 1);
  if (at == std::string::npos) return {at, 0};
  at += begin.size();
  return {at, std::min(text.find(';', at), text.size()) - at};
}

}  // namespace

bool known_field(const std::string& field) { return std::find(fields.begin(), fields.end(), field) != fields.end(); }

bool misreport(TimeNs now, SensorFault& fault, Random& random, std::string& text) {
  if (fault.kind == SensorFault::Kind::every) {
    if (now < fault.next_ns) return false;
    fault.next_ns = now + fault.period_ns;
    return true;
  }
  const auto [at, size] =
      fault.field.empty() ? std::pair<std::size_t, std::size_t>(0, text.size()) : place_of(text, fault.field);
  if (at == std::string::npos) return true;
  const std::string said = text.substr(at, size);
  std::string wrong = said;
  switch (fault.kind) {
    case SensorFault::Kind::stuck:
      if (fault.last.empty()) fault.last = said;
      wrong = fault.last;
      break;
    case SensorFault::Kind::garbage:
      if (fault.field.empty()) {
        for (char& c : wrong) {
          if (random.next() % 8 == 0) c = static_cast<char>(random.next());
        }
      } else {
        wrong = nonsense[random.next() % nonsense.size()];
      }
      break;
    case SensorFault::Kind::bias:
      if (const auto value = parse_number(said)) wrong = fmt::format("{}", std::lround(*value + fault.bias));
      break;
    case SensorFault::Kind::every:
      break;
  }
  text.replace(at, size, wrong);
  return true;
}

}  // namespace ledgerline::hil
