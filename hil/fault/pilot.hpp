#pragma once
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "common/config/config.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/sitl/world.hpp"

namespace ledgerline::hil {

/// One thing that the pilot of a manual flight says, a [[pilot]] of the script: `do` is takeoff, land, stop, cut,
/// "mission WORD" (approve, start, pause, resume, land: of the courses of all drones, flown together), "fly X Y Z
/// TURN", the velocity in the drone's own frame (forward, left, up, m/s) and its turn (rad/s), said again twenty times
/// a second for `for`, or steer: along the drone's course, by eye, for its laps, and then a landing.
struct PilotRow {
  std::string text;   ///< `do`, with one blank between words
  std::string drone;  ///< empty: all
  std::string at;     ///< as written
  Trigger trigger{};
  TimeNs for_ns = 0;
  bool takeoff = false, land = false, stop = false, cut = false, steer = false;
  std::optional<MissionCommand> mission{};
  Twist velocity{};  ///< of fly
  // Of steer: what the page shows of the drone, its newest state or the place predicted on its committed path, and how
  // late the pilot answers to what it shows.
  bool sees_path = false;
  TimeNs reaction_ns = 0;
  bool flies() const { return !takeoff && !land && !stop && !cut && !steer && !mission; }
};

/// A pilot's eye and hand for one drone: steers to a point of the course ahead of where the drone was a reaction time
/// ago, as far as it was shown (pure pursuit). One thread.
class SteeringPilot {
 public:
  SteeringPilot(const PilotRow& row, const WorldConfig& config, const DroneObservation& drone);
  /// Each time that the pilot looks and moves the sticks; nothing: it was not seen yet, or is through.
  std::optional<Twist> steer(TimeNs now, const ground::FlightCore& ground, std::size_t drone);
  bool is_through() const { return at_m_ >= end_m_; }

 private:
  struct Shown {
    TimeNs t_ns = 0;
    std::array<double, 3> position_m{};
    double yaw_rad = 0;
  };
  ground::Path course_;
  double speed_mps_, end_m_, at_m_ = 0;  ///< along the course
  bool sees_path_;
  TimeNs reaction_ns_;
  std::deque<Shown> shown_{};  ///< of the last reaction time
};

/// Reads each [[pilot]]. After the number of drones.
std::vector<PilotRow> read_pilot(Config& config, int drones);
std::string pilot_text(const std::vector<PilotRow>& rows);

/// Says them to a world when their moments come. One thread.
class Pilot {
 public:
  Pilot(const std::vector<PilotRow>& rows, const WorldConfig& config, const std::vector<DroneObservation>& drones);
  /// Before each step of the world.
  void step(SimulatedWorld& world);
  /// Rows whose moment has not come, in words.
  std::vector<std::string> never_said() const;

 private:
  static constexpr TimeNs again_ns = 50 * ns_per_ms;
  struct Row {
    PilotRow row;
    TriggerWatch watch;
    TimeNs begun_ns = -1, next_ns = 0;
    bool over = false;
    std::vector<SteeringPilot> steering{};  ///< of steer: as TriggerWatch::drones
  };
  static void steer(Row& row, SimulatedWorld& world);
  std::vector<Row> rows_;
};

}  // namespace ledgerline::hil
