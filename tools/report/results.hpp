#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/rt/histogram.hpp"
#include "common/rt/trace.hpp"
#include "ground/core/path.hpp"
#include "tools/launcher/configs.hpp"
#include "tools/launcher/launcher.hpp"
#include "tools/launcher/machine.hpp"

namespace ledgerline::report {

struct Sample {
  double t_s = 0;  ///< since the flight began
  double ms = 0;
};

/// Where a drone that flies by onboard odometry reported itself, against where it was; horizontally.
struct ReportedPosition {
  double t_s = 0;                   ///< since the flight began
  double three_sigma_m = 0;         ///< three standard deviations along the worse axis, as it reported
  std::optional<double> error_m{};  ///< none: no truth, a real drone
};
struct ReportedMetrics {
  std::size_t count = 0;
  double max_three_sigma_m = 0;
  std::optional<double> rms_error_m{}, max_error_m{};
  std::optional<double> inside{};  ///< share of errors within what was reported, 0..1
};

/// Where a drone was, as link reported it; simulated or real.
struct FlownMoment {
  double t_s = 0;                      ///< since the flight began
  std::array<double, 3> position_m{};  ///< map; without a pose x and y are NaN, and z is the drone's own height
  double speed_mps = 0;                ///< over the last 0.3 s; 0: not known yet; NaN without a pose
  double battery = 0;                  ///< 0..1; 0: not known yet
};
/// Names as common/msg/names.hpp has them.
struct ModeChange {
  double t_s = 0;
  std::string phase, mode, cause;
};

struct DroneResult {
  std::string id;
  std::vector<Sample> two_way, age;
  Quantiles two_way_ms, age_ms;
  double cross_track_rms_m = 0, cross_track_max_m = 0;
  bool path_flown = false;  ///< there is a cross-track error to speak of
  std::vector<double> lap_s;
  struct Turn {
    double asked_mps = 0, flown_mps = 0, rms_m = 0, max_m = 0;
  };
  std::vector<Turn> turns;                         ///< laps, by the truth
  std::optional<double> limit_mps, slowed_to_mps;  ///< the latency-aware limit at the end; the least that slowed it
  struct States {
    std::uint64_t sampled = 0, sent = 0, on_ledger = 0, merged = 0, dropped = 0;
  };
  struct Transitions {
    std::uint64_t made = 0, on_ledger = 0, lost = 0;
  };
  struct Commands {
    std::uint64_t sent = 0, on_ledger = 0, refused = 0, applied = 0, late = 0, dropped = 0;
  };
  States states;
  Transitions transitions;  ///< of the failsafe
  Commands commands;
  std::map<std::string, std::uint64_t> reasons;  ///< of those refused by agent or dropped by link
  std::vector<std::array<double, 2>> wanted, flown;
  std::vector<FlownMoment> moments;
  std::vector<ModeChange> modes;
  std::string why;                         ///< what went wrong, or who stopped it
  std::vector<ReportedPosition> reported;  ///< empty: no variance was reported, as with motion capture
};

/// A command to the proxy or the shim: by the script of --faults, at ground's page, or by `ledgerline hil faults`.
struct SwitchedFault {
  double t_s = 0;  ///< since the flight began; of before it: below 0
  std::string command;
};

struct Results {
  launcher::Options asked;
  std::vector<SwitchedFault> faults;
  launcher::Machine machine;
  std::string storage;
  std::uint64_t blocks = 0, transactions = 0;
  double bytes_per_drone_hour = 0;                        ///< that the ledger grows on its file system
  std::map<std::string, std::uint64_t> restarts;          ///< of Fabric's processes, by name; those that were restarted
  std::map<std::string, std::uint64_t> onboard_restarts;  ///< of RouDi, link and agent
  std::vector<std::pair<std::string, std::string>> ended_early;  ///< programs that ended unasked in flight, and how
  Quantiles disk_ms;                                             ///< how long blocks took to be on disk
  std::vector<DroneResult> drones;
  Quantiles two_way_ms, age_ms;  ///< of all drones
  double flight_s = 0;
  double messages_per_s = 0, transactions_per_s = 0;
  std::map<std::string, double> cpu_percent;
  std::map<std::string, double> memory_mb;  ///< proportional set size
  bool ok = false;
  std::string why;
  std::vector<std::string> missing;  ///< traces and summaries that a program did not leave
};

/// Of drones that the flight did not simulate: why there is no error figure.
inline constexpr const char* no_truth = "no truth: a real drone";

/// Reads what the programs left in the directory of the run. Files that are missing (a crash) leave their metrics at
/// zero and are named in `missing`.
Results read_results(const launcher::RunFiles& files, const launcher::Options& asked,
                     const launcher::RunRecord& record);

/// Time from each record's stamp to itself, the first of each id alone: two-way latency of command_verified, age at
/// application of command_applied.
std::vector<Sample> latencies(const std::vector<TraceRecord>& trace, TraceKind kind, std::uint16_t drone,
                              TimeNs begin_ns);
Quantiles quantiles_of(const std::vector<Sample>& samples);

/// Distance of the true positions to the path, from begin_ns to end_ns.
struct CrossTrack {
  double rms_m = 0, max_m = 0;
  std::uint64_t count = 0;
};
CrossTrack cross_track(const std::vector<TraceRecord>& truth, std::uint16_t drone, const ground::Path& path,
                       TimeNs begin_ns, TimeNs end_ns);

/// What link sampled with a variance since begin_ns; where there is a truth, while the drone flew.
std::vector<ReportedPosition> reported_positions(const std::vector<TraceRecord>& link,
                                                 const std::vector<TraceRecord>& truth, std::uint16_t drone,
                                                 TimeNs begin_ns);
/// Nothing where no variance was reported.
std::optional<ReportedMetrics> metrics_of(const std::vector<ReportedPosition>& reported);

/// Of link's trace, of one drone, between these times.
std::vector<FlownMoment> flown_moments(const std::vector<TraceRecord>& link, std::uint16_t drone, TimeNs begin_ns,
                                       TimeNs end_ns);
std::vector<ModeChange> mode_changes(const std::vector<TraceRecord>& link, std::uint16_t drone, TimeNs begin_ns,
                                     TimeNs end_ns);

/// The object of `fly --json`.
nlohmann::json to_json(const Results& results);
/// The table for a terminal.
std::string to_table(const Results& results);
/// The page: self-contained, with Chart.js inlined from `chart_js`.
Result<std::string> to_page(const Results& results, const std::string& chart_js);
/// Where Debian's libjs-chart.js puts it.
inline constexpr const char* chart_js_file = "/usr/share/javascript/chart.js/chart.min.js";

/// The faults, one a line, and where they came from; empty: there were none.
std::vector<std::string> fault_lines(const Results& results);

/// What differs from the published setting, one difference a line.
std::vector<std::string> differences(const Results& results);

/// Two-way latency as published for the bridge that this project starts from, in seconds: box (quartiles) and whiskers.
struct PublishedBox {
  std::string_view name;
  double low_s, q1_s, median_s, q3_s, high_s;
};
inline constexpr std::array published_boxes{
    PublishedBox{"square", .313, .396, .456, .525, .711},
    PublishedBox{"triangle", .295, .387, .458, .512, .697},
    PublishedBox{"x", .316, .439, .521, .618, .879},
    PublishedBox{"3 drones", .529, .731, .802, .873, 1.081},
};

/// The box to stand beside a flight.
constexpr const PublishedBox& published_for(std::string_view shape, int drones) {
  for (const PublishedBox& box : published_boxes) {
    if (drones > 1 ? box.name == "3 drones" : box.name == shape) return box;
  }
  return published_boxes[0];
}

}  // namespace ledgerline::report
