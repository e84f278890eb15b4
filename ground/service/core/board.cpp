#include "ground/service/core/board.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/access/access.hpp"
#include "common/access/stops.hpp"
#include "common/base/text.hpp"
#include "common/msg/names.hpp"
#include "ground/json/strict.hpp"

namespace ledgerline::ground::service {
namespace {

using nlohmann::json;

std::string text_or_none(const std::optional<crypto::IdentityName>& who) {
  return who ? service::text_of(*who) : std::string();
}

/// A stop that is cleared is no reason any more, though the flight's summary has it.
std::string why_of(const FlightStatus& status, const Lease& lease) {
  return is_landed_by_stop(status) && !is_stopped(lease.stoppers) ? "" : status.why;
}

json stoppers_of(const Lease& lease) {
  json all = json::array();
  for (const Stop& stop : lease.stoppers.stoppers()) all.push_back(text_of(to_name(stop.stopper())));
  return all;
}

json requests_of(const Lease& lease) {
  json all = json::array();
  if (!lease.record) return all;
  for (const Request& request : lease.record->requests())
    all.push_back(
        {{"msp", request.who().msp_id()}, {"subject", request.who().subject()}, {"priority", request.priority()}});
  return all;
}

/// Of its position; 0: not known, as motion capture reports no variance.
double sigma_of(const StateSample& state) {
  return state.pose_stamp_ns != 0 ? std::sqrt(state.pose_variance[0] + state.pose_variance[1]) : 0;
}

/// In whole millimetres: what is drawn needs no more, and it goes out 30 times a second.
json place_json(const Eigen::Vector3d& place_m) {
  const auto rounded = [](double metres) { return std::round(metres * 1e3) / 1e3; };
  return {rounded(place_m.x()), rounded(place_m.y()), rounded(place_m.z())};
}

json committed_json(const CommittedPath& path) {
  json points = json::array();
  for (const Eigen::Vector3d& point : path.points_m) points.push_back(place_json(point));
  return {{"points", std::move(points)}, {"step_ms", to_ms(path.step_ns)}, {"until_ms", to_ms(path.until_ns)}};
}

json drone_json(TimeNs now, const FlightView& flights, std::size_t i) {
  const FlightStatus& status = flights.status(i);
  const IntakeState& seen = flights.intake(i);
  const Lease& lease = flights.lease(i);
  const StateSample& state = seen.state;
  const bool placed = seen.has_state && state.pose_stamp_ns != 0;
  const TimeNs since_ns = now - seen.received_ns;
  const auto& task = flights.drones()[i].task;
  const double limit_mps = std::min(status.limit_mps, task ? task->speed_mps : flights.config().controller.speed_mps);
  json drone{
      {"name", flights.drones()[i].name},
      {"channel", flights.channel_of(i)},
      {"phase", name_of(status.phase)},
      {"why", why_of(status, lease)},
      {"has_state", seen.has_state},
      {"link_phase", name(state.phase)},
      {"mode", name(state.mode)},
      {"cause", name(state.cause)},
      {"cause_words", state.cause == FailsafeCause::none ? "" : words_for(state.cause)},
      {"state_age_ms", seen.has_state ? json(to_ms(since_ns)) : json()},
      {"command_age_ms",
       seen.has_state && state.arrived_ns != 0 ? json(to_ms(state.stamp_ns - state.arrived_ns + since_ns)) : json()},
      {"battery_percent", seen.has_state && state.battery >= 0 ? json(std::lround(100 * state.battery)) : json()},
      {"position", placed ? json(state.position_m) : json()},
      {"height_m", seen.has_state ? json(state.tof_m > 0 ? state.tof_m : state.height_m) : json()},
      {"velocity", placed ? json(state.velocity_mps) : json()},
      {"yaw", placed ? json(state.yaw_rad) : json()},
      {"origin", placed ? json(status.origin_m) : json()},
      {"lap", status.lap},
      {"progress", status.progress},
      {"paused", status.paused},
      {"stopped_by", stoppers_of(lease)},
      {"requests", requests_of(lease)},
      {"ledger_untrusted", status.ledger_untrusted},
      {"limit_mps", std::isfinite(status.limit_mps) && status.limit_mps > 0 ? json(limit_mps) : json()},
      {"lease",
       {{"holder", text_or_none(lease.holder)},
        {"commander", text_or_none(lease.commander)},
        {"ours", lease.commander == flights.config().self},
        {"epoch", lease.epoch}}}};
  const double sigma_m = sigma_of(state);
  drone["sigma_m"] = sigma_m > 0 ? json(sigma_m) : json();
  const auto committed = placed ? flights.committed(now, i) : std::nullopt;
  drone["predicted"] = committed ? place_json(committed->predicted_m) : json();
  drone["committed"] = committed ? committed_json(*committed) : json();
  return drone;
}

/// What the ledger is to blame for needs a person, whatever the drone does about it.
constexpr bool is_of_ledger(FailsafeCause cause) {
  return cause == FailsafeCause::ledger_silent || cause == FailsafeCause::ledger_untrusted;
}

constexpr Level level_of(FailsafeMode mode, FailsafeCause cause) {
  if (mode != FailsafeMode::none && is_of_ledger(cause)) return Level::alarm;
  switch (mode) {
    case FailsafeMode::none:
      return Level::info;
    case FailsafeMode::hold:
    case FailsafeMode::brake:
      return Level::warning;
    case FailsafeMode::land:
    case FailsafeMode::cut:
      return Level::alarm;
  }
  return Level::alarm;
}

}  // namespace

std::optional<std::string> Board::changed_paths(const FlightView& flights) {
  const std::size_t count = flights.drones().size();
  bool changed = paths_.size() != count;
  paths_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (paths_[i] == flights.status(i).planned) continue;
    paths_[i] = flights.status(i).planned;
    changed = true;
  }
  if (!changed) return std::nullopt;
  json all = json::object();
  for (std::size_t i = 0; i < count; ++i) all[flights.drones()[i].name] = paths_[i];
  return all.dump();
}

std::string Board::drones(TimeNs now, const FlightView& flights) {
  json all = json::array();
  for (std::size_t i = 0; i < flights.drones().size(); ++i) all.push_back(drone_json(now, flights, i));
  // A subject of somebody's certificate may be no UTF-8.
  return ground::json::dump(all);
}

std::string Board::state_message(TimeNs now, const FlightView& flights, const std::string& drones) {
  return fmt::format(R"({{"op":"state","t_ms":{:.1f},"delay_ms":{:.1f},"drones":{}}})", to_ms(now),
                     to_ms(flights.delay_ns()), drones);
}

Event Board::make_event(TimeNs now, Level level, const std::string& drone, std::string text) {
  return {next_number_++, now, level, drone, std::move(text)};
}

void Board::add(TimeNs now, Level level, const std::string& drone, std::string text, std::vector<Event>& events) {
  events.push_back(make_event(now, level, drone, std::move(text)));
}

void Board::update(TimeNs now, const FlightView& flights, std::size_t i, std::vector<Event>& events) {
  const std::string& name = flights.drones()[i].name;
  const FlightStatus& status = flights.status(i);
  const StateSample& state = flights.intake(i).state;
  const Lease& lease = flights.lease(i);
  Before& before = before_[i];
  if (std::exchange(before.phase, status.phase) != status.phase) {
    // Landed because the ledger brings nothing of it: no failsafe's event comes, either.
    const bool is_silent = status.phase == GroundPhase::landing &&
                           now - flights.intake(i).received_ns > flights.config().limits.silence_ns;
    const bool failed = status.phase == GroundPhase::failed || is_silent;
    const Level level = failed ? Level::alarm : status.why.empty() ? Level::info : Level::warning;
    add(now, level, name, name_of(status.phase) + (status.why.empty() ? "" : ": " + status.why), events);
  }
  const bool reached = state.phase != LinkPhase::disconnected;
  if (std::exchange(before.reached, reached) != reached)
    add(now, reached ? Level::info : Level::alarm, name, reached ? "link reaches it" : "link does not reach it",
        events);
  if (now - flights.intake(i).received_ns <= flights.config().limits.alarm_silence_ns) {
    if (std::exchange(before.silent, false)) add(now, Level::info, name, "states come again", events);
  } else if (is_aloft(flights, i) && !std::exchange(before.silent, true)) {
    add(now, Level::alarm, name, "no state comes through the ledger: it holds, and lands by its failsafe", events);
  }
  const bool other_mode = std::exchange(before.mode, state.mode) != state.mode;
  const bool other_cause = std::exchange(before.cause, state.cause) != state.cause;
  // In the air a cause without a mode is a warning: at the fence, another drone in the way, battery low.
  const bool warns = state.cause == FailsafeCause::takeoff_refused_by_drone ||
                     (is_in_flight(state.phase) && state.cause != FailsafeCause::none);
  if (other_cause && state.mode == FailsafeMode::none && warns)
    add(now, Level::warning, name, words_for(state.cause), events);
  if (other_mode || (other_cause && state.mode != FailsafeMode::none)) {
    add(now, level_of(state.mode, state.cause), name,
        state.mode == FailsafeMode::none
            ? "its failsafe lets it go on"
            : fmt::format("failsafe: {} ({})", ledgerline::name(state.mode), words_for(state.cause)),
        events);
  }
  const double three_sigma_m = 3 * sigma_of(state);
  if (three_sigma_m >= before.warn_at_m) {
    add(now, Level::warning, name,
        fmt::format("its position is uncertain by {:.1f} m (three sigma) and becomes more so: land it before "
                    "its failsafe brakes it",
                    three_sigma_m),
        events);
    while (before.warn_at_m <= three_sigma_m) before.warn_at_m *= 2;
  }
  while (before.warn_at_m > uncertain_m && three_sigma_m < before.warn_at_m / 4) before.warn_at_m /= 2;
  if (before.holder != lease.holder || before.commander != lease.commander) {
    before.holder = lease.holder;
    before.commander = lease.commander;
    std::string text = lease.holder ? "its lease is held by " + text_of(*lease.holder) : "nobody holds its lease";
    if (lease.commander != lease.holder) text += ", who lets " + text_or_none(lease.commander) + " command it";
    add(now, Level::info, name, std::move(text), events);
  }
  if (std::string stoppers = stopper_names(lease.stoppers); stoppers != before.stoppers) {
    add(now, stoppers.empty() ? Level::info : Level::alarm, name,
        stoppers.empty() ? "its stop is cleared" : "stopped by " + stoppers, events);
    before.stoppers = std::move(stoppers);
  }
}

std::vector<Event> Board::update(TimeNs now, const FlightView& flights, const std::vector<std::string>& notes) {
  std::vector<Event> events;
  before_.resize(flights.drones().size());
  for (std::size_t i = 0; i < before_.size(); ++i) update(now, flights, i, events);
  for (const std::string& note : notes) {
    const std::size_t end = note.find(": ");
    const bool of_drone = end != std::string::npos && index_of(flights.drones(), std::string_view(note).substr(0, end));
    if (of_drone)
      add(now, Level::warning, note.substr(0, end), note.substr(end + 2), events);
    else
      add(now, Level::warning, "", note, events);
  }
  return events;
}

std::vector<Event> Board::refusals(TimeNs now, Refusals& refusals) {
  std::vector<Event> events;
  for (Notice& said : refusals.pop_due(now)) add(now, Level::warning, said.drone, std::move(said.text), events);
  return events;
}

namespace {

constexpr std::size_t max_words = 300;  // bytes of what a peer says

std::string text_of(std::string_view function, const fabric::Outcome& outcome) {
  const std::string words = printable(outcome.refusal ? outcome.refusal->words : outcome.message, max_words);
  using Kind = fabric::Outcome::Kind;
  switch (outcome.kind) {
    case Kind::committed:
      return "";
    case Kind::invalidated:
      return fmt::format("{} does not count: invalid in block {} (code {}){}{}", function, outcome.block, outcome.code,
                         words.empty() ? "" : ": ", words);
    case Kind::refused:
      return fmt::format("{} refused: {}", function, words);
    case Kind::unavailable:
      return fmt::format("{}: no answer of the ledger: {}", function, words);
    case Kind::overloaded:
      return fmt::format("{} not sent, too many are in flight: {}", function, words);
  }
  return fmt::format("{} did not get through", function);
}

}  // namespace

void Refusals::add(std::string_view function, const fabric::Outcome& outcome) {
  if (outcome.kind == fabric::Outcome::Kind::committed) return;
  const auto named = std::ranges::find_if(
      names_, [&](const std::string& name) { return outcome.refusal && fabric::names(*outcome.refusal, name); });
  notices_.add(named == names_.end() ? std::string() : *named, outcome.kind, text_of(function, outcome));
}

}  // namespace ledgerline::ground::service
