#include "hil/fault/judge/judge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/enum_count.hpp"
#include "common/msg/names.hpp"
#include "hil/lines/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Kind = Rule::Kind;
using Words = std::vector<std::string_view>;

namespace invariants {
enum Which : std::uint8_t {
  too_fast,
  too_high,
  too_far,
  unseen,
  silent,
  hovers,
  rc_range,
  ramps,
  order,
  old_plans,
  in_the_air,
  hangs,
  missing,
  lost,
  unasked,
  count
};
}  // namespace invariants
constexpr auto invariant_names = std::to_array<std::string_view>({
    "always: never faster than the limits",
    "always: never higher than the limits",
    "always: never farther than the limits",
    "always: who is not seen is stopped and landed",
    "always: a hold or a landing after silence",
    "always: a hold ends in a landing",
    "always: rc in the SDK's range",
    "always: told speed ramps",
    "always: commands in order, each once",
    "always: a brake takes its plans with it",
    "always: on the ground in the end",
    "always: no hang",
    "always: every fault began",
    "always: nothing acknowledged is lost",
    "always: nothing is flown that nobody signed",
});
static_assert(invariant_names.size() == invariants::count);

std::string with_spaces(std::string_view name) {
  std::string text(name);
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
}

std::optional<FailsafeMode> mode_of(std::string_view word) {
  for (const auto& [text, mode] : {std::pair("hold", FailsafeMode::hold), std::pair("holds", FailsafeMode::hold),
                                   std::pair("brake", FailsafeMode::brake), std::pair("brakes", FailsafeMode::brake),
                                   std::pair("land", FailsafeMode::land), std::pair("cut", FailsafeMode::cut)}) {
    if (word == text) return mode;
  }
  return std::nullopt;
}

std::optional<FailsafeCause> cause_of(std::string_view text) {
  for (std::size_t i = 1; i < enum_count<FailsafeCause>; ++i) {
    const auto cause = static_cast<FailsafeCause>(i);
    if (with_spaces(name(cause)) == text) return cause;
  }
  return std::nullopt;
}

// Of a rule's amount, to the nanosecond.
bool longer(TimeNs duration, double seconds) { return duration > std::llround(seconds * 1e9); }

std::string joined(const Words& words, std::size_t from, std::size_t to) {
  std::string text;
  for (std::size_t i = from; i < to; ++i) text += (text.empty() ? "" : " ") + std::string(words[i]);
  return text;
}

// "is seen", "is never seen" at the end; how many words are before it.
std::optional<std::pair<std::size_t, bool>> seen_at(const Words& words) {
  const std::size_t n = words.size();
  if (n >= 3 && words[n - 1] == "seen" && words[n - 2] == "is") return std::pair(n - 2, false);
  if (n >= 4 && words[n - 1] == "seen" && words[n - 2] == "never" && words[n - 3] == "is")
    return std::pair(n - 3, true);
  return std::nullopt;
}

Moment::Excuse excuse_of(const Moment& moment, std::size_t drone) {
  return moment.excuses.empty() ? Moment::Excuse{} : moment.excuses[drone];
}

bool is_named(const Moment& moment, std::size_t drone) {
  const auto& named = moment.first_fault_drones;
  return named.empty() || std::find(named.begin(), named.end(), drone) != named.end();
}

}  // namespace

std::optional<Amount> parse_amount(std::string_view text) {
  text = trimmed(text);
  const std::size_t end = text.find_first_not_of("0123456789.");
  if (end == 0 || end == std::string_view::npos) return std::nullopt;
  const auto value = parse_number(text.substr(0, end));
  const std::string_view unit = trimmed(text.substr(end));
  if (!value) return std::nullopt;
  if (unit == "ms") return Amount{*value / 1000, Amount::Unit::time};
  if (unit == "s") return Amount{*value, Amount::Unit::time};
  if (unit == "m") return Amount{*value, Amount::Unit::metres};
  if (unit == "m/s") return Amount{*value, Amount::Unit::speed};
  return std::nullopt;
}

std::string rule_help() {
  return "  finishes                                 every drone flew its path and landed\n"
         "  recovers and finishes the lap            and flew its plan again after the last fault's end\n"
         "  hold within 300 ms after the plan's end\n"
         "  holds|brakes|lands within 2 s            of the first fault's beginning; lands: it is on the ground\n"
         "  resumes within 2 s                       of the last fault's end: the plan is flown again\n"
         "  MODE is seen, MODE is never seen         hold, brake, land, cut\n"
         "  CAUSE is seen, CAUSE is never seen       plan ran out, agent silent, ledger silent, state stale, pose lost "
         "...\n"
         "  no command older than 500 ms applied\n"
         "  height below 3 m\n"
         "  speed below 1.5 m/s\n"
         "  path within 0.4 m                        of the true place from the path\n"
         "  pose within 0.2 m                        of what link believes from the truth, in flight\n"
         "  fence kept within 0.2 m                  the true place is nowhere farther beyond it\n"
         "  nothing acknowledged is lost\n"
         "  at most 70 transactions a second         on the ledger, on average\n"
         "  ends within 60 s\n"
         "  sends emergency, sends no emergency      command, takeoff, land\n"
         "  no crash                                 no drone turns over, and no process ends but by a fault\n";
}

Result<Rule> parse_rule(std::string_view sentence) {
  Rule rule;
  rule.text = trimmed(sentence);
  const Words words = words_of(rule.text);
  const auto is = [&](std::string_view begin) { return rule.text.starts_with(begin); };
  const auto amount_behind = [&](std::string_view begin, Amount::Unit unit) -> bool {
    if (!is(begin)) return false;
    const auto amount = parse_amount(std::string_view(rule.text).substr(begin.size()));
    if (!amount || amount->unit != unit) return false;
    rule.amount = amount->value;
    return true;
  };
  const auto found = [&](Kind kind) {
    rule.kind = kind;
    return rule;
  };
  using Unit = Amount::Unit;
  if (rule.text == "finishes") return found(Kind::finishes);
  if (rule.text == "recovers and finishes the lap") return found(Kind::recovers);
  if (rule.text == "nothing acknowledged is lost") return found(Kind::nothing_lost);
  if (rule.text == "no crash") return found(Kind::no_crash);
  constexpr std::string_view after_plan = " after the plan's end";
  if (is("hold within ") && rule.text.ends_with(after_plan)) {
    const auto amount = parse_amount(std::string_view(rule.text).substr(12, rule.text.size() - 12 - after_plan.size()));
    if (amount && amount->unit == Unit::time) {
      rule.amount = amount->value;
      return found(Kind::hold_after_plan);
    }
  }
  constexpr std::string_view applied = " applied";
  if (is("no command older than ") && rule.text.ends_with(applied)) {
    const auto amount = parse_amount(std::string_view(rule.text).substr(22, rule.text.size() - 22 - applied.size()));
    if (amount && amount->unit == Unit::time) {
      rule.amount = amount->value;
      return found(Kind::command_age);
    }
  }
  constexpr std::string_view per_second = " transactions a second";
  if (is("at most ") && rule.text.ends_with(per_second)) {
    if (const auto rate = parse_number(rule.text.substr(8, rule.text.size() - 8 - per_second.size()))) {
      rule.amount = *rate;
      return found(Kind::transactions);
    }
  }
  if (amount_behind("height below ", Unit::metres)) return found(Kind::height);
  if (amount_behind("speed below ", Unit::speed)) return found(Kind::speed);
  if (amount_behind("path within ", Unit::metres)) return found(Kind::path);
  if (amount_behind("pose within ", Unit::metres)) return found(Kind::estimate);
  if (amount_behind("fence kept within ", Unit::metres)) return found(Kind::fence);
  if (amount_behind("ends within ", Unit::time)) return found(Kind::ends);
  if (amount_behind("lands within ", Unit::time)) return found(Kind::lands);
  if (amount_behind("resumes within ", Unit::time)) return found(Kind::resumes);
  if (amount_behind("holds within ", Unit::time) || amount_behind("brakes within ", Unit::time)) {
    rule.mode = mode_of(words[0]);
    return found(Kind::reacts);
  }
  if (words.size() >= 2 && words[0] == "sends") {
    rule.negated = words.size() == 3 && words[1] == "no";
    constexpr std::array<std::string_view, 4> commands{"command", "takeoff", "land", "emergency"};
    const bool known = std::find(commands.begin(), commands.end(), words.back()) != commands.end();
    if (known && (rule.negated || words.size() == 2)) {
      rule.command = words.back();
      return found(Kind::sent);
    }
  }
  if (const auto seen = seen_at(words)) {
    const std::string what = joined(words, 0, seen->first);
    if (seen->first == 1) rule.mode = mode_of(what);
    rule.cause = cause_of(what);
    if (rule.mode || rule.cause) return found(seen->second ? Kind::never_seen : Kind::seen);
  }
  return Error{fmt::format("\"{}\" is no rule; there are\n{}", rule.text, rule_help())};
}

Judge::Judge(const std::vector<Rule>& rules, const Limits& limits) : limits_(limits), rules_(rules.size()) {
  for (const Rule& rule : rules) states_.push_back({{rule, true, 0, {}}, false, false, {}});
  for (const std::string_view text : invariant_names) {
    Rule rule;
    rule.text = text;
    rule.always = true;
    states_.push_back({{rule, true, 0, {}}, false, false, {}});
  }
}

void Judge::broke(State& state, TimeNs now, std::string what) {
  if (!state.verdict.held) return;
  state.verdict.held = false;
  state.verdict.broken_ns = now;
  state.verdict.what = std::move(what);
}

void Judge::look(const Moment& moment) {
  drones_.resize(moment.drones.size());
  for (std::size_t i = 0; i < rules_; ++i) look_at(moment, states_[i]);
  for (std::size_t i = 0; i < moment.drones.size(); ++i) look_after(moment, i);
  for (const WorldEvent& event : moment.events) {
    if (event.kind == WorldEvent::Kind::unasked)
      broke(invariant(invariants::unasked), moment.now,
            fmt::format("{}: {}", moment.drones[event.drone].name, event.text));
    if (event.kind == WorldEvent::Kind::bad_rc) broke(invariant(invariants::rc_range), moment.now, event.text);
  }
  look_at_order(moment);
}

void Judge::look_at_order(const Moment& moment) {
  for (const WorldEvent& event : moment.events) {
    if (event.kind == WorldEvent::Kind::started) {  // it knows of nothing before
      for (Drone& drone : drones_) {
        if (event.text == "agent") drone.handed = 0;
        if (event.text == "link") drone.applied = 0;
      }
    }
    const bool handed = event.kind == WorldEvent::Kind::handed;
    const DroneFacts& facts = moment.drones[event.drone];
    // Else it may be a stop, whose sequence is nobody's.
    const bool applied = event.kind == WorldEvent::Kind::applied && facts.phase == FlightPhase::flying &&
                         facts.mode < FailsafeMode::land;
    if ((!handed && !applied) || event.sequence == 0) continue;
    std::uint64_t& newest = handed ? drones_[event.drone].handed : drones_[event.drone].applied;
    if (event.sequence <= newest)
      broke(invariant(invariants::order), moment.now,
            fmt::format("{}: {} {} after {}", facts.name, handed ? "agent hands on" : "link flies", event.sequence,
                        newest));
    newest = event.sequence;
  }
}

void Judge::look_at_ramp(const Moment& moment, std::size_t index, bool rested) {
  const DroneFacts& facts = moment.drones[index];
  Drone& drone = drones_[index];
  const double changed =
      std::hypot(facts.told[0] - drone.told[0], facts.told[1] - drone.told[1], facts.told[2] - drone.told[2]);
  const double limit = limits_.told_mps2 * (facts.mode == FailsafeMode::brake ? 2 : 1);
  drone.may_change_mps =
      std::min(told_at_once_mps, drone.may_change_mps + limit * to_seconds(moment.now - drone.looked_ns));
  drone.looked_ns = moment.now;
  drone.told = facts.told;
  if (!rested) return;
  drone.may_change_mps -= changed;
  if (drone.may_change_mps < 0)
    broke(invariant(invariants::ramps), moment.now,
          fmt::format("{}: told {:.2f} m/s more or less at once", facts.name, changed));
}

void Judge::look_at_brake(const Moment& moment, std::size_t index, bool flies) {
  const DroneFacts& facts = moment.drones[index];
  Drone& drone = drones_[index];
  if (facts.mode == FailsafeMode::brake || !flies) {
    drone.braked = flies;
    drone.plans_at_brake = facts.plans_given;
  }
  if (drone.braked && facts.plans_given == drone.plans_at_brake && facts.mode == FailsafeMode::none &&
      facts.told_mps > 0)
    broke(invariant(invariants::old_plans), moment.now,
          fmt::format("{}: told {:.2f} m/s after its brake, and no plan came", facts.name, facts.told_mps));
}

// Speed, height, place.
void Judge::look_at_limits(const Moment& moment, std::size_t index) {
  const DroneFacts& facts = moment.drones[index];
  Drone& drone = drones_[index];
  const auto& at = facts.truth.position_m;
  const auto& v = facts.truth.velocity_mps;
  const Moment::Excuse excuse = excuse_of(moment, index);
  if (excuse.physical || !facts.truth.in_flight || facts.truth.crashed) return;
  if (const double speed = std::hypot(v[0], v[1], v[2]); speed > limits_.speed_mps)
    broke(invariant(invariants::too_fast), moment.now, fmt::format("{}: {:.2f} m/s", facts.name, speed));
  const double high = std::max(0.0, at[2] - limits_.height_m);
  double far = 0;
  for (std::size_t i = 0; i < 2; ++i) far = std::max({far, limits_.min_m[i] - at[i], at[i] - limits_.max_m[i]});
  if (excuse.deaf) {
    drone.high_m = high;
    drone.far_m = far;
    return;
  }
  const auto beyond = [](double now, double before) { return now > (before > 0 ? before + farther_m : 0); };
  if (beyond(high, drone.high_m))
    broke(invariant(invariants::too_high), moment.now, fmt::format("{}: {:.2f} m", facts.name, at[2]));
  if (beyond(far, drone.far_m))
    broke(invariant(invariants::too_far), moment.now, fmt::format("{}: at {:.2f}, {:.2f} m", facts.name, at[0], at[1]));
}

void Judge::look_at_unseen(const Moment& moment, std::size_t index) {
  const DroneFacts& facts = moment.drones[index];
  Drone& drone = drones_[index];
  const Moment::Excuse excuse = excuse_of(moment, index);
  const bool unseen = moment.link_runs && facts.phase == FlightPhase::disconnected && facts.truth.in_flight;
  if (!unseen || excuse.deaf || excuse.physical) {
    drone.unseen_since_ns = 0;
    return;
  }
  if (drone.unseen_since_ns == 0) drone.unseen_since_ns = moment.now;
  const TimeNs since = moment.now - drone.unseen_since_ns;
  const double speed = std::hypot(facts.truth.velocity_mps[0], facts.truth.velocity_mps[1]);
  if (since > unseen_stops_ns && speed > unseen_mps)
    broke(invariant(invariants::unseen), moment.now, fmt::format("{}: {:.2f} m/s, unseen", facts.name, speed));
  if (since > unseen_down_ns)
    broke(invariant(invariants::unseen), moment.now,
          fmt::format("{}: unseen and in the air for {:.0f} s", facts.name, to_seconds(since)));
}

// The invariants.
void Judge::look_after(const Moment& moment, std::size_t index) {
  const DroneFacts& facts = moment.drones[index];
  Drone& drone = drones_[index];
  const TimeNs now = moment.now;
  drone.flew = drone.flew || (facts.truth.in_flight && facts.truth.position_m[2] > on_ground_m);
  look_at_limits(moment, index);
  look_at_unseen(moment, index);

  const bool flies = moment.link_runs && facts.phase == FlightPhase::flying;
  if (!flies) {
    drone.rested_since_ns = 0;
  } else if (drone.rested_since_ns == 0) {
    drone.rested_since_ns = now;
  }
  // A link that stood still says nothing for a second, so that the drone may land itself: see LinkSettings.
  const bool rested = flies && now - drone.rested_since_ns > 1'500 * ns_per_ms;
  look_at_ramp(moment, index, rested);
  look_at_brake(moment, index, flies);
  if (flies) {
    const TimeNs silent_since = std::max(facts.plan_end_ns, drone.rested_since_ns);
    const TimeNs silent_for = now - silent_since;
    if (rested && silent_for > hold_within_ns && facts.mode == FailsafeMode::none) {
      broke(invariant(invariants::silent), now,
            fmt::format("{}: {:.0f} ms after its plan's end no hold", facts.name, to_ms(silent_for)));
    }
    if (rested && silent_for > hold_within_ns + ramp_ns && facts.told_mps > 0) {
      broke(invariant(invariants::silent), now,
            fmt::format("{}: told {:.2f} m/s {:.0f} ms after its plan's end", facts.name, facts.told_mps,
                        to_ms(silent_for)));
    }
  }
  const bool hovering = flies && (facts.mode == FailsafeMode::hold || facts.mode == FailsafeMode::brake);
  if (!hovering) {
    drone.hovering_since_ns = 0;
  } else if (drone.hovering_since_ns == 0) {
    drone.hovering_since_ns = now;
  } else if (now - drone.hovering_since_ns > land_after_ns) {
    broke(invariant(invariants::hovers), now,
          fmt::format("{} hovers for {:.1f} s", facts.name, to_seconds(now - drone.hovering_since_ns)));
  }
}

void Judge::look_at(const Moment& moment, State& state) {
  const Rule& rule = state.verdict.rule;
  state.waits = false;
  const TimeNs now = moment.now;
  state.done.resize(moment.drones.size());
  switch (rule.kind) {
    case Kind::sent:
    case Kind::command_age:
      for (const WorldEvent& event : moment.events) {
        if (rule.kind == Kind::sent && event.kind == WorldEvent::Kind::sent && event.text == rule.command) {
          state.seen = true;
          if (rule.negated) broke(state, now, moment.drones[event.drone].name + " was sent it");
        }
        if (rule.kind == Kind::command_age && event.kind == WorldEvent::Kind::applied && event.value > rule.amount)
          broke(state, now, fmt::format("{}: {:.0f} ms", moment.drones[event.drone].name, 1000 * event.value));
      }
      return;
    default:
      break;
  }
  for (std::size_t i = 0; i < moment.drones.size(); ++i) {
    const DroneFacts& facts = moment.drones[i];
    const auto& at = facts.truth.position_m;
    const auto& v = facts.truth.velocity_mps;
    switch (rule.kind) {
      case Kind::height:
        if (at[2] >= rule.amount) broke(state, now, fmt::format("{}: {:.2f} m", facts.name, at[2]));
        break;
      case Kind::speed:
        if (const double speed = std::hypot(v[0], v[1], v[2]); speed >= rule.amount)
          broke(state, now, fmt::format("{}: {:.2f} m/s", facts.name, speed));
        break;
      case Kind::path:
        if (facts.off_path_m.value_or(0) > rule.amount)
          broke(state, now, fmt::format("{}: {:.2f} m", facts.name, *facts.off_path_m));
        break;
      case Kind::estimate:
        if (facts.pose && facts.phase == FlightPhase::flying) {
          const auto& p = facts.pose->position_m;
          const double off = std::hypot(p[0] - at[0], p[1] - at[1], p[2] - at[2]);
          if (off > rule.amount) broke(state, now, fmt::format("{}: {:.2f} m off", facts.name, off));
        }
        break;
      case Kind::fence:
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const double beyond = std::max(limits_.fence_min_m[axis] - at[axis], at[axis] - limits_.fence_max_m[axis]);
          if (beyond > rule.amount) broke(state, now, fmt::format("{}: {:.2f} m beyond it", facts.name, beyond));
        }
        break;
      case Kind::no_crash:
        if (facts.truth.crashed) broke(state, now, facts.name + " turned over");
        break;
      case Kind::hold_after_plan:
        if (moment.link_runs && facts.phase == FlightPhase::flying && facts.plan_end_ns != 0 &&
            longer(now - facts.plan_end_ns, rule.amount) && facts.mode == FailsafeMode::none)
          broke(state, now,
                fmt::format("{}: {:.0f} ms after its plan's end no hold", facts.name, to_ms(now - facts.plan_end_ns)));
        break;
      case Kind::seen:
      case Kind::never_seen:
        if (!in_flight(facts.phase)) break;
        if ((rule.mode && facts.mode == *rule.mode) || (rule.cause && facts.cause == *rule.cause)) {
          state.seen = true;
          if (rule.kind == Kind::never_seen) broke(state, now, facts.name);
        }
        break;
      case Kind::reacts:
      case Kind::lands:
        if (!moment.first_fault_ns || state.done[i] || !is_named(moment, i)) break;
        if (drones_[i].flew && (rule.kind == Kind::reacts ? facts.mode == *rule.mode : on_ground(facts.truth)))
          state.done[i] = state.seen = true;
        if (!state.done[i] && longer(now - *moment.first_fault_ns, rule.amount))
          broke(state, now, fmt::format("{}: not within {:g} s", facts.name, rule.amount));
        if (!state.done[i]) state.waits = true;
        break;
      case Kind::resumes:
      case Kind::recovers:
        if (!moment.last_fault_end_ns || state.done[i]) break;
        if (facts.mode == FailsafeMode::none && facts.told_ns != 0 && facts.plan_end_ns > now) state.done[i] = true;
        if (rule.kind == Kind::resumes && !state.done[i] && longer(now - *moment.last_fault_end_ns, rule.amount))
          broke(state, now, fmt::format("{}: not within {:g} s", facts.name, rule.amount));
        break;
      default:
        break;
    }
  }
}

std::vector<Verdict> Judge::finish(const Ending& ending) {
  for (std::size_t i = 0; i < rules_; ++i) {
    State& state = states_[i];
    const Rule& rule = state.verdict.rule;
    switch (rule.kind) {
      case Kind::finishes:
      case Kind::recovers:
        if (!ending.ok) broke(state, ending.now, ending.why.empty() ? "not finished" : ending.why);
        if (rule.kind == Kind::recovers && std::find(state.done.begin(), state.done.end(), false) != state.done.end())
          broke(state, ending.now, "its plan was never flown again");
        break;
      case Kind::ends:
        if (longer(ending.now, rule.amount) || !ending.over)
          broke(state, ending.now, fmt::format("{:.1f} s", to_seconds(ending.now)));
        break;
      case Kind::transactions:
        if (const double rate = static_cast<double>(ending.transactions) / to_seconds(ending.now); rate > rule.amount)
          broke(state, ending.now, fmt::format("{:.0f} a second", rate));
        break;
      case Kind::nothing_lost:
        if (!ending.lost.empty()) broke(state, ending.now, ending.lost.front());
        break;
      case Kind::no_crash:
        if (!ending.crashed.empty()) broke(state, ending.now, ending.crashed.front());
        break;
      case Kind::seen:
        if (!state.seen) broke(state, ending.now, "never");
        break;
      case Kind::sent:
        if (!state.seen && !rule.negated) broke(state, ending.now, "never");
        break;
      case Kind::reacts:
      case Kind::lands:
        if (!state.seen || state.waits) broke(state, ending.now, "never");
        break;
      case Kind::resumes:
        if (std::find(state.done.begin(), state.done.end(), false) != state.done.end())
          broke(state, ending.now, "never");
        break;
      default:
        break;
    }
  }
  if (!ending.over) broke(invariant(invariants::hangs), ending.now, ending.why.empty() ? "it goes on" : ending.why);
  if (!ending.missing.empty()) broke(invariant(invariants::missing), ending.now, ending.missing.front());
  if (!ending.lost.empty())
    broke(invariant(invariants::lost), ending.now,
          fmt::format("{}{}", ending.lost.front(),
                      ending.lost.size() > 1 ? fmt::format(" and {} more", ending.lost.size() - 1) : ""));
  for (const std::string& name : ending.in_the_air) broke(invariant(invariants::in_the_air), ending.now, name);
  std::vector<Verdict> verdicts;
  for (const State& state : states_) verdicts.push_back(state.verdict);
  return verdicts;
}

}  // namespace ledgerline::hil
