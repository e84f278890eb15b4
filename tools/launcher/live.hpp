#pragma once
#include <array>
#include <cstdint>
#include <cstdio>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"

namespace ledgerline::launcher {

/// Lines that a terminal of this size shows without a break or a scroll, so that they can be replaced: cut at its
/// width, and no more than fit. Names and numbers are ASCII.
std::vector<std::string> fitted(std::vector<std::string> lines, std::size_t columns, std::size_t rows);

/// What a person sees while drones fly: a line per drone, rewritten in place on a terminal, one line every few seconds
/// elsewhere. Fed with the status lines of agent and ground; on standard error.
class Live {
 public:
  Live(const std::vector<std::string>& names, bool terminal, TimeNs start_ns);

  /// A status line of agent or ground; others are ignored. False when it is no JSON object.
  bool on_status(const std::string& line);
  /// Prints if it is time to; also, once a drone and reason, that agent goes on refusing its commands.
  void show(TimeNs now_ns);
  /// Text of its own, above the live lines.
  void print(const std::string& text);
  static constexpr std::size_t wide_columns = 120;  ///< of a line with all there is
  /// The lines as they would be shown; for tests too. In less room: shorter, what matters least at the end.
  std::vector<std::string> lines(TimeNs now_ns, std::size_t columns = wide_columns) const;
  /// As ground said last: drones that are in the air, by its phases.
  bool anything_in_air() const;

 private:
  struct Drone {
    std::string name, phase = "waiting", link_phase, mode;
    int lap = 0;
    double progress = 0;
    std::optional<std::array<double, 3>> position_m{};  ///< none: no pose
    std::optional<double> height_m{};                   ///< its own, above take-off
    struct Refused {
      std::uint64_t count = 0, count_before = 0;  ///< now, and when it was looked at last
      int periods = 0;                            ///< in a row in which it grew
    };
    std::map<std::string, Refused> refused{};  ///< by reason, as agent says
    double state_age_ms = -1, command_age_ms = -1, two_way_ms = -1;
  };
  void clear();
  void report_refusals(TimeNs now_ns);

  std::vector<Drone> drones_;
  std::uint64_t height_ = 0;
  bool terminal_;
  TimeNs start_ns_;
  TimeNs next_ns_ = 0, next_refusals_ns_ = 0;
  std::size_t shown_ = 0;
};

}  // namespace ledgerline::launcher
