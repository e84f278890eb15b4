#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/msg/ros.hpp"
#include "common/rt/trace.hpp"
#include "ground/core/controller.hpp"
#include "ground/core/path.hpp"

/// What goes into FlightCore and comes out of it.
namespace ledgerline::ground {

struct FlightDrone {
  std::string name;  ///< "tello1"
  DroneNumber number = 1;
  std::optional<Task> task{};  ///< nothing: what the flight says
};

/// Of messages to people.
enum class Level { info, warning, alarm };

/// What is done with a request for a drone that we hold when our operator has not answered it in time.
enum class RequestRule { none, hand_over, deny };

/// Time-outs of a drone's phases; each ends in landing, or in failure where there is nothing to land.
struct PhaseLimits {
  TimeNs wait_ns = 30 * ns_per_s;          ///< for the first state with a pose, on the ground, under our lease
  TimeNs takeoff_ns = 25 * ns_per_s;       ///< until it hovers at the origin
  TimeNs settle_ns = 8 * ns_per_s;         ///< the part of it that is spent on settling at the origin
  TimeNs silence_ns = 5 * ns_per_s;        ///< no state at all while flying; a ledger may be choosing a new leader
  TimeNs warn_silence_ns = 1 * ns_per_s;   ///< in the log, and
  TimeNs alarm_silence_ns = 2 * ns_per_s;  ///< as an alarm; both are longer where the channel cuts blocks late
  TimeNs landing_ns = 20 * ns_per_s;
  double path_factor = 3.0;  ///< path: this many times the time that it should take, and half a minute
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
  MakeFollower follower{};    ///< who steers along the path; null: PathController
  crypto::IdentityName self;  ///< whose lease it must be
  std::shared_ptr<crypto::MspRegistry>
      trusted;  ///< states must be signed by one of these, the drone's owner, and control events must follow from
                ///< what their signer asked for; null: not checked
  fabric::ChannelAndContract where;  ///< what comes from elsewhere is not for us
  RequestRule request_rule = RequestRule::none;
  TimeNs request_after_ns = 0;  ///< so long our operator may answer a request before the rule does

  PhaseLimits limits{};
};

/// Per drone: waiting -> takeoff -> path -> landing -> landed, or failed: never took off, or not seen to land.
/// In a manual flight `manual` stands for the path, except while a pilot's path is flown (PilotOrder), and a take-off
/// is possible whenever the drone is on the ground.
enum class GroundPhase { waiting, takeoff, path, manual, landing, landed, failed };
std::string name_of(GroundPhase phase);

/// One transaction to submit; its outcome comes back with the same id.
struct Submission {
  std::uint64_t id = 0;
  fabric::Call call;
  bool urgent = false;                       ///< a stop: must not wait behind commands
  std::optional<crypto::IdentityName> by{};  ///< the operator who signs it; none: ground's own identity
};

/// What a pilot wants of a drone that is in the air in a manual flight.
struct PilotOrder {
  enum class Kind {
    path,        ///< fly this way, from where it is, and hover at its end; in the place of the path that is flown
    resume,      ///< fly the rest of a paused path, from where it is to the next waypoint not reached yet
    return_home  ///< fly to where it took off, at the height that it has, and hover
  };
  Kind kind = Kind::path;
  /// Of a path; metres in the map. No height: the flight's. The first one's speed holds on the way to it, too.
  std::vector<Waypoint> waypoints{};
  bool land_behind = false;  ///< of a path: lands at its end
};

/// What a pilot wants of one drone, since the last time. Of several words the safest counts: cut, stop, land, pause.
struct PilotCommand {
  std::size_t drone = 0;                     ///< index into FlightConfig::drones
  std::optional<crypto::IdentityName> by{};  ///< the operator who gave it; none: any client that ground serves
  std::optional<Twist> velocity{};
  TimeNs came_ns = 0;  ///< when the velocity came; the ground's clock
  bool takeoff = false, land = false;
  /// Hover where it is; the rest of the path is kept until another path, a return or a landing. Of an order in the same
  /// command, too.
  bool pause = false;
  std::optional<PilotOrder> order{};  ///< the newest; no match for land, stop and cut
  bool stop = false, cut = false;     ///< the contract's stop: land now, no matter who flies; motors off at once
  bool clear_stop = false;            ///< of a drone that ground itself has stopped, once it is on the ground
  std::uint64_t replaced = 0;         ///< velocities for which a newer one came before anybody looked
  std::uint64_t bad_values = 0;       ///< velocities that no drone can fly
  std::uint64_t malformed = 0;        ///< messages that are not what their topic says
  std::uint64_t late = 0;             ///< velocities that were held back on their way: not flown
  /// Who asked for what by the API, for people: "land, asked for by alice"; each once.
  std::vector<std::string> requests{};
};

/// What is taken at any time, and before all else.
inline bool brings_down(const PilotCommand& command) { return command.stop || command.cut || command.land; }
/// What needs no operator who is signed in: it lands the drone. A cut drops it, on people who may stand below.
inline bool only_lands(const PilotCommand& command) { return (command.stop || command.land) && !command.cut; }

struct FlightInputs {
  const fabric::Block* block = nullptr;      ///< the next of the stream, checked as a chain by the client
  const fabric::Outcome* outcome = nullptr;  ///< of submission `outcome_id`
  std::uint64_t outcome_id = 0;
  bool more = false;  ///< there is newer input already: nothing is sent before that was seen
  std::string land;   ///< not empty: land all drones and end; why
  std::span<const PilotCommand> commands;
  std::span<const StateSample> states;  ///< without a ledger: straight from link
  std::int64_t realtime_s = 0;          ///< for the expiry of certificates
  std::vector<std::string> unheard{};   ///< by drone: why somebody who writes its topics is not heard; empty: all are
};

/// What a block says of a drone; CDR as it came. Empty is what it does not say, or has said before.
struct DroneUpdate {
  std::size_t drone = 0;  ///< index into FlightConfig::drones
  std::optional<StateSample> state;
  TimeNs real_ns = 0;             ///< the state's moment as real time
  std::string odometry, battery;  ///< of the state's moment; not every state brings a battery
  std::string transitions;        ///< of the failsafe
  std::string alarm;              ///< why its agent does not or did not trust the ledger
  std::string diagnosis;          ///< what ground itself says of it
};

struct FlightOutputs {
  std::vector<Submission> submissions;
  std::vector<TraceRecord> traces;
  std::vector<DroneUpdate> updates;
  std::vector<DroneUpdate> diagnoses;  ///< no block's, but to publish as well
  std::vector<std::string> notes;  ///< for the log: what a pilot asked for and did not get; a path that is flown slower
  std::vector<Plan> plans;         ///< without a ledger: straight to link
};

/// What became of a pilot's commands.
struct PilotCounters {
  std::uint64_t velocities = 0;  ///< made into plans
  std::uint64_t replaced = 0;    ///< velocities for which a newer one was there already
  std::uint64_t bad_values = 0;  ///< velocities with numbers that no drone can fly
  std::uint64_t not_flying = 0;  ///< velocities for a drone that is not in manual flight
  std::uint64_t malformed = 0;   ///< messages that are not what their topic says
  std::uint64_t late = 0;        ///< velocities that were held back on their way
  std::uint64_t refused = 0;     ///< take-offs, landings, orders and stops
};

/// What became of the plans made for a drone.
struct CommandCounters {
  std::uint64_t made = 0, sent = 0;
  std::uint64_t merged = 0;  ///< a newer one took its place before it went out
  std::uint64_t refused = 0;
};

struct FlightStatus {
  GroundPhase phase = GroundPhase::waiting;
  bool finished = false;    ///< flew its whole path
  bool paused = false;      ///< manual: the rest of a path waits for its pilot's resume
  int lap = 0;              ///< the one it is in, from 1; 0 before the path
  double progress = 0;      ///< of the whole flight, manual: of the newest path; 0..1
  std::uint64_t paths = 0;  ///< manual: begun so far
  std::size_t reached =
      0;  ///< manual: waypoints of the newest path that it has reached; the last one when the path ends
  std::array<double, 2> origin_m{};
  /// Corners of the path that is flown or paused, in its order; map frame. A closed path ends with its first corner.
  std::vector<std::array<double, 3>> planned;
  std::vector<double> lap_s;
  double lap_m = 0;                 ///< of one lap, as flown: with rounded corners; 0: no path
  std::array<TimeNs, 2> path_ns{};  ///< when the path began and ended; the drone's clock; 0: not yet
  std::string why;                  ///< what went wrong
  bool landed_by_stop = false;      ///< `why` is somebody's stop
  bool cut_in_air = false;          ///< its motors, by a pilot of this ground
  PilotCounters pilot;
  double limit_mps = 0;                 ///< the latency-aware limit now; 0: none known, or no prediction
  std::optional<double> slowed_to_mps;  ///< the least limit that was below the speed asked for
  motion::Response response;            ///< as learned so far
  std::uint64_t alarms = 0;             ///< of its agent, which does not trust the ledger
  bool ledger_untrusted = false;        ///< as the newest of them says
  std::uint64_t states_received = 0;
  CommandCounters commands;
};

/// Somebody's stop has landed it, and nothing else went wrong.
inline bool is_landed_by_stop(const FlightStatus& status) {
  return status.phase == GroundPhase::landed && status.landed_by_stop;
}

struct FlightTransactions {
  std::uint64_t submitted = 0, committed = 0, invalidated = 0, refused = 0, unavailable = 0, overloaded = 0;
  std::uint64_t malformed = 0;          ///< batches, states and alarms that cannot be read
  std::uint64_t states_unverified = 0;  ///< states not signed by the drone's owner; control events
  std::uint64_t altered = 0;            ///< events not as their signer asked for, records that follow from nothing
  std::uint64_t transactions_unverified = 0;  ///< not what their flags say (fabric::Transaction::problem)
};

/// What this drone flies: its own task, or the flight's.
Task task_of(const FlightConfig& config, std::size_t drone);

/// The newest velocity counts; one that nobody has looked at yet is replaced.
void set_velocity(const Twist& velocity, TimeNs came_ns, PilotCommand& command);

/// Index of the drone of this name; nothing: it does not fly here.
std::optional<std::size_t> index_of(const std::vector<FlightDrone>& drones, std::string_view name);

/// What ground publishes for ROS 2: a row a topic. docs/ros2.md has frames and meanings.
struct DroneTopic {
  std::string_view name;  ///< "/odom" of "/tello1/odom"
  bool of_all = false;    ///< one topic of this name for all drones
  std::string_view type;
  bool latched = false;  ///< who comes late still gets the last ones
  /// Its message as CDR; empty where the update has none. An error: what the ledger has is no such message.
  Result<std::string> (*make)(const DroneUpdate& update, const std::string& drone);
  bool newest_alone = false;  ///< a writer for each drone, and who comes late gets its newest; else the last ten
};
extern const std::array<DroneTopic, 8> drone_topics;
std::string topic_of(const DroneTopic& topic, const std::string& drone);

/// What ground hears from ROS 2, in the names of the Tello's driver for ROS 2, and stop.
struct PilotTopic {
  std::string_view name;  ///< behind "/<drone>"
  std::string_view type;
  bool reliable = true;  ///< best effort hears both kinds of writers; for what is soon said again
  bool cuts = false;     ///< motors off, in the air, too
  /// Adds the message to what the pilot commands. `came_ns`: the ground's clock.
  void (*apply)(std::string_view cdr, TimeNs came_ns, PilotCommand& command);
};
extern const std::array<PilotTopic, 5> pilot_topics;
std::string topic_of(const PilotTopic& topic, const std::string& drone);

}  // namespace ledgerline::ground
