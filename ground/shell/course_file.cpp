#include "ground/shell/course_file.hpp"

#include <fmt/format.h>

#include "common/rt/file.hpp"

namespace ledgerline::ground {

Result<Course> course_from(const std::string& shape_or_file) {
  if (const auto shape = shape_from_name(shape_or_file)) return Course{*shape, {}};
  const auto text = read_file(shape_or_file);
  if (!text) {
    return Error{fmt::format("\"{}\" is neither square, triangle, x nor eight, nor a file of waypoints: {}",
                             shape_or_file, text.error().what)};
  }
  auto waypoints = motion::waypoints_from_csv(*text, shape_or_file);
  if (!waypoints) return waypoints.error();
  return Course{Shape::square, std::move(waypoints).value()};
}

}  // namespace ledgerline::ground
