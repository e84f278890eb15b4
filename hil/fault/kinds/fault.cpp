#include "hil/fault/kinds/fault.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cassert>
#include <cctype>
#include <utility>

#include "common/base/nearest_word.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {

bool Trigger::reached(TimeNs now, const DroneObservation& drone) const {
  switch (kind) {
    case Kind::time:
      return now >= after_ns;
    case Kind::takeoff:
      return drone.truth.in_flight;
    case Kind::flying:
      return drone.phase == LinkPhase::flying;
    case Kind::path:
      return drone.ground_phase == ground::GroundPhase::path;
    case Kind::lap:
      return drone.lap >= static_cast<int>(value);
    case Kind::height:
      return drone.truth.position_m[2] >= value;
    case Kind::landing:
      return drone.phase == LinkPhase::landing;
    case Kind::landed:
      return drone.phase == LinkPhase::landed;
  }
  return false;
}

TriggerWatch::TriggerWatch(const Trigger& its_trigger, std::string_view name, std::span<const DroneObservation> all)
    : trigger(its_trigger) {
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (name.empty() || name == all[i].name) drones.push_back(i);
  }
}

bool TriggerWatch::is_due(TimeNs now, std::span<const DroneObservation> all) {
  const auto reaches = [&](std::size_t i) { return trigger.reached(now, all[i]); };
  if (!reached_ns && std::any_of(drones.begin(), drones.end(), reaches))
    reached_ns = trigger.kind == Trigger::Kind::time ? now - trigger.after_ns : now;
  return reached_ns && now >= *reached_ns + trigger.after_ns;
}

std::vector<DroneObservation> named_drones(int count) {
  std::vector<DroneObservation> drones(static_cast<std::size_t>(count));
  for (int k = 1; k <= count; ++k) {
    drones[static_cast<std::size_t>(k) - 1].name = drone_name(k);
    drones[static_cast<std::size_t>(k) - 1].number = static_cast<DroneNumber>(k);
  }
  return drones;
}

Result<Trigger> parse_trigger(std::string_view text) {
  const std::string_view whole = trimmed(text);
  const std::string usage = fmt::format(
      "must be a time as 5s, or takeoff, flying, path, lap N, height METRES, landing or landed, which may be followed "
      "by + 2s; a time is at most {}",
      time_text(max_delay));
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
  if (words.size() == 1) {
    for (const Kind kind : {Kind::takeoff, Kind::flying, Kind::path, Kind::landing, Kind::landed}) {
      if (words[0] != enum_names<Kind>[static_cast<std::size_t>(kind)]) continue;
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

namespace {

void set_port(LedgerPort& port, TimeNs now, const Effects::OfPort& effects) {
  port.cut(now, effects.cut);
  port.stale(effects.stale);
  port.set_tampering(effects.tampering);
  port.serve(effects.serves);
  port.order(effects.orders);
  port.slip(effects.slip);
  port.stall_to(effects.stall_to);
  port.stall_from(effects.stall_from);
  port.delay_to(effects.delay_to);
  port.delay_from(effects.delay_from);
}

}  // namespace

void Effects::apply_to(SimulatedWorld& world) const {
  world.relay().set_tampering(relay ? relay->tampering : RelayTampering::none);
  if (relay) world.relay().compared(relay->compared);
  world.stall_ledger(ledger_stalled);
  for (const Process process : {Process::agent, Process::link, Process::ground}) {
    world.stop(process, stopped[static_cast<std::size_t>(process)]);
    if (process != Process::link) set_port(world.port(process), world.now(), port(process));
  }
  world.sim().set_wind(wind_mps);
  for (const auto host : {WorldClock::Host::mocap, WorldClock::Host::drones})
    world.clock().drift(host, clock_drift[static_cast<std::size_t>(host)]);
  for (std::size_t i = 0; i < drones.size(); ++i) {
    for (std::size_t at = 0; at < drone_traffic_count; ++at)
      world.network(i).impair(static_cast<DroneTraffic>(at), drones[i].impairments[at]);
    [[maybe_unused]] const Status set = world.sdk().set(i, drones[i].sdk);
    assert(set.ok());  // a fault that needs another drone was refused where there is none
    world.network(i).set_sensor_faults(drones[i].sensors);
    world.network(i).set_mocap_fault(drones[i].mocap);
    world.sim().drain_battery(world.drones()[i].number, drones[i].drain_per_s);
    world.sim().set_sensing(world.drones()[i].number, drones[i].sensing);
  }
}

namespace {

using Words = std::vector<std::string_view>;

Error wrong(std::string_view text, std::string_view what) { return Error{fmt::format("\"{}\": {}", text, what)}; }

bool is_open(std::string_view of_form) { return std::isupper(static_cast<unsigned char>(of_form[0])) != 0; }

/// How well words fit a form.
struct Fit {
  std::size_t fixed = 0;  ///< words that stand as they are, from the beginning on
  bool all_fixed = true;  ///< every one of the form's
  bool whole = false;     ///< and there are as many words as it has
};

Fit fit_of(const Words& words, const Words& form) {
  Fit fit;
  for (std::size_t i = 0; i < form.size() && fit.all_fixed; ++i) {
    if (is_open(form[i])) continue;
    fit.all_fixed = i < words.size() && std::ranges::count(split(form[i], '|'), words[i]) > 0;
    if (fit.all_fixed) ++fit.fixed;
  }
  const bool open_end = form.back().ends_with("...");
  fit.whole = fit.all_fixed && (open_end ? words.size() + 1 >= form.size() : words.size() == form.size());
  return fit;
}

FaultKind::ParsedText parse_form(const std::string& text, const FaultKind& kind) {
  const Words words = words_of(text), form = words_of(kind.form);
  FaultKind::ParsedText parsed{text, {}, {}, {}};
  for (std::size_t i = 0; i < form.size(); ++i) {
    if (form[i].ends_with("...")) {
      parsed.rest = fmt::format("{}", fmt::join(words.begin() + static_cast<std::ptrdiff_t>(i), words.end(), " "));
    } else if (form[i] == "NAME") {
      parsed.drone = words[i] == "*" ? "" : words[i];
    } else if (is_open(form[i]) || form[i].find('|') != std::string_view::npos) {
      parsed.words.push_back(words[i]);
    }
  }
  return parsed;
}

/// That a fault may begin with.
std::vector<std::string> first_words(bool real) {
  std::vector<std::string> first;
  for (const FaultKind* kind : fault_kinds()) {
    if (kind->real_only && !real) continue;
    for (const std::string_view word : split(words_of(kind->form)[0], '|')) {
      if (std::ranges::find(first, word) == first.end()) first.emplace_back(word);
    }
  }
  return first;
}

}  // namespace

std::vector<const FaultKind*> fault_kinds() {
  std::vector<const FaultKind*> all;
  for (const auto& table : {drone_faults(), sensing_faults(), ledger_faults(), process_faults(), machine_faults()}) {
    for (const FaultKind& kind : table) all.push_back(&kind);
  }
  return all;
}

Result<const FaultKind*> kind_of(std::string_view text, bool real) {
  const Words words = words_of(text);
  std::pair<bool, std::size_t>
      best;  // of all kinds: all its fixed words are there; how many of them, from the beginning
  std::vector<const FaultKind*> nearest;
  for (const FaultKind* kind : fault_kinds()) {
    const Fit fit = fit_of(words, words_of(kind->form));
    const std::pair rank{fit.all_fixed, fit.fixed};
    if (fit.fixed == 0 || rank < best) continue;
    if (rank > best) nearest.clear();
    best = rank;
    nearest.push_back(kind);
  }
  if (nearest.empty()) {
    const std::vector<std::string> first = first_words(real);
    return wrong(text, fmt::format("must begin with {}{}", fmt::join(first, ", "),
                                   words.empty() ? "" : did_you_mean(": ", std::string(words[0]), first)));
  }
  if (!real && nearest.front()->real_only)
    return wrong(text, fmt::format("{} is not there in simulated time: such a fault needs the real processes (--real)",
                                   words[0]));
  std::string forms;
  for (const FaultKind* kind : nearest) {
    if (fit_of(words, words_of(kind->form)).whole) return kind;
    forms += fmt::format("{}`{}`", forms.empty() ? "" : ", ", kind->form);
  }
  return wrong(text, "must be " + forms);
}

Result<TimeNs> parse_fault_time(std::string_view duration) {
  const auto time = parse_time(duration);
  if (time && *time <= 0)
    return wrong(duration, "a fault lasts longer than nothing; leave `for` out for one to the end");
  return time;
}

Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real) {
  Fault fault;
  fault.text = fmt::format("{}", fmt::join(words_of(text), " "));
  if (fault.text.empty()) return Error{"a fault must say where and what, as in \"drone tello1 to delay 200ms\""};
  const auto kind = kind_of(fault.text, real);
  if (!kind) return kind.error();
  const FaultKind::ParsedText parsed = parse_form(fault.text, **kind);
  auto acts = (*kind)->make(parsed);
  if (!acts) return wrong(fault.text, acts.error().message);
  fault.drone = parsed.drone;
  fault.acts = std::move(*acts);
  if (!at.empty()) {
    auto trigger = parse_trigger(at);
    if (!trigger) return trigger.error();
    fault.trigger = *trigger;
    fault.at = at;
  }
  if (!duration.empty()) {
    const auto time = parse_fault_time(duration);
    if (!time) return time.error();
    if (fault.acts.momentary) return wrong(fault.text, "happens at one moment: leave `for` out");
    fault.for_ns = *time;
  }
  return fault;
}

std::string never_text(const Fault& fault) { return fmt::format("\"{}\" at {} never began", fault.text, fault.at); }

}  // namespace ledgerline::hil
