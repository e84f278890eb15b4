#include "tools/launcher/live.hpp"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace ledgerline::launcher {
namespace {

using nlohmann::json;

constexpr TimeNs terminal_period_ns = 200 * ns_per_ms;
constexpr TimeNs log_period_ns = 5 * ns_per_s;
constexpr TimeNs refusals_period_ns = 2 * ns_per_s;  // agent's lines come more often
constexpr int reported_periods = 2;                  // a block that came late costs a command of one

double number(const json& object, const char* key, double otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : otherwise;
}

double count(const json& object, const char* key, double otherwise) {
  return std::clamp(number(object, key, otherwise), 0.0, 1e9);
}

std::string text(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

std::string in_ms(double ms) { return ms < 0 ? "  -  " : fmt::format("{:4.0f} ms", ms); }

/// Where it is: in `map`, or without a pose how high.
std::string place(const std::optional<std::array<double, 3>>& at_m, std::optional<double> height_m, bool narrow) {
  std::string text = height_m ? fmt::format("height {:.2f} m", *height_m) : "-";
  const double step_m = narrow ? 0.1 : 0.01;
  const auto shown = [&](std::size_t i) { return std::abs((*at_m)[i]) < step_m / 2 ? 0 : (*at_m)[i]; };  // no "-0.00"
  if (at_m) text = fmt::format("{:6.2f} {:6.2f} {:5.2f} m", shown(0), shown(1), shown(2));
  if (at_m && narrow) return fmt::format("{:.1f} {:.1f} {:.1f} m", shown(0), shown(1), shown(2));
  return narrow ? text : fmt::format("{:>21}", text);
}

/// What there is in less room.
std::string short_ms(double ms) { return ms < 0 ? "   -" : fmt::format("{:4.0f}", ms); }

}  // namespace

std::vector<std::string> fitted(std::vector<std::string> lines, std::size_t columns, std::size_t rows) {
  const std::size_t most = std::max<std::size_t>(rows, 2) - 1;  // the cursor's own row is below
  if (lines.size() > most) {
    const std::size_t left_out = lines.size() - most + 1;
    lines.resize(most - 1);
    lines.push_back(fmt::format("and {} drones more, for which this terminal has no room", left_out));
  }
  for (std::string& line : lines) {
    if (line.size() > columns) line.resize(columns);
  }
  return lines;
}

Live::Live(const std::vector<std::string>& names, bool terminal, TimeNs start_ns)
    : terminal_(terminal), start_ns_(start_ns) {
  for (const std::string& name : names) {
    Drone drone;
    drone.name = name;
    drones_.push_back(drone);
  }
}

bool Live::on_status(const std::string& line) {
  const json message = json::parse(line, nullptr, false);
  if (!message.is_object()) return false;
  for (const char* who : {"agent", "ground"}) {
    const auto part = message.find(who);
    if (part == message.end() || !part->is_object()) continue;
    height_ = static_cast<std::uint64_t>(count(*part, "height", static_cast<double>(height_)));
    const auto list = part->find("drones");
    if (list == part->end() || !list->is_array()) continue;
    for (const json& one : *list) {
      if (!one.is_object()) continue;
      const auto drone =
          std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.name == text(one, "name", ""); });
      if (drone == drones_.end()) continue;
      if (std::string_view(who) == "ground") {
        drone->phase = text(one, "phase", drone->phase);
        drone->lap = static_cast<int>(count(one, "lap", drone->lap));
        drone->progress = number(one, "progress", drone->progress);
        continue;
      }
      drone->link_phase = text(one, "phase", drone->link_phase);
      drone->mode = text(one, "mode", drone->mode);
      if (const auto refused = one.find("refused_reasons"); refused != one.end() && refused->is_object()) {
        for (const auto& [why, number] : refused->items()) {
          if (number.is_number_unsigned()) drone->refused[why].count = number.get<std::uint64_t>();
        }
      }
      drone->state_age_ms = number(one, "state_age_ms", -1);
      drone->command_age_ms = number(one, "command_age_ms", -1);
      drone->two_way_ms = number(one, "two_way_ms", -1);
      if (const auto height = one.find("height_m"); height != one.end() && height->is_number())
        drone->height_m = height->get<double>();
      const auto position = one.find("position");
      drone->position_m.reset();
      if (position == one.end() || !position->is_array() || position->size() != 3) continue;
      drone->position_m.emplace();
      for (std::size_t i = 0; i < 3; ++i) {
        if ((*position)[i].is_number()) (*drone->position_m)[i] = (*position)[i].get<double>();
      }
    }
  }
  return true;
}

std::vector<std::string> Live::lines(TimeNs now_ns, std::size_t columns) const {
  std::vector<std::string> lines;
  const bool narrow = columns < wide_columns;
  for (const Drone& d : drones_) {
    const bool calm = d.mode.empty() || d.mode == "none";
    std::string phase = d.phase;
    if (d.phase == "path") phase = fmt::format("path {:.0f} %", 100 * d.progress);
    if (d.phase == "path" && (calm || !narrow)) phase += fmt::format(", lap {}", d.lap);
    if (!calm) phase += " (" + d.mode + ")";
    const std::string where = place(d.position_m, d.height_m, narrow);
    if (narrow) {
      lines.push_back(fmt::format("{:4.0f}s {:6} {:16} age {} 2-way {} ms block {} {}", to_seconds(now_ns - start_ns_),
                                  d.name, phase, short_ms(d.state_age_ms), short_ms(d.two_way_ms), height_, where));
      continue;
    }
    lines.push_back(fmt::format("{:5.1f} s  {:8} {:16} {}  state {}  command {}  block {:5}  two-way {}",
                                to_seconds(now_ns - start_ns_), d.name, phase, where, in_ms(d.state_age_ms),
                                in_ms(d.command_age_ms), height_, in_ms(d.two_way_ms)));
  }
  return lines;
}

void Live::clear() {
  // A terminal that shows ^C has moved the cursor from the row's begin.
  if (terminal_ && shown_ > 0) std::fprintf(stderr, "\r\033[%zuA\033[J", shown_);
  shown_ = 0;
}

void Live::print(const std::string& what) {
  clear();
  std::fprintf(stderr, "%s\n", what.c_str());
}

void Live::report_refusals(TimeNs now_ns) {
  if (now_ns < next_refusals_ns_) return;
  next_refusals_ns_ = now_ns + refusals_period_ns;
  for (Drone& drone : drones_) {
    for (auto& [why, refused] : drone.refused) {
      const bool grew = refused.count > std::exchange(refused.count_before, refused.count);
      if (refused.periods == reported_periods) continue;
      refused.periods = grew ? refused.periods + 1 : 0;
      if (refused.periods == reported_periods)
        print(fmt::format("{}: agent refuses its commands: {} (docs/troubleshooting.md)", drone.name, why));
    }
  }
}

void Live::show(TimeNs now_ns) {
  report_refusals(now_ns);
  if (now_ns < next_ns_) return;
  next_ns_ = now_ns + (terminal_ ? terminal_period_ns : log_period_ns);
  clear();
  winsize size{};
  const bool is_sized =
      terminal_ && ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 && size.ws_row > 0;
  auto all = lines(now_ns, is_sized ? size.ws_col : wide_columns);
  if (is_sized) all = fitted(std::move(all), size.ws_col, size.ws_row);
  for (const std::string& line : all) std::fprintf(stderr, "%s\n", line.c_str());
  if (terminal_) shown_ = all.size();
}

bool Live::anything_in_air() const {
  return std::any_of(drones_.begin(), drones_.end(), [](const Drone& d) {
    return d.phase == "takeoff" || d.phase == "path" || d.phase == "manual" || d.phase == "landing" ||
           d.link_phase == "taking_off" || d.link_phase == "flying" || d.link_phase == "landing";
  });
}

}  // namespace ledgerline::launcher
