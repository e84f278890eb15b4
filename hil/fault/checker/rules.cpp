// The table of rules: each row a sentence, what it takes, and who checks it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/msg/names.hpp"
#include "hil/fault/checker/rule.hpp"

namespace ledgerline::hil {
namespace {

using Takes = RuleKind::Takes;

// To the nanosecond.
bool longer(TimeNs duration, double seconds) { return duration > std::llround(seconds * 1e9); }

const DroneObservation& of(const Sight& sight, std::size_t drone) { return sight.moment.drones[drone]; }

bool has_landed(const Sight& sight, std::size_t drone) {
  return sight.flew[drone] && on_ground(of(sight, drone).truth);
}

void finishes(RuleState& state, const Ending& ending) {
  if (!ending.ok) state.verdict.broke(ending.now, ending.why.empty() ? "not finished" : ending.why);
}

void recovers(RuleState& state, const Ending& ending) {
  finishes(state, ending);
  if (!state.all_done()) state.verdict.broke(ending.now, "its plan was never flown again");
}

/// Behind what was not done in time: what the time counts from, and whether the drone could do it no more.
std::string counted_from(std::string_view what, TimeNs from_ns, bool landed) {
  return fmt::format(", counted from {} at {:.3f} s{}", what, to_seconds(from_ns),
                     landed ? "; it had landed by then" : "");
}

void never(RuleState& state, const Ending& ending) { state.verdict.broke(ending.now, "never"); }

void flies_again(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  if (sight.moment.last_fault_end_ns && observation.mode == FailsafeMode::none && observation.sent_ns != 0 &&
      observation.plan_end_ns > sight.moment.now)
    state.done[drone] = true;
}

void resumes(RuleState& state, const Sight& sight, std::size_t drone) {
  flies_again(state, sight, drone);
  const auto& from = state.from_ns = sight.moment.last_fault_end_ns;
  if (!from || state.done[drone]) return;
  const bool landed = has_landed(sight, drone);
  state.counts[drone] = landed ? 1 : 0;
  if (longer(sight.moment.now - *from, state.verdict.rule.amount))
    state.verdict.broke(sight.moment.now,
                        fmt::format("{}: not within {:g} s{}", of(sight, drone).name, state.verdict.rule.amount,
                                    counted_from("the last fault's end", *from, landed)));
}

// A run may end before the time is up.
void resumed(RuleState& state, const Ending& ending) {
  const auto waiting = std::ranges::find(state.done, false);
  if (waiting == state.done.end()) return;
  if (!state.from_ns) return state.verdict.broke(ending.now, "never: the faults had not ended");
  const auto drone = static_cast<std::size_t>(waiting - state.done.begin());
  state.verdict.broke(ending.now,
                      fmt::format("tello{}: never{}", drone + 1,
                                  counted_from("the last fault's end", *state.from_ns, state.counts[drone] > 0)));
}

constexpr std::string_view first_beginning = "the first fault's beginning";

bool is_named(const Moment& moment, std::size_t drone) {
  const auto& named = moment.first_fault_drones;
  return named.empty() || std::find(named.begin(), named.end(), drone) != named.end();
}

// `does`: what it has to do within the time.
void within(RuleState& state, const Sight& sight, std::size_t drone, bool does) {
  const Moment& moment = sight.moment;
  if (!moment.first_fault_ns || state.done[drone] || !is_named(moment, drone)) return;
  if (sight.flew[drone] && does) state.done[drone] = state.seen = true;
  if (state.done[drone]) return;
  state.waits = true;
  state.from_ns = moment.first_fault_ns;
  if (longer(moment.now - *moment.first_fault_ns, state.verdict.rule.amount))
    state.verdict.broke(moment.now,
                        fmt::format("{}: not within {:g} s{}", of(sight, drone).name, state.verdict.rule.amount,
                                    counted_from(first_beginning, *moment.first_fault_ns, has_landed(sight, drone))));
}

template <FailsafeMode mode>
void reacts(RuleState& state, const Sight& sight, std::size_t drone) {
  within(state, sight, drone, of(sight, drone).mode == mode);
}

void lands(RuleState& state, const Sight& sight, std::size_t drone) {
  within(state, sight, drone, on_ground(of(sight, drone).truth));
}

void was_done_by_all(RuleState& state, const Ending& ending) {
  if (state.seen && !state.waits) return;
  state.verdict.broke(ending.now, state.from_ns ? "never" + counted_from(first_beginning, *state.from_ns, false)
                                                : "never: no fault had begun");
}

void hold_after_plan(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  const TimeNs since = sight.moment.now - observation.plan_end_ns;
  if (sight.moment.link_runs && observation.phase == LinkPhase::flying && observation.plan_end_ns != 0 &&
      longer(since, state.verdict.rule.amount) && observation.mode == FailsafeMode::none)
    state.verdict.broke(sight.moment.now,
                        fmt::format("{}: {:.0f} ms after its plan's end no hold", observation.name, to_ms(since)));
}

bool shows(const Rule& rule, const DroneObservation& observation) {
  return is_in_flight(observation.phase) &&
         ((rule.mode && observation.mode == *rule.mode) || (rule.cause && observation.cause == *rule.cause));
}

void is_seen(RuleState& state, const Sight& sight, std::size_t drone) {
  state.seen = state.seen || shows(state.verdict.rule, of(sight, drone));
}

void is_never_seen(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  if (shows(state.verdict.rule, observation)) state.verdict.broke(sight.moment.now, observation.name);
}

void was_seen(RuleState& state, const Ending& ending) {
  if (!state.seen) never(state, ending);
}

void command_age(RuleState& state, const Moment& moment, const WorldEvent& event) {
  if (event.kind == WorldEvent::Kind::applied && event.value > state.verdict.rule.amount)
    state.verdict.broke(moment.now, fmt::format("{}: {:.0f} ms", moment.drones[event.drone].name, 1000 * event.value));
}

bool is_sent(const RuleState& state, const WorldEvent& event) {
  return event.kind == WorldEvent::Kind::sent && event.text == state.verdict.rule.command;
}

void sends(RuleState& state, const Moment&, const WorldEvent& event) {
  state.seen = state.seen || is_sent(state, event);
}

void sends_no(RuleState& state, const Moment& moment, const WorldEvent& event) {
  if (is_sent(state, event)) state.verdict.broke(moment.now, moment.drones[event.drone].name + " was sent it");
}

void untrusted(RuleState& state, const Moment&, const WorldEvent& event) {
  state.seen = state.seen || event.kind == WorldEvent::Kind::untrusted;
}

void always_trusted(RuleState& state, const Moment& moment, const WorldEvent& event) {
  if (event.kind == WorldEvent::Kind::untrusted) state.verdict.broke(moment.now, event.text);
}

/// With three decimals, or as many as tell it from the limit: "path within 0.4 m: 0.400 m" would look held.
std::string beyond(double measured, double limit) {
  constexpr int min_digits = 3, max_digits = 9;
  const auto text = [](double value, int digits) { return fmt::format("{:.{}f}", value, digits); };
  int digits = min_digits;
  while (digits < max_digits && text(measured, digits) == text(limit, digits)) ++digits;
  return text(measured, measured == limit ? min_digits : digits);
}

/// `measured`: of a drone; it is what the broken rule says was seen.
void check_measure(RuleState& state, const Sight& sight, std::size_t drone, double measured, bool breaks,
                   std::string_view unit) {
  if (!breaks) return;
  state.verdict.broke(sight.moment.now, fmt::format("{}: {} {}", of(sight, drone).name,
                                                    beyond(measured, state.verdict.rule.amount), unit));
  const double first = state.excess ? state.excess->first : measured;
  if (!state.excess || measured > state.excess->worst)
    state.excess = RuleState::Excess{first, measured, of(sight, drone).name, unit};
}

void height(RuleState& state, const Sight& sight, std::size_t drone) {
  const double metres = of(sight, drone).truth.position_m[2];
  check_measure(state, sight, drone, metres, metres >= state.verdict.rule.amount, "m");
}

void speed(RuleState& state, const Sight& sight, std::size_t drone) {
  const double mps = length_of(of(sight, drone).truth.velocity_mps);
  check_measure(state, sight, drone, mps, mps >= state.verdict.rule.amount, "m/s");
}

void path(RuleState& state, const Sight& sight, std::size_t drone) {
  const double metres = of(sight, drone).off_path_m.value_or(0);
  check_measure(state, sight, drone, metres, metres > state.verdict.rule.amount, "m");
}

void hovers(RuleState& state, const Sight& sight, std::size_t drone) {
  constexpr TimeNs settles_ns = 2 * ns_per_s;
  const DroneObservation& observation = of(sight, drone);
  RuleState::Hover& hover = state.hovers[drone];
  if (observation.phase != LinkPhase::flying) {
    hover = {};
    return;
  }
  if (!hover.since_ns) hover.since_ns = sight.moment.now;
  if (sight.moment.now - *hover.since_ns < settles_ns) return;
  if (!hover.place_m) hover.place_m = observation.truth.position_m;
  const double off = distance_m(observation.truth.position_m, *hover.place_m);
  check_measure(state, sight, drone, off, off > state.verdict.rule.amount, "m off");
}

// `counts`: corners that it came to in their order, from the one behind the first, laps counted on.
void visits(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  const auto& corners = observation.corners;
  std::size_t& count = state.counts[drone];
  state.done[drone] = corners.empty() || count >= corners.size() * static_cast<std::size_t>(observation.laps);
  if (state.done[drone] || !observation.truth.in_flight) return;
  const auto& next = corners[(count + 1) % corners.size()];
  if (std::hypot(observation.truth.position_m[0] - next[0], observation.truth.position_m[1] - next[1]) <=
      state.verdict.rule.amount)
    ++count;
}

void visited_all(RuleState& state, const Ending& ending) {
  for (std::size_t drone = 0; drone < state.counts.size(); ++drone) {
    if (!state.done[drone])
      state.verdict.broke(ending.now,
                          fmt::format("tello{}: {} corners in their order", drone + 1, state.counts[drone]));
  }
}

void estimate(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  if (!observation.pose || observation.phase != LinkPhase::flying) return;
  const double off = distance_m(observation.pose->position_m, observation.truth.position_m);
  check_measure(state, sight, drone, off, off > state.verdict.rule.amount, "m off");
}

void fence(RuleState& state, const Sight& sight, std::size_t drone) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double at = of(sight, drone).truth.position_m[axis];
    const double outside = std::max(sight.limits.fence_min_m[axis] - at, at - sight.limits.fence_max_m[axis]);
    check_measure(state, sight, drone, outside, outside > state.verdict.rule.amount, "m beyond it");
  }
}

// On the ground they stand where they were put.
void apart(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  for (const DroneObservation& other : sight.moment.drones.first(drone)) {
    if (on_ground(observation.truth) && on_ground(other.truth)) continue;
    const double distance = distance_m(observation.truth.position_m, other.truth.position_m);
    if (distance < state.verdict.rule.amount)
      state.verdict.broke(sight.moment.now, fmt::format("{} and {}: {} m", observation.name, other.name,
                                                        beyond(distance, state.verdict.rule.amount)));
  }
}

// `done`: it has flown, and landed.
void takes_off_once(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  if (on_ground(observation.truth) && sight.flew[drone]) state.done[drone] = true;
  if (state.done[drone] && observation.truth.in_flight)
    state.verdict.broke(sight.moment.now, observation.name + " took off again");
}

void no_crash(RuleState& state, const Sight& sight, std::size_t drone) {
  const DroneObservation& observation = of(sight, drone);
  if (observation.truth.crashed) state.verdict.broke(sight.moment.now, observation.name + " turned over");
}

void no_crashed_process(RuleState& state, const Ending& ending) {
  if (!ending.crashed.empty()) state.verdict.broke(ending.now, ending.crashed.front());
}

void ends(RuleState& state, const Ending& ending) {
  if (longer(ending.now, state.verdict.rule.amount) || !ending.over)
    state.verdict.broke(ending.now, fmt::format("{:.1f} s", to_seconds(ending.now)));
}

void transactions(RuleState& state, const Ending& ending) {
  if (const double rate = static_cast<double>(ending.transactions) / to_seconds(ending.now);
      rate > state.verdict.rule.amount)
    state.verdict.broke(ending.now, fmt::format("{:.0f} a second", rate));
}

void nothing_lost(RuleState& state, const Ending& ending) {
  if (!ending.lost.empty()) state.verdict.broke(ending.now, ending.lost.front());
}

constexpr RuleKind table[] = {
    {.form = "finishes", .help = "every drone flew its path and landed", .finish = finishes},
    {.form = "recovers and finishes the lap",
     .help = "and flew its plan again after the last fault's end",
     .observe = flies_again,
     .finish = recovers,
     .needs_fault = true,
     .needs_fault_end = true,
     .needs_link = true},
    {.form = "hold within {} after the plan's end",
     .takes = Takes::time,
     .help = "of the newest plan that link was given",
     .observe = hold_after_plan,
     .needs_link = true,
     .not_real = "the traces do not tell a plan's end"},
    {.form = "holds within {}",
     .takes = Takes::time,
     .help = "of the first fault's beginning",
     .observe = reacts<FailsafeMode::hold>,
     .finish = was_done_by_all,
     .needs_fault = true,
     .needs_link = true},
    {.form = "brakes within {}",
     .takes = Takes::time,
     .help = "the same",
     .observe = reacts<FailsafeMode::brake>,
     .finish = was_done_by_all,
     .needs_fault = true,
     .needs_link = true},
    {.form = "lands within {}",
     .takes = Takes::time,
     .help = "the same: it is on the ground",
     .observe = lands,
     .finish = was_done_by_all,
     .needs_fault = true},
    {.form = "resumes within {}",
     .takes = Takes::time,
     .help = "of the last fault's end: the plan is flown again",
     .observe = resumes,
     .finish = resumed,
     .needs_fault = true,
     .needs_fault_end = true,
     .needs_link = true},
    {.form = "{} is seen",
     .takes = Takes::mode_or_cause,
     .help = "hold, brake, land, cut; plan ran out, agent silent, pose lost ...",
     .observe = is_seen,
     .finish = was_seen,
     .needs_link = true},
    {.form = "{} is never seen",
     .takes = Takes::mode_or_cause,
     .help = "the same",
     .observe = is_never_seen,
     .needs_link = true},
    {.form = "no command older than {} applied",
     .takes = Takes::time,
     .help = "at application",
     .on_event = command_age,
     .needs_link = true},
    {.form = "height below {}", .takes = Takes::metres, .help = "of the true place", .observe = height},
    {.form = "speed below {}", .takes = Takes::speed, .help = "of the true speed", .observe = speed},
    {.form = "path within {}", .takes = Takes::metres, .help = "of the true place from the path", .observe = path},
    {.form = "hovers within {}",
     .takes = Takes::metres,
     .help = "of the true place where it was 2 s after it began to fly, until it lands: of one that nobody steers",
     .observe = hovers,
     .needs_link = true},
    {.form = "corners within {}",
     .takes = Takes::metres,
     .help = "every drone comes so near to each corner of its course, in their order, every lap",
     .observe = visits,
     .finish = visited_all},
    {.form = "pose within {}",
     .takes = Takes::metres,
     .help = "of what link estimates from the truth, in flight",
     .observe = estimate,
     .needs_link = true},
    {.form = "fence kept within {}",
     .takes = Takes::metres,
     .help = "the true place is nowhere farther beyond it",
     .observe = fence},
    {.form = "drones apart by {}",
     .takes = Takes::metres,
     .help = "no two of which one flies are ever nearer",
     .observe = apart},
    {.form = "nothing acknowledged is lost",
     .help = "neither commits nor transitions",
     .finish = nothing_lost,
     .needs_lost = true,
     .needs_link = true},
    {.form = "at most {} transactions a second",
     .takes = Takes::number,
     .help = "on the ledger, on average",
     .finish = transactions,
     .needs_link = true,
     .not_real = "the traces do not tell how many there were"},
    {.form = "the ledger is not trusted",
     .help = "by agent, which says so in its log",
     .on_event = untrusted,
     .finish = was_seen,
     .needs_link = true,
     .not_real = "the traces do not tell it"},
    {.form = "the ledger is always trusted",
     .help = "the same",
     .on_event = always_trusted,
     .needs_link = true,
     .not_real = "the traces do not tell it"},
    {.form = "takes off once", .help = "no drone leaves the ground again that has landed", .observe = takes_off_once},
    {.form = "ends within {}", .takes = Takes::time, .help = "of the run's beginning", .finish = ends},
    {.form = "sends {}",
     .takes = Takes::command,
     .help = "command, takeoff, land, emergency: to a drone",
     .on_event = sends,
     .finish = was_seen,
     .not_real = "the traces do not tell it"},
    {.form = "sends no {}",
     .takes = Takes::command,
     .help = "the same",
     .on_event = sends_no,
     .not_real = "the traces do not tell it"},
    {.form = "no crash",
     .help = "no drone turns over, broken or not, and no process ends but by a fault",
     .observe = no_crash,
     .finish = no_crashed_process},
};

}  // namespace

std::span<const RuleKind> rule_kinds() { return table; }

}  // namespace ledgerline::hil
