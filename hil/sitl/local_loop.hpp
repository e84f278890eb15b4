#pragma once
#include <optional>
#include <vector>

#include "common/msg/onboard.hpp"
#include "common/rt/histogram.hpp"
#include "onboard/agent/core/fusion.hpp"

namespace ledgerline::hil {

/// What stands in the agent's place where the controller flies beside the driver: it fuses mocap and says that the
/// ledger is alive; states and plans go from hand to hand, and how long that takes is counted. One thread.
class LocalLoop {
 public:
  explicit LocalLoop(int drones)
      : fusions_(static_cast<std::size_t>(drones), agent::Fusion({})), two_way_(fusions_.size()) {}

  /// Drones are indices. Nothing: the measurement was rejected.
  std::optional<Pose> fused(std::size_t drone, const agent::MocapPose& measured);
  /// Nothing: not due yet.
  std::optional<AgentHeartbeat> heartbeat(TimeNs now);
  /// A state was answered by a plan.
  void answered(std::size_t drone, TimeNs after_ns) { two_way_[drone].add(after_ns); }
  Quantiles two_way_ms(std::size_t drone) const { return two_way_[drone].quantiles_ms(); }

 private:
  std::vector<agent::Fusion> fusions_;
  std::vector<Histogram> two_way_;
  TimeNs next_heartbeat_ns_ = 0;
};

}  // namespace ledgerline::hil
