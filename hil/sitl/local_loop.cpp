#include "hil/sitl/local_loop.hpp"

namespace ledgerline::hil {

std::optional<Pose> LocalLoop::fused(std::size_t drone, const agent::MocapPose& measured) {
  auto pose = fusions_[drone].add(measured);
  if (pose) pose->drone = static_cast<DroneNumber>(drone + 1);
  return pose;
}

std::optional<AgentHeartbeat> LocalLoop::heartbeat(TimeNs now) {
  constexpr TimeNs period_ns = 50 * ns_per_ms;  // as agent's
  if (now < next_heartbeat_ns_) return std::nullopt;
  next_heartbeat_ns_ = now + period_ns;
  AgentHeartbeat heartbeat;
  heartbeat.stamp_ns = now;
  heartbeat.ledger_alive = true;
  return heartbeat;
}

}  // namespace ledgerline::hil
