#include "hil/netem/sensor_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "common/base/text.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/netem/text_parse.hpp"

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
  if (fault.kind == SensorFault::Kind::stuck && fault.last.empty()) fault.last = said;
  if (fault.share < 1 && random.uniform() >= fault.share) return true;
  switch (fault.kind) {
    case SensorFault::Kind::stuck:
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
    case SensorFault::Kind::says:
      wrong = fmt::format("{}", std::lround(fault.bias));
      break;
    case SensorFault::Kind::every:
      break;
  }
  text.replace(at, size, wrong);
  return true;
}

}  // namespace

Result<SensorFault> parse_sensor(std::string_view text) {
  const Error wrong{fmt::format(
      "\"{}\": must be `FIELD|all stuck|garbage`, `FIELD bias|says NUMBER` or `all every 2s`, the first three "
      "with a share of the texts (`30%`) behind them; fields are those of the Tello's state text: h, tof, "
      "bat, yaw, vgx ...",
      printable(text, 100))};
  auto words = words_of(text);
  SensorFault fault;
  if (words.size() > 2 && words[1] != "every" && words.back().ends_with('%')) {
    const auto percent = parse_number(words.back().substr(0, words.back().size() - 1));
    if (!percent || *percent <= 0 || *percent > 100) return wrong;
    fault.share = *percent / 100;
    words.pop_back();
  }
  if (words.size() < 2 || words.size() > 3) return wrong;
  const bool all = words[0] == "all";
  if (!all) fault.field = words[0];
  if (!all && std::find(fields.begin(), fields.end(), words[0]) == fields.end()) return wrong;
  const std::string_view what = words[1];
  if (words.size() == 2 && (what == "stuck" || what == "garbage")) {
    fault.kind = what == "stuck" ? SensorFault::Kind::stuck : SensorFault::Kind::garbage;
    return fault;
  }
  if (words.size() == 3 && (what == "bias" || what == "says") && !all) {
    const auto bias = parse_number(words[2]);
    if (!bias || std::abs(*bias) > 1e6) return wrong;
    fault.kind = what == "bias" ? SensorFault::Kind::bias : SensorFault::Kind::says;
    fault.bias = *bias;
    return fault;
  }
  if (words.size() == 3 && what == "every" && all) {
    const auto period = parse_time(words[2]);
    if (!period) return period.error();
    if (*period <= 0) return Error{"every must be followed by more than 0 s"};
    fault.kind = SensorFault::Kind::every;
    fault.period_ns = *period;
    return fault;
  }
  return wrong;
}

void renew(std::vector<SensorFault>& known, std::vector<SensorFault> faults) {
  for (SensorFault& fault : faults) {
    const auto before =
        std::find_if(known.begin(), known.end(), [&](const SensorFault& k) { return k.item == fault.item; });
    if (before == known.end()) continue;
    fault.last = before->last;
    fault.next_ns = before->next_ns;
  }
  known = std::move(faults);
}

bool misreport(TimeNs now, std::vector<SensorFault>& faults, Random& random, std::string& text) {
  return std::all_of(faults.begin(), faults.end(),
                     [&](SensorFault& fault) { return misreport(now, fault, random, text); });
}

}  // namespace ledgerline::hil
