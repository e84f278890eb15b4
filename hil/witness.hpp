#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "hil/facts.hpp"
#include "onboard/link/link_core.hpp"

namespace ledgerline::hil {

/// Sees what goes to link and what link does, and where the drones are: the facts and events by which a run is judged.
/// One thread.
class Witness {
 public:
  Witness(int drones, const sim::Simulator& sim);

  const std::vector<DroneFacts>& facts() const { return facts_; }
  /// Of the last step, and what was noted before it.
  const std::vector<WorldEvent>& events() const { return events_; }

  void note(TimeNs now, WorldEvent::Kind kind, std::size_t drone, std::string text);
  void begin_step();
  void given(const std::vector<Pose>& poses);
  void given(const std::vector<Plan>& plans);
  void handed(TimeNs now, const Plan& plan);
  void sent(TimeNs now, DroneNumber drone, std::string_view command);
  void traced(TimeNs now, const TraceRecord& record);
  void link_ended();
  /// What is not running is null.
  void end_step(const sim::Simulator& sim, const ground::FlightCore* ground, const link::LinkCore* link);
  /// Every drone is on the ground and known to be.
  bool all_down() const;

 private:
  std::vector<DroneFacts> facts_;
  std::vector<WorldEvent> events_, noted_;
};

}  // namespace ledgerline::hil
