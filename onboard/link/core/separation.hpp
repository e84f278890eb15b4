#pragma once
#include <array>
#include <bitset>
#include <cmath>
#include <cstdint>
#include <span>

#include "common/msg/onboard.hpp"
#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

using Vec3 = std::array<double, 3>;

/// Of metres or metres per second; std::hypot's care for huge numbers costs six times as much.
inline double length(const Vec3& v) noexcept { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/// Where something may be: all within `radius_m` of a level segment, between two heights. Metres, map frame.
struct Capsule {
  std::array<double, 2> from_m{}, to_m{};
  double low_m = 0, high_m = 0;
  double radius_m = 0;
};

/// How far apart two are, by a cylinder's measure: the level distance or the one in height, whichever is larger.
/// Negative where both overlap. Any point of one is at least so far from any of the other. Pure.
double gap_m(const Capsule& one, const Capsule& other) noexcept;

/// What is known of a flying drone, which follows what it is sent as a first-order response of `response_s`.
struct Motion {
  Vec3 position_m{};    ///< the newest pose's, moved on by what was sent since it came
  Vec3 velocity_mps{};  ///< of that pose
  Vec3 sent_mps{};      ///< what it is sent now
  double late_s = 0;    ///< so old was the pose when it came
  double age_s = 0;     ///< so old is it now
  double blur_m = 0;    ///< it may be so far from there
};

/// What the limiter does with what a drone is sent, and what comes of it.
struct Braking {
  double acceleration_mps2;  ///< of the limiter
  double response_s;         ///< of the drone
  double reaction_s;         ///< until a new command takes effect
};

/// Where a drone is, and where it would come to rest if it were sent zero at once: x and x + T·v.
///
/// With v' = (u - v)/T the way from now on is ∫v = T·v + ∫u, so the place that it comes to rest at is known from place,
/// velocity and what it is sent: x + T·v + u·|u|/2a, where u is ramped to zero by a. For the same reason x + T·v moves
/// by what is sent alone: that of an old pose needs no guess of how the velocity went since.
struct Coasting {
  Vec3 at_m{}, coasted_m{};
  double blur_m = 0;
};
Coasting coasting(const Motion& motion, const Braking& braking) noexcept;

/// Where it is until it hovers, if it is sent `sent_mps` now and to stop from the next step on. On its way to rest a
/// drone stays in the triangle of x, x + T·v and its rest, since the answer to u lags the decay of v; the capsule has
/// that triangle in it. Commanded to stop it shrinks into itself, which is what Separation rests on.
Capsule until_rest(const Coasting& coasting, const Braking& braking, const Vec3& sent_mps) noexcept;

/// The capsule, stretched by a way: where it goes on.
Capsule stretched(const Capsule& capsule, const Vec3& way_m) noexcept;

/// Notices that a drone hovers above or below another, where the upper one's wash pushes the lower one down. Height
/// alone keeps two drones from touching, but nobody may stay so. One for each drone.
///
///   none ──stacked and still for max_hover_s──▶ leave ──beside the other──▶ stay_out ──stay_out_s, or alone──▶ none
///
/// Pure state: time comes in with each step; one thread.
class DownwashWatch {
 public:
  enum class Advice : std::uint8_t {
    none,
    leave,    ///< get beside the other
    stay_out  ///< do not go back: a goal that lies above another would lead there at once
  };
  /// A Tello's free jet of 4 m/s fades to a gust's 0.5 m/s some 1.5 m below it. Half leaves the lower drone in the jet;
  /// double forbids two layers under a ceiling of 3 m.
  static constexpr double height_m = 1.5;
  /// A path's corner above another takes half of it. With half a pass that is held up for a moment is taken for a stay,
  /// with double the lower drone sinks by its own height first.
  static constexpr double max_hover_s = 1;
  /// Two drones that move against each other faster than this pass. Corrections of a hovering drone are half of it.
  static constexpr double passing_mps = 0.2;
  /// Then a path through may try again. Half has a drone with its goal above another spend a third of the time there.
  static constexpr double stay_out_s = 10;

  /// `stacked`: another is above or below. `still`: neither moves against the other. `there`: it is still about.
  void step(double passed_s, bool stacked, bool still, bool there) noexcept {
    if (stacked && still) hovered_s_ += passed_s;
    if (!stacked) hovered_s_ = 0;
    if (advice_ == Advice::leave && !stacked) {
      advice_ = Advice::stay_out;
      out_s_ = 0;
    }
    if (advice_ == Advice::stay_out && ((out_s_ += passed_s) > stay_out_s || !there)) advice_ = Advice::none;
    if (hovered_s_ > max_hover_s) advice_ = Advice::leave;
  }
  Advice advice() const noexcept { return advice_; }

 private:
  Advice advice_ = Advice::none;
  double hovered_s_ = 0, out_s_ = 0;
};

/// A drone as the others must take it.
struct Neighbour {
  enum class Kind : std::uint8_t {
    steered,   ///< flies what it is sent; only such a one is commanded here
    held,      ///< in the air, and sent zero, or what keeps its place: a failsafe has it
    rising,    ///< taking off: all heights up to its own take-off's end are its
    sinking,   ///< landing, or motors off: all below it is its
    standing,  ///< on the ground
  };
  DroneNumber number = 0;
  Kind kind = Kind::held;
  Motion motion;
  Vec3 desired_mps{};           ///< of its plan, behind fence
  bool can_step_aside = false;  ///< one that is held, with a usable position: out of the wash of another
  bool lands = false;           ///< its setpoint is to come down, and to land once there is room for it
  double floor_m = 0, ceiling_m = 0;
};

struct Clearance {
  enum class Kind : std::uint8_t {
    unchanged,  ///< it flies its setpoint
    hold,       ///< another comes too near: it waits, or flies that part of its setpoint that leads past
    give_way,   ///< it gets out of the other's way
  };
  Kind kind = Kind::unchanged;
  Vec3 velocity_mps{};           ///< what it may fly
  DroneNumber other = 0;         ///< because of whom
  bool takeoff_refused = false;  ///< of one that stands: another is beside it or above
  bool landing_blocked = false;  ///< of one in the air: another is below, or stands there, and a landing would wait
};

/// Keeps drones of one host apart: never nearer than `min_m`, and nobody waits for ever.
///
/// Never nearer. Each drone has a capsule that it does not leave if it is commanded to stop. All are
/// apart by min + margin; a setpoint is flown only if they still are with the next step's capsule of who flies it,
/// against the new ones of those who were asked before and the present ones of those who come behind. To stop is always
/// allowed, since it shrinks the own capsule into itself: so whatever each drone decides, all stay apart. Where
/// something moved a drone without a command, nothing is flown that brings the two nearer.
///
/// Nobody waits for ever. Lower numbers are asked first, and higher ones keep out of where they will be for
/// `lookahead_s`: one that is not in it waits at its edge, one that is in it gives way. Nobody yields to who hovers:
/// the moving drone goes round it. A drone that has waited without result for longer than `detour_after_s` goes round
/// as well, whatever its number. One that found no way tries the next direction.
///
/// Nobody hovers in another's wash (DownwashWatch): above or below another two may pass, but of two that stay so
/// the higher number gets beside the lower one, or the one that can.
///
/// A landing is not steered any more and reserves everything below it, so it begins only with room for it. Until then a
/// drone that must land descends as any setpoint leads, and goes round drones in its way.
///
///   unchanged ──setpoint leads too near──▶ hold ──in the way, or waited enough──▶ give_way
///       ▲                                   │                                      │
///       └──────────── setpoint is clear ────┴──────────────────────────────────────┘
///
/// Pure but for what it remembers: no clock, no allocation; one thread.
class Separation {
 public:
  Separation(const SeparationSettings& settings, double acceleration_mps2) noexcept;

  /// `passed_s` since the last step. `neighbours`: all that have a place, max_drones at most, each in every step as
  /// long as it has one. The clearances are in their order, valid until the next step.
  std::span<const Clearance> step(double passed_s, std::span<const Neighbour> neighbours) noexcept;

 private:
  /// The ways round another, tried in turn.
  enum class Direction : std::uint8_t { none, up, down, away, right, left };
  struct Memory {
    Direction direction = Direction::none;
    double giving_way_s = 0;  ///< on this way
    double waited_s = 0;      ///< without a break, with a setpoint that is not flown
    double idle_s = 0;        ///< on this way, without getting further
    int tries = 0;            ///< where the next way is looked for
    double clear_s = 0;       ///< the setpoint is flown
    bool aside = false;       ///< that way is out of another's wash
  };
  struct Drone {
    Capsule now;         ///< until rest: first as if commanded to stop, then of what was decided
    Capsule claim;       ///< where it will be if nobody hinders it
    double reach_m = 0;  ///< how far either of them goes, level
    bool moves = false;
    Coasting coasting;
    std::bitset<max_drones> near;  ///< who could come into its way at all
    std::size_t stacked_with = 0;  ///< who is nearest of those above and below; itself: nobody
  };

  void predict(std::size_t i) noexcept;
  void find_near() noexcept;
  void decide(std::size_t i) noexcept;
  /// Its desired, level.
  bool leads_away(std::size_t i, std::size_t other) const noexcept;
  void go_round(std::size_t i, std::size_t other) noexcept;
  /// Takes the first of its ways that leads anywhere.
  void choose_direction(std::size_t i, std::size_t other) noexcept;
  void choose_direction(std::size_t i, std::size_t other, std::span<const Direction> directions) noexcept;
  /// Out of another's wash, or not back into it; false: nothing of that is needed.
  bool avoid_wash(std::size_t i) noexcept;
  void watch_wash(std::size_t i) noexcept;
  bool can_step_aside(std::size_t i) const noexcept;
  bool has_room(std::size_t i, std::size_t other, Direction direction) const noexcept;
  Vec3 direction_mps(std::size_t i, std::size_t other, Direction direction) const noexcept;
  /// Who is in the way of this velocity; itself: nobody.
  std::size_t hindered_by(std::size_t i, const Vec3& velocity_mps, bool yields) const noexcept;
  bool try_fly(std::size_t i, const Vec3& velocity_mps, Clearance::Kind kind, bool yields) noexcept;
  void fly(std::size_t i, const Vec3& velocity_mps, Clearance::Kind kind) noexcept;
  /// What it is sent in the next step, if this is the desired velocity.
  Vec3 limited(const Vec3& sent_mps, const Vec3& desired_mps) const noexcept;
  bool has_right_of_way_over(std::size_t j, std::size_t i) const noexcept;
  void refuse_takeoffs() noexcept;
  void delay_landings() noexcept;

  SeparationSettings settings_;
  Braking braking_;
  double apart_m_;
  double passed_s_ = 0;
  std::span<const Neighbour> in_;
  std::array<Drone, max_drones> drones_{};
  std::array<Clearance, max_drones> clearances_{};
  std::array<Memory, max_drones + 1> memory_{};  ///< by number
  std::array<DownwashWatch, max_drones + 1> wash_{};
};

}  // namespace ledgerline::link
