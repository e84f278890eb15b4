#pragma once
#include <optional>
#include <string>

#include "ground/core/flight/planner.hpp"

namespace ledgerline::ground {

constexpr bool is_in_air(GroundPhase phase) { return phase >= GroundPhase::takeoff && phase <= GroundPhase::manual; }
/// Or on its way down.
constexpr bool is_flown(GroundPhase phase) { return is_in_air(phase) || phase == GroundPhase::landing; }

/// On the ground link reports what forbids a take-off. It reports a stop until the next take-off command; the ledger
/// decides whether that is allowed.
bool may_take_off(const StateSample& state, bool manual);

/// One drone's flight: which phase it is in, by its states, its lease, its pilot and the time; why it went wrong.
///
///     waiting -> takeoff -> path or manual (manual: a pilot's path, and back to manual) -> landing -> landed
///        |          |            |               |
///        +----------+-- failed --+---------------+   (with something to land: through landing)
///
/// Deterministic; one thread. What it is given must outlive it; it writes the status's phase, progress and reasons.
class Phases {
 public:
  Phases(const FlightConfig& config, const Lease& lease, const IntakeState& seen, const PlanTiming& timing,
         Planner& planner, FlightStatus& status)
      : config_(config), lease_(lease), seen_(seen), timing_(timing), planner_(planner), status_(status) {}

  void begin(TimeNs now) { entered_ns_ = now; }
  bool in_air() const { return is_in_air(status_.phase); }
  /// On a new state. `delay_ns`: until a plan made now is flown.
  void advance(TimeNs now, TimeNs delay_ns);
  /// Looks whether a time-out is over. What its pilot should know of that, if anything.
  std::optional<std::string> check_time(TimeNs now);
  /// The lease changed, or somebody stopped the drone.
  void lease_changed(TimeNs now);
  /// Ends the flight, where it is not landing already. `by_stop`: `why` is somebody's stop.
  void land(TimeNs now, const std::string& why, bool by_stop = false);
  /// Its pilot wants it down, also where it was given up, and where it still waits to fly its path. The error of this
  /// and of the next three says what speaks against it.
  Status land_by_pilot(TimeNs now, const std::string& why, bool by_stop = false);
  /// `ending`: the whole flight is.
  Status take_off(TimeNs now, bool ending);
  /// `delay_ns`: until a plan made now is flown.
  Status apply_order(TimeNs now, const PilotOrder& order, TimeNs delay_ns);
  Status pause_path(TimeNs now);
  /// The error says why link did not obey a pilot's take-off, which is over with that.
  Status check_takeoff(TimeNs now);
  /// What speaks against a take-off.
  Status check_ready(TimeNs now) const;

 private:
  /// For an order.
  Status check_flying(TimeNs now) const;
  Status check_pose(TimeNs now) const;
  Status fly(TimeNs now, const std::vector<Waypoint>& way, bool land_behind, TimeNs delay_ns);
  Status fly_checked(TimeNs now, const std::vector<Waypoint>& way, bool land_behind, TimeNs delay_ns);
  std::string silence_words(TimeNs now, TimeNs limit_ns) const;
  std::string abandon_path(TimeNs now, const std::string& why);
  void advance_waiting(TimeNs now);
  void advance_takeoff(TimeNs now, TimeNs delay_ns);
  void advance_flown(TimeNs now);
  void advance_path(TimeNs now);
  void advance_pilot_path(TimeNs now);
  bool settled() const;
  bool near_origin() const;
  void end_path();
  void clear_why();
  TimeNs path_limit_ns() const;
  void enter(TimeNs now, GroundPhase phase);

  const FlightConfig& config_;
  const Lease& lease_;
  const IntakeState& seen_;
  const PlanTiming& timing_;
  Planner& planner_;
  FlightStatus& status_;
  TimeNs entered_ns_ = 0;  ///< the phase; the ground's clock
  bool flew_ = false;
  bool is_silence_reported_ = false;
  bool origin_known_ = false;    ///< it took off under us, with a pose
  TimeNs asked_ns_ = 0;          ///< for a pilot's take-off; the drone's clock
  bool refused_before_ = false;  ///< the drone's refusal of an earlier one still shows
  TimeNs settling_since_ns_ = 0, path_since_ns_ = 0, end_since_ns_ = 0;  ///< the drone's clock
};

}  // namespace ledgerline::ground
