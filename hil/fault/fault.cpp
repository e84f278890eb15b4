#include "hil/fault/fault.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "hil/lines/sensor_text.hpp"
#include "hil/lines/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Words = std::vector<std::string_view>;
using What = Fault::What;

Error allowed(std::string_view text, std::string_view what) { return Error{fmt::format("\"{}\": {}", text, what)}; }

std::string joined(const Words& words, std::size_t from) {
  std::string text;
  for (std::size_t i = from; i < words.size(); ++i) text += (text.empty() ? "" : " ") + std::string(words[i]);
  return text;
}

std::optional<std::array<double, 3>> vector_of(const Words& words, std::size_t from) {
  if (words.size() != from + 3) return std::nullopt;
  std::array<double, 3> v{};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto value = parse_number(words[from + i]);
    if (!value || std::abs(*value) > 100) return std::nullopt;
    v[i] = *value;
  }
  return v;
}

std::optional<double> share_of(std::string_view word) {
  if (!word.ends_with('%')) return std::nullopt;
  const auto value = parse_number(word.substr(0, word.size() - 1));
  if (!value || *value < 0 || *value > 100) return std::nullopt;
  return *value / 100;
}

// "*" or a drone's name.
std::string drone_of(std::string_view word) { return word == "*" ? std::string() : std::string(word); }

Status line_effects(Fault& fault, const Words& words, std::size_t from) {
  fault.what = What::line;
  const std::string effects = joined(words, from);
  for (std::size_t begin = 0; begin <= effects.size();) {
    const std::size_t comma = std::min(effects.find(',', begin), effects.size());
    Impairment effect;
    if (auto applied = apply_effect(std::string_view(effects).substr(begin, comma - begin), effect); !applied)
      return applied;
    if (!effect.any()) return allowed(fault.text, "does nothing: a fault ends by its `for`, not by `off` or `clear`");
    overlay(effect, fault.impairment);
    begin = comma + 1;
  }
  return done;
}

Status parse_drone(Fault& fault, const Words& words) {
  constexpr std::string_view usage =
      "must be `drone NAME|* ` and one of to, answers, states, from, both, plans with an effect (delay, jitter, loss, "
      "duplicate, reorder, corrupt, truncate, rate, stall, partition), or reboot, battery 10%, drain 1%, propeller, "
      "kick X Y Z";
  if (words.size() < 3) return allowed(fault.text, usage);
  fault.drone = drone_of(words[1]);
  const std::string_view what = words[2];
  const bool alone = words.size() == 3;
  if (what == "to") fault.lines = {LineAt::to};
  if (what == "answers") fault.lines = {LineAt::answers};
  if (what == "states") fault.lines = {LineAt::states};
  if (what == "from") fault.lines = {LineAt::answers, LineAt::states};
  if (what == "both") fault.lines = {LineAt::to, LineAt::answers, LineAt::states};
  if (what == "plans") fault.lines = {LineAt::plans};
  if (!fault.lines.empty()) {
    if (auto parsed = line_effects(fault, words, 3); !parsed || what != "plans") return parsed;
    const Impairment& has = fault.impairment;
    const std::string_view effect = has.corrupt > 0    ? "corrupt"
                                    : has.truncate > 0 ? "truncate"
                                    : has.rate         ? "rate"
                                                       : "";
    if (effect.empty()) return done;
    return allowed(fault.text, fmt::format("agent hands plans on in shared memory, which has no {}", effect));
  }
  if (what == "reboot" && alone) {
    fault.what = What::reboot;
    return done;
  }
  if (what == "propeller" && alone) {
    fault.what = What::propeller;
    return done;
  }
  if (what == "kick") {
    const auto v = vector_of(words, 3);
    if (!v) return allowed(fault.text, "kick must be followed by three velocities in m/s");
    fault.what = What::kick;
    fault.vector = *v;
    return done;
  }
  if ((what == "battery" || what == "drain") && words.size() == 4) {
    const auto share = share_of(words[3]);
    if (!share) return allowed(fault.text, "battery and drain must be followed by a share, 0% to 100%");
    fault.what = what == "battery" ? What::battery : What::drain;
    fault.value = *share;
    return done;
  }
  return allowed(fault.text, usage);
}

Status parse_sensor(Fault& fault, const Words& words) {
  if (words.size() < 4) return allowed(fault.text, "must be `sensor NAME|* FIELD|all stuck`, garbage, bias or every");
  auto sensor = hil::parse_sensor(joined(words, 2));
  if (!sensor) return allowed(fault.text, sensor.error().what);
  fault.what = What::sensor;
  fault.drone = drone_of(words[1]);
  fault.sensor = std::move(*sensor);
  return done;
}

Status parse_mocap(Fault& fault, const Words& words) {
  if (words.size() < 3)
    return allowed(fault.text,
                   "must be `mocap NAME|* ` and frozen, jump X Y Z, noise M, every 500ms, or an effect "
                   "(delay, jitter, loss ...)");
  fault.drone = drone_of(words[1]);
  const std::string_view what = words[2];
  if (what == "frozen" && words.size() == 3) {
    fault.what = What::mocap_frozen;
    return done;
  }
  if (what == "jump") {
    const auto v = vector_of(words, 3);
    if (!v) return allowed(fault.text, "jump must be followed by three distances in m");
    fault.what = What::mocap_offset;
    fault.vector = *v;
    return done;
  }
  if (what == "noise" && words.size() == 4) {
    const auto sigma = parse_number(words[3]);
    if (!sigma || *sigma < 0 || *sigma > 100) return allowed(fault.text, "noise must be followed by 0 to 100 m");
    fault.what = What::mocap_noise;
    fault.value = *sigma;
    return done;
  }
  if (what == "every" && words.size() == 4) {
    const auto period = parse_time(words[3]);
    if (!period) return period.error();
    if (*period <= 0) return allowed(fault.text, "every must be followed by more than 0 s");
    fault.what = What::mocap_every;
    fault.time_ns = *period;
    return done;
  }
  fault.lines = {LineAt::mocap};
  return line_effects(fault, words, 2);
}

Status parse_ledger(Fault& fault, const Words& words) {
  constexpr std::string_view usage =
      "must be `ledger stall`, `ledger restart`, `ledger relay LIE [compared]`, or `ledger agent|ground|both ` and "
      "cut, stale, lies WHAT, or "
      "[to|from] "
      "with stall or delay DISTRIBUTION";
  if (words.size() == 2 && words[1] == "stall") {
    fault.what = What::ledger_stall;
    return done;
  }
  if (words.size() == 2 && words[1] == "restart") {
    fault.what = What::ledger_restart;
    return done;
  }
  if (words.size() >= 2 && words[1] == "relay") {
    const auto lie = words.size() >= 3 ? relay_lie_from(words[2]) : std::nullopt;
    if (!lie || words.size() > 4 || (words.size() == 4 && words[3] != "compared"))
      return allowed(fault.text, "ledger relay must be followed by one of " + relay_lies() + ", and may by compared");
    fault.what = What::relay;
    fault.relay = *lie;
    fault.value = words.size() == 4 ? 1 : 0;
    return done;
  }
  if (words.size() < 3) return allowed(fault.text, usage);
  if (words[1] == "agent" || words[1] == "both") fault.ends.push_back(Process::agent);
  if (words[1] == "ground" || words[1] == "both") fault.ends.push_back(Process::ground);
  if (fault.ends.empty()) return allowed(fault.text, usage);
  if (words.size() == 3 && (words[2] == "cut" || words[2] == "stale")) {
    fault.what = words[2] == "cut" ? What::ledger_cut : What::ledger_stale;
    return done;
  }
  if (words[2] == "lies") {
    const auto lie = words.size() == 4 ? lie_from(words[3]) : std::nullopt;
    if (!lie) return allowed(fault.text, "lies must be followed by one of " + lies());
    fault.what = What::ledger_lie;
    fault.lie = *lie;
    return done;
  }
  const bool one_way = words[2] == "to" || words[2] == "from";
  fault.to = !one_way || words[2] == "to";
  fault.from = !one_way || words[2] == "from";
  const std::size_t at = one_way ? 3 : 2;
  if (words.size() == at + 1 && words[at] == "stall") {
    fault.what = What::ledger_hold;
    return done;
  }
  if (words.size() > at + 1 && words[at] == "delay") {
    auto delay = parse_distribution(joined(words, at + 1));
    if (!delay) return delay.error();
    fault.what = What::ledger_delay;
    fault.delay = std::move(*delay);
    return done;
  }
  for (const std::string_view effect : {"loss", "duplicate", "reorder", "corrupt", "truncate", "jitter", "partition"}) {
    if (words.size() > at && words[at] == effect)
      return allowed(fault.text, fmt::format("a ledger's connection is a stream (TCP) and has no {}: use delay, stall "
                                             "or cut",
                                             effect));
  }
  return allowed(fault.text, usage);
}

// What the real processes alone have; nothing: it is none of that.
std::optional<Status> parse_real(Fault& fault, const Words& words) {
  const std::string_view name = words[0];
  if (name == "disk") {
    fault.what = What::fill_disk;
    if (words.size() == 2 && words[1] == "full") return done;
    return allowed(fault.text, "must be `disk full`: the ledger's");
  }
  if (name == "roudi") {
    fault.what = What::kill_roudi;
    if (words.size() == 2 && words[1] == "kill") return done;
    return allowed(fault.text, "must be `roudi kill`");
  }
  if (name == "cpu") {
    fault.what = What::burn;
    const auto core = words.size() == 3 && words[2] == "burn" ? parse_number(words[1]) : std::nullopt;
    fault.value = core.value_or(-1);
    if (core && *core >= 0 && *core < 1024 && *core == std::floor(*core)) return done;
    return allowed(fault.text, "must be `cpu N burn`, N being a core from 0 on");
  }
  if (name == "memory") {
    fault.what = What::take_memory;
    const bool size = words.size() == 3 && words[1] == "take" && words[2].ends_with("MB");
    const auto megabytes = size ? parse_number(words[2].substr(0, words[2].size() - 2)) : std::nullopt;
    fault.value = megabytes.value_or(0) * 1e6;
    if (megabytes && *megabytes >= 1 && *megabytes <= 1e6) return done;
    return allowed(fault.text, "must be `memory take 500MB`, with at least 1MB");
  }
  for (const auto& [part, most] : {std::pair("peer", 3), std::pair("orderer", 3), std::pair("chaincode", 3)}) {
    if (name != part) continue;
    fault.what = What::kill_part;
    fault.part = leader_part;
    if (words.size() == 3 && words[1] == "leader" && words[2] == "kill" && part == std::string_view("orderer"))
      return done;
    const auto number = words.size() == 3 && words[2] == "kill" ? parse_number(words[1]) : std::nullopt;
    if (!number || *number < 1 || *number > most || *number != std::floor(*number))
      return allowed(fault.text, fmt::format("must be `{} N kill`, N from 1 to {}{}", part, most,
                                             part == std::string_view("orderer") ? ", or `orderer leader kill`" : ""));
    fault.part = fmt::format("{}{:.0f}", part, *number);
    return done;
  }
  return std::nullopt;
}

Status parse_other(Fault& fault, const Words& words, bool real) {
  if (words[0] == "wind") {
    const auto v = vector_of(words, 1);
    if (!v) return allowed(fault.text, "wind must be followed by three velocities in m/s");
    fault.what = What::wind;
    fault.vector = *v;
    return done;
  }
  for (const auto& [name, process] :
       {std::pair("agent", Process::agent), std::pair("link", Process::link), std::pair("ground", Process::ground)}) {
    if (words[0] != name) continue;
    const bool ends = process == Process::link && words.size() == 2 && words[1] == "end";
    if (words.size() != 2 || (words[1] != "kill" && words[1] != "stop" && !ends))
      return allowed(fault.text, fmt::format("must be `{} kill` or `{} stop`{}", name, name,
                                             process == Process::link ? ", or `link end` (SIGTERM)" : ""));
    fault.what = ends ? What::end : words[1] == "kill" ? What::kill : What::stop;
    fault.ends = {process};
    return done;
  }
  if (words[0] == "clock" && words.size() == 3 && words[1] == "jump") {
    const bool back = words[2].starts_with('-');
    const auto by = parse_time(words[2].substr(back ? 1 : 0));
    if (!by) return by.error();
    fault.what = What::clock_jump;
    fault.time_ns = back ? -*by : *by;
    return done;
  }
  for (const auto& [name, who] :
       {std::pair("operator", Stopper::operating), std::pair("supervisor", Stopper::supervisor),
        std::pair("stranger", Stopper::stranger)}) {
    for (const auto& [said, word] :
         {std::pair("stop", StopWord::stop), std::pair("cut", StopWord::cut), std::pair("resume", StopWord::resume)}) {
      if (words.size() != 3 || words[0] != name || words[1] != said) continue;
      fault.what = What::stop_drone;
      fault.drone = drone_of(words[2]);
      fault.stopper = who;
      fault.stop_word = word;
      return done;
    }
  }
  if (words[0] == "operator" && words.size() >= 2 && words[1] == "errs") {
    const auto slip = words.size() == 3 ? slip_from(words[2]) : std::nullopt;
    if (!slip) return allowed(fault.text, "operator errs must be followed by one of " + slips());
    fault.what = What::slip;
    fault.slip = *slip;
    fault.ends = {Process::ground};
    return done;
  }
  if (real) {
    if (const auto parsed = parse_real(fault, words)) return *parsed;
  }
  for (const std::string_view part : {"peer", "orderer", "chaincode", "cpu", "memory", "disk", "roudi"}) {
    if (words[0] == part)
      return allowed(fault.text, fmt::format("{} is not there in virtual time: such a fault needs the real processes "
                                             "(--real)",
                                             part));
  }
  return allowed(fault.text,
                 "must begin with drone, sensor, mocap, wind, ledger, agent, link, ground, clock, operator, "
                 "supervisor or stranger");
}

}  // namespace

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
    if (!after) return allowed(text, usage);
    trigger.after_ns = *after;
    head = trimmed(whole.substr(0, plus));
  }
  const Words words = words_of(head);
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
  return allowed(text, usage);
}

bool Fault::pushes() const {
  return what == What::kick || what == What::propeller || what == What::reboot || what == What::wind ||
         (what == What::stop_drone && stop_word == StopWord::cut);
}

bool Fault::deafens() const {
  return what == What::line && std::find(lines.begin(), lines.end(), LineAt::to) != lines.end();
}

bool Fault::silences() const {
  return (what == What::kill || what == What::stop || what == What::end) && ends[0] == Process::link;
}

bool Fault::momentary() const {
  return what == What::end || what == What::reboot || what == What::battery || what == What::kick ||
         what == What::propeller || what == What::ledger_restart || what == What::clock_jump ||
         what == What::stop_drone || what == What::kill_part || what == What::kill_roudi;
}

Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real) {
  Fault fault;
  fault.text = trimmed(text);
  const Words words = words_of(fault.text);
  if (words.empty()) return Error{"a fault must say where and what, as in \"drone tello1 to delay 200ms\""};
  Status parsed = words[0] == "drone"    ? parse_drone(fault, words)
                  : words[0] == "sensor" ? parse_sensor(fault, words)
                  : words[0] == "mocap"  ? parse_mocap(fault, words)
                  : words[0] == "ledger" ? parse_ledger(fault, words)
                                         : parse_other(fault, words, real);
  if (!parsed) return parsed.error();
  if (!at.empty()) {
    auto trigger = parse_trigger(at);
    if (!trigger) return trigger.error();
    fault.trigger = *trigger;
    fault.at = at;
  }
  if (!duration.empty()) {
    const auto time = parse_time(duration);
    if (!time) return time.error();
    if (*time <= 0) return allowed(duration, "a fault lasts longer than nothing; leave `for` out for one to the end");
    if (fault.momentary()) return allowed(fault.text, "happens at one moment: leave `for` out");
    fault.for_ns = *time;
  }
  return fault;
}

std::string never_text(const Fault& fault) { return fmt::format("\"{}\" at {} never began", fault.text, fault.at); }

}  // namespace ledgerline::hil
