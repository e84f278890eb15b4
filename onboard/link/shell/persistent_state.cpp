#include "onboard/link/shell/persistent_state.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>

#include "common/base/file.hpp"

namespace ledgerline::link {
namespace {

constexpr std::string_view first_line = "ledgerline-link local stops 1\n";
constexpr std::string_view sum_word = "sum ";

// FNV-1a: detects a torn or overwritten file, not one that somebody forged, who could as well write the right one.
std::uint64_t sum_of(std::string_view text) {
  std::uint64_t sum = 0xcbf29ce484222325U;
  for (const char c : text) sum = (sum ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
  return sum;
}

/// The lines between the first and the last one; none: it is not whole.
std::optional<std::vector<std::string>> names_in(std::string_view text) {
  const auto sum_at = text.rfind(sum_word);
  if (!text.starts_with(first_line) || sum_at == std::string_view::npos || sum_at < first_line.size() ||
      text.substr(sum_at) != fmt::format("{}{:016x}\n", sum_word, sum_of(text.substr(0, sum_at))))
    return std::nullopt;
  std::vector<std::string> names;
  std::istringstream lines(std::string(text.substr(first_line.size(), sum_at - first_line.size())));
  for (std::string name; std::getline(lines, name);) names.push_back(name);
  return names;
}

}  // namespace

LocalStopsFile::LocalStopsFile(std::string path, std::vector<DroneSettings> drones)
    : path_(std::move(path)), drones_(std::move(drones)) {}

Result<DroneSet> LocalStopsFile::read() {
  kept_ = text_of({});  // what no file says
  std::error_code error;
  const bool missing = std::filesystem::symlink_status(path_, error).type() == std::filesystem::file_type::not_found;
  if (path_.empty() || missing) return DroneSet{};
  kept_.clear();  // to be rewritten, if it is not whole
  const auto text = read_file(path_);
  if (!text) return Error{fmt::format("output.local_stops: {}", text.error().message)};
  const auto names = names_in(*text);
  if (!names) return Error{fmt::format("output.local_stops: {} is damaged", path_)};
  DroneSet stopped;
  for (const std::string& name : *names) {
    const auto drone =
        std::find_if(drones_.begin(), drones_.end(), [&](const DroneSettings& d) { return d.name == name; });
    if (drone == drones_.end()) {
      others_.push_back(name);
    } else {
      stopped.set(drone->number);
    }
  }
  kept_ = *text;
  return stopped;
}

std::string LocalStopsFile::text_of(const DroneSet& stopped) const {
  std::string text(first_line);
  for (const DroneSettings& drone : drones_) {
    if (stopped.test(drone.number)) text += drone.name + "\n";
  }
  for (const std::string& name : others_) text += name + "\n";
  return text + fmt::format("{}{:016x}\n", sum_word, sum_of(text));
}

Status LocalStopsFile::store(const DroneSet& stopped) {
  if (path_.empty()) return done;
  std::string text = text_of(stopped);
  if (text == kept_) return done;
  if (auto status = replace_file(path_, text, 0600); !status)
    return Error{fmt::format("output.local_stops: {}", status.error().message)};
  kept_ = std::move(text);
  return done;
}

Result<int> record_start(const std::string& file, TimeNs now) {
  // Slots of the newest starts, the oldest of which gives way: one write, so that a kill tears nothing.
  std::array<TimeNs, 64> starts{};
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  const auto failed = [&] { return Error{fmt::format("output.starts: {}: {}", file, std::strerror(errno))}; };
  if (fd < 0) return failed();
  if (::pread(fd, starts.data(), sizeof starts, 0) != static_cast<ssize_t>(sizeof starts)) starts = {};
  std::size_t oldest = 0;
  int count = 1;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    if (starts[i] <= 0 || starts[i] > now || now - starts[i] > starts_within_ns) starts[i] = 0;
    if (starts[i] != 0) ++count;
    if (starts[i] < starts[oldest]) oldest = i;
  }
  starts[oldest] = now;
  const bool written = ::pwrite(fd, starts.data(), sizeof starts, 0) == static_cast<ssize_t>(sizeof starts);
  const Error error = failed();
  ::close(fd);
  if (!written) return error;
  return std::min(count, static_cast<int>(starts.size()));
}

}  // namespace ledgerline::link
