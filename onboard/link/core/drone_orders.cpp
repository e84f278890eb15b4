#include "onboard/link/core/drone_orders.hpp"

#include <algorithm>

namespace ledgerline::link {

DropReason DroneOrders::takeoff_refusal(const Plan& plan) const noexcept {
  if (is_landing_requested() || !is_on_ground(session_.phase())) return DropReason::not_flying;
  return plan.state_stamp_ns <= takeoff_after_ns_ ? DropReason::too_old : DropReason::none;
}

DropReason DroneOrders::land(TimeNs now) noexcept {
  if (session_.phase() == LinkPhase::disconnected && !session_.may_be_airborne()) return DropReason::not_flying;
  session_.land_again(now, LostLinkProtocol::Requester::holder);
  request_landing(now);
  return DropReason::none;
}

void DroneOrders::request_landing(TimeNs now) noexcept {
  if (session_.phase() == LinkPhase::flying) {
    if (!is_landing_requested()) landing_requested_ns_ = now;  // the step sends it, this one where nobody is below
  } else {
    session_.request_land(now);
  }
}

void DroneOrders::on_phase(TimeNs now, LinkPhase before, LinkPhase phase) noexcept {
  landing_requested_ns_ = 0;
  if (is_in_flight(before) && !is_in_flight(phase)) takeoff_after_ns_ = now;
  if (!session_.is_possibly_in_flight()) cut_ = false;
}

void DroneOrders::stop(TimeNs now, const Plan& plan) noexcept {
  stop_ = true;
  cut_ = cut_ || plan.action == PlanAction::cut;
  stopped_ns_ = std::max(stopped_ns_, plan.verified_ns);
  stop_cleared_ = local_stop_cleared_ = false;
  takeoff_after_ns_ = now;
  session_.land_again(now, LostLinkProtocol::Requester::contract);
}

void DroneOrders::stop_locally(TimeNs now) noexcept {
  session_.land_again(now, LostLinkProtocol::Requester::local);
  if (!session_.is_possibly_in_flight() || !session_.has_responded()) return;
  local_stop_ = true;
  stopped_ns_ = std::max(stopped_ns_, now);
  stop_cleared_ = local_stop_cleared_ = false;
}

// One that was overtaken by a newer stop clears nothing.
DropReason DroneOrders::clear_stop(const Plan& plan) noexcept {
  if (plan.verified_ns < stopped_ns_) return DropReason::out_of_order;
  stop_cleared_ = true;
  local_stop_cleared_ = local_stop_cleared_ || plan.action == PlanAction::stop_cleared_by_owner;
  forget_cleared_stops();  // a take-off may come with it
  return DropReason::none;
}

void DroneOrders::clear_local_stop() noexcept {
  local_stop_cleared_ = true;
  forget_cleared_stops();
}

void DroneOrders::forget_cleared_stops() noexcept {
  if (session_.is_possibly_in_flight()) return;
  if (stop_cleared_) stop_ = cut_ = false;
  if (local_stop_cleared_) local_stop_ = false;
  stop_cleared_ = local_stop_cleared_ = false;
}

}  // namespace ledgerline::link
