#include <algorithm>

#include "onboard/link/core/drone_link.hpp"

/// Who stopped a drone, and what lifts it (docs/failsafe.md).
namespace ledgerline::link {

void DroneLink::stop(TimeNs now, const Plan& plan) noexcept {
  stop_ = true;
  cut_ = cut_ || plan.action == PlanAction::cut;
  stopped_ns_ = std::max(stopped_ns_, plan.verified_ns);
  resumed_ = resumed_locally_ = false;
  takeoff_after_ns_ = now;
  session_.land_again(now, LostLinkProtocol::Asker::contract);
  playout_.clear(DropReason::superseded);
}

void DroneLink::stop_locally(TimeNs now) noexcept {
  session_.land_again(now, LostLinkProtocol::Asker::local);
  if (!may_fly() || !session_.heard()) return;
  local_stop_ = true;
  stopped_ns_ = std::max(stopped_ns_, now);
  resumed_ = resumed_locally_ = false;
}

// One that was overtaken by a newer stop lifts nothing.
DropReason DroneLink::resume(const Plan& plan) noexcept {
  if (plan.verified_ns < stopped_ns_) return DropReason::out_of_order;
  resumed_ = true;
  resumed_locally_ = resumed_locally_ || plan.action == PlanAction::resumed_by_owner;
  lift_stops();  // a take-off may come with it
  return DropReason::none;
}

void DroneLink::resume_locally() noexcept {
  resumed_locally_ = true;
  lift_stops();
}

void DroneLink::lift_stops() noexcept {
  if (may_fly()) return;
  if (resumed_) stop_ = cut_ = false;
  if (resumed_locally_) local_stop_ = false;
  resumed_ = resumed_locally_ = false;
}

}  // namespace ledgerline::link
