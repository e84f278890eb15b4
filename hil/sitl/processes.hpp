#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/histogram.hpp"
#include "ground/core/flight.hpp"
#include "hil/sitl/digester.hpp"
#include "hil/sitl/drone_network.hpp"
#include "hil/sitl/flight_observer.hpp"
#include "hil/sitl/ledger/ledger_port.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"
#include "hil/sitl/ledger/stoppers.hpp"
#include "hil/sitl/mission_station.hpp"
#include "hil/sitl/world_clock.hpp"
#include "hil/sitl/world_setup.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/agent/core/mocap.hpp"
#include "onboard/link/core/link_core.hpp"
#include "sim/core/simulator.hpp"

// The processes of a simulated world: each is its program's core, with what its shell keeps besides, and may die and
// come back. All in one thread.

namespace ledgerline::hil {

/// What the processes of a world have in common.
struct SharedWorld {
  explicit SharedWorld(const WorldConfig& world_config);
  void note(WorldEvent::Kind kind, std::size_t drone, std::string text) {
    observer.note(clock.now(), kind, drone, std::move(text));
  }
  const std::vector<DroneObservation>& drones() const { return observer.drones(); }

  WorldConfig config;
  WorldClock clock;
  SimulatedLedger ledger;
  bool ledger_stalled = false;
  sim::Simulator sim;
  Wires wires;
  Digester digester;
  FlightObserver observer;
  std::uint64_t starts = 0;  ///< of processes, so far
};

/// What stands in the agent's place where the controller flies beside the driver: it fuses mocap and says that the
/// ledger is alive; states and plans go from hand to hand, and how long that takes is counted.
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

/// agent; in a local flight LocalLoop in its place. A start waits until the ledger is reached.
class AgentProcess {
 public:
  explicit AgentProcess(SharedWorld& world);

  /// The error is the ledger's: then it does not run.
  Status start();
  void kill();
  void set_wanted(bool wanted) { wanted_ = wanted; }
  bool lives() const { return core_.has_value(); }
  /// Somebody takes what link and mocap say.
  bool listens() const { return core_ || local_; }
  const agent::AgentCore* core() const { return core_ ? &*core_ : nullptr; }
  LedgerPort& port() { return port_; }
  Quantiles two_way_ms(std::size_t drone) const;

  /// `link`: which start of link gets what it says; nothing: none runs.
  void step(bool stopped, std::optional<std::uint64_t> link);
  /// Of a local flight: the states for ground, and ground's plans.
  std::vector<StateSample> step_local();
  void apply_plans(const std::vector<Plan>& plans);

 private:
  bool try_start();
  void drop_arrivals();
  void receive();
  void send(std::optional<std::uint64_t> link);
  /// The poses of a drone that have come and are accepted.
  std::vector<agent::MocapPose> pop_mocap(std::size_t drone);

  SharedWorld& world_;
  LedgerPort port_;
  bool wanted_ = true;
  std::optional<agent::AgentCore> core_;
  std::optional<agent::MocapIntake> mocap_;
  TimeNs next_clock_ns_ = 0;
  agent::AgentOutputs out_;
  std::optional<fabric::Checkpoint> checkpoint_;  ///< as the last agent left it, with its records
  agent::FirstRecords records_;
  std::optional<LocalLoop> local_;
};

/// ground, whose operator may speak to the contract besides (Stoppers). A start waits until the ledger is reached.
class GroundProcess {
 public:
  explicit GroundProcess(SharedWorld& world);

  /// The error is the ledger's: then it does not run.
  Status start();
  void kill();
  void set_wanted(bool wanted) { wanted_ = wanted; }
  bool lives() const { return core_ != nullptr; }
  /// It has ended; a dead one that was commanded to start has not.
  bool is_done() const { return core_ ? core_->done() : !wanted_; }
  const ground::FlightCore* core() const { return core_.get(); }
  LedgerPort& port() { return port_; }
  Stoppers& stoppers() { return stoppers_; }

  /// What the pilot of a manual flight wants; with the next step.
  void post_command(const ground::PilotCommand& command) { commands_.push_back(command); }
  /// What the operator of a manual flight says of its mission. The error says why it is refused.
  Status apply(MissionCommand word);

  /// What has come from the ledger; also where it stands still.
  void step_port();
  void step(bool stopped);
  /// Of a local flight; the plans are for link.
  std::vector<Plan> step_local(const std::vector<StateSample>& states);

 private:
  std::vector<Plan> step_core(ground::FlightInputs inputs);

  SharedWorld& world_;
  LedgerPort port_;
  Stoppers stoppers_;
  bool wanted_ = true;
  std::unique_ptr<ground::FlightCore> core_;
  std::optional<MissionStation> mission_;  ///< of a manual flight
  std::vector<ground::PilotCommand> commands_;
  std::vector<SimulatedLedger::Ended> outcomes_;  ///< one that stands still finds them later
  TimeNs next_ns_ = 0;
};

/// Steps a ground with what the ledger has for it, in the order of ground's shell: how calls ended, then blocks.
template <typename Step>
void apply_updates(const std::vector<SimulatedLedger::Ended>& outcomes, const std::vector<VerifiedBlock>& blocks,
                   const Step& step) {
  for (const auto& ended : outcomes) {
    ground::FlightInputs inputs;
    inputs.outcome = &ended.outcome;
    inputs.outcome_id = ended.id;
    step(inputs);
  }
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ground::FlightInputs inputs;
    inputs.block = blocks[i].get();
    inputs.more = i + 1 < blocks.size();
    step(inputs);
  }
}

class LinkProcess {
 public:
  explicit LinkProcess(SharedWorld& world) : world_(world) {}

  void start();
  void kill();
  bool lives() const { return core_.has_value(); }
  /// Which start of it runs; nothing: none.
  std::optional<std::uint64_t> running() const { return core_ ? std::optional(start_) : std::nullopt; }
  const link::LinkCore* core() const { return core_ ? &*core_ : nullptr; }
  /// SIGTERM: it lands what flies and ends, as its loop does; `again`: its supervisor then restarts it.
  void end(bool again);
  bool begins_again() const { return begins_again_; }

  /// `agent_listens`: somebody takes what it says. True: it has landed what flew, and ends.
  bool step(bool agent_listens);

 private:
  void observe_poses();

  SharedWorld& world_;
  std::optional<link::LinkCore> core_;
  std::uint64_t start_ = 0;
  std::vector<TimeNs> starts_ns_;
  std::optional<TimeNs> ends_ns_;  ///< SIGTERM came: at the latest then
  bool begins_again_ = false;
  link::DroneSet stops_;  ///< the file of its local stops
};

}  // namespace ledgerline::hil
