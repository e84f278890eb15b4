#include "hil/fault/scenarios.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/nearest_word.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;

constexpr const char* installed_folder = "share/ledgerline/scenarios";
constexpr const char* source_folder = "hil/scenarios";
constexpr const char* whole_library = "all";
constexpr int max_levels = 4;  // from build/PRESET up to the tree

bool is_folder(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error);
}

/// A scenario, all of a group, or the whole library.
Result<std::vector<std::string>> in_library(const std::string& name, const std::string& folder) {
  const auto files = scripts_in(folder);
  std::vector<std::string> found, known;
  for (const std::string& file : files ? *files : std::vector<std::string>()) {
    known.insert(known.end(), {name_of_script(file), group_of(file, folder)});
    if (name == whole_library || name_of_script(file) == name || group_of(file, folder) == name) found.push_back(file);
  }
  if (!found.empty()) return found;
  const std::string near = did_you_mean("", name, known);
  return Error{
      fmt::format("there is no file {}, and no scenario or group of this name in {} ({}{}`ledgerline fault list`)",
                  name, folder, near, near.empty() ? "" : " ")};
}

}  // namespace

Result<std::string> scenario_folder(const std::string& prefix) {
  const fs::path beside = fs::path(prefix) / installed_folder;
  if (is_folder(beside)) return beside.string();
  fs::path tree = prefix;
  for (int level = 0; level < max_levels && tree.has_relative_path(); ++level, tree = tree.parent_path()) {
    if (is_folder(tree / source_folder)) return (tree / source_folder).string();
  }
  return Error{fmt::format("the scenarios that come with the program are neither in {} nor in {} of a tree around {}",
                           beside.string(), source_folder, prefix)};
}

Result<std::vector<std::string>> scripts_in(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (auto entry = fs::recursive_directory_iterator(folder, error); !error && entry != fs::end(entry);
       entry.increment(error)) {
    if (entry->path().extension() == ".toml") files.push_back(entry->path().string());
  }
  if (error) return Error{fmt::format("{}: {}", folder, error.message())};
  if (files.empty()) return Error{fmt::format("there is no *.toml in {}", folder)};
  std::sort(files.begin(), files.end());
  return files;
}

Result<std::vector<std::string>> scripts_named(const std::vector<std::string>& names, const std::string& prefix) {
  std::vector<std::string> files;
  for (const std::string& name : names) {
    std::error_code error;
    if (is_folder(name)) {
      auto below = scripts_in(name);
      if (!below) return below.error();
      files.insert(files.end(), below->begin(), below->end());
    } else if (fs::exists(name, error)) {
      files.push_back(name);
    } else {
      const auto folder = scenario_folder(prefix);
      if (!folder) return Error{fmt::format("there is no file {}, and {}", name, folder.error().message)};
      const auto found = in_library(name, *folder);
      if (!found) return found.error();
      files.insert(files.end(), found->begin(), found->end());
    }
  }
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());
  return files;
}

std::string name_of_script(const std::string& file) { return fs::path(file).stem().string(); }

std::string group_of(const std::string& file, const std::string& folder) {
  const fs::path below = fs::path(file).lexically_relative(folder).parent_path();
  return below.string();
}

namespace {

constexpr const char* first_script_text = R"(# One flight, what goes wrong in it, and what must hold.
#   ledgerline fault check {0}.toml                        what is wrong with this file, by line
#   ledgerline fault run {0}.toml                          one flight; --seeds 1..30 --jobs 2: thirty
#   ledgerline fault list faults                           what can go wrong; `list rules`: what can be demanded
# An editor that knows schemas: `ledgerline fault schema > fault.schema.json`, and this as the first line here:
#   #:schema ./fault.schema.json

title = "{0}: the ledger orders nothing for 3 s; the drone holds, then flies on"

# Each a sentence that the run must keep; what every run must keep besides needs no words.
must = [
  "finishes",
  "hold is seen",
  "resumes within 2 s",
  "nothing acknowledged is lost",
]

# What differs from the usual flight: one drone, a square of 1.5 m a side at 0.5 m/s.
[flight]
speed_mps = 0.8
laps = 2

# As many of these as wanted. `at`: a time of the run, or takeoff, flying, path, "lap 2", "height 0.5", landing, landed,
# each with "+ 2s" behind it if wanted. Without `for` it lasts to the end.
[[fault]]
what = "ledger stall"
at = "path + 3s"
for = "3s"

#[[fault]]
#what = "drone tello1 to delay gamma 50ms 20ms, loss 5%"
#at = "takeoff"
)";

}  // namespace

std::string first_script(const std::string& name) { return fmt::format(fmt::runtime(first_script_text), name); }

}  // namespace ledgerline::hil
