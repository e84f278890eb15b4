#include "hil/proxy/switches.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil::proxy {
namespace {

constexpr const auto& way_names = enum_names<Direction>;
constexpr std::string_view allowed =
    "allowed are: drone NAME to|answers|state|video|from|both EFFECTS, server NAME to|from|both EFFECTS, server NAME "
    "cut, sensor NAME FIELD|all stuck|garbage|bias N|says N|every TIME, of the shim sdk NAME answers|states FAULT, "
    "clear, "
    "list";

Error wrong(std::string_view command, std::string_view why) {
  return Error{fmt::format("\"{}\": {}", printable(command, 200), why)};
}

/// Takes the first word off.
std::string_view take_word(std::string_view& text) {
  text = trimmed(text);
  const std::size_t end = std::min(text.find_first_of(" \t\r"), text.size());
  const std::string_view word = text.substr(0, end);
  text = trimmed(text.substr(end));
  return word;
}

std::vector<Direction> ways_of(const Target& target, std::string_view name) {
  std::vector<Direction> found;
  for (std::size_t i = 0; i < ways; ++i) {
    const Direction way{static_cast<int>(i)};
    if (!target.has(way)) continue;
    const bool comes_back = way != Direction::to;
    if (name == way_names[i] || name == "both" || (name == "from" && comes_back)) found.push_back(way);
  }
  return found;
}

std::string kind_name(Target::Kind kind) { return kind == Target::Kind::drone ? "drone" : "server"; }

}  // namespace

std::string_view name_of(Direction way) { return way_names[static_cast<std::size_t>(way)]; }

Switches::Switches(std::vector<Target> targets, ReadRecording read, ReadLinkRecording read_link_recording)
    : targets_(std::move(targets)),
      read_(std::move(read)),
      read_link_recording_(std::move(read_link_recording)),
      sensors_(targets_.size()),
      sdk_(targets_.size()),
      impairments_(targets_.size()),
      cut_(targets_.size(), false) {}

Status Switches::apply(std::string_view command) {
  std::string_view rest = command;
  const std::string_view first = take_word(rest);
  if (rest.empty() && first == "list") return done;
  if (rest.empty() && first == "clear") {
    for (auto& impairments : impairments_) impairments = {};
    for (auto& sensors : sensors_) sensors.clear();
    for (auto& sdk : sdk_) sdk.clear();
    return done;
  }
  if (first != "drone" && first != "server" && first != "sensor" && first != "sdk") return wrong(command, allowed);
  const std::string_view name = take_word(rest);
  if (rest.empty()) return wrong(command, allowed);
  const auto applied = first == "sensor" ? apply_fault(sensors_, name, rest, parse_sensor)
                       : first == "sdk"
                           ? apply_fault(sdk_, name, rest, parse_sdk_fault)
                           : apply_to(first == "drone" ? Target::Kind::drone : Target::Kind::server, name, rest);
  if (!applied) return wrong(command, applied.error().message);
  return done;
}

Result<std::vector<std::size_t>> Switches::named(Target::Kind kind, std::string_view name) const {
  std::vector<std::size_t> meant;
  std::string names;
  for (std::size_t i = 0; i < targets_.size(); ++i) {
    if (targets_[i].kind != kind) continue;
    names += (names.empty() ? "" : ", ") + targets_[i].name;
    const bool begins_so = name.ends_with('*') && targets_[i].name.starts_with(name.substr(0, name.size() - 1));
    if (begins_so || name == targets_[i].name) meant.push_back(i);
  }
  if (meant.empty())
    return Error{
        fmt::format("there is no such {}; there {}", kind_name(kind), names.empty() ? "is none" : "are " + names)};
  return meant;
}

template <typename Fault>
Status Switches::apply_fault(std::vector<std::vector<Switched<Fault>>>& all, std::string_view name,
                             std::string_view rest, Result<Fault> (*parse)(std::string_view)) {
  const auto meant = named(Target::Kind::drone, name);
  if (!meant) return meant.error();
  if (std::is_same_v<Fault, SdkFault> && !targets_[meant->front()].behind_shim)
    return Error{"only the shim knows the SDK's calls (docs/faults.md): allowed here are drone, server and sensor"};
  const bool off = rest.ends_with(" off");
  if (off) rest = trimmed(rest.substr(0, rest.size() - 4));
  auto fault = parse(rest);
  if (!fault) return fault.error();
  if constexpr (std::is_same_v<Fault, SdkFault>) {
    if (fault->kind == SdkFault::Kind::other_drone && targets_.size() < 2)
      return Error{"there is no other drone whose state text it could be"};
  }
  const std::string text = fmt::format("{}", fmt::join(words_of(rest), " "));
  auto changed = all;
  for (const std::size_t i : *meant) {
    auto& faults = changed[i];
    if (off) {
      const auto last = std::find_if(faults.rbegin(), faults.rend(), [&](const auto& one) { return one.text == text; });
      if (last != faults.rend()) faults.erase(std::next(last).base());
      continue;
    }
    if (faults.size() == max_faults)
      return Error{fmt::format("{} has {} such faults already, which are the most", targets_[i].name, max_faults)};
    fault->item = ++items_;
    faults.push_back({text, *fault});
  }
  all = std::move(changed);
  return done;
}

Status Switches::apply_to(Target::Kind kind, std::string_view name, std::string_view rest) {
  const auto meant = named(kind, name);
  if (!meant) return meant.error();
  const std::string_view way = take_word(rest);
  if (way == "cut" && rest.empty()) {
    if (kind == Target::Kind::drone) return Error{"a drone has no connection that could be cut: allowed is partition"};
    for (const std::size_t i : *meant) cut_[i] = true;
    return done;
  }
  const auto meant_ways = ways_of(targets_[meant->front()], way);
  if (meant_ways.empty())
    return Error{fmt::format("a {} has {}", kind_name(kind),
                             kind == Target::Kind::drone
                                 ? (targets_[meant->front()].behind_shim
                                        ? "to, answers, state, from (all that comes from it) and both; no video, which "
                                          "is not simulated"
                                        : "to, answers, state, video, from (all that comes from it) and both")
                                 : "to, from, both and cut")};
  auto changed = impairments_;
  for (const std::size_t i : *meant) {
    for (const Direction one : meant_ways) {
      Impairment& impairment = changed[i][static_cast<std::size_t>(one)];
      if (auto applied = apply_effects(rest, impairment, read_, read_link_recording_); !applied) return applied;
      if (kind == Target::Kind::drone) continue;
      if (auto possible = check_for_stream(impairment); !possible) return possible;
    }
  }
  impairments_ = std::move(changed);
  return done;
}

bool Switches::pop_cut(std::size_t target) {
  const bool cut = cut_[target];
  cut_[target] = false;
  return cut;
}

std::string Switches::list() const {
  std::string lines;
  for (std::size_t i = 0; i < targets_.size(); ++i) {
    for (std::size_t k = 0; k < ways; ++k) {
      const Impairment& impairment = impairments_[i][k];
      if (!impairment.any()) continue;
      lines += fmt::format("{} {} {} {}\n", kind_name(targets_[i].kind), targets_[i].name, way_names[k],
                           text_of(impairment));
    }
  }
  for (std::size_t i = 0; i < targets_.size(); ++i) {
    for (const auto& sensor : sensors_[i]) lines += fmt::format("sensor {} {}\n", targets_[i].name, sensor.text);
    for (const auto& sdk : sdk_[i]) lines += fmt::format("sdk {} {}\n", targets_[i].name, sdk.text);
  }
  return lines;
}

Result<std::string> opposite(std::string_view command) {
  std::string_view rest = command;
  const std::string_view kind = take_word(rest);
  if ((kind == "sensor" || kind == "sdk") && !trimmed(command).ends_with(" off"))
    return fmt::format("{} off", trimmed(command));
  const std::string_view name = take_word(rest), way = take_word(rest);
  const bool effects = !rest.empty() && (kind == "drone" || kind == "server");
  std::string off;
  while (effects && !rest.empty()) {
    const std::size_t comma = std::min(rest.find(','), rest.size());
    std::string_view effect = rest.substr(0, comma);
    rest.remove_prefix(std::min(comma + 1, rest.size()));
    const std::string_view what = take_word(effect);
    if (what == "clear" || effect == "off") return wrong(command, "only what is switched on lasts for a time");
    off += fmt::format("{}{} off", off.empty() ? "" : ", ", what);
  }
  if (off.empty()) return wrong(command, "only effects last for a time");
  return fmt::format("{} {} {} {}", kind, name, way, off);
}

Result<CommandSchedule> CommandSchedule::make(const std::vector<ScheduledFault>& faults, Switches switches,
                                              std::size_t* which) {
  CommandSchedule schedule;
  for (std::size_t i = 0; i < faults.size(); ++i) {
    const ScheduledFault& fault = faults[i];
    schedule.commands_.push_back({fault.at_ns, true, fault.for_ns.has_value(), i, fault.command});
    if (!fault.for_ns) continue;
    auto off = opposite(fault.command);
    if (!off) return off.error();
    schedule.commands_.push_back({fault.at_ns + *fault.for_ns, false, false, i, std::move(*off)});
  }
  std::stable_sort(schedule.commands_.begin(), schedule.commands_.end(), [](const Command& a, const Command& b) {
    return std::pair(a.at_ns, a.on) < std::pair(b.at_ns, b.on);  // what ends makes room for what begins then
  });
  // All of it in order; of each direction those of its effects that will end by themselves.
  const Switches none = switches;
  std::vector<unsigned> timed(switches.targets().size() * ways);
  for (const Command& command : schedule.commands_) {
    if (which) *which = command.fault;
    Switches alone = none;
    if (auto possible = alone.apply(command.text); !possible) return possible.error();
    for (std::size_t i = 0; i < timed.size(); ++i) {
      const std::size_t target = i / ways;
      const Direction way{static_cast<int>(i % ways)};
      const unsigned wanted = command.on ? kinds_in(alone.of(target, way)) : 0;
      if ((wanted & (command.lasts ? kinds_in(switches.of(target, way)) : timed[i])) != 0)
        return wrong(command.text, fmt::format("{} {} has such an effect then, and the end of one would end both: let "
                                               "them follow each other",
                                               switches.targets()[target].name, name_of(way)));
      if (command.lasts) timed[i] |= wanted;
    }
    if (auto possible = switches.apply(command.text); !possible) return possible.error();
    for (std::size_t i = 0; i < timed.size(); ++i)
      timed[i] &= kinds_in(switches.of(i / ways, Direction{static_cast<int>(i % ways)}));
  }
  return schedule;
}

std::optional<std::string> CommandSchedule::pop(TimeNs since_start) {
  if (done_ == commands_.size() || commands_[done_].at_ns > since_start) return std::nullopt;
  return commands_[done_++].text;
}

std::optional<TimeNs> CommandSchedule::next() const {
  if (done_ == commands_.size()) return std::nullopt;
  return commands_[done_].at_ns;
}

void SwitchedCommands::add(TimeNs at_ns, std::string command) {
  constexpr std::size_t max_named = 10'000;
  if (named_.size() < max_named)
    named_.emplace_back(at_ns, std::move(command));
  else
    ++unnamed_;
}

void SwitchedCommands::report_to(nlohmann::json& summary) const {
  auto& switched = summary["switched"] = nlohmann::json::array();
  for (const auto& [at_ns, command] : named_) switched.push_back({{"t_ns", at_ns}, {"command", command}});
  summary["switched_unnamed"] = unnamed_;
}

}  // namespace ledgerline::hil::proxy
