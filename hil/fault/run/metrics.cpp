#include "hil/fault/run/metrics.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::hil {
namespace {

// `least`: what nobody would call a change, be it ever so certain. Each is near what one more or one less setpoint,
// millisecond or datagram makes of the metric.
constexpr MetricKind metric_table[] = {
    {.name = "path_rms_m", .help = "distance of the truth from the path, root mean square", .least = 0.002},
    {.name = "path_max_m", .help = "the same, at most", .least = 0.01},
    {.name = "pose_rms_m", .help = "distance of what link estimates from the truth, in flight", .least = 0.002},
    {.name = "pose_max_m", .help = "the same, at most", .least = 0.01},
    {.name = "beyond_fence_m", .help = "how far the truth got beyond the fence, in flight", .least = 0.01},
    {.name = "pose_beyond_fence_m", .help = "the same, as link takes it to be", .least = 0.01},
    {.name = "speed_max_mps", .help = "of the truth", .least = 0.02},
    {.name = "sent_change_mps2",
     .help = "how fast the velocity that a drone is sent changes, root mean square",
     .least = 0.02},
    {.name = "nearest_m", .help = "of two drones of which one flies", .least = 0.01, .less_is_worse = true},
    {.name = "command_age_median_ms", .help = "of commands as they are applied, from their state's stamp", .least = 1},
    {.name = "command_age_p95_ms", .help = "the same", .least = 1},
    {.name = "command_age_max_ms", .help = "the same", .least = 2},
    {.name = "commands_hz",
     .help = "commands applied for each second and drone in flight",
     .least = 0.2,
     .less_is_worse = true},
    {.name = "two_way_median_ms",
     .help = "from a state until its command is at the agent, of the agent that ran last",
     .least = 1},
    {.name = "two_way_p95_ms", .help = "the same", .least = 1},
    {.name = "late_percent",
     .help = "of the plans that the link that ran last was given: too late to be flown",
     .least = 0.2},
    {.name = "dropped_percent", .help = "the same: dropped", .least = 0.2},
    {.name = "holds", .help = "how often a drone began to hold in flight", .least = 0.1},
    {.name = "brakes", .help = "the same: to brake", .least = 0.1},
    {.name = "landings", .help = "the same: to be landed by its failsafe", .least = 0.1},
    {.name = "held_s", .help = "held or braked in flight, of all drones together", .least = 0.05},
    {.name = "flown_s", .help = "until the run was over", .least = 0.1},
    {.name = "transactions", .help = "on the ledger", .least = 2},
};

// Of the fence's walls and ceiling: nothing is below the ground.
double beyond_m(const Limits& limits, const std::array<double, 3>& at) {
  double beyond = at[2] - limits.fence_max_m[2];
  for (std::size_t i = 0; i < 2; ++i)
    beyond = std::max({beyond, limits.fence_min_m[i] - at[i], at[i] - limits.fence_max_m[i]});
  return std::max(0.0, beyond);
}

}  // namespace

std::span<const MetricKind> metric_kinds() { return metric_table; }

const MetricKind* metric_kind(std::string_view name) {
  const auto* found = std::ranges::find(metric_table, name, &MetricKind::name);
  return found == std::end(metric_table) ? nullptr : found;
}

void MetricRecorder::observe(const Moment& moment) {
  drones_.resize(moment.drones.size());
  const TimeNs passed_ns = std::max<TimeNs>(0, moment.now - last_ns_);
  last_ns_ = moment.now;
  for (std::size_t i = 0; i < drones_.size(); ++i) observe_drone(moment.drones[i], drones_[i], passed_ns);
  observe_distances(moment);
  for (const WorldEvent& event : moment.events) {
    if (event.kind != WorldEvent::Kind::applied) continue;
    ++applied_;
    age_.add(from_seconds(event.value));
  }
}

void MetricRecorder::observe_drone(const DroneObservation& observation, OfDrone& before, TimeNs passed_ns) {
  if (observation.off_path_m) {
    off_path_.add(*observation.off_path_m);
    off_path_max_m_ = std::max(off_path_max_m_, *observation.off_path_m);
  }
  speed_max_mps_ = std::max(speed_max_mps_, length_of(observation.truth.velocity_mps));
  if (observation.truth.in_flight)
    beyond_fence_m_ = std::max(beyond_fence_m_, beyond_m(limits_, observation.truth.position_m));
  if (observation.phase == LinkPhase::flying) {
    flying_ns_ += passed_ns;
    if (observation.pose) {
      const double off = distance_m(observation.pose->position_m, observation.truth.position_m);
      off_pose_.add(off);
      off_pose_max_m_ = std::max(off_pose_max_m_, off);
      pose_beyond_fence_m_ = std::max(pose_beyond_fence_m_, beyond_m(limits_, observation.pose->position_m));
    }
    if (observation.sent_ns > before.sent_ns && before.sent_ns > 0)
      sent_change_.add(distance_m(observation.sent, before.sent) / to_seconds(observation.sent_ns - before.sent_ns));
  }
  before.sent = observation.sent;
  before.sent_ns = observation.sent_ns;
  const FailsafeMode mode = is_in_flight(observation.phase) ? observation.mode : FailsafeMode::none;
  if (mode != before.mode) {
    if (mode == FailsafeMode::hold) ++holds_;
    if (mode == FailsafeMode::brake) ++brakes_;
    if (mode == FailsafeMode::land) ++landings_;
  }
  before.mode = mode;
  if (mode == FailsafeMode::hold || mode == FailsafeMode::brake) held_ns_ += passed_ns;
}

void MetricRecorder::observe_distances(const Moment& moment) {
  for (std::size_t i = 0; i < moment.drones.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const DroneObservation &a = moment.drones[i], &b = moment.drones[j];
      if (on_ground(a.truth) && on_ground(b.truth)) continue;
      const double metres = distance_m(a.truth.position_m, b.truth.position_m);
      nearest_m_ = std::min(nearest_m_.value_or(metres), metres);
    }
  }
}

Metrics MetricRecorder::finish(TimeNs flown_ns) const {
  Metrics metrics;
  const auto add_rms = [&](std::string_view name, const Squares& squares) {
    if (squares.count > 0) metrics.push_back({name, std::sqrt(squares.sum / static_cast<double>(squares.count))});
  };
  add_rms("path_rms_m", off_path_);
  if (off_path_.count > 0) metrics.push_back({"path_max_m", off_path_max_m_});
  add_rms("pose_rms_m", off_pose_);
  if (off_pose_.count > 0) metrics.push_back({"pose_max_m", off_pose_max_m_});
  metrics.push_back({"beyond_fence_m", beyond_fence_m_});
  if (off_pose_.count > 0) metrics.push_back({"pose_beyond_fence_m", pose_beyond_fence_m_});
  metrics.push_back({"speed_max_mps", speed_max_mps_});
  add_rms("sent_change_mps2", sent_change_);
  if (nearest_m_) metrics.push_back({"nearest_m", *nearest_m_});
  if (age_.count() > 0) {
    metrics.push_back({"command_age_median_ms", to_ms(age_.quantile(0.5))});
    metrics.push_back({"command_age_p95_ms", to_ms(age_.quantile(0.95))});
    metrics.push_back({"command_age_max_ms", to_ms(age_.max())});
  }
  if (flying_ns_ > 0) metrics.push_back({"commands_hz", static_cast<double>(applied_) / to_seconds(flying_ns_)});
  metrics.push_back({"holds", static_cast<double>(holds_)});
  metrics.push_back({"brakes", static_cast<double>(brakes_)});
  metrics.push_back({"landings", static_cast<double>(landings_)});
  metrics.push_back({"held_s", to_seconds(held_ns_)});
  metrics.push_back({"flown_s", to_seconds(flown_ns)});
  return metrics;
}

}  // namespace ledgerline::hil
