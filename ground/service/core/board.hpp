#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "ground/core/flight_view.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/core/refusals.hpp"

namespace ledgerline::ground::service {

/// Makes of the flight what the station's clients are sent: its drones as JSON, and events of what changed between two
/// looks. Deterministic; one thread.
class Board {
 public:
  /// Events since the look before: phases, failsafe, lease, stops, and the core's notes.
  std::vector<Event> look(TimeNs now, const FlightView& core, const std::vector<std::string>& notes);
  /// An event of the station itself.
  Event tell(TimeNs now, Level level, const std::string& drone, std::string text);
  /// Events of calls that did not get through.
  std::vector<Event> refusals(TimeNs now, Refusals& refusals);
  /// [DRONE...] of docs/station.md.
  static std::string drones(TimeNs now, const FlightView& core);
  /// {"tello1":[[x,y,z]...]}: what each drone flies or will; nothing where no path has changed since the last one.
  std::optional<std::string> changed_paths(const FlightView& core);
  /// {"op":"state", ...} around drones().
  static std::string state_message(TimeNs now, const FlightView& core, const std::string& drones);

 private:
  struct Before {
    DronePhase phase = DronePhase::waiting;
    FailsafeMode mode = FailsafeMode::none;
    FailsafeCause cause = FailsafeCause::none;
    bool reached = false;
    std::optional<crypto::IdentityName> holder, commander;
    std::string stoppers;
  };
  void look(TimeNs now, const FlightView& core, std::size_t drone, std::vector<Event>& events);
  void add(TimeNs now, Level level, const std::string& drone, std::string text, std::vector<Event>& events);

  std::vector<Before> before_;
  std::vector<std::vector<std::array<double, 3>>> paths_;  ///< as last sent
  std::uint64_t next_number_ = 1;
};

}  // namespace ledgerline::ground::service
