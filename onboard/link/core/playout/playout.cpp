#include "onboard/link/core/playout/playout.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {

namespace {
// More than any drone here can do: such a number is an error, not a wish to be limited.
constexpr float absurd_mps = 100;
constexpr float absurd_radps = 100;

constexpr TimeNs margin_look_ns = 100 * ns_per_ms;
constexpr std::size_t margin_plans = 32;  // fewer say nothing about a quantile

bool believable(const Setpoint& setpoint) noexcept {
  return std::all_of(setpoint.velocity_mps.begin(), setpoint.velocity_mps.end(),
                     [](float v) { return std::isfinite(v) && std::abs(v) <= absurd_mps; }) &&
         std::isfinite(setpoint.yaw_rate_radps) && std::abs(setpoint.yaw_rate_radps) <= absurd_radps;
}
}  // namespace

void Margin::add(TimeNs now, TimeNs lateness_ns) noexcept {
  lateness_ns_[count_ % lateness_ns_.size()] = lateness_ns;
  ++count_;
  // A burst of plans pays for one look only.
  if (count_ < margin_plans || now - target_since_ns_ < margin_look_ns) return;
  target_since_ns_ = now;
  auto sorted = lateness_ns_;
  const std::size_t known = std::min(count_, sorted.size());
  const auto rank = static_cast<std::size_t>(settings_.margin_quantile * static_cast<double>(known - 1));
  std::nth_element(sorted.begin(), sorted.begin() + rank, sorted.begin() + known);
  target_ns_ = std::clamp<TimeNs>(sorted[rank], 0, settings_.max_margin_ns);
}

TimeNs Margin::step(TimeNs now) noexcept {
  const TimeNs passed = std::max<TimeNs>(0, now - last_ns_);
  last_ns_ = now;
  if (margin_ns_ < target_ns_) {
    margin_ns_ = std::min(target_ns_, margin_ns_ + passed / 2);
  } else {
    margin_ns_ = std::max(target_ns_, margin_ns_ - passed / 20);
  }
  return margin_ns_;
}

DropReason Playout::check(TimeNs now, const Plan& plan) const noexcept {
  if (is_contract_stop(plan.action)) return DropReason::none;
  if (any_ && (plan.epoch < newest_epoch_ || (plan.epoch == newest_epoch_ && plan.sequence <= newest_sequence_))) {
    return DropReason::out_of_order;
  }
  // A landing is never too old to be obeyed.
  const bool wants_flight = plan.action == PlanAction::fly || plan.action == PlanAction::takeoff;
  if (wants_flight && now - plan.state_stamp_ns > settings_.max_age_ns) return DropReason::too_old;
  if (plan.action != PlanAction::fly) return DropReason::none;
  if (plan.state_stamp_ns > now || plan.count == 0 || plan.count > max_setpoints) return DropReason::bad_value;
  for (std::uint32_t i = 0; i < plan.count; ++i) {
    const Setpoint& setpoint = plan.setpoints[i];
    if (!believable(setpoint) || setpoint.at_ns < 0 || setpoint.at_ns > now + settings_.max_ahead_ns)
      return DropReason::bad_value;
    if (i > 0 && setpoint.at_ns <= plan.setpoints[i - 1].at_ns) return DropReason::bad_value;
  }
  return DropReason::none;
}

DropReason Playout::admit(TimeNs now, const Plan& plan) noexcept {
  ++counters_.received;
  const DropReason reason = check(now, plan);
  if (reason != DropReason::none) {
    count_dropped(plan, reason);
    return reason;
  }
  if (is_contract_stop(plan.action)) return DropReason::none;
  any_ = true;
  newest_epoch_ = plan.epoch;
  newest_sequence_ = plan.sequence;
  return DropReason::none;
}

void Playout::count_dropped(const Plan& plan, DropReason reason) noexcept {
  ++counters_.dropped;
  ++counters_.dropped_by[static_cast<std::size_t>(reason)];
  ends_.push({plan.sequence, plan.state_stamp_ns, reason});
}

void Playout::finish(const Waiting& waiting, DropReason reason) noexcept {
  if (waiting.applied) return;  // counted when it was
  if (reason == DropReason::none) {
    ++counters_.late;
    ends_.push({waiting.plan.sequence, waiting.plan.state_stamp_ns, reason});
  } else {
    count_dropped(waiting.plan, reason);
  }
}

TimeNs Playout::end_of(const Plan& plan) const noexcept {
  const Setpoint& last = plan.setpoints[plan.count - 1];
  const TimeNs hold = plan.count == 1
                          ? settings_.default_hold_ns
                          : std::min(last.at_ns - plan.setpoints[plan.count - 2].at_ns, settings_.max_hold_ns);
  return last.at_ns + hold;
}

void Playout::add(TimeNs now, const Plan& plan) noexcept {
  margin_.add(now, now - plan.setpoints[0].at_ns);
  const Waiting waiting{plan, end_of(plan), false, -1};
  if (waiting.end_ns <= now - margin_.value()) {
    finish(waiting, DropReason::none);
    return;
  }
  if (waiting_.full()) {
    // What waits longest is flown soonest; the newest one waiting speaks of the time that this plan speaks of, too.
    finish(waiting_[waiting_.size() - 1], DropReason::queue_full);
    waiting_.pop_back();
  }
  waiting_.push(waiting);
}

Playout::Wish Playout::wish(TimeNs now) noexcept {
  const TimeNs time = now - margin_.step(now);  // of playout
  // The newest plan that is due takes over, and what is older than it will never be flown again.
  std::size_t due = waiting_.size();
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    if (waiting_[i].plan.setpoints[0].at_ns <= time) due = i;
  }
  if (due < waiting_.size()) {
    for (std::size_t i = 0; i < due; ++i) {
      finish(waiting_[i], waiting_[i].end_ns <= time ? DropReason::none : DropReason::superseded);
    }
    waiting_.erase_front(due);
    covered_until_ns_ = waiting_[0].end_ns + margin_.value();
    if (waiting_[0].end_ns <= time) {
      finish(waiting_[0], DropReason::none);
      waiting_.erase_front(1);
    }
  }
  wished_setpoint_ = -1;
  if (waiting_.empty() || waiting_[0].plan.setpoints[0].at_ns > time) return {};
  const Waiting& flown = waiting_[0];
  std::uint32_t at = 0;
  while (at + 1 < flown.plan.count && flown.plan.setpoints[at + 1].at_ns <= time) ++at;
  wished_setpoint_ = static_cast<std::int32_t>(at);
  const Setpoint& setpoint = flown.plan.setpoints[at];
  return {.valid = true,
          .fresh = wished_setpoint_ != flown.sent_setpoint,
          .velocity = {setpoint.velocity_mps, setpoint.yaw_rate_radps},
          .sequence = flown.plan.sequence,
          .state_stamp_ns = flown.plan.state_stamp_ns,
          .meant_ns = setpoint.at_ns};
}

bool Playout::mark_sent() noexcept {
  if (wished_setpoint_ < 0 || waiting_.empty()) return false;
  Waiting& flown = waiting_[0];
  flown.sent_setpoint = wished_setpoint_;
  if (flown.applied) return false;
  flown.applied = true;
  ++counters_.applied;
  return true;
}

void Playout::clear(DropReason reason) noexcept {
  for (const Waiting& waiting : waiting_) finish(waiting, reason);
  waiting_.clear();
  wished_setpoint_ = -1;
  covered_until_ns_ = 0;
}

void Limiter::reset(TimeNs now) noexcept {
  output_ = {};
  last_ns_ = now;
}

const Velocity& Limiter::step(TimeNs now, const Velocity& wish, bool braking) noexcept {
  // A long gap between two steps must not allow one big jump.
  const auto dt = static_cast<float>(std::clamp(to_seconds(now - last_ns_), 0.0, 0.05));
  last_ns_ = now;

  std::array<float, 3> goal = wish.mps;
  const float speed = std::hypot(goal[0], goal[1]);
  if (speed > settings_.max_speed_mps) {
    goal[0] *= settings_.max_speed_mps / speed;
    goal[1] *= settings_.max_speed_mps / speed;
  }
  goal[2] = std::clamp(goal[2], -settings_.max_vertical_mps, settings_.max_vertical_mps);

  std::array<float, 3> change{};
  for (std::size_t i = 0; i < 3; ++i) change[i] = goal[i] - output_.mps[i];
  const float wanted = std::hypot(change[0], change[1], change[2]);
  const float allowed = settings_.max_acceleration_mps2 * (braking ? 2.0F : 1.0F) * dt;
  if (wanted <= allowed) {
    output_.mps = goal;  // exactly: zero is reached, not approached
  } else {
    for (std::size_t i = 0; i < 3; ++i) output_.mps[i] += change[i] * allowed / wanted;
  }

  const float yaw = std::clamp(wish.yaw_radps, -settings_.max_yaw_rate_radps, settings_.max_yaw_rate_radps);
  const float yaw_change = settings_.max_yaw_acceleration_radps2 * dt;
  output_.yaw_radps += std::clamp(yaw - output_.yaw_radps, -yaw_change, yaw_change);
  return output_;
}

}  // namespace ledgerline::link
