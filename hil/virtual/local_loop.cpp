#include "hil/virtual/local_loop.hpp"

namespace ledgerline::hil {

std::optional<Pose> LocalLoop::fused(std::size_t drone, const agent::MocapPose& measured) {
  auto pose = fusions_[drone].add(measured);
  if (pose) pose->drone = static_cast<DroneNumber>(drone + 1);
  return pose;
}

std::optional<AgentBeat> LocalLoop::beat(TimeNs now) {
  constexpr TimeNs period_ns = 50 * ns_per_ms;  // as agent's
  if (now < next_beat_ns_) return std::nullopt;
  next_beat_ns_ = now + period_ns;
  AgentBeat beat;
  beat.stamp_ns = now;
  beat.ledger_alive = true;
  return beat;
}

}  // namespace ledgerline::hil
