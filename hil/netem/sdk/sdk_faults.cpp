#include "hil/netem/sdk/sdk_faults.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "common/base/text.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/netem/sdk/calls.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Kind = SdkFault::Kind;

constexpr std::array<std::string_view, sdk_fault_kinds> kind_names{"late",  "wrong",   "garbage", "missing", "twice",
                                                                   "other", "shifted", "torn",    "stale",   "other"};

constexpr std::string_view forms =
    "must be `answers late TIME [SHARE] [to COMMAND]`, `answers wrong|garbage|missing|other|shifted [SHARE] [to "
    "COMMAND]`, `answers twice [TIME] [SHARE] [to COMMAND]` or `states torn|stale|other [SHARE]`, with a TIME such as "
    "300ms, a SHARE such as 30% and a COMMAND of the SDK, or * for every one";

Error wrong(std::string_view text, std::string_view why) {
  return Error{fmt::format("\"{}\": {}", printable(text, 100), why)};
}

Result<std::string> command_in(std::string_view word) {
  if (word == "*") return std::string();
  const auto answered = how_answered(word);
  if (!answered)
    return wrong(word,
                 "is no command of the SDK: takeoff, land, command, emergency, forward, battery? ..., or * for every "
                 "one");
  if (*answered == Answered::never) return wrong(word, "has no answer, so nothing can be wrong with it");
  return std::string(word);
}

}  // namespace

std::string_view name_of(SdkFault::Kind kind) { return kind_names[static_cast<std::size_t>(kind)]; }

Result<SdkFault> parse_sdk_fault(std::string_view text) {
  const auto words = words_of(text);
  if (words.size() < 2 || (words[0] != "answers" && words[0] != "states")) return wrong(text, forms);
  const bool states = words[0] == "states";
  SdkFault fault;
  const auto* const begin = kind_names.begin() + (states ? static_cast<int>(Kind::torn) : 0);
  const auto* const end = states ? kind_names.end() : kind_names.begin() + static_cast<int>(Kind::torn);
  const auto* const named = std::find(begin, end, words[1]);
  if (named == end) return wrong(text, forms);
  fault.kind = static_cast<Kind>(named - kind_names.begin());
  const bool may_have_time = fault.kind == Kind::late || fault.kind == Kind::twice;
  bool time_there = false;
  std::size_t i = 2;
  if (i < words.size() && may_have_time && !words[i].ends_with('%') && words[i] != "to") {
    const auto time = parse_time(words[i]);
    if (!time) return wrong(text, time.error().message);
    fault.time_ns = *time;
    time_there = true;
    ++i;
  }
  if (fault.kind == Kind::late && (!time_there || fault.time_ns == 0))
    return wrong(text, "late must be followed by a TIME of more than nothing, such as 300ms");
  if (i < words.size() && words[i].ends_with('%')) {
    const auto share = parse_share(words[i]);
    if (!share || *share <= 0) return wrong(text, "a SHARE is more than 0% and at most 100%, such as 30%");
    fault.share = *share;
    ++i;
  }
  if (!states && i + 1 < words.size() && words[i] == "to") {
    auto command = command_in(words[i + 1]);
    if (!command) return command.error();
    fault.command = std::move(*command);
    i += 2;
  }
  if (i != words.size()) return wrong(text, forms);
  return fault;
}

std::string text_of(const SdkFault& fault) {
  std::string text = fmt::format("{} {}", of_states(fault.kind) ? "states" : "answers", name_of(fault.kind));
  if (fault.kind == Kind::late || (fault.kind == Kind::twice && fault.time_ns > 0))
    text += " " + time_text(fault.time_ns);
  if (fault.share < 1) text += fmt::format(" {}%", fault.share * 100);
  if (!fault.command.empty()) text += " to " + fault.command;
  return text;
}

namespace {

/// What no Tello answers; some of it is near to an ok.
std::string garbage(Random& random) {
  static constexpr std::array<std::string_view, 7> nonsense{"",        "o", "okay", "ko", "nan", "99999999999999999999",
                                                            "ok;error"};
  constexpr std::size_t max_noise = 24;
  const std::size_t which = random.next() % (nonsense.size() + 1);
  if (which < nonsense.size()) return std::string(nonsense[which]);
  std::string noise(1 + random.next() % max_noise, '\0');
  for (char& c : noise) c = static_cast<char>(random.next());
  return noise;
}

/// A refusal becomes an ok; an ok, and a value, a refusal.
std::string opposite_of(std::string_view answer) { return is_refusal(answer) ? "ok" : "error"; }

/// Inside of a field: neither beside a semicolon nor in the line's end. Nothing: the text has no such place.
std::optional<std::size_t> place_in_field(std::string_view text, Random& random) {
  std::vector<std::size_t> places;
  for (std::size_t i = 1; i < text.size() && text[i] != '\r' && text[i] != '\n'; ++i) {
    if (text[i - 1] != ';' && text[i] != ';') places.push_back(i);
  }
  if (places.empty()) return std::nullopt;
  return places[random.next() % places.size()];
}

/// The end is missing, or of the text before: as of a buffer that was sent while it was written.
std::string torn(const std::string& text, const std::string* before, Random& random) {
  const auto place = place_in_field(text, random);
  if (!place) return text;
  const bool halves = before && *place < before->size() && random.next() % 2 == 0;
  return text.substr(0, *place) + (halves ? before->substr(*place) : std::string());
}

}  // namespace

SdkFaults::SdkFaults(std::uint64_t seed, std::size_t drones) : seed_(seed), drones_(drones) {}

Status SdkFaults::set(std::size_t drone, std::vector<SdkFault> faults) {
  const auto of_another = [](const SdkFault& fault) { return fault.kind == Kind::other_drone; };
  if (drones_.size() < 2 && std::any_of(faults.begin(), faults.end(), of_another))
    return Error{"states of another drone: there is no other one"};
  Drone& d = drones_[drone];
  std::vector<Live> live;
  for (SdkFault& fault : faults) {
    const auto before = std::find_if(d.faults.begin(), d.faults.end(), [&](const Live& known) {
      return known.fault.item == fault.item && known.fault.kind == fault.kind;
    });
    Random seeds(seed_ + drone);
    const Random fresh(seeds.next() + fault.item * sdk_fault_kinds + static_cast<std::size_t>(fault.kind));
    const Random random = before == d.faults.end() ? fresh : before->random;
    live.push_back({std::move(fault), random});
  }
  d.faults = std::move(live);
  const bool shifts =
      std::any_of(d.faults.begin(), d.faults.end(), [](const Live& l) { return l.fault.kind == Kind::shifted; });
  if (d.held && !shifts) add_unit(0, drone, false, *std::exchange(d.held, std::nullopt));
  return done;
}

void SdkFaults::command(TimeNs now, std::size_t drone, std::string_view bytes) {
  Drone& d = drones_[drone];
  if (d.calls.command(now, bytes.substr(0, max_bytes)) && d.held)
    add_unit(now, drone, false, *std::exchange(d.held, std::nullopt));
}

bool SdkFaults::draw_strike(Live& live) {
  if (live.fault.share < 1 && live.random.uniform() >= live.fault.share) return false;
  ++counts_.struck[static_cast<std::size_t>(live.fault.kind)];
  return true;
}

void SdkFaults::answer(TimeNs now, std::size_t drone, std::string_view bytes) {
  ++counts_.answers;
  Drone& d = drones_[drone];
  std::string said(bytes);
  if (said.size() > max_bytes) return add_unit(now, drone, false, std::move(said));
  const auto call = d.calls.match(now, said);
  const std::string before = std::exchange(d.last_answer, said);
  bool missing = false, shifted = false;
  TimeNs due = now;
  std::vector<TimeNs> again;
  for (Live& live : d.faults) {
    const SdkFault& fault = live.fault;
    if (of_states(fault.kind) || (!fault.command.empty() && (!call || call->word != fault.command))) continue;
    if (fault.kind == Kind::other && before.empty()) continue;
    if (!draw_strike(live)) continue;
    if (fault.kind == Kind::late) due += fault.time_ns;
    if (fault.kind == Kind::wrong) said = opposite_of(said);
    if (fault.kind == Kind::garbage) said = garbage(live.random);
    if (fault.kind == Kind::missing) missing = true;
    if (fault.kind == Kind::twice) again.push_back(fault.time_ns);
    if (fault.kind == Kind::other) said = before;
    if (fault.kind == Kind::shifted) shifted = true;
  }
  if (missing) return;
  if (shifted) {
    if (d.held) add_unit(now, drone, false, std::move(*d.held));
    d.held = std::move(said);
    return;
  }
  for (const TimeNs after : again) add_unit(due + after, drone, false, said);
  add_unit(due, drone, false, std::move(said));
}

const std::string* SdkFaults::text_of_another(std::size_t drone, Random& random) const {
  std::vector<const std::string*> texts;
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    if (i != drone && !drones_[i].texts.empty()) texts.push_back(&drones_[i].texts.back());
  }
  return texts.empty() ? nullptr : texts[random.next() % texts.size()];
}

void SdkFaults::state(TimeNs now, std::size_t drone, std::string_view bytes) {
  ++counts_.states;
  Drone& d = drones_[drone];
  const std::string reported(bytes);
  if (reported.size() > max_bytes) return add_unit(now, drone, true, reported);
  std::string said = reported;
  for (Live& live : d.faults) {  // which text
    if (live.fault.kind == Kind::stale && !d.texts.empty() && draw_strike(live))
      said = d.texts[live.random.next() % d.texts.size()];
    if (live.fault.kind != Kind::other_drone) continue;
    if (const std::string* text = text_of_another(drone, live.random); text && draw_strike(live)) said = *text;
  }
  for (Live& live : d.faults) {
    if (live.fault.kind == Kind::torn && draw_strike(live))
      said = torn(said, d.texts.empty() ? nullptr : &d.texts.back(), live.random);
  }
  d.texts.push_back(reported);
  if (d.texts.size() > max_texts) d.texts.pop_front();
  add_unit(now, drone, true, std::move(said));
}

std::optional<SdkFaults::Unit> SdkFaults::pop(TimeNs now) {
  if (units_.empty() || units_.begin()->first.first > now) return std::nullopt;
  auto node = units_.extract(units_.begin());
  --drones_[node.mapped().drone].waiting;
  return std::move(node.mapped());
}

std::optional<TimeNs> SdkFaults::next_due() const {
  if (units_.empty()) return std::nullopt;
  return units_.begin()->first.first;
}

void SdkFaults::add_unit(TimeNs due, std::size_t drone, bool is_state, std::string bytes) {
  if (drones_[drone].waiting >= max_waiting) {
    ++counts_.no_room;
    return;
  }
  ++drones_[drone].waiting;
  units_.emplace(std::pair(due, next_number_++), Unit{drone, is_state, std::move(bytes)});
}

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
    const auto share = parse_share(words.back());
    if (!share || *share <= 0) return wrong;
    fault.share = *share;
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
