#include "ground/mission/run.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"
#include "ground/json/strict.hpp"
#include "ground/mission/mission.hpp"

namespace ledgerline::ground::mission {
namespace {

constexpr std::size_t max_approvals = 1'000;  // of all that were ever given for one mission
constexpr TimeNs again_ns = 300 * ns_per_ms;  // FlightCore takes an order at once, or refuses it
constexpr std::size_t max_why = 300;          // bytes of a reason

bool hovers(const DroneNow& seen) { return seen.phase == GroundPhase::manual && !seen.on_ground; }
bool is_down(const DroneNow& seen) {
  return seen.phase == GroundPhase::waiting || seen.phase == GroundPhase::landed || seen.phase == GroundPhase::failed;
}

std::string with_why(const std::string& words, const DroneNow& seen) {
  return seen.why.empty() ? words : words + ": " + seen.why;
}

}  // namespace

std::string name_of(RunPhase phase) {
  constexpr std::array names{"checked", "approved", "taking_off", "to_start", "flying", "done", "aborted"};
  static_assert(names.size() == enum_count<RunPhase>);
  return names[static_cast<std::size_t>(phase)];
}

MissionRun::MissionRun(Mission mission, const RunConfig& config)
    : mission_(std::move(mission)),
      config_(config),
      canonical_(mission::canonical(mission_)),
      digest_(crypto::sha256(canonical_)),
      parts_(mission_.drones.size()) {
  sort_by_name(mission_);
}

Result<MissionRun> MissionRun::make(Mission mission, const RunConfig& config) {
  if (config.required_approvals < 1 || config.required_approvals > 2) return Error{"1 or 2 approvals may be required"};
  if (const Status bounds = check_bounds(mission); !bounds) return bounds.error();
  return MissionRun(std::move(mission), config);
}

RunProgress MissionRun::progress() const { return {phase_, paused_, why_, {parts_.begin(), parts_.end()}}; }

Result<MissionRun> MissionRun::restore(std::string_view text, const RunConfig& config) {
  auto saved = saved_run_from(text);
  if (!saved) return saved.error();
  auto run = make(std::move(saved->mission), config);
  if (!run) return run.error();
  const RunProgress& progress = saved->progress;
  // Approvals are the ledger's to say.
  run->phase_ = progress.phase == RunPhase::approved ? RunPhase::checked : progress.phase;
  run->paused_ = run->active() && progress.paused;
  run->why_ = progress.why;
  run->recovering_ = run->active();
  for (std::size_t i = 0; i < run->parts_.size(); ++i) {
    Part& part = run->parts_[i];
    static_cast<DroneProgress&>(part) = progress.drones[i];
    // What was in progress starts again from where it is.
    if (part.leg == Leg::rising) part.leg = Leg::ready;
    if (part.leg == Leg::ordered || part.leg == Leg::flying) part.leg = Leg::halted;
    part.found = part.leg == Leg::standing || part.leg == Leg::landed || part.leg == Leg::lost;
    // Of an aborted one those land that were not seen to; of another one that is for its rules.
    part.landing_due = part.landing_due && run->phase_ == RunPhase::aborted;
    part.to_land = part.landing_due;
  }
  return run;
}

bool MissionRun::landing_due() const {
  return phase_ == RunPhase::aborted && std::ranges::any_of(parts_, [](const Part& part) { return part.landing_due; });
}

Mission MissionRun::rest() const {
  Mission rest{mission_.name, {}};
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    if (is_over(i) || parts_[i].leg == Leg::landing) continue;
    MissionDrone drone = mission_.drones[i];
    const std::size_t reached = std::min(parts_[i].reached, drone.waypoints.size() - 1);
    drone.waypoints = {drone.waypoints.begin() + static_cast<std::ptrdiff_t>(reached), drone.waypoints.end()};
    if (parts_[i].leg != Leg::standing) drone.start_m.reset();  // it is wherever its pause has left it
    rest.drones.push_back(std::move(drone));
  }
  return rest;
}

Status MissionRun::change(Mission mission) {
  if (phase_ >= RunPhase::taking_off) return Error{fmt::format("mission {} is started", mission_.name)};
  auto changed = make(std::move(mission), config_);
  if (!changed) return changed.error();
  const auto approvals = std::move(all_approvals_);
  *this = std::move(*changed);
  set_approvals(approvals);
  return ledgerline::done;
}

void MissionRun::set_approvals(std::span<const Approval> approvals) {
  const auto kept = approvals.first(std::min(approvals.size(), max_approvals));
  all_approvals_.assign(kept.begin(), kept.end());
  approvals_read_ = true;
  approvers_.clear();
  for (const Approval& approval : all_approvals_) {
    if (approval.digest == digest_) approvers_.insert(approval.signer);
  }
  if (phase_ <= RunPhase::approved) phase_ = missing_approvals() ? RunPhase::approved : RunPhase::checked;
}

Status MissionRun::missing_approvals() const {
  if (approvers_.size() >= static_cast<std::size_t>(config_.required_approvals)) return ledgerline::done;
  return Error{fmt::format("mission {} has {} of {} approvals of {}", mission_.name, approvers_.size(),
                           config_.required_approvals, crypto::hex(digest_))};
}

Status MissionRun::start(std::span<const Finding> findings) {
  if (phase_ >= RunPhase::taking_off)
    return Error{fmt::format("mission {} is started already: {}", mission_.name, name_of(phase_))};
  if (const Status missing = missing_approvals(); !missing) return missing;
  const auto forbids_it = [](const Finding& finding) { return finding.forbids; };
  const auto found = std::ranges::find_if(findings, forbids_it);
  if (found != findings.end()) return Error{fmt::format("mission {}: {}", mission_.name, found->words)};
  phase_ = RunPhase::taking_off;
  add_event(
      Level::info, "",
      fmt::format("mission {} begins with {} drones, approved by {}", mission_.name, parts_.size(), approvers_.size()));
  return ledgerline::done;
}

Status MissionRun::pause() {
  if (!active() || paused_)
    return Error{fmt::format("mission {} is {}", mission_.name, paused_ ? "paused" : name_of(phase_))};
  hold("it is paused");
  return ledgerline::done;
}

Status MissionRun::resume() {
  if (!active() || !paused_) return Error{fmt::format("mission {} is not paused: {}", mission_.name, name_of(phase_))};
  if (recovering_) return Error{fmt::format("mission {} is still looking for its drones", mission_.name)};
  if (const Status missing = missing_approvals(); !missing) return missing;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    if (parts_[i].leg == Leg::ordered || parts_[i].leg == Leg::flying)
      return Error{fmt::format("mission {}: {} does not hover yet", mission_.name, name(i))};
  }
  paused_ = false;
  add_event(Level::info, "", fmt::format("mission {} goes on", mission_.name));
  return ledgerline::done;
}

Status MissionRun::end(const std::string& why) {
  if (!active()) return Error{fmt::format("mission {} is {}", mission_.name, name_of(phase_))};
  abort(why);
  return ledgerline::done;
}

void MissionRun::hold(const std::string& why) {
  if (paused_) return;
  awaits_check_ = false;
  paused_ = true;
  add_event(Level::warning, "", fmt::format("mission {}: all hover: {}", mission_.name, why));
}

void MissionRun::abort(const std::string& why) {
  phase_ = RunPhase::aborted;
  why_ = printable(why, max_why);
  paused_ = awaits_check_ = false;
  land_all();
  add_event(Level::alarm, "", fmt::format("mission {}: all land: {}", mission_.name, why_));
}

void MissionRun::mark_lost(std::size_t drone, const std::string& why) {
  parts_[drone].leg = Leg::lost;
  parts_[drone].found = true;
  add_event(Level::alarm, name(drone), fmt::format("mission {} lost it: {}", mission_.name, printable(why, max_why)));
  if (!active()) return;
  const auto lost = [](const Part& part) { return part.leg == Leg::lost; };
  if (std::ranges::all_of(parts_, lost)) return abort("no drone is left");
  if (config_.on_loss == OnLoss::land) return abort(fmt::format("{}: {}", name(drone), why));
  if (config_.on_loss == OnLoss::hover) hold(fmt::format("{} was lost", name(drone)));
}

void MissionRun::observe(TimeNs now, std::size_t drone, const DroneNow& seen) {
  switch (parts_[drone].leg) {
    case Leg::standing:
    case Leg::rising:
      return observe_rising(now, drone, seen);
    case Leg::ready:
    case Leg::halted:
      if (hovers(seen) && seen.paths == parts_[drone].paths) return;
      return mark_lost(drone, seen.phase == GroundPhase::path || hovers(seen) ? "somebody else flies it"
                                                                              : with_why("it hovers no longer", seen));
    case Leg::ordered:
    case Leg::flying:
      return observe_flying(now, drone, seen);
    case Leg::ended:
    case Leg::landing:
      return observe_end(drone, seen);
    case Leg::landed:
    case Leg::lost:
      return;
  }
}

void MissionRun::observe_rising(TimeNs now, std::size_t drone, const DroneNow& seen) {
  Part& part = parts_[drone];
  if (hovers(seen)) {
    part.leg = Leg::ready;
    part.paths = seen.paths;
  } else if (part.leg == Leg::standing) {
    return;
  } else if (seen.phase == GroundPhase::landing || seen.phase == GroundPhase::path) {
    mark_lost(drone, with_why("its take-off ended in " + name_of(seen.phase), seen));
  } else if (now - part.asked_ns > (is_down(seen) ? config_.order_ns : config_.takeoff_ns)) {
    mark_lost(drone, with_why("it did not take off", seen));
  }
}

void MissionRun::observe_flying(TimeNs now, std::size_t drone, const DroneNow& seen) {
  Part& part = parts_[drone];
  if (is_down(seen) && seen.phase != GroundPhase::landed)
    return mark_lost(drone, with_why("it is flown no longer", seen));
  if (seen.paths == part.paths) {
    if (!hovers(seen)) return mark_lost(drone, with_why("it is in " + name_of(seen.phase), seen));
    if (now - part.asked_ns > config_.order_ns) mark_lost(drone, with_why("it did not begin its path", seen));
    return;
  }
  if (seen.paths > part.paths + 1) return mark_lost(drone, "somebody else flies it");
  part.leg = Leg::flying;
  const std::size_t count = mission_.drones[drone].waypoints.size();
  part.reached = std::min(count, part.begun_at + seen.reached);
  const bool at_end = part.reached == count;
  if (seen.phase == GroundPhase::path) return;
  if (seen.phase == GroundPhase::landing || seen.phase == GroundPhase::landed) {
    if (!at_end || !mission_.drones[drone].land_behind) return mark_lost(drone, with_why("it lands", seen));
    part.leg = Leg::landing;
    return observe_end(drone, seen);
  }
  if (!hovers(seen)) return mark_lost(drone, with_why("it is in " + name_of(seen.phase), seen));
  if (at_end) {
    part.leg = Leg::ended;
    return add_event(Level::info, name(drone), fmt::format("mission {}: it hovers at its end", mission_.name));
  }
  if (!paused_ && !seen.paused) return mark_lost(drone, with_why("it gave up its path", seen));
  part.leg = Leg::halted;
  part.paths = seen.paths;
  hold(fmt::format("{} was paused", name(drone)));
}

void MissionRun::observe_end(std::size_t drone, const DroneNow& seen) {
  Part& part = parts_[drone];
  if (seen.phase == GroundPhase::landed) {
    part.leg = Leg::landed;
    add_event(Level::info, name(drone), fmt::format("mission {}: it has landed", mission_.name));
  } else if (seen.phase == GroundPhase::waiting || seen.phase == GroundPhase::failed) {
    mark_lost(drone, with_why("it is flown no longer", seen));
  }
}

// FlightCore holds a drone that it finds in the air; until then it is on its way there.
void MissionRun::find(TimeNs now, std::size_t drone, const DroneNow& seen) {
  Part& part = parts_[drone];
  if (part.found) return;
  const bool is_late = now - recovering_since_ns_ > config_.find_ns;
  if (hovers(seen) && (seen.battery_share || is_late)) {  // its charge comes with one of its next states
    part.found = true;
    part.paths = seen.paths;
    part.begun_at = part.reached;
  } else if (seen.seen && seen.on_ground) {
    DroneNow landed = seen;
    landed.phase = GroundPhase::landed;
    part.leg == Leg::landing ? observe_end(drone, landed)
                             : mark_lost(drone, with_why("it was found on the ground", seen));
    part.found = true;
  } else if (is_late) {
    mark_lost(drone, with_why("it was not found in the air", seen));
  }
}

// All drones are found or lost, and who has approved it is known, if it matters.
bool MissionRun::is_recovered(TimeNs now) const {
  return std::ranges::all_of(parts_, [](const Part& part) { return part.found; }) &&
         (approvals_read_ || config_.after_restart != AfterRestart::go_on ||
          now - recovering_since_ns_ > config_.find_ns);
}

void MissionRun::recover() {
  recovering_ = false;
  if (!active()) return;
  const Status missing = missing_approvals();
  std::string waits = config_.after_restart == AfterRestart::hover ? "the ground station was started again" : "";
  if (phase_ == RunPhase::taking_off) waits = "nobody takes off by itself after a restart";
  if (!missing) waits = missing.error().message;
  if (!waits.empty()) hold(waits);
  awaits_check_ = !paused_;
}

void MissionRun::resume_after_check(const Status& checked) {
  if (!std::exchange(awaits_check_, false)) return;
  if (!checked) return hold(checked.error().message);
  add_event(Level::warning, "", fmt::format("mission {} goes on after a restart", mission_.name));
}

void MissionRun::order(TimeNs now, std::size_t drone, const DroneNow& seen, std::size_t index) {
  Part& part = parts_[drone];
  std::vector<Waypoint> rest = mission_.drones[drone].way();
  rest.erase(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(part.reached));
  part.leg = Leg::ordered;
  part.begun_at = part.reached;
  part.asked_ns = now;
  part.paths = seen.paths;
  PilotCommand command{.drone = index};
  command.order = PilotOrder{PilotOrder::Kind::path, std::move(rest), mission_.drones[drone].land_behind};
  part.ordered_ns = now;
  commands_.push_back(std::move(command));
}

void MissionRun::conduct(TimeNs now, std::span<const DroneNow> drones, std::span<const std::size_t> indices) {
  bool all_wait = true;  // each that is neither lost nor at its end hovers, and waits for its path
  bool one_waits = false;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    Part& part = parts_[i];
    const bool ready = part.leg == Leg::ready || part.leg == Leg::halted;
    const bool waits = ready && !drones[indices[i]].held;
    one_waits = one_waits || waits;
    all_wait = all_wait && (waits || is_over(i) || part.leg == Leg::landing);
    if (paused_ && (part.leg == Leg::ordered || part.leg == Leg::flying) &&
        drones[indices[i]].phase == GroundPhase::path) {
      commands_.push_back({.drone = indices[i], .pause = true});
    } else if (!paused_ && part.leg == Leg::ordered && now - part.ordered_ns >= again_ns) {
      // Its failsafe may have braked it for a moment; order_ns says when it is too late for the others.
      const TimeNs asked_ns = part.asked_ns;
      order(now, i, drones[indices[i]], indices[i]);
      part.asked_ns = asked_ns;
    } else if (!paused_ && part.leg == Leg::standing) {
      part.leg = Leg::rising;
      part.asked_ns = now;
      commands_.push_back({.drone = indices[i], .takeoff = true});
    }
  }
  if (paused_ || !all_wait || !one_waits) return;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    if (parts_[i].leg == Leg::ready || parts_[i].leg == Leg::halted) order(now, i, drones[indices[i]], indices[i]);
  }
  if (phase_ != RunPhase::taking_off) return;
  phase_ = RunPhase::to_start;
  add_event(Level::info, "", fmt::format("mission {}: all hover, their paths begin", mission_.name));
}

void MissionRun::advance() {
  const auto all = [&](auto holds) {
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (!holds(i)) return false;
    }
    return true;
  };
  if (phase_ == RunPhase::to_start && all([&](std::size_t i) { return parts_[i].reached > 0 || is_over(i); })) {
    phase_ = RunPhase::flying;
    add_event(Level::info, "", fmt::format("mission {}: all are at their first waypoint", mission_.name));
  }
  if (phase_ == RunPhase::flying && all([&](std::size_t i) { return is_over(i); })) {
    phase_ = RunPhase::done;
    paused_ = false;
    add_event(Level::info, "", fmt::format("mission {} is done", mission_.name));
  }
}

void MissionRun::land_all() {
  for (Part& part : parts_) part.to_land = part.landing_due = true;
}

// Once, and not before FlightCore has the drone: after a restart it has to find it.
void MissionRun::land(std::size_t drone, const DroneNow& seen, std::size_t index) {
  Part& part = parts_[drone];
  if (seen.seen && seen.on_ground) part.landing_due = false;
  const bool is_flown = is_in_air(seen.phase) || (seen.phase == GroundPhase::failed && !seen.on_ground);
  if (!part.to_land || !seen.seen || !(is_flown || seen.on_ground || seen.phase == GroundPhase::landing)) return;
  part.to_land = false;
  if (is_flown) commands_.push_back({.drone = index, .land = true});
}

RunOutputs MissionRun::step(TimeNs now, std::span<const DroneNow> drones) {
  std::vector<std::size_t> indices;  // of each drone among `drones`; their count: it is not there
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const auto found = std::ranges::find_if(drones, [&](const DroneNow& seen) { return seen.name == name(i); });
    indices.push_back(static_cast<std::size_t>(found - drones.begin()));
    if (found == drones.end() && active() && !is_over(i)) mark_lost(i, "it does not fly here");
  }
  if (recovering_ && config_.after_restart == AfterRestart::land) abort("the ground station was started again");
  recovering_ = recovering_ && active();
  if (recovering_) {
    if (recovering_since_ns_ == 0) recovering_since_ns_ = now;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (indices[i] < drones.size()) find(now, i, drones[indices[i]]);
    }
    if (is_recovered(now)) recover();
  } else if (active()) {
    for (std::size_t i = 0; i < parts_.size() && active(); ++i) {
      if (indices[i] < drones.size()) observe(now, i, drones[indices[i]]);
    }
  }
  if (!recovering_ && !awaits_check_ && active()) conduct(now, drones, indices);
  if (!recovering_ && active()) advance();
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    if (indices[i] < drones.size()) land(i, drones[indices[i]], indices[i]);
  }
  RunOutputs out{std::move(commands_), std::move(events_), false};
  commands_.clear();
  events_.clear();
  std::string state = text_of(progress(), mission_);
  out.changed = state != last_saved_state_;
  last_saved_state_ = std::move(state);
  return out;
}

namespace {

using nlohmann::json;
namespace strict = ground::json;

constexpr int version = 1;
// A mission, one deeper, and five values of each drone.
constexpr strict::Bounds saved_bounds{max_saved_bytes, 6, (5 * motion::max_waypoints + 20) * max_drones + 20};

template <typename Names>
std::optional<std::size_t> index_in(const Names& names, const json& name) {
  if (!name.is_string()) return std::nullopt;
  const auto found = std::ranges::find(names, name.get_ref<const std::string&>());
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

Result<RunPhase> phase_from(const json& name) {
  for (std::size_t i = 0; i < enum_count<RunPhase>; ++i) {
    if (name == name_of(static_cast<RunPhase>(i))) return static_cast<RunPhase>(i);
  }
  return Error{"phase must be one of a mission's"};
}

constexpr std::array<std::string_view, 10> leg_names{"standing", "rising", "ready",   "ordered", "flying",
                                                     "halted",   "ended",  "landing", "landed",  "lost"};
static_assert(leg_names.size() == enum_count<DroneProgress::Leg>);

Result<DroneProgress> drone_from(const json& given, const MissionDrone& drone) {
  using Leg = DroneProgress::Leg;
  if (!given.is_object()) return Error{"must be an object"};
  if (const Status keys = strict::only(given, {"drone", "leg", "reached", "to_land"}); !keys) return keys.error();
  if (given.value("drone", json()) != drone.drone) return Error{fmt::format("must be {}", drone.drone)};
  const auto leg = index_in(leg_names, given.value("leg", json()));
  if (!leg) return Error{"leg must be one of a mission's"};
  const json reached = given.value("reached", json());
  const std::size_t count = drone.waypoints.size();
  if (!reached.is_number_unsigned() || reached.get<std::uint64_t>() > count)
    return Error{fmt::format("reached must be 0 to {}", count)};
  const json to_land = given.value("to_land", json());
  if (!to_land.is_boolean()) return Error{"to_land must be true or false"};
  const DroneProgress read{static_cast<Leg>(*leg), reached.get<std::size_t>(), to_land.get<bool>()};
  const bool at_end = read.leg == Leg::ended || read.leg == Leg::landing || read.leg == Leg::landed;
  if (read.leg != Leg::lost && at_end != (read.reached == count))
    return Error{fmt::format("leg {} does not go with {} of {} waypoints", leg_names[*leg], read.reached, count)};
  if (read.leg == Leg::landing && !drone.land_behind)
    return Error{"leg landing does not go with a path that ends in hovering"};
  return read;
}

}  // namespace

std::string text_of(const RunProgress& progress, const Mission& mission) {
  json drones = json::array();
  for (std::size_t i = 0; i < progress.drones.size(); ++i)
    drones.push_back({{"drone", mission.drones[i].drone},
                      {"leg", leg_names[static_cast<std::size_t>(progress.drones[i].leg)]},
                      {"reached", progress.drones[i].reached},
                      {"to_land", progress.drones[i].landing_due}});
  const json state{{"version", version},
                   {"phase", name_of(progress.phase)},
                   {"paused", progress.paused},
                   {"why", progress.why},
                   {"drones", std::move(drones)}};
  return state.dump();
}

std::string text_of(const RunProgress& progress, const Mission& mission, const std::string& canonical) {
  std::string text = text_of(progress, mission);
  text.back() = ',';
  return text + R"("mission":)" + canonical + "}";
}

Result<SavedRun> saved_run_from(std::string_view text) {
  const auto wrong = [](const std::string& what) { return Error{"the kept mission: " + what}; };
  if (text.size() > max_saved_bytes) return wrong(fmt::format("has {} bytes; {} may be", text.size(), max_saved_bytes));
  const auto parsed = strict::object_from(text, "the kept mission", saved_bounds);
  if (!parsed) return parsed.error();
  if (const Status keys = strict::only(*parsed, {"version", "mission", "phase", "paused", "why", "drones"}); !keys)
    return wrong(keys.error().message);
  if (parsed->value("version", json()) != version) return wrong(fmt::format("version must be {}", version));
  auto mission = mission_from_document(parsed->value("mission", json()));
  if (!mission) return wrong(mission.error().message);
  SavedRun saved{std::move(*mission), {}};
  sort_by_name(saved.mission);
  const auto phase = phase_from(parsed->value("phase", json()));
  if (!phase) return wrong(phase.error().message);
  const json paused = parsed->value("paused", json()), why = parsed->value("why", json());
  if (!paused.is_boolean() || !why.is_string()) return wrong("paused must be true or false, why a text");
  const json drones = parsed->value("drones", json());
  if (!drones.is_array() || drones.size() != saved.mission.drones.size())
    return wrong(fmt::format("drones must be a list of {}", saved.mission.drones.size()));
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const auto drone = drone_from(drones[i], saved.mission.drones[i]);
    if (!drone) return wrong(fmt::format("drone number {}: {}", i + 1, drone.error().message));
    saved.progress.drones.push_back(*drone);
  }
  saved.progress.phase = *phase;
  saved.progress.paused = paused.get<bool>();
  saved.progress.why = printable(why.get<std::string>());
  return saved;
}

}  // namespace ledgerline::ground::mission
