#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "hil/fault/checker/rule.hpp"

namespace ledgerline::hil {

/// What must hold in every run:
///
///     speed, height, distance   never beyond the limits, but of a drone that was pushed, broken or deafened, until 5 s
///                               behind that fault's end (1 s behind the start of a link that was away); where it got
///                               meanwhile it may stay, but no farther than 0.5 m on.
///                               All of it is the truth. A drone that lost its own velocity may drift at most
///                               blind_way_m from where it lost it, or from where it was last deaf, and as far beyond
///                               the limits as its estimate is wrong by then. Where motion capture still steers it, or
///                               it is deaf or misled, its speed limit is blind_mps
///     no crash                  no drone turns over but one that a fault broke, and no process ends but by a fault
///     lost link                 a drone in the air that a running link does not see stands still after 1 s, but for
///                               one that is blind, and is down after 25 s: whatever became of the link before
///     hold after silence        300 ms after the newest plan's end link holds, brakes or lands, and 0.6 s later it
///                               sends the drone zero
///     landing after a hold      a hold or brake of land_after (5 s) and 0.5 s more is a landing, which
///                               waits for room below for 10 s at most
///     rc in range               as the SDK takes it
///     ramps                     what the drone is sent changes no faster than the limit of acceleration, but for a
///                               link that stood still, and of a drone that lost a propeller: it spins, and the
///                               heading that its rc was made for is not known
///     commands in order         agent hands each one on once, link flies from each one once, none after a newer one
///     a brake takes its plans   after it nothing is flown before another plan came
///     down in the end           when the run is over, or its time is up, nothing is in the air
///     no hang                   it is over before its time is up
///     every fault began         of the script, but those that are optional: otherwise the run says nothing about it
///     nothing unasked           what agent hands on is in a call that its creator signed, and what ground flies by is
///                               what link said
///     no cut while upright      nobody says emergency to a drone in the air that stands upright, unless a cut was
///                               asked for
///     nothing is lost           that was acknowledged as committed; transitions have no gap
///
/// Plain data in, verdicts out. One thread.
class Invariants {
 public:
  explicit Invariants(const Limits& limits);

  void observe(const Moment& moment);
  void finish(const Ending& ending);
  const std::vector<Verdict>& verdicts() const { return verdicts_; }

  static constexpr TimeNs hold_within_ns = 300 * ns_per_ms;
  static constexpr double hold_mps =
      0.46;  ///< to keep its place: 0.3 m/s along the ground, as much upward, and rounding
  static constexpr TimeNs ramp_ns = 600 * ns_per_ms;  ///< from 2 m/s at 4 m/s2, and a step of rc
  static constexpr double sent_at_once_mps = 0.3;     ///< between two rc of a ramp, and their rounding
  static constexpr TimeNs land_after_ns = 5'500 * ns_per_ms;
  static constexpr TimeNs landing_waits_ns = 10'500 * ns_per_ms;  ///< for room below: SeparationSettings, and 0.5 s
  static constexpr double farther_m = 0.5;                        ///< than where it got while it was deaf
  /// From where a drone's own velocity was lost. At 1 m/s it goes 0.5 m until that is noticed, and with the sticks at
  /// zero 3 m until drag has stopped it or it is down. Half would fail honest runs; double would pass a runaway of 5 s.
  static constexpr double blind_way_m = 5;
  /// Of one that motion capture steers all the same, in attitude mode by a ground that may be a second away, of one
  /// that keeps leaning because nobody can tell it not to, and of one whose texts hide that it is blind. Half is a fast
  /// flight; a runaway has 5 m/s.
  static constexpr double blind_mps = 4;
  static constexpr TimeNs lost_stops_ns = 1 * ns_per_s, lost_down_ns = 25 * ns_per_s;
  static constexpr double upright_rad = 0.5;
  static constexpr double lost_mps = 0.4;  ///< horizontally: gusts, and how a Tello drifts

 private:
  struct Drone {
    TimeNs hovering_since_ns = 0;
    TimeNs waits_since_ns = 0;                          ///< its failsafe lands it, and it is still steered
    TimeNs lost_since_ns = 0;                           ///< in the air, and link runs but does not see it
    double high_m = 0, far_m = 0;                       ///< beyond the limits: where it got while it was deaf
    std::optional<std::array<double, 2>> blind_from_m;  ///< where its own velocity was lost; nothing: it is not
    bool may_run = false;                               ///< blind, and it got fast by no fault of the flight
    double misled_m = 0;                                ///< how wrong its estimate became then, at most blind_way_m
    TimeNs rested_since_ns = 0;                         ///< link runs and the drone flies, without a break
    std::array<double, 3> sent{};
    double may_change_mps = 0;  ///< what it is sent, now
    TimeNs looked_ns = 0;
    std::uint64_t handed = 0, applied = 0;  ///< newest sequences
    bool braked = false;
    std::uint64_t plans_at_brake = 0;  ///< that link had been given when it ended
  };
  void check_drone(const Moment& moment, std::size_t drone);
  void check_limits(const Moment& moment, std::size_t drone);
  /// Whether it is blind and still within its physical bound.
  static bool check_blind(const DroneObservation& observation, const Moment::Excuse& excuse, Drone& drone);
  void check_lost_link(const Moment& moment, std::size_t drone);
  void check_ramp(const Moment& moment, std::size_t drone, bool rested);
  void check_brake(const Moment& moment, std::size_t drone, bool flies);
  void check_cut(const Moment& moment, std::size_t drone);
  void check_order(const Moment& moment);
  void broke(std::size_t which, TimeNs now, std::string what) { verdicts_[which].broke(now, std::move(what)); }

  Limits limits_;
  std::vector<Verdict> verdicts_;
  std::vector<Drone> drones_;
};

/// Checks a run moment by moment: the script's rules, then the invariants of every run. Plain data in, verdicts out.
/// One thread.
class Checker {
 public:
  Checker(const std::vector<Rule>& rules, const Limits& limits);

  /// After each step of the world.
  void observe(const Moment& moment);
  /// After the last one.
  std::vector<Verdict> finish(const Ending& ending);

 private:
  void check_rule(const Moment& moment, RuleState& state) const;

  Limits limits_;
  std::vector<RuleState> rules_;
  Invariants invariants_;
  std::vector<bool> flew_;  ///< by drone: was higher than on_ground_m, in flight
};

}  // namespace ledgerline::hil
