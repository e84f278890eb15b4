#include "hil/fault/own/course_keys.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "ground/shell/course_file.hpp"

namespace ledgerline::hil {
namespace {

constexpr std::size_t max_waypoints = 500;

std::string row_of(const ground::Waypoint& waypoint) {
  std::string row = fmt::format("{},{}", waypoint.at_m.x(), waypoint.at_m.y());
  if (waypoint.height_m || waypoint.speed_mps)
    row += "," + (waypoint.height_m ? fmt::format("{}", *waypoint.height_m) : std::string());
  if (waypoint.speed_mps) row += fmt::format(",{}", *waypoint.speed_mps);
  return row;
}

}  // namespace

void read_course(Config& config, const std::string& prefix, const std::string& folder, ground::Task& task) {
  const std::string shape = config.text(
      Key(prefix + "shape", "square, triangle, x, eight, or a CSV file of x,y[,z[,speed]] rows beside the script")
          .like(R"(^(square|triangle|x|eight|.*[./].*)$)"),
      "");
  const auto rows = config.texts({prefix + "waypoints", "the same rows here, in the place of a shape"}, max_waypoints);
  task.side_m = config.number({prefix + "side_m", "of a shape"}, task.side_m, 0.3, 20);
  task.speed_mps = config.number({prefix + "speed_mps", "along the path"}, task.speed_mps, 0.05, 3);
  task.laps = static_cast<int>(config.integer({prefix + "laps", "around the path"}, task.laps, 1, 100));
  if (!shape.empty() && !rows.empty()) {
    config.wrong(prefix + "waypoints", "must not be there beside a shape");
    return;
  }
  if (!rows.empty()) {
    auto points = motion::waypoints_from_csv(fmt::format("{}", fmt::join(rows, "\n")), "row");
    if (points) {
      task.waypoints = std::move(*points);
    } else {
      config.wrong(prefix + "waypoints", "must be rows \"x,y[,z[,speed]]\": " + points.error().what);
    }
    return;
  }
  if (shape.empty()) return;
  if (const auto known = ground::shape_from_name(shape)) {
    task.shape = *known;
    task.waypoints.clear();
    return;
  }
  auto course = ground::course_from(shape.front() == '/' || folder.empty() ? shape : folder + "/" + shape);
  if (course) {
    task.waypoints = std::move(course->waypoints);
  } else {
    config.wrong(prefix + "shape", course.error().what);
  }
}

void read_tasks(Config& config, const std::string& folder, WorldConfig& flight) {
  ground::Task common = task_of(flight, 0);
  read_course(config, "flight.", folder, common);
  flight.shape = common.shape;
  flight.side_m = common.side_m;
  flight.waypoints = common.waypoints;
  flight.speed_mps = common.speed_mps;
  flight.laps = common.laps;
  for (std::size_t i = 0; i < config.table_count({"task", "what one drone flies in the place of [flight]'s course"});
       ++i) {
    const std::string prefix = fmt::format("task.{}.", i);
    const std::string name = config.text({prefix + "drone", "whose course it is"});
    ground::Task task = common;
    read_course(config, prefix, folder, task);
    int number = 1;
    while (number <= flight.drones && drone_name(number) != name) ++number;
    if (config.describes() || name.empty()) continue;
    if (number > flight.drones) {
      config.wrong(prefix + "drone",
                   fmt::format("must be one that flies here: {} to {}", drone_name(1), drone_name(flight.drones)));
    } else if (!flight.tasks.emplace(number, std::move(task)).second) {
      config.wrong(prefix + "drone", "must be another one: it has a task already");
    }
  }
}

std::string course_text(const ground::Task& task, const ground::Task& usual) {
  std::string text;
  if (!task.waypoints.empty()) {
    text += "waypoints = [";
    for (const ground::Waypoint& waypoint : task.waypoints) text += fmt::format("\n  \"{}\",", row_of(waypoint));
    text += "\n]\n";
  } else if (task.shape != usual.shape || !usual.waypoints.empty()) {
    text += fmt::format("shape = \"{}\"\n", ground::name_of(task.shape));
  }
  if (task.side_m != usual.side_m) text += fmt::format("side_m = {}\n", task.side_m);
  if (task.speed_mps != usual.speed_mps) text += fmt::format("speed_mps = {}\n", task.speed_mps);
  if (task.laps != usual.laps) text += fmt::format("laps = {}\n", task.laps);
  return text;
}

std::string course_rows(const ground::Task& task) {
  std::string rows;
  for (const ground::Waypoint& waypoint : task.waypoints) rows += row_of(waypoint) + "\n";
  return rows;
}

std::string tasks_text(const WorldConfig& flight) {
  std::string text;
  const ground::Task common = task_of(flight, 0);
  for (const auto& [number, task] : flight.tasks)
    text += fmt::format("\n[[task]]\ndrone = \"{}\"\n", drone_name(number)) + course_text(task, common);
  return text;
}

double greatest_height_m(const WorldConfig& flight) {
  const double usual_m = ground::ControllerConfig{}.height_m;
  double height_m = usual_m;
  for (int k = 1; k <= flight.drones; ++k) {
    for (const ground::Waypoint& waypoint : task_of(flight, k).waypoints)
      height_m = std::max(height_m, waypoint.height_m.value_or(usual_m));
  }
  return height_m;
}

}  // namespace ledgerline::hil
