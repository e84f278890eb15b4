#pragma once
#include <string>
#include <vector>

#include "ground/core/path.hpp"

namespace ledgerline::ground {

/// What a command line or a config means by a path.
struct Course {
  Shape shape = Shape::square;
  std::vector<Waypoint> waypoints;  ///< empty: the shape
};

/// A shape's name, or else the name of a CSV file of waypoints (motion::waypoints_from_csv). The error says which
/// shapes there are, or names the file and what is wrong in it.
Result<Course> course_from(const std::string& shape_or_file);

}  // namespace ledgerline::ground
