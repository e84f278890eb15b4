#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "hil/sitl/processes.hpp"

namespace ledgerline::hil {

/// A whole flight in one thread on a simulated clock, millisecond by millisecond, so that faults can act between: the
/// cores of sim, link, agent, node and ground, with test signers, and between them the bytes that go between the
/// processes, on links that may be impaired. Shared memory is queues of iceoryx's lengths. Processes may die, stand
/// still and come back. The same config and the same calls give the same bytes (digest()).
class SimulatedWorld {
 public:
  /// An error is one of the set-up, and a bug.
  static Result<std::unique_ptr<SimulatedWorld>> create(const WorldConfig& config);

  /// One millisecond.
  void step();
  TimeNs now() const { return shared_.clock.now(); }
  const std::vector<DroneObservation>& drones() const { return shared_.drones(); }
  /// Of the last step, and what was done to the world before it.
  const std::vector<WorldEvent>& events() const { return shared_.observer.events(); }

  /// Ground has ended, and every drone is on the ground and known to be, for half a second.
  bool over() const;
  bool ground_done() const { return ground_.is_done(); }
  bool ok() const { return ground() && ground()->ok(); }
  std::string why() const { return ground() ? ground()->why() : "ground is not running"; }
  bool lives(Process process) const;
  /// It runs: it lives and was not stopped.
  bool runs(Process process) const { return lives(process) && !stopped(process); }

  /// What ground and agent count as committed, but a node that restarts from its store does not know or holds for
  /// invalid: must be none. At the end: it restarts the node.
  std::vector<std::string> lost_acknowledged();
  /// Transitions that are neither on the ledger nor kept by link or agent: drones with such, in words; of the link that
  /// runs now.
  std::vector<std::string> lost_transitions() const { return shared_.ledger.transition_gaps(); }
  std::uint64_t transitions_pending() const;

  /// SHA-256 over all blocks, all trace records, every datagram and every mocap pose so far. Call it once, at the end.
  crypto::Digest digest();
  std::uint64_t blocks() const { return shared_.ledger.height(); }
  std::uint64_t transactions() const { return shared_.ledger.transactions(); }
  /// From a state until the command that answers it is here again: as agent counts it, or a local flight.
  Quantiles two_way_ms(std::size_t drone) const { return agent_.two_way_ms(drone); }
  // Null while they do not run.
  const ground::FlightCore* ground() const { return ground_.core(); }
  const agent::AgentCore* agent() const { return agent_.core(); }
  const link::LinkCore* link() const { return link_.core(); }

  // Faults. Drones are indices.
  DroneNetwork& network(std::size_t drone) { return shared_.wires.drones[drone].network; }
  SdkFaults& sdk() { return shared_.wires.sdk; }
  void kill(Process process);   ///< also one whose start waits for the ledger
  void start(Process process);  ///< no effect while it lives
  void stop(Process process, bool stopped) { stopped_[static_cast<std::size_t>(process)] = stopped; }
  /// SIGTERM: link lands what flies and ends, as its loop does; `again`: its supervisor then restarts it.
  void end_link(bool again = false) { link_.end(again); }
  void stall_ledger(bool stalled) { shared_.ledger_stalled = stalled; }
  void restart_ledger();
  LedgerPort& port(Process process) { return process == Process::agent ? agent_.port() : ground_.port(); }
  Relay& relay() { return shared_.ledger.relay(); }
  SimulatedLedger& ledger() { return shared_.ledger; }
  WorldClock& clock() { return shared_.clock; }
  sim::Simulator& sim() { return shared_.sim; }
  /// The contract's stop, and its end.
  void post_control(Stopper who, std::size_t drone, ControlCommand word);
  /// What the pilot of a manual flight wants; with ground's next step.
  void post_command(const ground::PilotCommand& command) { ground_.post_command(command); }
  /// What the operator of a manual flight says of its mission; refused while ground does not run.
  void post_mission_command(MissionCommand word);
  void note(WorldEvent::Kind kind, std::size_t drone, std::string text) { shared_.note(kind, drone, std::move(text)); }

 private:
  explicit SimulatedWorld(const WorldConfig& config);
  Status set_up();
  void step_sim();
  void step_mocap(const std::vector<sim::MocapPose>& poses);
  void step_link();
  void deliver_to_drones();
  bool stopped(Process process) const {
    return stopped_[static_cast<std::size_t>(process)] ||
           (shared_.clock.host_suspended() && process != Process::ground);
  }

  SharedWorld shared_;
  AgentProcess agent_;
  GroundProcess ground_;
  LinkProcess link_;
  std::array<bool, process_count> stopped_{};
  TimeNs quiet_since_ns_ = 0;
};

}  // namespace ledgerline::hil
