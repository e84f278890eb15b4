#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::ground::motion {

enum class Shape { square, triangle, x, eight };
Result<Shape> shape_from_name(const std::string& name);
std::string name_of(Shape shape);
/// "square", "triangle", "x", "eight".
const std::vector<std::string>& shape_names();

/// What a waypoint of a path of one's own may be.
inline constexpr std::size_t max_waypoints = 500;
inline constexpr double min_apart_m = 0.01;  ///< of two in a row; what is nearer is one place
inline constexpr double min_height_m = 0.3, max_height_m = 10;
inline constexpr double min_speed_mps = 0.05, max_speed_mps = 8;
inline constexpr double max_distance_m = 100;  ///< of a waypoint from where its way begins
/// Of x and y in the map. What is further away is a mistake in writing: a path is within 100 m of its start.
inline constexpr double max_coordinate_m = 1'000;

/// A corner of a path. Metres from the first one, which lies where the drone takes off.
struct Waypoint {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();
  std::optional<double> height_m{};   ///< above the map's zero; else the flight's height
  std::optional<double> speed_mps{};  ///< at most, from here to the next; else the flight's speed
  int line = 0;                       ///< of the file that it came from; 0: none
};

/// A closed path: from each waypoint straight to the next, from the last to the first, which is its origin.
///
///     square        triangle        x                 eight (Gerono's)
///     3 ---- 2         2            3      1           _     _
///     |      |        / \           | \  / |          / \   / \       begins at its left end, 0, upwards;
///     |      |       /   \          | /  \ |         0   \_/   |      as wide as a side, half as high,
///     0 ---- 1      0 --- 1         0      2          \_/ \ _ /       a quarter of a side above and below 0
///
/// The first three stay in the quadrant x >= 0, y >= 0. The x is the two diagonals of a square, joined by two of its
/// sides, so that it closes without turning back on itself. The eight is 96 pieces.
std::vector<Waypoint> waypoints_of(Shape shape, double side_m);

/// A path as text: a line each, `x,y[,z[,speed]]` in metres of the map and m/s, empty z or speed as if not there; `#`
/// begins a comment; a first line may name the columns, `x,y`. 1 to 500 points, no two in a row closer than
/// 1 cm, x and y to 1,000 m, 0.3 <= z <= 10, 0.05 <= speed <= 8. An error names file, line and what is allowed.
Result<std::vector<Waypoint>> path_from_csv(std::string_view text, const std::string& file);

/// The same as a closed path from where a drone takes off: moved so that its first point lies there. 3 points at least,
/// within 100 m of the first.
Result<std::vector<Waypoint>> waypoints_from_csv(std::string_view text, const std::string& file);

/// For a person, where waypoints_from_csv() moves such a file: its drone flies elsewhere than where the file says.
/// Empty: its first point is 0,0, or it has none.
std::string moved_note(std::string_view text, const std::string& file);

/// Where each row of such a file is four whole numbers, it may be two with decimal commas as well ("1,5,1,5"): a note
/// for a person that names the first such row and how it is read, since both are files that somebody may mean. Else
/// empty.
std::string decimal_comma_note(const std::string& text, const std::string& file);

/// The error says what of its height or speed may not be, to be read behind its name.
Status check_limits(const Waypoint& point);

/// Waypoints in metres of the map, of a way that begins at `from_m`: 1 to 500, within 100 m of it, and otherwise what
/// waypoints_from_csv() allows. The error says which one is wrong, counted from 1, and what is allowed.
Status check_way(const std::vector<Waypoint>& way, const Eigen::Vector2d& from_m);

/// A path with an end, as the closed one that Path and Track take. The closing pieces leave its last waypoint straight
/// on and come to its first corner straight on, so that neither is rounded: the way begins and ends at these places
/// themselves. Its follower stops at the arc length of corner `last`; the closing pieces are never flown.
///
///     before --> here --> way[0] --> ... --> way[n-1] --> behind
///        ^                                                  |
///        +--------------------------------------------------+
struct OpenPath {
  std::vector<Waypoint> waypoints;  ///< of the closed path; metres from `origin_m`
  Eigen::Vector2d origin_m = Eigen::Vector2d::Zero();
  std::size_t first = 0;  ///< the corner that is the way's first waypoint: 0 where `here` is that place, else 1
  std::size_t last = 0;   ///< the corner that is the way's last waypoint
};

/// From `here` through all waypoints of `way` (check_way() allows it), which are in metres of the map. Closer than 1 cm
/// to the first waypoint, the path begins at that. On the way there the first waypoint's own limit of speed holds.
OpenPath open_path(const Waypoint& here, const std::vector<Waypoint>& way);

// What every file of comma-separated waypoints has in common.

/// The lines of a text that say something, one after the other: without comments (`#`), blanks around them, a carriage
/// return, and a byte order mark before the first.
class CsvLines {
 public:
  explicit CsvLines(std::string_view text);
  bool next();                                     ///< false: there is no further one
  int number() const { return number_; }           ///< of the line, from 1; all count
  std::string_view line() const { return line_; }  ///< never empty

 private:
  std::string_view rest_, line_;
  int number_ = 0;
};

/// More columns than any table here has.
inline constexpr std::size_t max_cells = 16;
/// Without blanks around them, one more than max_cells at most; valid as long as the line.
std::vector<std::string_view> cells_of(std::string_view line);

/// x,y[,z[,speed]], empty z or speed as if not there. The error names the column.
Result<Waypoint> waypoint_of(std::span<const std::string_view> cells);

}  // namespace ledgerline::ground::motion
