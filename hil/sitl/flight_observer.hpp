#pragma once
#include <deque>
#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "hil/sitl/observation.hpp"
#include "onboard/link/core/link_core.hpp"

namespace ledgerline::hil {

struct WorldConfig;

/// Sees what goes to link and what link does, and where the drones are: the observations and events by which a run is
/// checked. One thread.
class FlightObserver {
 public:
  FlightObserver(const WorldConfig& config, const sim::Simulator& sim);

  const std::vector<DroneObservation>& drones() const { return drones_; }
  /// Of the last step, and what was noted before it.
  const std::vector<WorldEvent>& events() const { return events_; }

  void note(TimeNs now, WorldEvent::Kind kind, std::size_t drone, std::string text);
  void begin_step();
  void on_poses(const std::vector<Pose>& poses);
  /// `host_slept_ns`: so far is the clock that plans are made by behind `now`.
  void on_plans(TimeNs now, TimeNs host_slept_ns, const std::vector<Plan>& plans);
  void on_plan_handed(TimeNs now, const Plan& plan);
  /// A call that its creator signed: what agent hands on must be in one.
  void on_call_signed(const fabric::Call& call);
  /// A call that is on the ledger: a stop that is not may be obeyed, and is over once the drone is down.
  void on_call_committed(const fabric::Call& call);
  /// A state that link said: what ground shows must be one.
  void on_state_reported(const StateSample& state);
  void on_state_shown(TimeNs now, std::size_t drone, const StateSample& state);
  /// `yaw_rad`: by which link made an rc.
  void on_command_sent(TimeNs now, DroneNumber drone, std::string_view command, double yaw_rad);
  void on_trace(TimeNs now, const TraceRecord& record);
  void on_link_ended();
  /// What is not running is null.
  void end_step(TimeNs now, const sim::Simulator& sim, const ground::FlightCore* ground, const link::LinkCore* link);
  /// Every drone is on the ground and known to be.
  bool all_down() const;

 private:
  std::vector<DroneObservation> drones_;
  struct SignedRequests {
    std::unordered_set<std::string> plans;  ///< every one that was signed
    bool stop = false, cut = false, clear_stop = false;
    bool stopped = false;          ///< by a stop that is on the ledger
    std::deque<StateSample> said;  ///< newest last
  };
  void check_handed(TimeNs now, const Plan& plan);

  std::vector<ground::Path> courses_;  ///< by drone: what a pilot should fly; none in a flight around paths
  std::vector<WorldEvent> events_, noted_;
  std::vector<SignedRequests> asked_;  ///< by drone
};

}  // namespace ledgerline::hil
