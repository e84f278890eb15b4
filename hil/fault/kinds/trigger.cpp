#include "hil/fault/kinds/trigger.hpp"

#include <fmt/format.h>

#include <array>
#include <utility>

#include "hil/netem/distribution.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {

bool Trigger::reached(TimeNs now, const DroneFacts& drone) const {
  switch (kind) {
    case Kind::time:
      return now >= after_ns;
    case Kind::takeoff:
      return drone.truth.in_flight;
    case Kind::flying:
      return drone.phase == FlightPhase::flying;
    case Kind::path:
      return drone.ground_phase == ground::DronePhase::path;
    case Kind::lap:
      return drone.lap >= static_cast<int>(value);
    case Kind::height:
      return drone.truth.position_m[2] >= value;
    case Kind::landing:
      return drone.phase == FlightPhase::landing;
    case Kind::landed:
      return drone.phase == FlightPhase::landed;
  }
  return false;
}

Result<Trigger> parse_trigger(std::string_view text) {
  const std::string_view whole = trimmed(text);
  constexpr std::string_view usage =
      "must be a time as 5s, or takeoff, flying, path, lap N, height METRES, landing or landed, which may be followed "
      "by "
      "+ 2s";
  Trigger trigger;
  std::string_view head = whole;
  if (const auto plus = whole.find('+'); plus != std::string_view::npos) {
    const auto after = parse_time(trimmed(whole.substr(plus + 1)));
    if (!after) return Error{fmt::format("\"{}\": {}", text, usage)};
    trigger.after_ns = *after;
    head = trimmed(whole.substr(0, plus));
  }
  const auto words = words_of(head);
  using Kind = Trigger::Kind;
  constexpr std::array<std::pair<std::string_view, Kind>, 5> plain{{{"takeoff", Kind::takeoff},
                                                                    {"flying", Kind::flying},
                                                                    {"path", Kind::path},
                                                                    {"landing", Kind::landing},
                                                                    {"landed", Kind::landed}}};
  if (words.size() == 1) {
    for (const auto& [name, kind] : plain) {
      if (words[0] != name) continue;
      trigger.kind = kind;
      return trigger;
    }
    const auto time = parse_time(words[0]);
    if (time && head == whole) {
      trigger.after_ns = *time;
      return trigger;
    }
  }
  if (words.size() == 2 && (words[0] == "lap" || words[0] == "height")) {
    const auto value = parse_number(words[1]);
    const bool lap = words[0] == "lap";
    const bool good = value && (lap ? *value >= 1 && *value <= 1000 && *value == static_cast<int>(*value)
                                    : *value > 0 && *value <= 100);
    if (good) {
      trigger.kind = lap ? Kind::lap : Kind::height;
      trigger.value = *value;
      return trigger;
    }
  }
  return Error{fmt::format("\"{}\": {}", text, usage)};
}

}  // namespace ledgerline::hil
