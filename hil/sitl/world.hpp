#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/verification/control_records.hpp"
#include "ground/core/flight.hpp"
#include "hil/sitl/ledger/ledger_port.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"
#include "hil/sitl/ledger/stoppers.hpp"
#include "hil/sitl/local_loop.hpp"
#include "hil/sitl/mission/mission_station.hpp"
#include "hil/sitl/wires/drone_network.hpp"
#include "hil/sitl/witness.hpp"
#include "hil/sitl/world_setup.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/agent/core/mocap_intake.hpp"
#include "onboard/link/core/link_core.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil {

class Digester;
class SdkFaults;
struct Wires;

/// A whole flight in one thread on a simulated clock, millisecond by millisecond, so that faults can act between: the
/// cores of sim, link, agent, node and ground, with test signers, and between them the bytes that go between the
/// processes, on links that may be impaired. Shared memory is queues of iceoryx's lengths. Processes may die, stand
/// still and come back. The same config and the same calls give the same bytes (digest()).
class SimulatedWorld {
 public:
  /// An error is one of the set-up, and a bug.
  static Result<std::unique_ptr<SimulatedWorld>> create(const WorldConfig& config);
  ~SimulatedWorld();

  /// One millisecond.
  void step();
  TimeNs now() const { return now_; }
  const std::vector<DroneFacts>& facts() const { return witness_.facts(); }
  /// Of the last step, and what was done to the world before it.
  const std::vector<WorldEvent>& events() const { return witness_.events(); }

  /// Ground has ended, and every drone is on the ground and known to be, for half a second.
  bool over() const;
  /// It has ended; a dead one that was commanded to start has not.
  bool ground_done() const { return ground_ ? ground_->done() : !ground_wanted_; }
  bool ok() const { return ground_ && ground_->ok(); }
  std::string why() const { return ground_ ? ground_->why() : "ground is not running"; }
  bool lives(Process process) const;
  /// It runs: it lives and was not stopped.
  bool runs(Process process) const;

  /// What ground and agent count as committed, but a node that restarts from its store does not know or holds for
  /// invalid: must be none. At the end: it restarts the node.
  std::vector<std::string> lost_acknowledged();
  /// Transitions that are neither on the ledger nor kept by link or agent: drones with such, in words; of the link that
  /// runs now.
  std::vector<std::string> lost_transitions() const;
  std::uint64_t transitions_pending() const;

  /// SHA-256 over all blocks, all trace records, every datagram and every mocap pose so far. Call it once, at the end.
  crypto::Digest digest();
  std::uint64_t blocks() const { return ledger_.height(); }
  std::uint64_t transactions() const { return ledger_.transactions(); }
  /// What became of a drone's plans, in words: agent's refusals and link's counters, of those that run now.
  std::string plans_text(std::size_t drone) const;
  /// From a state until the command that answers it is here again: as agent counts it, or a local flight.
  Quantiles two_way_ms(std::size_t drone) const;
  const ground::FlightCore* ground() const { return ground_.get(); }             ///< null while it does not run
  const agent::AgentCore* agent() const { return agent_ ? &*agent_ : nullptr; }  ///< null while it does not run
  const link::LinkCore* link() const { return link_ ? &*link_ : nullptr; }

  // Faults. Drones are indices.
  DroneNetwork& network(std::size_t drone);
  SdkFaults& sdk();
  void kill(Process process);   ///< also one whose start waits for the ledger
  void start(Process process);  ///< no effect while it lives
  void stop(Process process, bool stopped) { stopped_[static_cast<std::size_t>(process)] = stopped; }
  /// The drones' host, link and agent, sleeps: its clock stands still meanwhile.
  void suspend_host(bool suspended) { host_suspended_ = suspended; }
  /// SIGTERM: link lands what flies and ends, as its loop does; `again`: its supervisor then restarts it.
  void end_link(bool again = false);
  void stall_ledger(bool stalled) { ledger_stalled_ = stalled; }
  void restart_ledger();
  LedgerPort& port(Process process) { return process == Process::agent ? host_ : operator_; }
  Relay& relay() { return ledger_.relay(); }
  SimulatedLedger& ledger() { return ledger_; }
  /// Real time, of all hosts or of one. What a drift has made of it stays.
  enum class Host : std::uint8_t { mocap, drones };
  void jump_clock(TimeNs by_ns) { clock_jump_ns_ += by_ns; }
  void jump_clock(Host host, TimeNs by_ns) { host_jump_ns_[static_cast<std::size_t>(host)] += by_ns; }
  void drift_clock(Host host, double share) { host_drift_[static_cast<std::size_t>(host)] = share; }
  sim::Simulator& sim() { return sim_; }
  /// The contract's stop, and its end.
  void say_control(Stopper who, std::size_t drone, ControlWord word);
  /// What the pilot of a manual flight wants; with ground's next step.
  void post_command(const ground::PilotCommand& command) { commands_.push_back(command); }
  /// What the operator of a manual flight says of its mission; refused while ground does not run.
  void say(MissionWord word);
  void note(WorldEvent::Kind kind, std::size_t drone, std::string text) {
    witness_.note(now_, kind, drone, std::move(text));
  }

 private:
  explicit SimulatedWorld(const WorldConfig& config);
  Status set_up();
  Status start_agent();
  Status start_ground();
  void start_link();
  void step_sim();
  void step_mocap(const std::vector<sim::MocapPose>& poses);
  void deliver_to_drones();
  /// The poses of a drone that have come and are accepted.
  std::vector<agent::MocapPose> take_mocap(std::size_t drone);
  void step_agent();
  void step_local();
  void step_ground();
  void step_link();
  void give_ground(ground::FlightInputs inputs);
  Result<Control> read_control(LedgerPort& port, const std::string& drone);
  /// Real time minus now().
  TimeNs real_offset(Host host) const;
  /// CLOCK_MONOTONIC of the drones' host, and real time less it.
  TimeNs host_now() const { return now_ - host_slept_ns_; }
  TimeNs host_real_offset() const { return real_offset(Host::drones) + host_slept_ns_; }
  bool stopped(Process process) const {
    return stopped_[static_cast<std::size_t>(process)] || (host_suspended_ && process != Process::ground);
  }

  WorldConfig config_;
  SimulatedLedger ledger_;
  LedgerPort host_, operator_;
  Stoppers stoppers_;
  std::vector<ground::PilotCommand> commands_;
  std::vector<SimulatedLedger::Ended> ground_outcomes_;  ///< a ground that stands still finds them later
  sim::Simulator sim_;
  std::optional<link::LinkCore> link_;
  std::optional<agent::AgentCore> agent_;
  std::optional<agent::MocapIntake> mocap_intake_;
  std::unique_ptr<ground::FlightCore> ground_;
  std::optional<MissionStation> mission_;  ///< of a manual flight
  std::unique_ptr<Wires> wires_;
  std::unique_ptr<Digester> digester_;
  Witness witness_;
  TimeNs now_ = 0, next_ground_ns_ = 0, next_clock_ns_ = 0, quiet_since_ns_ = 0, clock_jump_ns_ = 0;
  std::array<TimeNs, 2> host_jump_ns_{};
  std::array<double, 2> host_drift_{};
  std::uint64_t starts_ = 0, link_start_ = 0;
  bool ledger_stalled_ = false, host_suspended_ = false;
  TimeNs host_slept_ns_ = 0;
  std::array<bool, process_count> stopped_{};
  std::optional<TimeNs> link_ends_ns_;  ///< SIGTERM came: at the latest then
  bool link_begins_again_ = false;
  link::DroneSet link_stops_;  ///< the file of its local stops
  std::vector<TimeNs> link_starts_ns_;
  bool agent_wanted_ = true, ground_wanted_ = true;  ///< to live: a start waits until the ledger is reached
  agent::AgentOutputs agent_out_;
  std::optional<fabric::Checkpoint> agent_checkpoint_;  ///< as the last agent left it, with its records
  agent::FirstRecords agent_records_;
  std::optional<LocalLoop> local_;  ///< in the agent's place
};

}  // namespace ledgerline::hil
