#include "hil/fault/checker/checker.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ledgerline::hil {
namespace {

namespace which {
enum Which : std::uint8_t {
  too_fast,
  too_high,
  too_far,
  crash,
  lost_link,
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
  upright,
  count
};
}  // namespace which
/// What must hold in every run, and what a run must show for it.
struct Invariant {
  std::string_view text;
  Evidence needs = Evidence::truth;
  std::string_view not_in_traces{};  ///< why traces do not show it
};
constexpr auto invariants = std::to_array<Invariant>({
    {"always: never faster than the limits"},
    {"always: never higher than the limits"},
    {"always: never farther than the limits"},
    {"always: no crash"},
    {"always: who is not seen is stopped and landed", Evidence::traces},
    {"always: a hold or a landing after silence", Evidence::traces},
    {"always: a hold ends in a landing", Evidence::traces},
    {"always: rc in the SDK's range", Evidence::traces},
    {"always: commanded speed ramps", Evidence::simulation, "of what a drone is sent traces have each rc's range"},
    {"always: commands in order, each once", Evidence::traces},
    {"always: a brake takes its plans with it", Evidence::traces},
    {"always: on the ground in the end"},
    {"always: no hang"},
    {"always: every fault began"},
    {"always: nothing acknowledged is lost", Evidence::traces},
    {"always: nothing is flown that nobody signed", Evidence::simulation,
     "traces have no signatures: tests/system/relay compares what is flown with the ledger"},
    {"always: no motors cut while upright", Evidence::simulation, "of what a drone is sent traces have rc alone"},
});
constexpr std::string_view no_link = "a flight by the SDK has no link, agent, ground or ledger";
constexpr std::string_view lost_unknown = "who counts what was acknowledged was killed";

void set_not_checked(Verdict& verdict, std::string_view why) {
  if (verdict.held) verdict.not_checked = why;  // what is broken was seen
}

static_assert(invariants.size() == which::count);

// Where link takes it to be, beside the truth.
std::string estimated(const DroneObservation& observation) {
  if (!observation.pose) return {};
  return fmt::format(", by its pose at {:.2f}, {:.2f} m", observation.pose->position_m[0],
                     observation.pose->position_m[1]);
}

/// Since when something has been so, which is kept in `since_ns` (0: it is not); `now` where it is not.
TimeNs since(bool is_so, TimeNs now, TimeNs& since_ns) {
  since_ns = !is_so ? 0 : since_ns == 0 ? now : since_ns;
  return is_so ? since_ns : now;
}

Moment::Excuse excuse_of(const Moment& moment, std::size_t drone) {
  return moment.excuses.empty() ? Moment::Excuse{} : moment.excuses[drone];
}

}  // namespace

Invariants::Invariants(const Limits& limits) : limits_(limits) {
  for (const Invariant& invariant : invariants) verdicts_.push_back(always(invariant.text));
}

void Invariants::observe(const Moment& moment) {
  drones_.resize(moment.drones.size());
  for (std::size_t i = 0; i < moment.drones.size(); ++i) check_drone(moment, i);
  for (const WorldEvent& event : moment.events) {
    if (event.kind == WorldEvent::Kind::unasked)
      broke(which::unasked, moment.now, fmt::format("{}: {}", moment.drones[event.drone].name, event.text));
    if (event.kind == WorldEvent::Kind::bad_rc) broke(which::rc_range, moment.now, event.text);
    if (event.kind == WorldEvent::Kind::sent && event.text == "emergency") check_cut(moment, event.drone);
  }
  check_order(moment);
}

void Invariants::check_cut(const Moment& moment, std::size_t index) {
  const DroneObservation& observation = moment.drones[index];
  const bool upright =
      observation.truth.in_flight && !observation.truth.crashed && observation.truth.tilt_rad < upright_rad;
  if (upright && !excuse_of(moment, index).cut)
    broke(which::upright, moment.now,
          fmt::format("{}: tilted by {:.2f} rad at {:.2f} m", observation.name, observation.truth.tilt_rad,
                      observation.truth.position_m[2]));
}

void Invariants::check_order(const Moment& moment) {
  for (const WorldEvent& event : moment.events) {
    if (event.kind == WorldEvent::Kind::started) {  // it knows of nothing before
      for (Drone& drone : drones_) {
        if (event.text == "agent") drone.handed = 0;
        if (event.text == "link") drone.applied = 0;
      }
    }
    const bool handed = event.kind == WorldEvent::Kind::handed;
    const DroneObservation& observation = moment.drones[event.drone];
    // Else it may be a stop, whose sequence is nobody's.
    const bool applied = event.kind == WorldEvent::Kind::applied && observation.phase == LinkPhase::flying &&
                         observation.mode < FailsafeMode::land;
    if ((!handed && !applied) || event.sequence == 0) continue;
    std::uint64_t& newest = handed ? drones_[event.drone].handed : drones_[event.drone].applied;
    if (event.sequence <= newest)
      broke(which::order, moment.now,
            fmt::format("{}: {} {} after {}", observation.name, handed ? "agent hands on" : "link flies",
                        event.sequence, newest));
    newest = event.sequence;
  }
}

void Invariants::check_ramp(const Moment& moment, std::size_t index, bool rested) {
  const DroneObservation& observation = moment.drones[index];
  Drone& drone = drones_[index];
  const double changed = distance_m(observation.sent, drone.sent);
  const double limit = limits_.sent_mps2 * (observation.mode == FailsafeMode::brake ? 2 : 1);
  drone.may_change_mps =
      std::min(sent_at_once_mps, drone.may_change_mps + limit * to_seconds(moment.now - drone.looked_ns));
  drone.looked_ns = moment.now;
  drone.sent = observation.sent;
  if (!rested) return;
  drone.may_change_mps -= changed;
  if (drone.may_change_mps < 0)
    broke(which::ramps, moment.now, fmt::format("{}: sent {:.2f} m/s more or less at once", observation.name, changed));
}

void Invariants::check_brake(const Moment& moment, std::size_t index, bool flies) {
  const DroneObservation& observation = moment.drones[index];
  Drone& drone = drones_[index];
  if (observation.mode == FailsafeMode::brake || !flies) {
    drone.braked = flies;
    drone.plans_at_brake = observation.plans_given;
  }
  if (drone.braked && observation.plans_given == drone.plans_at_brake && observation.mode == FailsafeMode::none &&
      observation.sent_mps > 0)
    broke(which::old_plans, moment.now,
          fmt::format("{}: sent {:.2f} m/s after its brake, and no plan came", observation.name, observation.sent_mps));
}

bool Invariants::check_blind(const DroneObservation& observation, const Moment::Excuse& excuse, Drone& drone) {
  const auto& at = observation.truth.position_m;
  if (!excuse.blind) {
    drone.blind_from_m.reset();
    drone.may_run = false;
    return false;
  }
  if (!drone.blind_from_m || excuse.deaf) drone.blind_from_m = {at[0], at[1]};
  drone.may_run = drone.may_run || excuse.deaf || excuse.misled || excuse.steered;
  if (observation.pose) {
    const double off = std::hypot(observation.pose->position_m[0] - at[0], observation.pose->position_m[1] - at[1]);
    drone.misled_m = std::max(drone.misled_m, std::min(off, blind_way_m));
  }
  return std::hypot(at[0] - (*drone.blind_from_m)[0], at[1] - (*drone.blind_from_m)[1]) <= blind_way_m;
}

// Speed, height, place.
void Invariants::check_limits(const Moment& moment, std::size_t index) {
  const DroneObservation& observation = moment.drones[index];
  Drone& drone = drones_[index];
  const Moment::Excuse excuse = excuse_of(moment, index);
  const auto& at = observation.truth.position_m;
  if (!observation.truth.in_flight || observation.truth.crashed) return;
  const bool within_way = check_blind(observation, excuse, drone);
  const double max_mps = drone.may_run ? std::max(blind_mps, limits_.speed_mps) : limits_.speed_mps;
  if (const double speed = length_of(observation.truth.velocity_mps); speed > max_mps && !excuse.physical)
    broke(which::too_fast, moment.now, fmt::format("{}: {:.2f} m/s", observation.name, speed));
  const double high = std::max(0.0, at[2] - limits_.height_m);
  double far = 0;
  for (std::size_t i = 0; i < 2; ++i) far = std::max({far, limits_.min_m[i] - at[i], at[i] - limits_.max_m[i]});
  if (excuse.deaf || excuse.physical) {
    drone.high_m = high;
    drone.far_m = far;
    return;
  }
  if (within_way) drone.far_m = far;
  const auto beyond = [](double now, double before) { return now > (before > 0 ? before + farther_m : 0); };
  if (beyond(high, drone.high_m))
    broke(which::too_high, moment.now, fmt::format("{}: {:.2f} m", observation.name, at[2]));
  const double misled_m = excuse.blind && !within_way ? 0 : drone.misled_m;
  if (beyond(far, drone.far_m) && far > misled_m)
    broke(which::too_far, moment.now,
          fmt::format("{}: at {:.2f}, {:.2f} m{}", observation.name, at[0], at[1], estimated(observation)));
}

void Invariants::check_lost_link(const Moment& moment, std::size_t index) {
  const DroneObservation& observation = moment.drones[index];
  Drone& drone = drones_[index];
  const Moment::Excuse excuse = excuse_of(moment, index);
  const bool is_lost = moment.link_runs && observation.phase == LinkPhase::disconnected && observation.truth.in_flight;
  const TimeNs lost_for =
      moment.now - since(is_lost && !excuse.deaf && !excuse.physical, moment.now, drone.lost_since_ns);
  const double speed = std::hypot(observation.truth.velocity_mps[0], observation.truth.velocity_mps[1]);
  if (lost_for > lost_stops_ns && speed > lost_mps && !excuse.blind)
    broke(which::lost_link, moment.now, fmt::format("{}: {:.2f} m/s, without state", observation.name, speed));
  if (lost_for > lost_down_ns)
    broke(which::lost_link, moment.now,
          fmt::format("{}: without state and in the air for {:.0f} s", observation.name, to_seconds(lost_for)));
}

void Invariants::check_drone(const Moment& moment, std::size_t index) {
  const DroneObservation& observation = moment.drones[index];
  Drone& drone = drones_[index];
  const TimeNs now = moment.now;
  if (observation.truth.crashed && !excuse_of(moment, index).broken)
    broke(which::crash, now, observation.name + " turned over");
  check_limits(moment, index);
  check_lost_link(moment, index);

  const bool flies = moment.link_runs && observation.phase == LinkPhase::flying;
  // A link that stood still says nothing for a second, so that the drone may land itself: see LinkSettings.
  const bool rested = now - since(flies, now, drone.rested_since_ns) > 1'500 * ns_per_ms;
  check_ramp(moment, index, rested && !excuse_of(moment, index).spins);
  check_brake(moment, index, flies);
  if (flies) {
    const TimeNs silent_since = std::max(observation.plan_end_ns, drone.rested_since_ns);
    const TimeNs silent_for = now - silent_since;
    if (rested && silent_for > hold_within_ns && observation.mode == FailsafeMode::none) {
      broke(which::silent, now,
            fmt::format("{}: {:.0f} ms after its plan's end no hold", observation.name, to_ms(silent_for)));
    }
    const bool stays = observation.mode == FailsafeMode::hold ||
                       (observation.mode == FailsafeMode::brake && observation.cause == FailsafeCause::state_stale);
    const double stays_mps = stays ? hold_mps : 0;
    if (rested && silent_for > hold_within_ns + ramp_ns && observation.sent_mps > stays_mps) {
      broke(which::silent, now,
            fmt::format("{}: sent {:.2f} m/s {:.0f} ms after its plan's end", observation.name, observation.sent_mps,
                        to_ms(silent_for)));
    }
  }
  // A landing of the failsafe waits for room below, but not for ever.
  const TimeNs waits_for = now - since(flies && observation.mode == FailsafeMode::land, now, drone.waits_since_ns);
  if (waits_for > landing_waits_ns)
    broke(which::hovers, now, fmt::format("{} waits to land for {:.1f} s", observation.name, to_seconds(waits_for)));
  const bool hovering = flies && (observation.mode == FailsafeMode::hold || observation.mode == FailsafeMode::brake);
  const TimeNs hovers_for = now - since(hovering, now, drone.hovering_since_ns);
  if (hovers_for > land_after_ns)
    broke(which::hovers, now, fmt::format("{} hovers for {:.1f} s", observation.name, to_seconds(hovers_for)));
}

void Invariants::finish(const Ending& ending) {
  if (!ending.over) broke(which::hangs, ending.now, ending.why.empty() ? "it goes on" : ending.why);
  if (!ending.missing.empty()) broke(which::missing, ending.now, ending.missing.front());
  if (!ending.crashed.empty()) broke(which::crash, ending.now, ending.crashed.front());
  if (!ending.lost.empty())
    broke(which::lost, ending.now,
          fmt::format("{}{}", ending.lost.front(),
                      ending.lost.size() > 1 ? fmt::format(" and {} more", ending.lost.size() - 1) : ""));
  for (const std::string& name : ending.in_the_air) broke(which::in_the_air, ending.now, name);
  for (std::size_t i = 0; i < verdicts_.size(); ++i) {
    if (ending.evidence < invariants[i].needs)
      set_not_checked(verdicts_[i], ending.evidence == Evidence::truth ? no_link : invariants[i].not_in_traces);
  }
  if (!ending.lost_is_known) set_not_checked(verdicts_[which::lost], lost_unknown);
}

Checker::Checker(const std::vector<Rule>& rules, const Limits& limits) : limits_(limits), invariants_(limits) {
  for (const Rule& rule : rules) rules_.push_back({.verdict = {rule, true, 0, {}}});
}

void Checker::check_rule(const Moment& moment, RuleState& state) const {
  const RuleKind& kind = *state.verdict.rule.kind;
  state.waits = false;
  state.done.resize(moment.drones.size());
  state.counts.resize(moment.drones.size());
  state.hovers.resize(moment.drones.size());
  for (const WorldEvent& event : moment.events) {
    if (kind.on_event) kind.on_event(state, moment, event);
  }
  for (std::size_t i = 0; i < moment.drones.size(); ++i) {
    if (kind.observe) kind.observe(state, {moment, limits_, flew_}, i);
  }
}

void Checker::observe(const Moment& moment) {
  flew_.resize(moment.drones.size());
  for (RuleState& state : rules_) check_rule(moment, state);
  for (std::size_t i = 0; i < moment.drones.size(); ++i) {
    const sim::Truth& truth = moment.drones[i].truth;
    flew_[i] = flew_[i] || (truth.in_flight && truth.position_m[2] > on_ground_m);
  }
  invariants_.observe(moment);
}

std::vector<Verdict> Checker::finish(const Ending& ending) {
  std::vector<Verdict> verdicts;
  for (RuleState& state : rules_) {
    const RuleKind& kind = *state.verdict.rule.kind;
    if (kind.finish) kind.finish(state, ending);
    if (const auto& excess = state.excess; excess && excess->worst - excess->first >= 0.001)  // as it is printed
      state.verdict.what += fmt::format("; at worst {}: {:.3f} {}", excess->drone, excess->worst, excess->unit);
    if (kind.needs_lost && !ending.lost_is_known) set_not_checked(state.verdict, lost_unknown);
    verdicts.push_back(state.verdict);
  }
  invariants_.finish(ending);
  verdicts.insert(verdicts.end(), invariants_.verdicts().begin(), invariants_.verdicts().end());
  return verdicts;
}

}  // namespace ledgerline::hil
