#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "ground/core/flight/command_outbox.hpp"
#include "ground/core/flight/diagnosis.hpp"
#include "ground/core/flight/phases.hpp"
#include "ground/core/flight/plan_timing.hpp"
#include "ground/core/flight/planner.hpp"
#include "ground/core/flight/state_intake.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/core/lease/lease_book.hpp"
#include "ground/core/lease/pilot_stops.hpp"
#include "ground/core/lease/request_answers.hpp"

namespace ledgerline::ground {

/// Flies N drones around a path, through the ledger: blocks in, `command` calls out, one plan per drone and state. What
/// is sent together, what waits and what is sent again: CommandOutbox.
///
/// Manual: no path, a pilot's commands instead. A velocity makes a plan at once, from the newest state; one that is not
/// renewed ends in zero after cmd_timeout_ns, and the drone hovers until it hears more or its failsafe lands it. An
/// order (PilotOrder) has a drone in the air fly a path of its pilot's, and hover or land behind it. A stop goes out by
/// itself, at once, and again until the ledger has it or refuses it. It ends when it is asked to, and every drone is
/// down.
///
/// The path of each drone begins where it stands before take-off. Times in plans are the drone host's clock alone: the
/// ground's clock and the drone's are never compared. A plan's first setpoint is for the moment when three of four
/// plans are there, by what the states say of when plans came, or, while they say nothing, by how long our own commands
/// take (RoundTripEstimate); its last one covers the delay's tail, so one that comes later takes over from its
/// predecessor then. Where link flies plans later than they say (its playout's margin) it says so, and predictions are
/// for that moment.
///
/// Without a ledger (FlightConfig::ledger) the same core flies beside the driver: no lease, a plan goes out at once,
/// for a few milliseconds later.
///
/// Deterministic; one thread; call step() for every block, outcome and request at once, and every 50 ms for the
/// time-outs.
class FlightCore {
 public:
  explicit FlightCore(FlightConfig config);
  FlightCore(const FlightCore&) = delete;  // its parts refer to each other
  FlightCore& operator=(const FlightCore&) = delete;

  /// Before the first step: a drone's record, as `get control/<drone>` answered it (bytes of ledgerline.Control). Later
  /// changes come with the blocks; so read the records behind the start of the block stream.
  Status set_control(const std::string& control);

  FlightOutputs step(TimeNs now_ns, const FlightInputs& inputs);

  bool done() const;  ///< every drone landed or failed; manual: asked to end, and no drone is in the air; no stop waits
  bool ok() const;    ///< every drone finished its path and landed; manual: nothing went wrong, a stop aside
  std::string why() const;  ///< of all drones; empty while nothing went wrong
  const std::vector<FlightDrone>& drones() const { return config_.drones; }
  const FlightStatus& status(std::size_t drone) const { return drones_.at(drone)->status; }
  const IntakeState& intake(std::size_t drone) const { return intake_.of(drone); }
  const Lease& lease(std::size_t drone) const { return leases_.of(drone); }
  const FlightConfig& config() const { return config_; }
  const FlightTransactions& transactions() const { return transactions_; }
  /// The round trip that plans are made for; the maximum over all drones.
  TimeNs delay_ns() const { return timing_.max_delay_ns(); }
  /// What was sent to it and is not flown yet (Planner::committed()); each call computes it.
  std::optional<CommittedPath> committed(TimeNs now_ns, std::size_t drone) const {
    return drones_.at(drone)->planner.committed(now_ns, timing_.of(drone));
  }
  /// Who steers along a path that is flown or was; null before.
  const Follower* follower(std::size_t drone) const { return drones_.at(drone)->planner.follower(); }
  /// The same where it is our own; null where a plug-in steers.
  const PathController* controller(std::size_t drone) const { return drones_.at(drone)->planner.controller(); }

 private:
  using Note = std::pair<std::string, TimeNs>;  ///< and when it was said
  struct Drone {
    Drone(const FlightConfig& config, std::size_t i, const Lease& lease, const IntakeState& seen,
          const PlanTiming& timing);
    FlightStatus status;
    Planner planner;
    Phases phases;
    bool fresh = false;      ///< a state came with this step
    bool commanded = false;  ///< the pilot said something with this step
    bool slowed_said = false;
    std::vector<Note> notes{};  ///< of the last second
    Diagnosis diagnosis{};
    std::uint64_t next_sequence = 1;  ///< without a ledger
  };

  void on_block(TimeNs now_ns, const FlightInputs& inputs, FlightOutputs& out);
  void on_alarm(const DroneUpdate& update, FlightOutputs& out);
  void on_state(TimeNs now_ns, std::size_t index, const StateSample& sample, FlightOutputs& out);
  void lease_changed(TimeNs now_ns, const LeaseBook::Change& change);
  void on_outcome(TimeNs now_ns, const FlightInputs& inputs, FlightOutputs& out);
  void on_command(TimeNs now_ns, const PilotCommand& command, FlightOutputs& out);
  void step_drone(TimeNs now_ns, std::size_t index, const FlightInputs& inputs, FlightOutputs& out);
  void emit_local_plan(TimeNs now_ns, std::size_t index, PlannedCommand command, FlightOutputs& out);
  Diagnosis::Finding diagnose(TimeNs now_ns, std::size_t index) const;
  /// False while the drone's state is unknown, and while we fly it.
  bool is_on_ground(std::size_t index) const;
  /// The error says who holds the lease, where it is not who commands. Landings and stops are anybody's.
  Status check_holder(const PilotCommand& command) const;
  void refuse(TimeNs now_ns, std::size_t index, const std::string& why, FlightOutputs& out);
  void add_note(TimeNs now_ns, std::size_t index, const std::string& why, FlightOutputs& out);

  const FlightConfig config_;
  FlightTransactions transactions_;
  LeaseBook leases_;
  StateIntake intake_;
  PlanTiming timing_;
  PilotStops stops_;
  RequestAnswers requests_;
  std::vector<std::unique_ptr<Drone>> drones_;
  std::optional<CommandOutbox> outbox_;  ///< of a ledger
  TimeNs started_ns_ = 0;                ///< 0: not yet
  bool ending_ = false;                  ///< manual: asked to
  std::uint64_t next_id_ = 1;
};

}  // namespace ledgerline::ground
