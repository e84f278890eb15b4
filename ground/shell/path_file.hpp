#pragma once
#include <string>
#include <vector>

#include "ground/core/path.hpp"

namespace ledgerline::ground {

/// What a command line or a config means by a path.
struct PathChoice {
  Shape shape = Shape::square;
  std::vector<Waypoint> waypoints;  ///< empty: the shape
  std::string note{};               ///< what a person should look at in that file; empty: nothing
};

/// A regular file of at most 1 MB, as motion::waypoints_from_csv takes it. The error names it.
Result<std::vector<Waypoint>> read_waypoints(const std::string& file);

/// A shape's name, or else the name of a CSV file of waypoints (motion::waypoints_from_csv). The error says which
/// shapes there are, and `others` that the caller knows beside them, or names the file and what is wrong in it.
Result<PathChoice> path_choice_from(const std::string& shape_or_file, const std::vector<std::string>& others = {});

}  // namespace ledgerline::ground
