#include "ground/motion/predictor.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace ledgerline::ground::motion {
namespace {

constexpr std::size_t sent_kept = 256;
constexpr TimeNs sample_ns = 50 * ns_per_ms;  // of what is committed, or a multiple: at 1 m/s a point each 5 cm

// Link's: how long it flies the only setpoint of a plan, and the last one of any plan at most.
constexpr TimeNs default_hold_ns = 100 * ns_per_ms, max_hold_ns = 500 * ns_per_ms;

TimeNs end_of(const std::vector<Setpoint>& plan) {
  const TimeNs last_ns = plan.back().at_ns;
  if (plan.size() == 1) return last_ns + default_hold_ns;
  return last_ns + std::min(last_ns - plan[plan.size() - 2].at_ns, max_hold_ns);
}

Eigen::Vector3d vector(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

Setpoint in_map(Setpoint setpoint, double yaw_rad) {
  const Eigen::Vector3d turned = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) * vector(setpoint.velocity_mps);
  Eigen::Vector3f::Map(setpoint.velocity_mps.data()) = turned.cast<float>();
  return setpoint;
}

}  // namespace

Predictor::Predictor(const PredictorConfig& config)
    : config_(config), estimator_(config.first), filter_(config.first) {}

void Predictor::observe(const StateSample& state) {
  late_ns_ = state.playout_margin_ns;
  // What link sent the drone is news without a new pose, too: it brakes while mocap is away.
  if (!filter_.add_sent(
          {state.stamp_ns, vector(state.sent_velocity_mps), static_cast<double>(state.sent_yaw_rate_radps)}))
    return;
  if (state.pose_stamp_ns <= filter_.newest().stamp_ns) return;
  const Motion measured{state.pose_stamp_ns, Eigen::Vector3d::Map(state.position_m.data()),
                        Eigen::Vector3d::Map(state.velocity_mps.data()), state.yaw_rad};
  if (filter_.add_pose(measured)) estimator_.interrupt();
  if (!config_.learn) return;
  estimator_.add(measured.stamp_ns, measured.position_m.head<2>(),
                 [this](TimeNs t) -> Eigen::Vector2d { return filter_.sent_at(t).velocity_mps.head<2>(); });
  filter_.set_response(estimator_.response());
}

void Predictor::sent(std::uint64_t id, std::span<const Setpoint> plan, bool body_frame) {
  if (plan.empty()) return;
  sent_.push_back({id, {plan.begin(), plan.end()}, body_frame});
  if (sent_.size() > sent_kept) sent_.pop_front();
  // What a newer plan replaced before the newest state is over.
  while (sent_.size() > 1 && sent_[1].plan.front().at_ns + late_ns_ < newest().stamp_ns - ns_per_s) sent_.pop_front();
}

void Predictor::withdraw(std::uint64_t id) {
  std::erase_if(sent_, [&](const Sent& sent) { return sent.id == id; });
}

// What the newest plan that has begun by then wants, as link's playout has it: behind its end, zero. Nothing: none has
// begun. Map frame, of a drone that looks there.
std::optional<Setpoint> Predictor::planned(TimeNs at_ns, double yaw_rad) const {
  for (auto sent = sent_.rbegin(); sent != sent_.rend(); ++sent) {
    if (sent->plan.front().at_ns > at_ns) continue;
    if (end_of(sent->plan) <= at_ns) return Setpoint{};
    const auto next = std::upper_bound(sent->plan.begin(), sent->plan.end(), at_ns,
                                       [](TimeNs t, const Setpoint& s) { return t < s.at_ns; });
    return sent->body_frame ? in_map(*(next - 1), yaw_rad) : *(next - 1);
  }
  return std::nullopt;
}

Rollout Predictor::until(TimeNs meant_ns) const {
  const TimeNs until_ns = std::min(meant_ns + late_ns_, newest().stamp_ns + max_ns);
  // What link says it sent counts, and behind that what was planned.
  Rollout out = filter_.rollout(std::min(known_until_ns(), until_ns));
  send_planned(out, until_ns);
  return out;
}

TimeNs Predictor::known_until_ns() const {
  const TimeNs stamp_ns = newest().stamp_ns;
  if (!filter_.has_sent()) return stamp_ns;
  return std::max(stamp_ns - from_seconds(response().dead_s), filter_.newest_sent_ns());
}

void Predictor::send_planned(Rollout& rollout, TimeNs until_ns) const {
  while (rollout.sent_until_ns() < until_ns) {
    const TimeNs to_ns = std::min(rollout.sent_until_ns() + estimation::cell_ns, until_ns);
    const auto setpoint = planned(rollout.sent_until_ns() - late_ns_, rollout.effect().yaw_rad);
    if (setpoint) {
      rollout.send(vector(setpoint->velocity_mps), static_cast<double>(setpoint->yaw_rate_radps), to_ns,
                   config_.sent_acceleration_mps2);
    } else {
      rollout.send(rollout.sent_mps(), 0, to_ns, config_.sent_acceleration_mps2);
    }
  }
}

std::vector<Motion> Predictor::committed(TimeNs from_ns, std::size_t most) const {
  if (!ready() || sent_.empty()) return {};
  const TimeNs dead_ns = from_seconds(response().dead_s), stamp_ns = newest().stamp_ns;
  const TimeNs first_ns = std::max(from_ns, stamp_ns);
  const TimeNs end_ns = std::min(end_of(sent_.back().plan) + late_ns_, stamp_ns + max_ns) + dead_ns;
  if (end_ns <= first_ns) return {};
  const TimeNs widest_ns = sample_ns * static_cast<TimeNs>(std::max<std::size_t>(most, 2) - 1);
  const TimeNs step_ns = sample_ns * ((end_ns - first_ns + widest_ns - 1) / widest_ns);
  std::vector<Motion> motions;
  Rollout rollout;
  for (TimeNs at_ns = first_ns;; at_ns = std::min(at_ns + step_ns, end_ns)) {
    // Behind what link says it sent it goes on from sample to sample.
    if (motions.empty() || rollout.sent_until_ns() < known_until_ns()) {
      rollout = until(at_ns - dead_ns - late_ns_);
    } else {
      send_planned(rollout, at_ns - dead_ns);
    }
    motions.push_back(rollout.effect());
    if (at_ns == end_ns) return motions;
  }
}

}  // namespace ledgerline::ground::motion
