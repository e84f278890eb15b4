#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "ground/core/flight.hpp"
#include "ground/mission/run.hpp"
#include "hil/netem/impairment.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/link/core/settings.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil {

struct WorldConfig {
  enum class Mode : std::uint8_t { ledger, local };
  Mode mode = Mode::ledger;  ///< local: the same controller beside the driver, no ledger and no agent
  int drones = 1;
  ground::Shape shape = ground::Shape::square;
  double side_m = 1.5;
  std::vector<ground::Waypoint> waypoints;  ///< of a path of one's own; empty: the shape
  std::map<int, ground::Task> tasks;        ///< by number: of drones that fly something else
  ground::MakeFollower follower;            ///< who steers in ground's place; null: ground itself
  double speed_mps = 0.5;
  ground::Ramp ramp;
  double rate_hz = 30;
  int laps = 1;
  bool predict = true;
  bool track = true;                    ///< link holds drones to their plans on board
  TimeNs max_age_ns = 500 * ns_per_ms;  ///< of a command, from its state's stamp; for a far ledger more
  link::OnUntrustedLedger on_untrusted_ledger =
      link::OnUntrustedLedger::ignore;          ///< link's, while agent does not trust the ledger
  TimeNs idle_evict_ns = agent::usual_idle_ns;  ///< agent's: a holder who is idle on the ground for so long
  bool keeps_rc = true, command_counts = true;  ///< which Tello: sim::SdkParameters
  bool drawn_tello = false;  ///< of what nobody knows of a real one, each seed draws another: sim/core/parameters.hpp
  std::optional<Impairment::RecordedLink> wifi;  ///< every drone's radio, both ways; the seed says where it begins
  double yaw_deg = 0;                            ///< every drone looks there when it is switched on
  std::vector<sim::Pad> pads;                    ///< mission pads on the floor
  double battery = 1.0;                          ///< of every drone at the start, 0..1
  std::optional<double> room_m = 3;  ///< the fence's distance from the paths; below 0 its far sides cut through them;
                                     ///< nothing: link's own fence
  double model_error = 0;            ///< the simulator's drone has mass, gain and lag larger by this share
  double gust_mps = sim::Parameters{}.wind.gust_mps;  ///< standard deviation of the simulator's wind
  double full_scale_mps = 1;  ///< what rc 100 means: to link, to the simulator, and to the controller
  LedgerDelays delays;
  std::size_t batch_count = 1;
  TimeNs batch_timeout_ns = 10 * ns_per_ms;
  std::uint64_t seed = 1;
  bool manual = false;  ///< flown by the commands of a pilot
  ground::mission::AfterRestart after_restart = ground::mission::AfterRestart::hover;  ///< manual: of a mission
  double seconds = 0;  ///< manual: then it is landed, and over; 0: never
  ground::RequestRule request_rule = ground::RequestRule::none;
  TimeNs request_after_ns = 0;
  double start_error_m = 0,
         start_error_rad = 0;  ///< of where drones are put for their own odometry: standard deviations
  link::PoseSource pose = link::PoseSource::mocap;  ///< of every drone
  bool calibrated = false;                          ///< link knows scale, lag and bias of its drones' own velocities
  sim::SensorParameters sensors;                    ///< of every drone
  fabric::BlockSource blocks = fabric::BlockSource::peer;  ///< agent's and ground's
  bool supervisors = false;  ///< enrolled besides the operator: for scripts in which they speak
};

// Who takes part.
extern const crypto::IdentityName drone_host, operator_name;
extern const crypto::IdentityName supervisor_name, outsider_name;  ///< of the drones' organisation, of another one
extern const crypto::IdentityName administrator_name;              ///< of the operator's organisation
std::string drone_name(int number);

/// What drone `number` (from 1) flies; a pilot's: what he should.
ground::Task task_of(const WorldConfig& config, int number);
/// How far a path reaches, from where its drone stands: least and greatest x and y.
struct Reach {
  std::array<double, 2> min_m{}, max_m{};
};
Reach reach_of(const ground::Task& task);
/// What encloses all paths of drones that stand there, with `config.room_m` around.
link::FenceSettings fence_around(const WorldConfig& config, const std::vector<std::array<double, 2>>& starts_m);
/// Of drone `number`, which stands there; its corners, as DroneObservation has them.
ground::Path course_of(const WorldConfig& config, int number, const std::array<double, 2>& start_m);
std::vector<std::array<double, 2>> corners_of(const ground::Path& path);

// The settings of each part of such a world.
node::CoreConfig node_config(const WorldConfig& config);
sim::Parameters sim_parameters(const WorldConfig& config);
link::LinkSettings link_settings(const WorldConfig& config);
/// `starts` differs from start to start.
agent::AgentCoreSettings agent_settings(const WorldConfig& config, std::uint64_t starts);
ground::FlightConfig ground_config(const WorldConfig& config, SimulatedLedger& ledger);

/// enroll, grant and acquire, as the launcher does before take-off.
Status prepare(SimulatedLedger& ledger, int drones);
/// Makes the two supervisors what they are; the outsider may stop these drones.
Status enroll_supervisors(SimulatedLedger& ledger, int drones);

}  // namespace ledgerline::hil
