#include "hil/fault/pilot.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "hil/netem/distribution.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs usual_for_ns = ns_per_s;
constexpr std::string_view pilot_words =
    "must be takeoff, land, stop, cut, mission approve (start, pause, resume, land), or fly X Y Z TURN, in m/s and "
    "rad/s, "
    "as \"fly 0.3 0 0 0\"";

bool parse_do(const std::string& text, PilotRow& row) {
  const auto words = words_of(text);
  row.text = fmt::format("{}", fmt::join(words, " "));
  if (words.size() == 1) {
    row.takeoff = words[0] == "takeoff";
    row.land = words[0] == "land";
    row.stop = words[0] == "stop";
    row.cut = words[0] == "cut";
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
    const std::string text =
        config.text(Key(prefix + "do", "takeoff, land, stop, cut, mission WORD, or fly X Y Z TURN")
                        .like(R"(^\s*(takeoff|land|stop|cut|mission\s+[a-z]+|fly(\s+-?[0-9.]+){4})\s*$)"));
    row.at = config.text({prefix + "at", "when, as of a fault"}, "1s");
    const std::string lasts = config.text({prefix + "for", "of fly: said again for so long"}, "");
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
    if (!row.drone.empty()) text += fmt::format("drone = \"{}\"\n", row.drone);
  }
  return text;
}

Pilot::Pilot(const std::vector<PilotRow>& rows, const std::vector<DroneObservation>& drones) {
  for (const PilotRow& row : rows) rows_.push_back({row, TriggerWatch(row.trigger, row.drone, drones)});
}

void Pilot::step(SimulatedWorld& world) {
  const TimeNs now = world.now();
  for (Row& one : rows_) {
    const PilotRow& row = one.row;
    if (one.over || !one.watch.is_due(now, world.drones()) || now < one.next_ns) continue;
    if (one.begun_ns < 0) one.begun_ns = now;
    one.next_ns = now + again_ns;
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
