#include "ground/motion/waypoints.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>
#include <utility>

#include "common/base/enum_count.hpp"
#include "common/base/text.hpp"

namespace ledgerline::ground::motion {
namespace {

constexpr std::size_t min_points = 3;
constexpr double closing_m = 0.3;  // beyond the bend of any corner, which misses its corner by 7 cm at most

Status check_from(const Waypoint& point, const Eigen::Vector2d& from_m) {
  if (const double far_m = (point.at_m - from_m).norm(); !(far_m <= max_distance_m))
    return Error{fmt::format("is {:.1f} m away; {} m may be", far_m, max_distance_m)};
  return check_limits(point);
}

bool is_heading(const std::vector<std::string_view>& cells) { return cells[0] == "x"; }

}  // namespace

const std::vector<std::string>& shape_names() {
  constexpr std::array words{"square", "triangle", "x", "eight"};
  static_assert(words.size() == enum_count<Shape>);
  static const std::vector<std::string> names(words.begin(), words.end());
  return names;
}

std::string name_of(Shape shape) { return shape_names()[static_cast<std::size_t>(shape)]; }

Result<Shape> shape_from_name(const std::string& name) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x, Shape::eight}) {
    if (name == name_of(shape)) return shape;
  }
  return Error{fmt::format("no shape \"{}\": square, triangle, x or eight", name)};
}

std::vector<Waypoint> waypoints_of(Shape shape, double side_m) {
  std::vector<Waypoint> points;
  const auto add = [&](double x, double y) { points.push_back({side_m * Eigen::Vector2d(x, y)}); };
  switch (shape) {
    case Shape::square:
      for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) add(x, y);
      break;
    case Shape::triangle:
      for (const auto& [x, y] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {0.5, std::sqrt(3.0) / 2}}) add(x, y);
      break;
    case Shape::x:
      for (const auto& [x, y] : {std::pair{0, 0}, {1, 1}, {1, 0}, {0, 1}}) add(x, y);
      break;
    case Shape::eight: {
      constexpr int pieces = 96;
      for (int i = 0; i < pieces; ++i) {
        const double t = std::numbers::pi * (1 - 2.0 * i / pieces);
        add(0.5 * (1 + std::cos(t)), -0.25 * std::sin(2 * t));
      }
      break;
    }
  }
  return points;
}

Result<std::vector<Waypoint>> path_from_csv(std::string_view text, const std::string& file) {
  std::vector<Waypoint> points;
  bool first = true;
  for (CsvLines lines(text); lines.next();) {
    const int number = lines.number();
    const auto cells = cells_of(lines.line());
    if (std::exchange(first, false) && is_heading(cells)) continue;
    const auto point = waypoint_of(cells);
    if (!point) return Error{fmt::format("{}:{}: {}", file, number, point.error().message)};
    if (!points.empty() && (point->at_m - points.back().at_m).norm() < min_apart_m)
      return Error{fmt::format("{}:{}: closer than 1 cm to the point before", file, number)};
    if (points.size() == max_waypoints)
      return Error{fmt::format("{}:{}: more than {} points", file, number, max_waypoints)};
    points.push_back(*point);
    points.back().line = number;
  }
  if (points.empty()) return Error{file + ": has no point"};
  return points;
}

Result<std::vector<Waypoint>> waypoints_from_csv(std::string_view text, const std::string& file) {
  auto points = path_from_csv(text, file);
  if (!points) return points;
  if (points->size() < min_points)
    return Error{fmt::format("{}: {} points, at least {} are needed", file, points->size(), min_points)};
  if ((points->back().at_m - points->front().at_m).norm() < min_apart_m)
    return Error{fmt::format("{}:{}: the first point again: the path closes by itself", file, points->back().line)};
  const Eigen::Vector2d origin = points->front().at_m;
  for (Waypoint& point : *points) {
    point.at_m -= origin;
    if (point.at_m.norm() > max_distance_m)
      return Error{fmt::format("{}:{}: more than {} m from the first point", file, point.line, max_distance_m)};
  }
  return points;
}

std::string moved_note(std::string_view text, const std::string& file) {
  const auto points = path_from_csv(text, file);
  if (!points || points->front().at_m.norm() < min_apart_m) return "";
  return fmt::format("{}:{}: {:g}, {:g} is flown from where the drone takes off, wherever that is", file,
                     points->front().line, points->front().at_m.x(), points->front().at_m.y());
}

std::string decimal_comma_note(const std::string& text, const std::string& file) {
  constexpr std::size_t all = 4;
  const auto is_whole = [](std::string_view cell) {
    if (cell.starts_with('-')) cell.remove_prefix(1);
    return !cell.empty() && cell.find_first_not_of("0123456789") == std::string_view::npos;
  };
  std::string note;
  bool first = true;
  for (CsvLines lines(text); lines.next();) {
    const auto cells = cells_of(lines.line());
    if (std::exchange(first, false) && is_heading(cells)) return "";  // its columns have names
    if (cells.size() != all || !std::ranges::all_of(cells, is_whole)) return "";
    // Most telling is a row whose decimals would be some.
    if (note.empty() && (cells[1] != "0" || cells[3] != "0"))
      note = fmt::format(
          "{}:{}: read as x {}, y {}, z {} m and {} m/s; if {},{} and {},{} are meant, write points: {}.{},{}.{}", file,
          lines.number(), cells[0], cells[1], cells[2], cells[3], cells[0], cells[1], cells[2], cells[3], cells[0],
          cells[1], cells[2], cells[3]);
  }
  return note;
}

Status check_limits(const Waypoint& point) {
  const auto within = [](const std::optional<double>& value, double min, double max) {
    return !value || (*value >= min && *value <= max);
  };
  if (!within(point.height_m, min_height_m, max_height_m))
    return Error{fmt::format("has z {} m; {} to {} may be", *point.height_m, min_height_m, max_height_m)};
  if (!within(point.speed_mps, min_speed_mps, max_speed_mps))
    return Error{fmt::format("has speed {} m/s; {} to {} may be", *point.speed_mps, min_speed_mps, max_speed_mps)};
  return done;
}

Status check_way(const std::vector<Waypoint>& way, const Eigen::Vector2d& from_m) {
  if (way.empty() || way.size() > max_waypoints)
    return Error{fmt::format("{} waypoints; 1 to {} may be", way.size(), max_waypoints)};
  for (std::size_t i = 0; i < way.size(); ++i) {
    if (const Status checked = check_from(way[i], from_m); !checked)
      return Error{fmt::format("waypoint {} {}", i + 1, checked.error().message)};
    if (i > 0 && (way[i].at_m - way[i - 1].at_m).norm() < min_apart_m)
      return Error{fmt::format("waypoint {} is closer than 1 cm to the one before", i + 1)};
  }
  return done;
}

OpenPath open_path(const Waypoint& here, const std::vector<Waypoint>& way) {
  OpenPath course;
  if ((way.front().at_m - here.at_m).norm() >= min_apart_m) {
    course.waypoints.push_back(here);
    course.waypoints.back().speed_mps = way.front().speed_mps;
    course.first = 1;
  }
  course.waypoints.insert(course.waypoints.end(), way.begin(), way.end());
  course.last = course.waypoints.size() - 1;
  course.origin_m = course.waypoints.front().at_m;
  for (Waypoint& waypoint : course.waypoints) waypoint.at_m -= course.origin_m;

  // A single place has no direction: any will do.
  Eigen::Vector2d out(1, 0), in(1, 0);
  if (course.last > 0) {
    in = (course.waypoints[1].at_m - course.waypoints[0].at_m).normalized();
    out = (course.waypoints[course.last].at_m - course.waypoints[course.last - 1].at_m).normalized();
  }
  Waypoint behind{course.waypoints[course.last].at_m + closing_m * out, course.waypoints[course.last].height_m};
  const Waypoint before{-closing_m * in, course.waypoints[0].height_m};
  // There and back again: the closing pieces must not be of no length.
  if ((behind.at_m - before.at_m).norm() < 0.5 * closing_m) behind.at_m += closing_m * out;
  course.waypoints[course.last].speed_mps.reset();
  course.waypoints.push_back(behind);
  course.waypoints.push_back(before);
  return course;
}

namespace {

constexpr std::size_t max_shown = 64;  // bytes of a cell that is given back in an error

std::string_view trimmed(std::string_view text) {
  const auto from = text.find_first_not_of(" \t\r");
  if (from == std::string_view::npos) return {};
  return text.substr(from, text.find_last_not_of(" \t\r") - from + 1);
}

Result<double> number_in(std::string_view cell, const char* what, double min, double max) {
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc{} || end != cell.data() + cell.size() || !(value >= min && value <= max))
    return Error{fmt::format("{} \"{}\" is no number from {} to {}", what, printable(cell, max_shown), min, max)};
  return value;
}

}  // namespace

CsvLines::CsvLines(std::string_view text) : rest_(text) {
  constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";
  if (rest_.substr(0, byte_order_mark.size()) == byte_order_mark) rest_.remove_prefix(byte_order_mark.size());
}

bool CsvLines::next() {
  while (!rest_.empty()) {
    ++number_;
    const auto end = rest_.find('\n');
    const std::string_view whole = rest_.substr(0, end);
    rest_ = end == std::string_view::npos ? std::string_view{} : rest_.substr(end + 1);
    line_ = trimmed(whole.substr(0, whole.find('#')));
    if (!line_.empty()) return true;
  }
  return false;
}

std::vector<std::string_view> cells_of(std::string_view line) {
  std::vector<std::string_view> cells;
  for (;;) {
    const auto comma = line.find(',');
    cells.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos || cells.size() > max_cells) return cells;
    line.remove_prefix(comma + 1);
  }
}

Result<Waypoint> waypoint_of(std::span<const std::string_view> cells) {
  if (cells.size() < 2 || cells.size() > 4) return Error{fmt::format("{} columns, not x,y[,z[,speed]]", cells.size())};
  const auto x = number_in(cells[0], "x", -max_coordinate_m, max_coordinate_m);
  if (!x) return x.error();
  const auto y = number_in(cells[1], "y", -max_coordinate_m, max_coordinate_m);
  if (!y) return y.error();
  Waypoint point{{*x, *y}};
  if (cells.size() > 2 && !cells[2].empty()) {
    const auto z = number_in(cells[2], "z", min_height_m, max_height_m);
    if (!z) return z.error();
    point.height_m = *z;
  }
  if (cells.size() > 3 && !cells[3].empty()) {
    const auto speed = number_in(cells[3], "speed", min_speed_mps, max_speed_mps);
    if (!speed) return speed.error();
    point.speed_mps = *speed;
  }
  return point;
}

}  // namespace ledgerline::ground::motion
