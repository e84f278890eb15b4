#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "ground/core/flight.hpp"
#include "hil/ledger_port.hpp"
#include "hil/line.hpp"
#include "hil/sensor_text.hpp"
#include "hil/virtual_ledger.hpp"
#include "onboard/agent/agent_core.hpp"
#include "onboard/agent/mocap_clock.hpp"
#include "onboard/link/link_core.hpp"
#include "sim/simulator.hpp"

namespace ledgerline::hil {

class Digester;

inline constexpr double on_ground_m = 0.1;  ///< a drone below it, its motors off, is on the ground

struct WorldConfig {
  int drones = 1;
  ground::Shape shape = ground::Shape::square;
  double side_m = 1.5;
  double speed_mps = 0.5;
  double rate_hz = 30;
  int laps = 1;
  bool predict = true;
  TimeNs max_age_ns = 500 * ns_per_ms;  ///< of a command, from its state's stamp; for a far ledger more
  double battery = 1.0;                 ///< of every drone at the start, 0..1
  double room_m = 3;                    ///< the fence's distance from the drones' places
  std::size_t batch_count = 1;
  TimeNs batch_timeout_ns = 10 * ns_per_ms;
  std::uint64_t seed = 1;
};

/// What a run is judged by: one drone at one moment. What link, agent and ground say is as they say it; the truth is
/// the simulator's.
struct DroneFacts {
  std::string name;
  DroneNumber number = 0;
  sim::Truth truth;
  FlightPhase phase = FlightPhase::disconnected;
  FailsafeMode mode = FailsafeMode::none;
  FailsafeCause cause = FailsafeCause::none;
  double told_mps = 0;       ///< horizontal and vertical speed of the newest rc, together
  TimeNs told_ns = 0;        ///< when it was sent; 0: never
  TimeNs told_until_ns = 0;  ///< end of the newest plan that link was given, as it says; 0: none
  TimeNs plan_end_ns = 0;    ///< the same, later by playout's margin now; 0: none
  std::optional<Pose> pose;  ///< newest that link was given
  ground::DronePhase ground_phase = ground::DronePhase::waiting;
  bool finished = false;
  int lap = 0;                       ///< 0 before the path
  std::optional<double> off_path_m;  ///< on its path: distance of the truth from it
  std::array<double, 2> start_m{};   ///< where it stood
};

/// What happened at one moment.
struct WorldEvent {
  enum class Kind {
    mode,     ///< link's phase, mode or cause changed; the facts have them
    applied,  ///< a plan's first setpoint was sent: `value` is its age [s]
    sent,     ///< a command that is no rc went to the drone: `text`
    bad_rc,   ///< an rc that the SDK would not take: `text`
    started,  ///< a process: `text`
    ended,    ///< the same
    fault,    ///< begins or ends: `text`
  };
  TimeNs t_ns = 0;
  Kind kind{};
  std::size_t drone = 0;  ///< index; of a process 0
  double value = 0;
  std::string text{};
};

/// The lines between the parts: to a drone's port 8889, its answers, its state text, its mocap.
enum class LineAt : std::uint8_t { to, answers, states, mocap };
inline constexpr std::size_t line_count = 4;

/// What mocap says wrongly about a drone.
struct MocapFault {
  bool frozen = false;
  std::array<double, 3> offset_m{};
  double noise_m = 0;  ///< standard deviation
  TimeNs period_ns = 0;
};

enum class Process : std::uint8_t { agent, link, ground };

/// A whole flight in one thread on a virtual clock, millisecond by millisecond, so that faults can act between: the
/// cores of sim, link, agent, node and ground, with test signers, and between them the bytes that go between the
/// processes, on lines that may be impaired. Shared memory is queues of iceoryx's lengths. Processes may die, stand
/// still and come back. The same config and the same calls give the same bytes (digest()).
class VirtualWorld {
 public:
  /// An error is one of the set-up, and a bug.
  static Result<std::unique_ptr<VirtualWorld>> create(const WorldConfig& config);
  ~VirtualWorld();

  /// One millisecond.
  void step();
  TimeNs now() const { return now_; }
  const std::vector<DroneFacts>& facts() const { return facts_; }
  /// Of the last step, and what was done to the world before it.
  const std::vector<WorldEvent>& events() const { return events_; }

  /// Ground has ended, and every drone is on the ground and known to be, for half a second.
  bool over() const;
  /// It has ended; a dead one that was told to start has not.
  bool ground_done() const { return ground_ ? ground_->done() : !ground_wanted_; }
  bool ok() const { return ground_ && ground_->ok(); }
  std::string why() const { return ground_ ? ground_->why() : "ground is not running"; }
  bool lives(Process process) const;
  /// It runs: it lives and was not stopped.
  bool runs(Process process) const;
  ground::FlightStatus status(std::size_t drone) const;

  /// What ground and agent were told is on the ledger, and is not in its blocks as valid: must be none. Reads all
  /// blocks.
  std::vector<std::string> lost_acknowledged() const;
  /// Transitions that are neither on the ledger nor kept by link or agent: drones with such, in words; of the link that
  /// runs now.
  std::vector<std::string> lost_transitions() const;
  std::uint64_t transitions_pending() const;

  /// SHA-256 over all blocks, all trace records, every datagram and every mocap pose so far. Call it once, at the end.
  crypto::Digest digest();
  std::uint64_t blocks() const { return ledger_.height(); }
  std::uint64_t transactions() const { return ledger_.transactions(); }
  const LedgerPort::Counts& counts(Process process) const;
  /// What became of a drone's plans, in words: agent's refusals and link's counters, of those that run now.
  std::string plans_text(std::size_t drone) const;
  LineCounts line_counts(LineAt at, std::size_t drone) const;

  // Faults. Drones are indices.
  void impair(LineAt at, std::size_t drone, const Impairment& impairment);
  /// All that it has now; one that it had before, by `item`, goes on with what it said and when.
  void set_sensor_faults(std::size_t drone, std::vector<SensorFault> faults);
  void set_mocap_fault(std::size_t drone, const MocapFault& fault);
  void kill(Process process);   ///< also one whose start waits for the ledger
  void start(Process process);  ///< no effect while it lives
  void stop(Process process, bool stopped);
  void stall_ledger(bool stalled) { ledger_stalled_ = stalled; }
  void restart_ledger();
  LedgerPort& port(Process process) { return process == Process::agent ? host_ : operator_; }
  void jump_clock(TimeNs by_ns) { clock_jump_ns_ += by_ns; }
  sim::Simulator& sim() { return sim_; }
  /// The operator's stop of the contract.
  void stop_drone(std::size_t drone, bool cut);
  void note(WorldEvent::Kind kind, std::size_t drone, std::string text);

 private:
  struct Wires;
  explicit VirtualWorld(const WorldConfig& config);
  Status set_up();
  Status start_agent();
  Status start_ground();
  void start_link();
  void step_sim();
  void step_mocap(const std::vector<sim::MocapPose>& poses);
  void deliver_to_drones();
  void step_agent();
  void step_ground();
  void step_link();
  void give_ground(ground::FlightInputs inputs);
  void take_link_traces(const link::LinkOutputs& out);
  void look();
  Result<std::string> control_record(LedgerPort& port, const std::string& drone);
  TimeNs real_offset() const;

  WorldConfig config_;
  VirtualLedger ledger_;
  LedgerPort host_, operator_;
  sim::Simulator sim_;
  std::optional<link::LinkCore> link_;
  std::optional<agent::AgentCore> agent_;
  std::optional<agent::MocapClock> mocap_clock_;
  std::unique_ptr<ground::FlightCore> ground_;
  std::unique_ptr<Wires> wires_;
  std::unique_ptr<Digester> digester_;
  TimeNs now_ = 0, next_ground_ns_ = 0, next_clock_ns_ = 0, quiet_since_ns_ = 0, clock_jump_ns_ = 0;
  std::uint64_t starts_ = 0;
  bool ledger_stalled_ = false, agent_stopped_ = false, link_stopped_ = false, ground_stopped_ = false;
  bool agent_wanted_ = true, ground_wanted_ = true;  ///< to live: a start waits until the ledger is reached
  std::uint64_t next_call_ = 1;
  std::vector<DroneFacts> facts_;
  std::vector<WorldEvent> events_, new_events_;
  agent::AgentOutputs agent_out_;
};

}  // namespace ledgerline::hil
