#include "onboard/link/core/playout/playout.hpp"

#include <algorithm>
#include <cmath>

#include "common/base/check.hpp"

namespace ledgerline::link {

namespace {

/// Where it is that much later.
Reference moved_on(const Reference& from, TimeNs by_ns) noexcept {
  constexpr TimeNs max_ns = 100 * ns_per_ms;  // two steps of ground's: behind it, it does not run away
  const auto t = static_cast<float>(to_seconds(std::min(by_ns, max_ns)));
  Reference out = from;
  for (std::size_t i = 0; i < 3; ++i) {
    out.position_m[i] += t * (from.velocity_mps[i] + 0.5F * t * from.acceleration_mps2[i]);
    out.velocity_mps[i] += t * from.acceleration_mps2[i];
  }
  return out;
}

constexpr TimeNs look_gap_ns = 100 * ns_per_ms;
constexpr std::size_t min_plans = 32;  // fewer say nothing about a quantile

}  // namespace

void Margin::add(TimeNs now, TimeNs lateness_ns) noexcept {
  lateness_ns_[count_ % lateness_ns_.size()] = lateness_ns;
  ++count_;
  // A burst of plans pays for one look only.
  if (count_ < min_plans || now - target_since_ns_ < look_gap_ns) return;
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
  LEDGERLINE_CHECK(margin_ns_ >= 0 && margin_ns_ <= settings_.max_margin_ns, "the margin keeps its bounds", margin_ns_);
  return margin_ns_;
}

void Playout::finish(const Waiting& waiting, DropReason reason) noexcept {
  if (!waiting.applied) admission_.record_end(waiting.plan, reason);
}

TimeNs Playout::end_of(const Plan& plan) const noexcept {
  const Setpoint& last = plan.setpoints[plan.count - 1];
  const TimeNs hold = plan.count == 1
                          ? settings_.default_hold_ns
                          : std::min(last.at_ns - plan.setpoints[plan.count - 2].at_ns, settings_.max_hold_ns);
  return last.at_ns + hold;
}

void Playout::add(TimeNs now, const Plan& plan) noexcept {
  if (!LEDGERLINE_CHECK(plan.count > 0 && plan.count <= max_setpoints, "what is flown has setpoints", plan.count))
    return;
  margin_.add(now, now - plan.setpoints[0].at_ns);
  const Waiting waiting{plan, end_of(plan), false, -1};
  if (waiting.end_ns <= now - margin_.value()) {
    finish(waiting, DropReason::none);
    return;
  }
  if (waiting_.full()) {
    // The oldest plan waiting is flown first; the newest one waiting covers the time that this plan covers, too.
    finish(waiting_[waiting_.size() - 1], DropReason::queue_full);
    waiting_.pop_back();
  }
  waiting_.push(waiting);
}

Playout::CurrentSetpoint Playout::setpoint(TimeNs now) noexcept {
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
  desired_index_ = -1;
  if (waiting_.empty() || waiting_[0].plan.setpoints[0].at_ns > time) return {};
  const Waiting& flown = waiting_[0];
  std::uint32_t at = 0;
  while (at + 1 < flown.plan.count && flown.plan.setpoints[at + 1].at_ns <= time) ++at;
  desired_index_ = static_cast<std::int32_t>(at);
  const Setpoint& setpoint = flown.plan.setpoints[at];
  return {.valid = true,
          .fresh = desired_index_ != flown.sent_setpoint,
          .velocity = {setpoint.velocity_mps, setpoint.yaw_rate_radps},
          .body_frame = flown.plan.body_frame,
          .has_reference = setpoint.has_reference && !flown.plan.body_frame,
          .reference = moved_on(setpoint.reference, time - setpoint.at_ns),
          .response = flown.plan.response,
          .sequence = flown.plan.sequence,
          .state_stamp_ns = flown.plan.state_stamp_ns,
          .meant_ns = setpoint.at_ns};
}

bool Playout::mark_sent() noexcept {
  if (desired_index_ < 0 || waiting_.empty()) return false;
  Waiting& flown = waiting_[0];
  flown.sent_setpoint = desired_index_;
  if (flown.applied) return false;
  flown.applied = true;
  admission_.record_applied();
  return true;
}

void Playout::clear(DropReason reason) noexcept {
  for (const Waiting& waiting : waiting_) finish(waiting, reason);
  waiting_.clear();
  desired_index_ = -1;
  covered_until_ns_ = 0;
}

namespace {

bool is_within(const std::array<float, 3>& values, float limit) noexcept {  // written so that NaN fails
  return std::ranges::all_of(values, [&](float v) { return std::abs(v) <= limit; });
}

bool plausible(const Setpoint& setpoint) noexcept {
  const Reference& r = setpoint.reference;
  return is_within(setpoint.velocity_mps, absurd_speed) && std::abs(setpoint.yaw_rate_radps) <= absurd_speed &&
         is_within(r.position_m, absurd_m) && is_within(r.velocity_mps, absurd_speed) &&
         is_within(r.acceleration_mps2, absurd_speed);
}

}  // namespace

DropReason PlanAdmission::check(TimeNs now, const Plan& plan) const noexcept {
  if (is_contract_action(plan.action)) return DropReason::none;
  if (any_ && (plan.epoch < newest_epoch_ || (plan.epoch == newest_epoch_ && plan.sequence <= newest_sequence_))) {
    return DropReason::out_of_order;
  }
  // A landing is never too old to be obeyed.
  const bool wants_flight = plan.action == PlanAction::fly || plan.action == PlanAction::takeoff;
  if (wants_flight && now - plan.state_stamp_ns > settings_.max_age_ns) return DropReason::too_old;
  if (plan.action != PlanAction::fly) return DropReason::none;
  if (plan.state_stamp_ns > now || plan.count > max_setpoints || !is_plausible(plan.response))
    return DropReason::bad_value;
  if (plan.count == 0 && !is_empty_plan(plan)) return DropReason::bad_value;
  for (std::uint32_t i = 0; i < plan.count; ++i) {
    const Setpoint& setpoint = plan.setpoints[i];
    if (!plausible(setpoint) || setpoint.at_ns < 0 || setpoint.at_ns > now + settings_.max_ahead_ns)
      return DropReason::bad_value;
    if (i > 0 && setpoint.at_ns <= plan.setpoints[i - 1].at_ns) return DropReason::bad_value;
  }
  return DropReason::none;
}

DropReason PlanAdmission::admit(TimeNs now, const Plan& plan) noexcept {
  ++counters_.received;
  const DropReason reason = check(now, plan);
  if (reason != DropReason::none) record_end(plan, reason);
  if (reason != DropReason::none || is_contract_action(plan.action)) return reason;
  any_ = true;
  newest_epoch_ = plan.epoch;
  newest_sequence_ = plan.sequence;
  return DropReason::none;
}

void PlanAdmission::record_end(const Plan& plan, DropReason reason) noexcept {
  ++(reason == DropReason::none ? counters_.late : counters_.dropped);
  if (reason != DropReason::none) ++counters_.dropped_by[static_cast<std::size_t>(reason)];
  ends_.push({plan.sequence, plan.state_stamp_ns, reason});
}

}  // namespace ledgerline::link
