#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "ground/core/flight.hpp"
#include "ground/mission/check.hpp"
#include "ground/mission/run.hpp"
#include "hil/sitl/world_setup.hpp"

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

}  // namespace ledgerline::hil
