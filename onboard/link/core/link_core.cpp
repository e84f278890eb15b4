#include "onboard/link/core/link_core.hpp"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

namespace ledgerline::link {

LinkCore::LinkCore(const LinkSettings& settings, std::uint64_t boot_id, int starts, DroneSet local_stops)
    : period_ns_(from_seconds(1.0 / settings.rate_hz)),
      health_gap_ns_(settings.health_gap_ns),
      health_rest_ns_(settings.health_rest_ns),
      land_first_(starts >= settings.session.many_starts),
      separation_(settings.separation, static_cast<double>(settings.playout.max_acceleration_mps2)) {
  for (const DroneSettings& drone : settings.drones)
    drones_.emplace_back(drone, settings, boot_id, local_stops.test(drone.number));
}

const DroneLink* LinkCore::find(DroneNumber number) const noexcept {
  const auto at =
      std::find_if(drones_.begin(), drones_.end(), [&](const DroneLink& d) { return d.number() == number; });
  return at == drones_.end() ? nullptr : &*at;
}

DroneLink* LinkCore::find(DroneNumber number) noexcept {
  return const_cast<DroneLink*>(std::as_const(*this).find(number));
}

const LinkOutputs& LinkCore::step(TimeNs now, const LinkInputs& inputs) noexcept {
  const CheckScope scope(checks_);
  LEDGERLINE_CHECK(now >= last_step_ns_, "time does not go back", now, last_step_ns_);
  out_.clear();
  const double passed_s = last_step_ns_ == 0 ? 0 : to_seconds(now - last_step_ns_);
  watch_health(now, age_after_suspend(now, inputs.suspended_ns));
  for (DroneLink& drone : drones_) {
    if (inputs.stop_all && !stop_all_) drone.orders().stop_locally(now);
    if (land_first_) drone.land_again(now);
    if (inputs.clear_local_stops) drone.orders().clear_local_stop();
  }
  land_first_ = false;
  stop_all_ = stop_all_ || inputs.stop_all;

  const LinkMoment at{.now = now,
                      .healthy = now >= unhealthy_until_ns_,
                      .not_before_ns = not_before_ns_,
                      .stop_all = stop_all_,
                      .check_failed = checks_.failed() || agent_check_failed_,
                      .out = out_};
  dispatch(at, inputs);
  separate(now, passed_s);
  for (DroneLink& drone : drones_) drone.step(at);
  sample(at);
  return out_;
}

void LinkCore::watch_health(TimeNs now, bool slept) noexcept {
  if (last_step_ns_ == 0) {
    next_sample_ns_ = now;
  } else {
    if (slept || now - last_step_ns_ > health_gap_ns_) unhealthy_until_ns_ = now + health_rest_ns_;
    for (DroneLink& drone : drones_) drone.dead_reckon(to_seconds(now - last_step_ns_));
  }
  last_step_ns_ = now;
}

bool LinkCore::age_after_suspend(TimeNs now, TimeNs suspended_ns) noexcept {
  const TimeNs slept_ns = last_step_ns_ == 0 ? 0 : suspended_ns - suspended_ns_;
  suspended_ns_ = suspended_ns;
  if (slept_ns <= health_gap_ns_) return false;
  not_before_ns_ = now;
  for (DroneLink& drone : drones_) drone.grow_older(now, slept_ns);
  return true;
}

void LinkCore::separate(TimeNs now, double passed_s) noexcept {
  std::array<Neighbour, max_drones> neighbours{};
  std::array<DroneLink*, max_drones> whose{};
  std::size_t count = 0;
  for (DroneLink& drone : drones_) {
    drone.set_clearance(std::nullopt);
    const auto neighbour = count < max_drones ? drone.as_neighbour(now) : std::nullopt;
    if (!neighbour) continue;
    neighbours[count] = *neighbour;
    whose[count++] = &drone;
  }
  const auto clearances = separation_.step(passed_s, std::span(neighbours).first(count));
  for (std::size_t i = 0; i < count; ++i) whose[i]->set_clearance(clearances[i]);
}

void LinkCore::dispatch(const LinkMoment& at, const LinkInputs& inputs) noexcept {
  for (const Received& received : inputs.received) {
    if (DroneLink* drone = find(received.drone)) drone->on_bytes(at.now, received.port, received.bytes);
  }
  for (const AgentHeartbeat& heartbeat : inputs.heartbeats) {
    agent_check_failed_ = agent_check_failed_ || heartbeat.check_failed;
    if (heartbeat.stamp_ns < heartbeat_ns_ || heartbeat.stamp_ns > at.now) continue;
    heartbeat_ns_ = heartbeat.stamp_ns;
    for (DroneLink& drone : drones_) {
      if (heartbeat.is_for(drone.number())) drone.on_heartbeat(heartbeat);
    }
  }
  for (const Pose& pose : inputs.poses) {
    if (pose.stamp_ns < not_before_ns_) continue;
    if (DroneLink* drone = find(pose.drone)) drone->on_pose(at.now, pose);
  }
  for (const Plan& plan : inputs.plans) {
    if (DroneLink* drone = find(plan.drone)) drone->on_plan(at, plan);
  }
}

void LinkCore::sample(const LinkMoment& at) noexcept {
  if (at.now < next_sample_ns_) return;
  // All drones at one moment, so that their samples go out in one batch.
  for (DroneLink& drone : drones_) drone.sample(at);
  next_sample_ns_ += period_ns_;
  if (next_sample_ns_ <= at.now) next_sample_ns_ = at.now + period_ns_;
}

bool LinkCore::all_on_ground() const noexcept {
  return std::none_of(drones_.begin(), drones_.end(),
                      [](const DroneLink& d) { return d.session().is_possibly_in_flight(); });
}

bool LinkCore::all_on_ground_or_unheard() const noexcept {
  return std::none_of(drones_.begin(), drones_.end(), [](const DroneLink& d) {
    return d.session().is_possibly_in_flight() && d.session().has_responded();
  });
}

bool LinkCore::all_landed_or_commanded() const noexcept {
  return std::none_of(drones_.begin(), drones_.end(), [&](const DroneLink& d) {
    return d.session().is_possibly_in_flight() && !d.session().commanded_to_land(last_step_ns_);
  });
}

DroneSet LinkCore::local_stops() const noexcept {
  DroneSet stopped;
  for (const DroneLink& drone : drones_) stopped[drone.number()] = drone.orders().is_stopped_locally();
  return stopped;
}

void LinkCore::finish() noexcept {
  for (DroneLink& drone : drones_) drone.finish();
}

std::vector<DroneReport> LinkCore::reports() const {
  std::vector<DroneReport> reports;
  reports.reserve(drones_.size());
  for (const DroneLink& drone : drones_) reports.push_back(drone.report());
  return reports;
}

}  // namespace ledgerline::link
