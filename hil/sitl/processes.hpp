#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/histogram.hpp"
#include "ground/core/flight.hpp"
#include "ground/mission/run.hpp"
#include "hil/sitl/digester.hpp"
#include "hil/sitl/ledger/ledger_port.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"
#include "hil/sitl/ledger/stoppers.hpp"
#include "hil/sitl/wires.hpp"
#include "hil/sitl/witness.hpp"
#include "hil/sitl/world_setup.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/agent/core/mocap.hpp"
#include "onboard/link/core/link_core.hpp"
#include "sim/core/simulator.hpp"

// The processes of a simulated world: each is its program's core, with what its shell keeps besides, and may die and
// come back. All in one thread.

namespace ledgerline::hil {

/// What an operator says of the mission.
enum class MissionCommand : std::uint8_t { approve, start, pause, resume, land };

/// A ground station's mission in a simulated world: the courses of all drones, flown together by MissionRun. It
/// outlives ground as the kept file does, and goes on by WorldConfig::after_restart. Deterministic; one thread.
class MissionStation {
 public:
  explicit MissionStation(const WorldConfig& config);

  /// The error says why it is refused. `core`: ground as it runs.
  Status apply(MissionCommand word, const ground::FlightCore& core);
  /// Behind ground's step; what it wants is for the next one.
  std::vector<ground::PilotCommand> step(TimeNs now, const ground::FlightCore& core);
  void ground_ended();
  void ground_began();

 private:
  std::vector<ground::mission::Finding> check(const ground::mission::Mission& mission,
                                              const ground::FlightCore& core) const;
  /// The error is what forbids it.
  Status allowed(const ground::mission::Mission& mission, const ground::FlightCore& core) const;
  void approve();

  ground::mission::RunConfig rules_;
  ground::mission::Fence fence_;
  bool approved_ = false, said_ = false;
  std::optional<ground::mission::MissionRun> run_;  ///< none while ground does not run
  std::string kept_;                                ///< as it was then
};

/// The clocks of a simulated world, and what was done to them.
class WorldClock {
 public:
  enum class Host : std::uint8_t { mocap, drones };

  void advance(TimeNs by_ns);
  TimeNs now() const { return now_; }
  /// Real time minus now().
  TimeNs real_offset(Host host) const;
  /// CLOCK_MONOTONIC of the drones' host, and real time less it.
  TimeNs host_now() const { return now_ - host_slept_ns_; }
  TimeNs host_real_offset() const { return real_offset(Host::drones) + host_slept_ns_; }
  TimeNs host_slept_ns() const { return host_slept_ns_; }

  /// Real time, of all hosts or of one. What a drift has made of it stays.
  void jump(TimeNs by_ns) { jump_ns_ += by_ns; }
  void jump(Host host, TimeNs by_ns) { host_jump_ns_[static_cast<std::size_t>(host)] += by_ns; }
  void drift(Host host, double share) { host_drift_[static_cast<std::size_t>(host)] = share; }
  /// The drones' host, link and agent, sleeps: its clock stands still meanwhile.
  void suspend_host(bool suspended) { host_suspended_ = suspended; }
  bool host_suspended() const { return host_suspended_; }

 private:
  TimeNs now_ = 0, jump_ns_ = 0, host_slept_ns_ = 0;
  std::array<TimeNs, 2> host_jump_ns_{};
  std::array<double, 2> host_drift_{};
  bool host_suspended_ = false;
};

/// What the processes of a world have in common.
struct SharedWorld {
  explicit SharedWorld(const WorldConfig& world_config);
  void note(WorldEvent::Kind kind, std::size_t drone, std::string text) {
    witness.note(clock.now(), kind, drone, std::move(text));
  }
  const std::vector<DroneObservation>& drones() const { return witness.drones(); }

  WorldConfig config;
  WorldClock clock;
  SimulatedLedger ledger;
  bool ledger_stalled = false;
  sim::Simulator sim;
  Wires wires;
  Digester digester;
  Witness witness;
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
void apply_news(const std::vector<SimulatedLedger::Ended>& outcomes, const std::vector<fabric::Block>& blocks,
                const Step& step) {
  for (const auto& ended : outcomes) {
    ground::FlightInputs inputs;
    inputs.outcome = &ended.outcome;
    inputs.outcome_id = ended.id;
    step(inputs);
  }
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ground::FlightInputs inputs;
    inputs.block = &blocks[i];
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
  void witness_poses();

  SharedWorld& world_;
  std::optional<link::LinkCore> core_;
  std::uint64_t start_ = 0;
  std::vector<TimeNs> starts_ns_;
  std::optional<TimeNs> ends_ns_;  ///< SIGTERM came: at the latest then
  bool begins_again_ = false;
  link::DroneSet stops_;  ///< the file of its local stops
};

}  // namespace ledgerline::hil
