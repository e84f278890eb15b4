#include "ground/motion/predictor.hpp"

#include <algorithm>

namespace ledgerline::ground::motion {
namespace {

constexpr std::size_t sent_kept = 256;

// Link's: how long it flies the only setpoint of a plan, and the last one of any plan at most.
constexpr TimeNs default_hold_ns = 100 * ns_per_ms, max_hold_ns = 500 * ns_per_ms;

TimeNs end_of(const std::vector<Setpoint>& plan) {
  const TimeNs last_ns = plan.back().at_ns;
  if (plan.size() == 1) return last_ns + default_hold_ns;
  return last_ns + std::min(last_ns - plan[plan.size() - 2].at_ns, max_hold_ns);
}

Eigen::Vector3d vector(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

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

void Predictor::sent(std::uint64_t id, std::span<const Setpoint> plan) {
  if (plan.empty()) return;
  sent_.push_back({id, {plan.begin(), plan.end()}});
  if (sent_.size() > sent_kept) sent_.pop_front();
  // What a newer plan replaced before the newest state is over.
  while (sent_.size() > 1 && sent_[1].plan.front().at_ns + late_ns_ < newest().stamp_ns - ns_per_s) sent_.pop_front();
}

void Predictor::withdraw(std::uint64_t id) {
  std::erase_if(sent_, [&](const Sent& sent) { return sent.id == id; });
}

// What the newest plan that has begun by then wants, as link's playout has it: behind its end, zero. Nothing: none has
// begun.
std::optional<Setpoint> Predictor::planned(TimeNs at_ns) const {
  for (auto sent = sent_.rbegin(); sent != sent_.rend(); ++sent) {
    if (sent->plan.front().at_ns > at_ns) continue;
    if (end_of(sent->plan) <= at_ns) return Setpoint{};
    const auto next = std::upper_bound(sent->plan.begin(), sent->plan.end(), at_ns,
                                       [](TimeNs t, const Setpoint& s) { return t < s.at_ns; });
    return *(next - 1);
  }
  return std::nullopt;
}

Rollout Predictor::until(TimeNs meant_ns) const {
  const TimeNs stamp_ns = newest().stamp_ns;
  const TimeNs until_ns = std::min(meant_ns + late_ns_, stamp_ns + max_ns);
  // Up to the last of link's words they count, behind it what was planned.
  const TimeNs known_ns =
      filter_.has_sent() ? std::max(stamp_ns - from_seconds(response().dead_s), filter_.newest_sent_ns()) : stamp_ns;
  Rollout out = filter_.rollout(std::min(known_ns, until_ns));
  while (out.sent_until_ns() < until_ns) {
    const TimeNs to_ns = std::min(out.sent_until_ns() + estimation::cell_ns, until_ns);
    if (const std::optional<Setpoint> setpoint = planned(out.sent_until_ns() - late_ns_)) {
      out.send(vector(setpoint->velocity_mps), static_cast<double>(setpoint->yaw_rate_radps), to_ns,
               config_.sent_acceleration_mps2);
    } else {
      out.send(out.sent_mps(), 0, to_ns, config_.sent_acceleration_mps2);
    }
  }
  return out;
}

}  // namespace ledgerline::ground::motion
