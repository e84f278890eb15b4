#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/belief/control_events.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/sending/in_flight.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/msg/ros.hpp"
#include "common/rt/trace.hpp"
#include "ground/core/controller.hpp"
#include "ground/core/path.hpp"
#include "ground/motion/delays.hpp"

namespace ledgerline {
class Control;
}  // namespace ledgerline

namespace ledgerline::ground {

struct PlannedCommand;

struct FlightDrone {
  std::string name;  ///< "tello1"
  DroneNumber number = 1;
};

struct FlightConfig {
  std::vector<FlightDrone> drones;
  bool manual = false;                      ///< flown by a pilot's messages instead of around a path
  TimeNs cmd_timeout_ns = 300 * ns_per_ms;  ///< a pilot's velocity holds so long
  Shape shape = Shape::square;
  double side_m = 1.5;
  std::vector<Waypoint> waypoints;  ///< of a path of one's own; empty: the shape
  bool ledger = true;  ///< false: states come by FlightInputs::states, plans go out by FlightOutputs::plans
  int laps = 3;
  double seconds = 0;  ///< > 0: fly the path this long instead of counting laps; manual: land and end after so long
  ControllerConfig controller;
  crypto::IdentityName self;  ///< whose lease it must be
  std::shared_ptr<crypto::MspRegistry>
      believed;  ///< states must be signed by one of these, the drone's owner, and control events must follow from
                 ///< what their signer asked for; null: not checked
  fabric::ChannelAndContract where;  ///< what comes from elsewhere is not for us

  // Time-outs of the phases; each ends in landing, or in failure where there is nothing to land.
  TimeNs wait_ns = 30 * ns_per_s;     ///< for the first state with a pose, on the ground, under our lease
  TimeNs takeoff_ns = 25 * ns_per_s;  ///< until it hovers at the origin
  TimeNs settle_ns = 8 * ns_per_s;    ///< the part of it that is spent on settling at the origin
  TimeNs silence_ns = 5 * ns_per_s;   ///< no state at all while flying; a ledger may be choosing a new leader
  TimeNs landing_ns = 20 * ns_per_s;
  double path_factor = 3.0;  ///< path: this many times the time that it should take, and half a minute
};

/// Per drone: waiting -> takeoff -> path -> landing -> landed, or failed: never took off, or not seen to land.
/// In a manual flight `manual` stands for the path, and a take-off is possible whenever the drone is on the ground.
enum class DronePhase { waiting, takeoff, path, manual, landing, landed, failed };
std::string name_of(DronePhase phase);

/// One transaction to submit; its outcome comes back with the same id.
struct Submission {
  std::uint64_t id = 0;
  fabric::Call call;
  bool urgent = false;  ///< a stop: must not wait behind commands
};

/// What a pilot wants of one drone, since the last time. Of several words the safest counts: cut, stop, land.
struct PilotWish {
  std::size_t drone = 0;  ///< index into FlightConfig::drones
  std::optional<Twist> velocity{};
  TimeNs came_ns = 0;  ///< when the velocity came; the ground's clock
  bool takeoff = false, land = false;
  bool stop = false, cut = false;  ///< the contract's stop: land now, whoever flies; motors off at once
  std::uint64_t replaced = 0;      ///< velocities for which a newer one came before anybody looked
  std::uint64_t bad_values = 0;    ///< velocities that no drone can fly
  std::uint64_t malformed = 0;     ///< messages that are not what their topic says
};

struct FlightInputs {
  const fabric::Block* block = nullptr;      ///< the next of the stream, checked as a chain by the client
  const fabric::Outcome* outcome = nullptr;  ///< of submission `outcome_id`
  std::uint64_t outcome_id = 0;
  bool more = false;  ///< there is newer input already: nothing is sent before that was seen
  std::string land;   ///< not empty: land all drones and end; why
  std::span<const PilotWish> wishes;
  std::span<const StateSample> states;  ///< without a ledger: straight from link
  std::int64_t realtime_s = 0;          ///< for the expiry of certificates
};

/// What a block says of a drone; CDR as it came. Empty is what it does not say, or has said before.
struct DroneNews {
  std::size_t drone = 0;  ///< index into FlightConfig::drones
  std::optional<StateSample> state;
  std::string odometry, battery;  ///< of the state's moment
  std::string transitions;        ///< of the failsafe
};

struct FlightOutputs {
  std::vector<Submission> submissions;
  std::vector<TraceRecord> traces;
  std::vector<DroneNews> news;
  std::vector<std::string> notes;  ///< for the log: what a pilot wished and did not get; a path that is flown slower
  std::vector<Plan> plans;         ///< without a ledger: straight to link
};

/// What became of a pilot's wishes.
struct PilotCounters {
  std::uint64_t velocities = 0;  ///< made into plans
  std::uint64_t replaced = 0;    ///< velocities for which a newer one was there already
  std::uint64_t bad_values = 0;  ///< velocities with numbers that no drone can fly
  std::uint64_t not_flying = 0;  ///< velocities for a drone that is not in manual flight
  std::uint64_t malformed = 0;   ///< messages that are not what their topic says
  std::uint64_t refused = 0;     ///< take-offs and stops
};

struct FlightStatus {
  DronePhase phase = DronePhase::waiting;
  bool finished = false;  ///< flew its whole path
  int lap = 0;            ///< the one it is in, from 1; 0 before the path
  double progress = 0;    ///< of the whole flight, 0..1
  std::array<double, 2> origin_m{};
  std::vector<double> lap_s;
  double lap_m = 0;                 ///< of one lap, as flown: with rounded corners; 0: no path
  std::array<TimeNs, 2> path_ns{};  ///< when the path began and ended; the drone's clock; 0: not yet
  std::string why;                  ///< what went wrong
  PilotCounters pilot;
  double limit_mps = 0;                 ///< the latency-aware limit now; 0: none known, or no prediction
  std::optional<double> slowed_to_mps;  ///< the least limit that was below the speed asked for
  motion::Response response;            ///< as learned so far
  std::uint64_t states_received = 0, commands_made = 0, commands_sent = 0, commands_merged = 0, commands_refused = 0;
};

struct FlightTransactions {
  std::uint64_t submitted = 0, committed = 0, invalidated = 0, refused = 0, unavailable = 0, overloaded = 0;
  std::uint64_t malformed = 0;   ///< frames and states that are none
  std::uint64_t unbelieved = 0;  ///< states whose signer is not the owner of the drone, or not believed; control events
  std::uint64_t altered = 0;     ///< events that are not what their signer asked for, records that follow from nothing
  std::uint64_t unbelievable = 0;  ///< flagged valid, and cannot be (fabric::code_unbelievable)
};

/// Flies N drones around a path, through the ledger: blocks in, `command` calls out. One plan per drone and state, the
/// plans of all drones in one call, one call in flight until it is committed, or behind a gap (fabric::InFlight); what is
/// made meanwhile waits, the newest per drone, and what it replaces is counted as merged. A call refused because of one
/// drone ("tello3: ...") is sent again at once without that drone.
///
/// Manual: no path, a pilot's wishes instead. A velocity makes a plan at once, from the newest state; one that is not
/// renewed ends in zero after cmd_timeout_ns, and the drone hovers until it hears more or its failsafe lands it. A stop
/// goes out by itself, at once, and again until the ledger has it or refuses it. It ends when it is asked to, and every
/// drone is down.
///
/// The path of each drone begins where it stands before take-off. Times in plans are the drone host's clock alone: the
/// ground's clock and the drone's are never compared. A plan's first setpoint is for the moment when three of four
/// plans are there, by what the states say of when plans came, or, while they say nothing, by how long our own commands
/// take (motion::TwoWay); its last one covers the delay's tail, so one that comes later takes over from its predecessor
/// then. Where link flies plans later than they say (its playout's margin) it says so, and predictions are for that
/// moment.
///
/// Without a ledger (FlightConfig::ledger) the same core flies beside the driver: no lease, a plan goes out at once,
/// for a few milliseconds later.
///
/// Deterministic; one thread; call step() for every block, outcome and request at once, and every 50 ms for the
/// time-outs.
class FlightCore {
 public:
  explicit FlightCore(FlightConfig config);
  ~FlightCore();

  /// Before the first step: a drone's record, as `get control/<drone>` answered it (bytes of ledgerline.Control). Later
  /// changes come with the blocks; so read the records behind the start of the block stream.
  Status set_control(const std::string& control);

  FlightOutputs step(TimeNs now_ns, const FlightInputs& inputs);

  bool done() const;  ///< every drone landed or failed; manual: asked to end, and no drone is in the air; no stop waits
  bool ok() const;    ///< every drone finished its path and landed; manual: nothing went wrong
  std::string why() const;  ///< of all drones; empty while nothing went wrong
  const std::vector<FlightDrone>& drones() const { return config_.drones; }
  FlightStatus status(std::size_t drone) const;
  double height_m() const { return config_.controller.height_m; }
  const FlightTransactions& transactions() const { return transactions_; }
  /// The way there and back that plans are made for; the longest of all drones'.
  TimeNs delay_ns() const;
  /// The controller of a path that is flown or was; null before.
  const PathController* controller(std::size_t drone) const;
  /// As flown: the shape's waypoints or one's own.
  static std::vector<Waypoint> waypoints(const FlightConfig& config);

 private:
  struct Drone;
  using Commands = std::vector<PlannedCommand>;
  struct Timing {
    TimeNs delay_ns = motion::TwoWay::unknown_ns;  ///< from a plan's making to its first setpoint
    TimeNs farthest_ns = 0;                        ///< no setpoint of it may be for later than that
    std::size_t steps = PathController::steps;
  };

  void take_block(TimeNs now_ns, const FlightInputs& inputs, FlightOutputs& out);
  void take_states(TimeNs now_ns, const fabric::Transaction& tx, std::int64_t realtime_s, FlightOutputs& out);
  void take_state(TimeNs now_ns, Drone& drone, const StateSample& sample, FlightOutputs& out);
  void observe(Drone& drone);
  bool may_command(const Drone& drone) const;
  void hand_over_plans(TimeNs now_ns, FlightOutputs& out);
  void forget(const PlannedCommand& command);
  bool believed(const fabric::Transaction& tx, std::int64_t realtime_s, const Drone& drone) const;
  void take_own_commands(TimeNs now_ns, const fabric::Transaction& tx);
  std::optional<belief::Creator> creator_of(const fabric::Transaction& tx, std::int64_t realtime_s) const;
  void take_control_event(TimeNs now_ns, const fabric::Transaction& tx, std::int64_t realtime_s);
  void take_stop(TimeNs now_ns, const Stop& stop);
  void take_control(TimeNs now_ns, const Control& control);
  void take_outcome(TimeNs now_ns, const fabric::Outcome& outcome, std::uint64_t id, FlightOutputs& out);
  void resend(Commands& refused, const fabric::Outcome& outcome);
  void measure(TimeNs one_way_ns);
  static Timing timing_for(TimeNs soonest_ns, TimeNs in_time_ns, TimeNs tail_ns);
  const Timing& timing(const Drone& drone) const;

  void advance(TimeNs now_ns, Drone& drone);
  void advance_path(TimeNs now_ns, Drone& drone);
  void advance_flown(TimeNs now_ns, Drone& drone);
  std::string not_ready(const Drone& drone) const;

  void take_wish(TimeNs now_ns, const PilotWish& wish, FlightOutputs& out);
  void take_velocity(const PilotWish& wish, Drone& drone);
  void take_off(TimeNs now_ns, Drone& drone, FlightOutputs& out);
  void submit_stops(TimeNs now_ns, FlightOutputs& out);
  bool take_stop_outcome(TimeNs now_ns, const fabric::Outcome& outcome, std::uint64_t id, FlightOutputs& out);
  static void refuse(TimeNs now_ns, Drone& drone, const std::string& why, FlightOutputs& out);
  bool settled(const Drone& drone) const;
  static void end_path(Drone& drone);
  void check_time(TimeNs now_ns, Drone& drone);
  TimeNs path_limit_ns(const Drone& drone) const;
  void enter(TimeNs now_ns, Drone& drone, DronePhase phase);
  void land(TimeNs now_ns, Drone& drone, const std::string& why);
  void make_plan(TimeNs now_ns, Drone& drone);
  void count_laps(Drone& drone, TimeNs at_ns);
  void submit_pending(TimeNs now_ns, FlightOutputs& out);
  Drone* find(std::string_view name);

  FlightConfig config_;
  std::vector<std::unique_ptr<Drone>> drones_;
  fabric::InFlight<Commands> in_flight_;
  TimeNs started_ns_ = 0;  ///< 0: not yet
  bool ending_ = false;    ///< manual: asked to
  std::uint64_t next_id_ = 1;
  FlightTransactions transactions_;
  motion::TwoWay two_way_;
  Timing guess_;  ///< by two_way_, for drones of which no plan is known to have come lately
};

}  // namespace ledgerline::ground
