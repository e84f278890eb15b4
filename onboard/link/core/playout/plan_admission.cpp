#include "onboard/link/core/playout/plan_admission.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {
namespace {

bool plausible(const Setpoint& setpoint) noexcept {
  return std::all_of(setpoint.velocity_mps.begin(), setpoint.velocity_mps.end(),
                     [](float v) { return std::isfinite(v) && std::abs(v) <= absurd_speed; }) &&
         std::isfinite(setpoint.yaw_rate_radps) && std::abs(setpoint.yaw_rate_radps) <= absurd_speed;
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
  if (plan.state_stamp_ns > now || plan.count > max_setpoints) return DropReason::bad_value;
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
