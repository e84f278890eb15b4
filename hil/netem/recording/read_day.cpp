#include "hil/netem/recording/read_day.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <map>

#include "common/base/file.hpp"
#include "hil/netem/recording/capture.hpp"
#include "hil/netem/recording/lateness.hpp"

namespace ledgerline::hil {
namespace {

/// By its first four bytes: pcap of micro- and nanoseconds in either order of bytes, and pcapng.
bool is_capture(const std::string& path) {
  std::uint32_t magic = 0;
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(&magic), sizeof magic);
  constexpr std::array<std::uint32_t, 5> known{0xa1b2c3d4, 0xd4c3b2a1, 0xa1b23c4d, 0x4d3cb2a1, 0x0a0d0d0a};
  return file && std::find(known.begin(), known.end(), magic) != known.end();
}

Result<MeasuredDay> measured(const std::string& path, const RecordingOptions& asked, std::string& drone) {
  const auto links = read_capture(path);
  if (!links) return links.error();
  const auto link = link_of(*links, asked.drone);
  if (!link) return Error{fmt::format("{}: {}", path, link.error().what)};
  drone = link->drone;
  auto day = asked.answers ? day_of_answers(link->asked) : day_of_states(link->states);
  if (!day) return Error{fmt::format("{}: {}: {}", path, drone, day.error().what)};
  return day;
}

}  // namespace

Result<Day> read_day(const std::string& path) {
  if (is_capture(path)) {
    std::string drone;
    auto day = measured(path, {}, drone);
    if (!day) return day.error();
    auto made = RecordedDay::make(std::move(day->moments));
    if (!made) return Error{fmt::format("{}: {}", path, made.error().what)};
    return made;
  }
  const auto content = read_file(path);
  if (!content) return content.error();
  return parse_day(path, *content);
}

ReadDay reading_days_once(ReadDay read) {
  using Known = std::map<std::string, Day>;
  return [read = std::move(read), known = std::make_shared<Known>()](const std::string& path) -> Result<Day> {
    if (const auto found = known->find(path); found != known->end()) return found->second;
    auto day = read(path);
    if (day) known->emplace(path, *day);
    return day;
  };
}

Result<std::string> table_of_capture(const std::string& path, const RecordingOptions& asked) {
  std::string drone;
  const auto day = measured(path, asked, drone);
  if (!day) return day.error();
  const std::string about =
      asked.answers
          ? fmt::format("# answers of {}: {} came, {} missing; delays are half of the time from command to answer\n",
                        drone, day->came, day->missing)
          : fmt::format("# states of {}: {} came, {} missing, one every {:.3f} ms; delays are beyond the least one\n",
                        drone, day->came, day->missing, day->period_s * 1e3);
  return about + table_of(day->moments);
}

}  // namespace ledgerline::hil
