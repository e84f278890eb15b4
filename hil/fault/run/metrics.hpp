#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "common/rt/histogram.hpp"
#include "hil/fault/checker/rule.hpp"

namespace ledgerline::hil {

/// A metric of a run, by which two builds are compared (hil/fault/compare): a row of the table in metrics.cpp.
struct MetricKind {
  std::string_view name;  ///< with its unit at the end
  std::string_view help;
  double least = 0;            ///< a change below it counts for nothing [the metric's unit]
  bool less_is_worse = false;  ///< otherwise more is
};
std::span<const MetricKind> metric_kinds();
/// Null: there is none of this name.
const MetricKind* metric_kind(std::string_view name);

struct MetricValue {
  std::string_view name;  ///< of a row of the table
  double value = 0;
};
using Metrics = std::vector<MetricValue>;

/// Makes a run's metrics of its moments, of all drones together. A simulated run has a moment each millisecond, a
/// recording of a real one as many as its traces show. Of bounded size; one thread.
class MetricRecorder {
 public:
  explicit MetricRecorder(const Limits& limits) : limits_(limits) {}
  void observe(const Moment& moment);
  /// Those that there was something to see of.
  Metrics finish(TimeNs flown_ns) const;

 private:
  struct Squares {
    double sum = 0;
    std::uint64_t count = 0;
    void add(double value) {
      sum += value * value;
      ++count;
    }
  };
  struct OfDrone {
    FailsafeMode mode = FailsafeMode::none;
    std::array<double, 3> sent{};
    TimeNs sent_ns = 0;
  };
  void observe_drone(const DroneObservation& observation, OfDrone& before, TimeNs passed_ns);
  void observe_distances(const Moment& moment);

  Limits limits_;
  std::vector<OfDrone> drones_;
  Squares off_path_, off_pose_, sent_change_;
  double off_path_max_m_ = 0, off_pose_max_m_ = 0, speed_max_mps_ = 0;
  double beyond_fence_m_ = 0, pose_beyond_fence_m_ = 0;
  std::optional<double> nearest_m_;  ///< of two drones in the air
  Histogram age_;
  std::uint64_t applied_ = 0, holds_ = 0, brakes_ = 0, landings_ = 0;
  TimeNs last_ns_ = 0, flying_ns_ = 0, held_ns_ = 0;
};

}  // namespace ledgerline::hil
