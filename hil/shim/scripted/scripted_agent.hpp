#pragma once
#include <array>
#include <vector>

#include "hil/shim/scripted/plan_script.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil::shim {

/// Stands in agent's place by a script: plans, poses (the truth, 100 times a second) and signs of life (20 times a
/// second), and takes transitions as if each were on the ledger at once. It does not look at what link says, so that
/// it says the same whatever link does. A plan's first setpoint is due 20 ms after the plan is said. A core; one
/// thread; `now` never goes back.
class ScriptedAgent {
 public:
  ScriptedAgent(const PlanScript& script, TimeNs begin_ns);

  struct DueMessages {
    std::vector<Plan> plans;
    std::vector<Pose> poses;
    std::vector<AgentHeartbeat> heartbeats;
  };
  /// What is due now: valid until the next call.
  const DueMessages& step(TimeNs now, const sim::Simulator& drones);
  /// As link gave it: the next sign of life says that it is on the ledger.
  void take(const Transition& transition);
  /// In the order in which they came, each once.
  const std::vector<Transition>& transitions() const { return transitions_; }

  bool over(TimeNs now) const { return now - begin_ns_ >= script_.end_ns; }

 private:
  /// As of the moment when it was due, so that what it says does not depend on how late it is asked; numbered also when
  /// it is not said.
  void plan(TimeNs due, TimeNs now, const PlanScript::Say& say, bool silent);

  const PlanScript& script_;
  TimeNs begin_ns_;
  DueMessages said_;
  std::vector<TimeNs> next_ns_;  ///< of each say
  TimeNs next_pose_ns_, next_heartbeat_ns_;
  std::array<std::uint64_t, max_drones + 1> sequences_{};
  AgentHeartbeat heartbeat_;
  std::vector<Transition> transitions_;
};

}  // namespace ledgerline::hil::shim
