#include <algorithm>

#include "onboard/link/core/drone_link.hpp"

/// Who stopped a drone, and what clears it (docs/failsafe.md).
namespace ledgerline::link {

void DroneLink::stop(TimeNs now, const Plan& plan) noexcept {
  stop_ = true;
  cut_ = cut_ || plan.action == PlanAction::cut;
  stopped_ns_ = std::max(stopped_ns_, plan.verified_ns);
  stop_cleared_ = local_stop_cleared_ = false;
  takeoff_after_ns_ = now;
  session_.land_again(now, LostLinkProtocol::Requester::contract);
  playout_.clear(DropReason::superseded);
}

void DroneLink::stop_locally(TimeNs now) noexcept {
  session_.land_again(now, LostLinkProtocol::Requester::local);
  if (!may_fly() || !session_.heard()) return;
  local_stop_ = true;
  stopped_ns_ = std::max(stopped_ns_, now);
  stop_cleared_ = local_stop_cleared_ = false;
}

// One that was overtaken by a newer stop clears nothing.
DropReason DroneLink::clear_stop(const Plan& plan) noexcept {
  if (plan.verified_ns < stopped_ns_) return DropReason::out_of_order;
  stop_cleared_ = true;
  local_stop_cleared_ = local_stop_cleared_ || plan.action == PlanAction::stop_cleared_by_owner;
  forget_cleared_stops();  // a take-off may come with it
  return DropReason::none;
}

void DroneLink::clear_local_stop() noexcept {
  local_stop_cleared_ = true;
  forget_cleared_stops();
}

void DroneLink::forget_cleared_stops() noexcept {
  if (may_fly()) return;
  if (stop_cleared_) stop_ = cut_ = false;
  if (local_stop_cleared_) local_stop_ = false;
  stop_cleared_ = local_stop_cleared_ = false;
}

}  // namespace ledgerline::link
