#pragma once
#include <array>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "hil/proxy/switches.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil::shim {

/// What an agent says to link, and what goes wrong meanwhile: a TOML file (docs/faults.md). Times are since the script
/// began.
struct PlanScript {
  /// A plan, repeated until `until_ns`: flown ones 30 times a second, each good for 0.6 s; the others 10 times a
  /// second.
  struct Say {
    TimeNs at_ns = 0, until_ns = 0;
    DroneNumber drone = 0;  ///< 0: every one
    PlanAction action = PlanAction::fly;
    std::array<float, 3> velocity_mps{};  ///< in `map`
    float yaw_rate_radps = 0;
  };
  /// agent says nothing at all: no plan, no pose, no sign of life.
  struct Silence {
    TimeNs at_ns = 0, until_ns = 0;
  };
  int drones = 1;
  TimeNs end_ns = 0;
  std::vector<Say> says;
  std::vector<Silence> silences;
  std::vector<proxy::ScheduledFault> faults;
};

/// Errors name file, line and key.
Result<PlanScript> load_plan_script(const std::string& path);
Result<PlanScript> parse_plan_script(std::string_view toml, const std::string& file);

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
  void add(const Transition& transition);
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
