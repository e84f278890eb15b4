#pragma once
#include <span>
#include <string>
#include <vector>

#include "hil/fault/checker/checker.hpp"
#include "hil/fault/run/result.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// What the invariants allow in a flight of this script, whose drones stand where the facts say.
Limits limits_of(const Script& script, const std::vector<DroneFacts>& drones);

/// Drones that are not on the ground, their motors off.
std::vector<std::string> in_the_air(const std::vector<DroneFacts>& drones);

/// "flying, hold (pose_lost)"; without mode and cause where there is none.
std::string mode_text(const DroneFacts& facts);

/// Has one run checked, moment by moment, and keeps of it its figures and what pictures and reports show: a point of
/// each drone every timeline_period_ns, and the first max_events events. The run may be a simulated one or a recording
/// of a real one. One thread.
class RunRecorder {
 public:
  /// `drones`: as they stand before the first moment.
  RunRecorder(const Script& script, std::uint64_t seed, const std::vector<DroneFacts>& drones);

  void observe(const Moment& moment);
  /// Behind the last moment; what the run alone knows is for the caller to fill in.
  RunResult finish(const Ending& ending);

 private:
  RunRecorder(const Script& script, std::uint64_t seed, const std::vector<DroneFacts>& drones, const Limits& limits);
  void keep_event(const Moment& moment, const WorldEvent& event);

  RunResult result_;
  Checker checker_;
  FigureMaker figures_;
  TimeNs next_point_ns_ = 0;
};

}  // namespace ledgerline::hil
