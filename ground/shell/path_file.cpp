#include "ground/shell/path_file.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>

#include "common/base/file.hpp"
#include "common/base/nearest_word.hpp"

namespace ledgerline::ground {
namespace {

constexpr std::uintmax_t max_bytes = 1'000'000;

Result<std::string> read_text(const std::string& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return Error{fmt::format("there is no file {}", file)};
  if (std::filesystem::file_size(file, error) > max_bytes || error)
    return Error{fmt::format("{}: more than 1 MB is no file of waypoints", file)};
  return read_file(file);
}

}  // namespace

Result<std::vector<Waypoint>> read_waypoints(const std::string& file) {
  const auto text = read_text(file);
  if (!text) return text.error();
  return motion::waypoints_from_csv(*text, file);
}

Result<PathChoice> path_choice_from(const std::string& shape_or_file, const std::vector<std::string>& others) {
  if (const auto shape = shape_from_name(shape_or_file)) return PathChoice{*shape, {}};
  std::error_code error;
  if (const auto text = read_text(shape_or_file)) {
    auto waypoints = motion::waypoints_from_csv(*text, shape_or_file);
    if (!waypoints) return waypoints.error();
    std::string note = motion::decimal_comma_note(*text, shape_or_file);
    if (note.empty()) note = motion::moved_note(*text, shape_or_file);
    return PathChoice{Shape::square, std::move(*waypoints), std::move(note)};
  } else if (std::filesystem::exists(shape_or_file, error)) {
    return text.error();
  }
  std::vector<std::string> known = motion::shape_names();
  known.insert(known.end(), others.begin(), others.end());
  return Error{fmt::format("\"{}\" is none of {}, nor a file of waypoints{}", shape_or_file, fmt::join(known, ", "),
                           did_you_mean(": ", shape_or_file, known))};
}

}  // namespace ledgerline::ground
