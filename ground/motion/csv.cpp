#include "ground/motion/csv.hpp"

#include <fmt/format.h>

#include <charconv>

#include "common/base/text.hpp"

namespace ledgerline::motion {
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

Result<Waypoint> waypoint_of(std::span<const std::string_view> cells, double max_coordinate_m) {
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

}  // namespace ledgerline::motion
