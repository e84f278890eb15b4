#pragma once
#include <span>
#include <string_view>
#include <vector>

#include "ground/motion/course.hpp"

/// Waypoints as comma-separated text: what every such file has in common. Pure; any thread.
namespace ledgerline::motion {

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

/// x,y[,z[,speed]], empty z or speed as if not there; x and y from -max_coordinate_m to it. The error names the column.
Result<Waypoint> waypoint_of(std::span<const std::string_view> cells, double max_coordinate_m);

}  // namespace ledgerline::motion
