#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/config/config.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/sitl/world.hpp"

namespace ledgerline::hil {

/// One thing that the pilot of a manual flight says, a [[pilot]] of the script: `do` is takeoff, land, stop, cut,
/// "mission WORD" (approve, start, pause, resume, land: of the courses of all drones, flown together), or "fly X Y Z
/// TURN", the velocity in the drone's own frame (forward, left, up, m/s) and its turn (rad/s), said again twenty times
/// a second for `for`.
struct PilotRow {
  std::string text;   ///< `do`, with one blank between words
  std::string drone;  ///< empty: all
  std::string at;     ///< as written
  Trigger trigger{};
  TimeNs for_ns = 0;
  bool takeoff = false, land = false, stop = false, cut = false;
  std::optional<MissionCommand> mission{};
  Twist velocity{};  ///< of fly
  bool flies() const { return !takeoff && !land && !stop && !cut && !mission; }
};

/// Reads each [[pilot]]. After the number of drones.
std::vector<PilotRow> read_pilot(Config& config, int drones);
std::string pilot_text(const std::vector<PilotRow>& rows);

/// Says them to a world when their moments come. One thread.
class Pilot {
 public:
  Pilot(const std::vector<PilotRow>& rows, const std::vector<DroneObservation>& drones);
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
  };
  std::vector<Row> rows_;
};

}  // namespace ledgerline::hil
