#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "onboard/link/core/settings.hpp"
#include "tools/checks/core/host.hpp"
#include "tools/checks/core/ledger.hpp"

/// What is checked of drones: by `ledgerline doctor --drones` what they answer, by `ledgerline tello preflight` what
/// drones, motion capture and the ledger say, by `ledgerline fly` what link, agent and the ledger say. Pure.
namespace ledgerline::checks {

/// Where a drone is. Without motion capture: as link estimates it by onboard odometry.
struct PoseInputs {
  double age_ms = 0;                 ///< of the newest, by its stamp on this computer's clock
  std::optional<double> rate_hz{};   ///< none: nobody counted
  std::optional<double> delay_ms{};  ///< the least from stamp to arrival; < 0: stamps of the future. None: not measured
  std::string frame{};               ///< as it names it; empty: not reported
  std::array<double, 3> position_m{};
  std::string fault{};  ///< for which agent refuses its numbers; empty: none, or nobody looked
};

struct DroneInputs {
  std::string name, address;
  std::string interface {};               ///< that it is behind; empty: the routing table says
  bool there = false;                     ///< it answers
  std::string serial{}, wanted_serial{};  ///< that it reported, and that it must report; empty: not reported, any
  std::optional<double> battery{};        ///< 0..1; none: not reported
  std::optional<double> temperature_c{};  ///< the hotter one that it reports; none: not reported
  std::optional<double> state_hz{};       ///< of its state text; none: nobody counted
  std::string unreadable{};               ///< what came in place of one, newest; empty: nothing
  bool has_velocity = true;               ///< in its state text: what it flies by without motion capture
  std::optional<PoseInputs> pose{};       ///< none: none has come
  std::string refusal{};                  ///< what link has against a take-off: a FailsafeCause's name; empty: nothing
  std::string phase{};  ///< that link sees, where it is not on the ground; empty: it is, or nobody looked
  std::optional<LeaseInputs> lease{};  ///< none: nobody looked
};

/// For so long a position by onboard odometry without fixes is good enough for a path in a fence that is so wide: by
/// the slow error of its flow alone (onboard/link/core/pose/odometry.cpp), so not longer. An hour at most.
double odometry_lasts_s(const link::FailsafeSettings& failsafe, const link::OdometrySettings& odometry, double width_m);

Finding assess_presence(const DroneInputs& drone);
/// `battery_low`: 0..1, up to which link does not take off.
Finding assess_battery(const DroneInputs& drone, double battery_low);
/// `listen`: ADDRESS:PORT, where its state texts arrive. None: nobody counted them.
std::optional<Finding> assess_state(const DroneInputs& drone, const std::string& listen);

struct LedgerInputs {
  enum class State { starts, reached, failed };
  State state = State::starts;  ///< starts: the flight starts it on this computer
  std::string what{};           ///< which it is, or why it was not reached
};

struct PreflightInputs {
  std::vector<DroneInputs> drones;
  link::LinkSettings link;   ///< fence and limits that drones fly with
  std::string pose_source;   ///< "mocap", or another one that link knows
  std::string pose_topic;    ///< of mocap, "{drone}" for the name
  bool stamps_count = true;  ///< of mocap: [pose] clock is not "arrival"
  bool enrols = true;        ///< the flight enrols drones that are not
  Status path = done;        ///< an error: where it leaves the fence
  double path_s = 0;         ///< of the path that takes most, without its corners; 0: not known
  ClockInputs clock;
  LedgerInputs ledger;
  Findings blocks;  ///< whether agent and ground wait for those of a network of others
};

/// Before a take-off: each drone's lines in the order of the inputs, then those of all. A drone that is not there has
/// nothing else to report than that, and its lease.
Findings assess(const PreflightInputs& inputs);

}  // namespace ledgerline::checks
