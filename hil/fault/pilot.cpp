#include "hil/fault/pilot.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "hil/netem/distribution.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs usual_for_ns = ns_per_s;
constexpr std::string_view pilot_words =
    "must be takeoff, land, stop, cut, steer, mission approve (start, pause, resume, land), or fly X Y Z TURN, in m/s "
    "and rad/s, as \"fly 0.3 0 0 0\"";
constexpr TimeNs usual_reaction_ns = 250 * ns_per_ms, max_reaction_ns = 5 * ns_per_s;
// A person looks ahead by so long, and does not look for the drone on a later piece of the course.
constexpr double look_ahead_s = 0.7, least_look_ahead_m = 0.3, search_m = 1, search_step_m = 0.02;
constexpr double climb_gain_per_s = 1, max_climb_mps = 0.3;

bool parse_do(const std::string& text, PilotRow& row) {
  const auto words = words_of(text);
  row.text = fmt::format("{}", fmt::join(words, " "));
  if (words.size() == 1) {
    row.takeoff = words[0] == "takeoff";
    row.land = words[0] == "land";
    row.stop = words[0] == "stop";
    row.cut = words[0] == "cut";
    row.steer = words[0] == "steer";
    return !row.flies();
  }
  if (words.size() == 2 && words[0] == "mission") {
    const auto* const found = std::ranges::find(enum_names<MissionCommand>, words[1]);
    if (found == enum_names<MissionCommand>.end()) return false;
    row.mission = static_cast<MissionCommand>(found - enum_names<MissionCommand>.begin());
    return true;
  }
  if (words.size() != 5 || words[0] != "fly") return false;
  constexpr double max_command = 10;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto value = parse_number(words[i + 1]);
    if (!value || std::abs(*value) > max_command) return false;
    (i < 3 ? row.velocity.linear_mps[i] : row.velocity.angular_radps[2]) = *value;
  }
  return true;
}

}  // namespace

std::vector<PilotRow> read_pilot(Config& config, int drones) {
  std::vector<PilotRow> rows;
  for (std::size_t i = 0; i < config.table_count({"pilot", "of a manual flight: what its pilot says"}); ++i) {
    const std::string prefix = fmt::format("pilot.{}.", i);
    PilotRow row;
    const std::string text = config.text(
        Key(prefix + "do", "takeoff, land, stop, cut, steer (along the course), mission WORD, or fly X Y Z TURN")
            .like(R"(^\s*(takeoff|land|stop|cut|steer|mission\s+[a-z]+|fly(\s+-?[0-9.]+){4})\s*$)"));
    row.at = config.text({prefix + "at", "when, as of a fault"}, "1s");
    const std::string lasts = config.text({prefix + "for", "of fly: said again for so long"}, "");
    const std::string reaction =
        config.text({prefix + "reaction", "of steer: how late it answers to what is shown"}, "");
    row.sees_path =
        config.choice({prefix + "sees", "of steer: the newest state, or where the committed path predicts it"},
                      {"state", "path"}, "state") == "path";
    const std::string drone = config.text({prefix + "drone", "to whom; * is everybody"}, "*");
    if (text.empty() || config.is_describing()) continue;
    if (!parse_do(text, row)) config.wrong(prefix + "do", std::string(pilot_words));
    const auto trigger = parse_trigger(row.at);
    if (!trigger) {
      config.wrong(prefix + "at", trigger.error().message);
    } else if (trigger->of_a_path()) {
      config.wrong(prefix + "at", "must be no moment of a path: a pilot flies none");
    } else {
      row.trigger = *trigger;
    }
    if (row.flies()) row.for_ns = usual_for_ns;
    if (!lasts.empty()) {
      const auto duration = parse_time(lasts);
      if (!duration || *duration <= 0 || !row.flies()) {
        config.wrong(prefix + "for", "must be a time as 2s, and goes with fly alone");
      } else {
        row.for_ns = *duration;
      }
    }
    if (row.steer) row.reaction_ns = usual_reaction_ns;
    if (!reaction.empty()) {
      const auto duration = parse_time(reaction);
      if (!duration || *duration < 0 || *duration > max_reaction_ns || !row.steer) {
        config.wrong(prefix + "reaction", "must be a time as 300ms, 5 s at most, and goes with steer alone");
      } else {
        row.reaction_ns = *duration;
      }
    }
    if (row.sees_path && !row.steer) config.wrong(prefix + "sees", "goes with steer alone");
    if (drone != "*") row.drone = drone;
    bool flies_here = row.drone.empty();
    for (int k = 1; k <= drones; ++k) flies_here = flies_here || drone_name(k) == row.drone;
    if (!flies_here) config.wrong(prefix + "drone", "must be one that flies here, or *");
    rows.push_back(std::move(row));
  }
  return rows;
}

std::string pilot_text(const std::vector<PilotRow>& rows) {
  std::string text;
  for (const PilotRow& row : rows) {
    text += fmt::format("\n[[pilot]]\ndo = \"{}\"\nat = \"{}\"\n", row.text, row.at);
    if (row.flies()) text += fmt::format("for = \"{}\"\n", time_text(row.for_ns));
    if (row.steer)
      text += fmt::format("reaction = \"{}\"\nsees = \"{}\"\n", time_text(row.reaction_ns),
                          row.sees_path ? "path" : "state");
    if (!row.drone.empty()) text += fmt::format("drone = \"{}\"\n", row.drone);
  }
  return text;
}

SteeringPilot::SteeringPilot(const PilotRow& row, const WorldConfig& config, const DroneObservation& drone)
    : course_(course_of(config, drone.number, drone.start_m)),
      speed_mps_(task_of(config, drone.number).speed_mps),
      end_m_(course_.length_m() * task_of(config, drone.number).laps),
      sees_path_(row.sees_path),
      reaction_ns_(row.reaction_ns) {}

std::optional<Twist> SteeringPilot::steer(TimeNs now, const ground::FlightCore& ground, std::size_t drone) {
  const ground::IntakeState& intake = ground.intake(drone);
  if (intake.has_state && intake.state.pose_stamp_ns != 0) {
    Shown shown{now, intake.state.position_m, intake.state.yaw_rad};
    const auto path = sees_path_ ? ground.committed(now, drone) : std::nullopt;
    if (path) shown.position_m = {path->predicted_m.x(), path->predicted_m.y(), path->predicted_m.z()};
    shown_.push_back(shown);
  }
  while (shown_.size() > 1 && shown_[1].t_ns <= now - reaction_ns_) shown_.pop_front();
  if (shown_.empty() || shown_.front().t_ns > now - reaction_ns_) return std::nullopt;
  const Shown& seen = shown_.front();
  const Eigen::Vector2d at(seen.position_m[0], seen.position_m[1]);
  double nearest_m = (course_.point(at_m_) - at).norm();
  const double from_m = at_m_;
  for (double s = from_m; s <= from_m + search_m; s += search_step_m) {
    const double distance_m = (course_.point(s) - at).norm();
    if (distance_m > nearest_m) continue;
    nearest_m = distance_m;
    at_m_ = s;
  }
  if (is_through()) return std::nullopt;
  const double ahead_m = std::max(least_look_ahead_m, look_ahead_s * speed_mps_);
  const Eigen::Vector2d way = course_.point(std::min(at_m_ + ahead_m, end_m_)) - at;
  const Eigen::Vector2d ahead_mps = speed_mps_ * (Eigen::Rotation2Dd(-seen.yaw_rad) * way.normalized());
  Twist sticks;
  sticks.linear_mps = {
      ahead_mps.x(), ahead_mps.y(),
      std::clamp(climb_gain_per_s * (course_.height_m(at_m_, ground::ControllerConfig{}.height_m) - seen.position_m[2]),
                 -max_climb_mps, max_climb_mps)};
  return sticks;
}

Pilot::Pilot(const std::vector<PilotRow>& rows, const WorldConfig& config,
             const std::vector<DroneObservation>& drones) {
  for (const PilotRow& row : rows) {
    Row& one = rows_.emplace_back(Row{row, TriggerWatch(row.trigger, row.drone, drones)});
    if (!row.steer) continue;
    for (const std::size_t drone : one.watch.drones) one.steering.emplace_back(row, config, drones[drone]);
  }
}

void Pilot::steer(Row& one, SimulatedWorld& world) {
  const ground::FlightCore* const ground = world.ground();
  if (!ground) return;
  one.over = true;
  for (std::size_t i = 0; i < one.steering.size(); ++i) {
    SteeringPilot& pilot = one.steering[i];
    const std::size_t drone = one.watch.drones[i];
    if (pilot.is_through()) continue;
    ground::PilotCommand command{.drone = drone, .came_ns = world.now()};
    command.velocity = pilot.steer(world.now(), *ground, drone);
    command.land = pilot.is_through();
    one.over = one.over && command.land;
    if (command.velocity || command.land) world.post_command(command);
  }
}

void Pilot::step(SimulatedWorld& world) {
  const TimeNs now = world.now();
  for (Row& one : rows_) {
    const PilotRow& row = one.row;
    if (one.over || !one.watch.is_due(now, world.drones()) || now < one.next_ns) continue;
    if (one.begun_ns < 0) one.begun_ns = now;
    one.next_ns = now + again_ns;
    if (row.steer) {
      steer(one, world);
      continue;
    }
    one.over = !row.flies() || one.next_ns >= one.begun_ns + row.for_ns;
    if (row.mission) {
      world.post_mission_command(*row.mission);
      continue;
    }
    for (const std::size_t drone : one.watch.drones) {
      ground::PilotCommand command{.drone = drone, .came_ns = now};
      if (row.flies()) command.velocity = row.velocity;
      command.takeoff = row.takeoff;
      command.land = row.land;
      command.stop = row.stop;
      command.cut = row.cut;
      world.post_command(command);
    }
  }
}

std::vector<std::string> Pilot::never_said() const {
  std::vector<std::string> texts;
  for (const Row& one : rows_) {
    if (one.begun_ns < 0)
      texts.push_back(fmt::format("the pilot's \"{}\" at \"{}\" never came", one.row.text, one.row.at));
  }
  return texts;
}

}  // namespace ledgerline::hil
