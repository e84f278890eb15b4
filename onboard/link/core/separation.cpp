#include "onboard/link/core/separation.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ledgerline::link {

namespace {

// Slower than this a drone hovers: it corrects its place, and goes nowhere. A gust's speed (docs/sources.md).
constexpr double moving_mps = 0.1;
// Without giving way: who has the right of way over the other, and who has not. The one behind waits for less, so that
// mostly it alone moves; four times its time is enough for it to be away.
constexpr double detour_after_s = 3.0, short_detour_after_s = 0.7;
// On one way round: a layer's height takes half of it.
constexpr double direction_for_s = 3.0;
// A way that leads no further is left after this.
constexpr double idle_for_s = 0.5;
// Its setpoint clear for so long, it is past: until then the ways that it tried are not tried again first.
constexpr double forget_s = 5.0;
// A take-off ends here at the latest; no way round leads lower than this, where a drone's own wash lifts it.
constexpr double takeoff_height_m = 1.2, lowest_m = 0.3;
// Beyond being apart: so that noise neither undoes a way round nor holds up who has the right of way.
constexpr double headroom_m = 0.05;
constexpr double below_all_m = -1e3;
// Beyond being apart: so far from another a drone that left its wash is still beside it.
constexpr double about_m = 0.5;

double level(const Vec3& v) noexcept { return length({v[0], v[1], 0}); }
bool moves(const Vec3& v) noexcept { return length(v) > moving_mps; }

}  // namespace

Separation::Separation(const SeparationSettings& settings, double acceleration_mps2) noexcept
    : settings_(settings),
      braking_{
          .acceleration_mps2 = acceleration_mps2, .response_s = settings.response_s, .reaction_s = settings.reaction_s},
      apart_m_(settings.min_m + settings.margin_m) {}

std::span<const Clearance> Separation::step(double passed_s, std::span<const Neighbour> neighbours) noexcept {
  in_ = neighbours.first(std::min<std::size_t>(neighbours.size(), max_drones));
  passed_s_ = std::clamp(passed_s, 0.0, 0.05);  // as the limiter takes it
  if (settings_.min_m <= 0) {
    for (std::size_t i = 0; i < in_.size(); ++i) clearances_[i] = {.velocity_mps = in_[i].desired_mps};
    return {clearances_.data(), in_.size()};
  }
  std::array<std::size_t, max_drones> order{};
  for (std::size_t i = 0; i < in_.size(); ++i) {
    order[i] = i;
    predict(i);
  }
  find_near();
  for (std::size_t i = 0; i < in_.size(); ++i) watch_wash(i);
  std::sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(in_.size()),
            [&](std::size_t a, std::size_t b) { return in_[a].number < in_[b].number; });
  for (std::size_t k = 0; k < in_.size(); ++k) decide(order[k]);
  refuse_takeoffs();
  delay_landings();
  return {clearances_.data(), in_.size()};
}

void Separation::predict(std::size_t i) noexcept {
  const Neighbour& drone = in_[i];
  Drone& seen = drones_[i];
  const bool steered = drone.kind == Neighbour::Kind::steered;
  seen.coasting = coasting(drone.motion, braking_);
  seen.now = until_rest(seen.coasting, braking_, limited(drone.motion.sent_mps, {}));
  if (drone.kind == Neighbour::Kind::rising)
    seen.now.high_m = std::max(seen.now.high_m, drone.floor_m + takeoff_height_m);
  if (drone.kind == Neighbour::Kind::sinking) seen.now.low_m = below_all_m;
  const Memory& memory = memory_[std::min(drone.number, max_drones)];
  const Vec3& direction = memory.direction == Direction::none ? drone.desired_mps : drone.motion.sent_mps;
  seen.moves = steered && moves(drone.desired_mps);
  seen.claim = seen.now;
  if (seen.moves) {
    Vec3 ahead = direction;
    for (double& v : ahead) v *= settings_.lookahead_s;
    seen.claim = stretched(until_rest(seen.coasting, braking_, direction), ahead);
  }
  // Whatever is tried in this step ends within a little more than these two.
  const auto reach_m = [&](const Capsule& capsule) {
    return level({capsule.to_m[0] - seen.now.from_m[0], capsule.to_m[1] - seen.now.from_m[1], 0}) + capsule.radius_m;
  };
  seen.reach_m = std::max(reach_m(seen.now), reach_m(seen.claim)) + settings_.margin_m;
}

void Separation::find_near() noexcept {
  for (std::size_t i = 0; i < in_.size(); ++i) drones_[i].near.reset();
  for (std::size_t i = 0; i < in_.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Drone &a = drones_[i], &b = drones_[j];
      const double x = a.now.from_m[0] - b.now.from_m[0], y = a.now.from_m[1] - b.now.from_m[1];
      const double reach_m = a.reach_m + b.reach_m + apart_m_;
      const bool near = x * x + y * y < reach_m * reach_m;
      drones_[i].near[j] = drones_[j].near[i] = near;
    }
  }
}

Vec3 Separation::limited(const Vec3& sent_mps, const Vec3& desired_mps) const noexcept {
  Vec3 change{};
  for (std::size_t k = 0; k < 3; ++k) change[k] = desired_mps[k] - sent_mps[k];
  const double wanted = length(change);
  const double allowed = braking_.acceleration_mps2 * passed_s_;
  if (wanted <= allowed) return desired_mps;
  Vec3 out = sent_mps;
  for (std::size_t k = 0; k < 3; ++k) out[k] += change[k] * allowed / wanted;
  return out;
}

bool Separation::has_right_of_way_over(std::size_t j, std::size_t i) const noexcept {
  return drones_[j].moves && in_[j].number < in_[i].number;
}

std::size_t Separation::hindered_by(std::size_t i, const Vec3& velocity_mps, bool yields) const noexcept {
  const Capsule mine = until_rest(drones_[i].coasting, braking_, limited(in_[i].motion.sent_mps, velocity_mps));
  std::size_t worst = i;
  double least = apart_m_;
  for (std::size_t j = 0; j < in_.size(); ++j) {
    if (j == i || !drones_[i].near.test(j)) continue;
    const auto hinders = [&](double gap) {
      if (gap >= least) return;
      least = gap;
      worst = j;
    };
    // A drone already too near may come no nearer; right-of-way areas are left first.
    const double gap = gap_m(mine, drones_[j].now);
    if (gap < least && gap < gap_m(drones_[i].now, drones_[j].now)) hinders(gap);
    if (yields && has_right_of_way_over(j, i)) hinders(gap_m(mine, drones_[j].claim) - headroom_m);
  }
  return worst;
}

bool Separation::try_fly(std::size_t i, const Vec3& velocity_mps, Clearance::Kind kind, bool yields) noexcept {
  if (hindered_by(i, velocity_mps, yields) != i) return false;
  fly(i, velocity_mps, kind);
  return true;
}

void Separation::fly(std::size_t i, const Vec3& velocity_mps, Clearance::Kind kind) noexcept {
  clearances_[i].kind = kind;
  clearances_[i].velocity_mps = velocity_mps;
  drones_[i].now = until_rest(drones_[i].coasting, braking_, limited(in_[i].motion.sent_mps, velocity_mps));
}

void Separation::decide(std::size_t i) noexcept {
  const Neighbour& drone = in_[i];
  clearances_[i] = {.velocity_mps = drone.desired_mps};
  Memory& memory = memory_[std::min(drone.number, max_drones)];
  if (drone.kind != Neighbour::Kind::steered) {
    if (!drone.can_step_aside || !avoid_wash(i)) memory = {};
    return;
  }
  // Who is too near already, or comes with the right of way: then hovering is no answer.
  std::size_t pressing = i;
  double least = apart_m_;
  for (std::size_t j = 0; j < in_.size(); ++j) {
    if (j == i || !drones_[i].near.test(j)) continue;
    double gap = apart_m_;
    if (has_right_of_way_over(j, i)) gap = gap_m(drones_[i].now, drones_[j].claim) - headroom_m / 2;
    // Within half of the margin something moved them without a command.
    if (in_[j].kind != Neighbour::Kind::steered || in_[j].number < drone.number)
      gap = std::min(gap, gap_m(drones_[i].now, drones_[j].now) + settings_.margin_m / 2);
    if (gap < least) {
      least = gap;
      pressing = j;
    }
  }
  if (pressing == i && avoid_wash(i)) return;
  const std::size_t hindered = hindered_by(i, drone.desired_mps, true);
  if (pressing == i && hindered == i) {
    memory.clear_s += passed_s_;
    memory = {.tries = memory.clear_s < forget_s ? memory.tries : 0, .clear_s = memory.clear_s};
    fly(i, drone.desired_mps, Clearance::Kind::unchanged);
    return;
  }
  const std::size_t other = hindered != i ? hindered : pressing;
  clearances_[i].other = in_[other].number;
  memory.clear_s = 0;
  memory.waited_s += passed_s_;
  const double detour_s = !drones_[other].moves             ? 0
                          : has_right_of_way_over(other, i) ? short_detour_after_s
                                                            : detour_after_s;
  if (hindered == i && leads_away(i, pressing)) {
    fly(i, drone.desired_mps, Clearance::Kind::give_way);
    return;
  }
  if (memory.direction == Direction::none && pressing == i && memory.waited_s <= detour_s) {
    fly(i, {}, Clearance::Kind::hold);
    return;
  }
  go_round(i, pressing != i ? pressing : other);
}

bool Separation::can_step_aside(std::size_t i) const noexcept {
  return in_[i].kind == Neighbour::Kind::steered || in_[i].can_step_aside;
}

void Separation::watch_wash(std::size_t i) noexcept {
  DownwashWatch& wash = wash_[std::min(in_[i].number, max_drones)];
  const auto flies = [&](std::size_t j) {
    return (in_[j].kind == Neighbour::Kind::steered || in_[j].kind == Neighbour::Kind::held) && !in_[j].lands;
  };
  const bool left = wash.advice() == DownwashWatch::Advice::leave;
  const double beside_m = apart_m_ + (left ? headroom_m : 0);
  double least = apart_m_ + about_m;
  drones_[i].stacked_with = i;
  for (std::size_t j = 0; j < in_.size() && flies(i); ++j) {
    const Vec3 &at = drones_[i].coasting.at_m, &other = drones_[j].coasting.at_m;
    if (j == i || !flies(j) || std::abs(at[2] - other[2]) >= DownwashWatch::height_m) continue;
    const double level_m = level({at[0] - other[0], at[1] - other[1], 0});
    if (level_m >= least) continue;
    least = level_m;
    drones_[i].stacked_with = j;
  }
  const std::size_t j = drones_[i].stacked_with;
  const Vec3 &mine = in_[i].motion.sent_mps, &others = in_[j].motion.sent_mps;
  const bool still =
      length({mine[0] - others[0], mine[1] - others[1], mine[2] - others[2]}) < DownwashWatch::passing_mps;
  wash.step(passed_s_, j != i && least < beside_m, still, j != i && !moves(others));
}

bool Separation::avoid_wash(std::size_t i) noexcept {
  using Advice = DownwashWatch::Advice;
  const Advice advice = wash_[std::min(in_[i].number, max_drones)].advice();
  const std::size_t other = drones_[i].stacked_with;
  const Vec3& desired = in_[i].desired_mps;
  Memory& memory = memory_[std::min(in_[i].number, max_drones)];
  const bool mine = in_[i].number > in_[other].number || !can_step_aside(other);
  if (advice == Advice::none || other == i || !mine || leads_away(i, other)) {
    if (std::exchange(memory.aside, false)) memory.direction = Direction::none;
    return false;
  }
  if (advice == Advice::stay_out) {
    if (std::exchange(memory.aside, false)) memory.direction = Direction::none;
    // Level it waits beside the other; up and down it is free.
    clearances_[i].other = in_[other].number;
    return level(desired) > 0 && try_fly(i, {0, 0, desired[2]}, Clearance::Kind::hold, true);
  }
  memory.giving_way_s += passed_s_;
  if (!std::exchange(memory.aside, true) || memory.direction == Direction::none ||
      memory.giving_way_s > direction_for_s)
    choose_direction(i, other, std::array{Direction::away, Direction::right, Direction::left});
  const Vec3 direction = direction_mps(i, other, memory.direction);
  if (!moves(direction) || !try_fly(i, direction, Clearance::Kind::give_way, false)) fly(i, {}, Clearance::Kind::hold);
  clearances_[i].other = in_[other].number;
  return true;
}

bool Separation::leads_away(std::size_t i, std::size_t other) const noexcept {
  const Vec3 desired = in_[i].desired_mps, &at = drones_[i].coasting.at_m, &from = drones_[other].coasting.at_m;
  return moves(desired) && desired[0] * (at[0] - from[0]) + desired[1] * (at[1] - from[1]) > 0;
}

void Separation::go_round(std::size_t i, std::size_t other) noexcept {
  Memory& memory = memory_[std::min(in_[i].number, max_drones)];
  memory.giving_way_s += passed_s_;
  if (memory.direction == Direction::none || memory.giving_way_s > direction_for_s || memory.idle_s > idle_for_s)
    choose_direction(i, other);
  const Vec3& desired = in_[i].desired_mps;
  const Vec3 direction = direction_mps(i, other, memory.direction);
  const bool in_height = memory.direction == Direction::up || memory.direction == Direction::down;
  // What of the setpoint leads past the other, once it is apart from it on the way that it took; then that way.
  const Vec3 past = in_height ? Vec3{desired[0], desired[1], 0} : Vec3{0, 0, desired[2]};
  const double idle_s = std::exchange(memory.idle_s, 0.0);
  if (moves(past) && try_fly(i, past, Clearance::Kind::hold, true)) return;
  if (in_height && try_fly(i, {desired[0], desired[1], direction[2]}, Clearance::Kind::give_way, true)) return;
  if (moves(direction) && try_fly(i, direction, Clearance::Kind::give_way, false)) return;
  memory.idle_s = idle_s + passed_s_;
  fly(i, {}, Clearance::Kind::hold);
}

bool Separation::has_room(std::size_t i, std::size_t other, Direction direction) const noexcept {
  const double need = apart_m_ + headroom_m;
  const bool beside = direction != Direction::up && direction != Direction::down;
  // Neither over nor under one that comes down or goes up.
  if (in_[other].kind == Neighbour::Kind::sinking || in_[other].kind == Neighbour::Kind::rising) return beside;
  if (direction == Direction::up) return drones_[other].now.high_m + need <= in_[i].ceiling_m;
  if (direction == Direction::down) return drones_[other].now.low_m - need >= in_[i].floor_m + lowest_m;
  return true;
}

void Separation::choose_direction(std::size_t i, std::size_t other) noexcept {
  const Vec3& desired = in_[i].desired_mps;
  const bool below = in_[i].motion.position_m[2] < in_[other].motion.position_m[2] - headroom_m;
  const bool upright = std::abs(desired[2]) > level(desired) || in_[other].kind == Neighbour::Kind::sinking ||
                       in_[other].kind == Neighbour::Kind::rising;
  const Direction first = below ? Direction::down : Direction::up, second = below ? Direction::up : Direction::down;
  if (upright) {
    choose_direction(i, other, std::array{Direction::away, Direction::right, Direction::left, first, second});
  } else {
    choose_direction(i, other, std::array{first, second, Direction::right, Direction::left, Direction::away});
  }
}

void Separation::choose_direction(std::size_t i, std::size_t other, std::span<const Direction> directions) noexcept {
  Memory& memory = memory_[std::min(in_[i].number, max_drones)];
  for (std::size_t k = 0; k < directions.size(); ++k) {
    const Direction direction = directions[(static_cast<std::size_t>(memory.tries) + k) % directions.size()];
    if (!has_room(i, other, direction) || hindered_by(i, direction_mps(i, other, direction), false) != i) continue;
    memory.direction = direction;
    memory.tries = static_cast<int>((static_cast<std::size_t>(memory.tries) + k + 1) % directions.size());
    memory.giving_way_s = memory.idle_s = 0;
    return;
  }
  memory.direction = Direction::none;
}

Vec3 Separation::direction_mps(std::size_t i, std::size_t other, Direction direction) const noexcept {
  // From below one that lands there is a second: it sinks by a height of min_m meanwhile.
  const double speed = (in_[other].kind == Neighbour::Kind::sinking ? 2 : 1) * settings_.part_mps;
  if (direction == Direction::none) return {};
  if (direction == Direction::up) {
    return {0, 0, std::clamp((in_[i].ceiling_m - in_[i].motion.position_m[2]) / 0.7, 0.0, speed)};
  }
  if (direction == Direction::down) {
    return {0, 0, -std::clamp((in_[i].motion.position_m[2] - in_[i].floor_m - lowest_m) / 0.7, 0.0, speed)};
  }
  const Vec3& desired = in_[i].desired_mps;
  double x = 0, y = 0;
  if (direction != Direction::away && level(desired) > moving_mps) {
    x = desired[0];
    y = desired[1];
  } else {  // from all that are near
    for (std::size_t j = 0; j < in_.size(); ++j) {
      if (j == i || (j != other && gap_m(drones_[i].now, drones_[j].now) > apart_m_ + headroom_m)) continue;
      const double from_x = in_[i].motion.position_m[0] - in_[j].motion.position_m[0];
      const double from_y = in_[i].motion.position_m[1] - in_[j].motion.position_m[1];
      const double distance = std::max(length({from_x, from_y, 0}), 1e-3);
      x += from_x / distance;
      y += from_y / distance;
    }
  }
  const double far = length({x, y, 0});
  if (far <= 0) return {speed, 0, 0};
  // A wall may be there: beside that.
  if (direction == Direction::right) return {speed * y / far, -speed * x / far, 0};
  if (direction == Direction::left) return {-speed * y / far, speed * x / far, 0};
  return {speed * x / far, speed * y / far, 0};
}

void Separation::refuse_takeoffs() noexcept {
  for (std::size_t i = 0; i < in_.size(); ++i) {
    if (in_[i].kind != Neighbour::Kind::standing) continue;
    for (std::size_t j = 0; j < in_.size() && !clearances_[i].takeoff_refused; ++j) {
      if (j == i) continue;
      const bool stands = in_[j].kind == Neighbour::Kind::standing;
      Capsule column = drones_[i].now;
      if (!stands) column.high_m = std::max(column.high_m, column.low_m) + takeoff_height_m + apart_m_;
      // One that stands is where it was put: no margin for what it might do.
      const double gap = gap_m(column, drones_[j].now);
      if (gap >= (stands ? settings_.min_m : apart_m_)) continue;
      clearances_[i].takeoff_refused = true;
      clearances_[i].other = in_[j].number;
    }
  }
}

// What is too near already does not hold a landing up unless it brings the two nearer: one beside it, or above.
void Separation::delay_landings() noexcept {
  for (std::size_t i = 0; i < in_.size(); ++i) {
    if (in_[i].kind != Neighbour::Kind::steered && in_[i].kind != Neighbour::Kind::held) continue;
    Capsule column = drones_[i].now;
    column.low_m = below_all_m;
    for (std::size_t j = 0; j < in_.size() && !clearances_[i].landing_blocked; ++j) {
      if (j == i || !drones_[i].near.test(j)) continue;
      // One that stands is where it was put; half of the margin is for who comes down.
      const bool stands = in_[j].kind == Neighbour::Kind::standing;
      const double apart_m = stands ? apart_m_ - settings_.margin_m / 2 : apart_m_;
      const double gap = gap_m(column, drones_[j].now);
      if (gap >= apart_m || gap >= gap_m(drones_[i].now, drones_[j].now)) continue;
      clearances_[i].landing_blocked = true;
      if (in_[i].lands) clearances_[i].other = in_[j].number;
    }
  }
}

namespace {

using Point = std::array<double, 2>;

Point minus(const Point& a, const Point& b) noexcept { return {a[0] - b[0], a[1] - b[1]}; }
double dot(const Point& a, const Point& b) noexcept { return a[0] * b[0] + a[1] * b[1]; }
double cross(const Point& a, const Point& b) noexcept { return a[0] * b[1] - a[1] * b[0]; }

double squared_to_segment(const Point& point, const Point& from, const Point& to) noexcept {
  const Point along = minus(to, from), there = minus(point, from);
  const double squared = dot(along, along);
  const double part = squared > 0 ? std::clamp(dot(there, along) / squared, 0.0, 1.0) : 0;
  const Point off{there[0] - part * along[0], there[1] - part * along[1]};
  return dot(off, off);
}

bool cross_each_other(const Capsule& a, const Capsule& b) noexcept {
  const Point along_a = minus(a.to_m, a.from_m), along_b = minus(b.to_m, b.from_m);
  const double a1 = cross(along_a, minus(b.from_m, a.from_m)), a2 = cross(along_a, minus(b.to_m, a.from_m));
  const double b1 = cross(along_b, minus(a.from_m, b.from_m)), b2 = cross(along_b, minus(a.to_m, b.from_m));
  return a1 * a2 < 0 && b1 * b2 < 0;
}

double level_distance_m(const Capsule& a, const Capsule& b) noexcept {
  if (cross_each_other(a, b)) return 0;
  return std::sqrt(
      std::min({squared_to_segment(a.from_m, b.from_m, b.to_m), squared_to_segment(a.to_m, b.from_m, b.to_m),
                squared_to_segment(b.from_m, a.from_m, a.to_m), squared_to_segment(b.to_m, a.from_m, a.to_m)}));
}

}  // namespace

double gap_m(const Capsule& one, const Capsule& other) noexcept {
  const double in_height = std::max(one.low_m - other.high_m, other.low_m - one.high_m);
  return std::max(in_height, level_distance_m(one, other) - one.radius_m - other.radius_m);
}

Coasting coasting(const Motion& motion, const Braking& braking) noexcept {
  Coasting out;
  out.blur_m = motion.blur_m;
  const double kept = std::exp(-motion.age_s / braking.response_s);
  for (std::size_t i = 0; i < 3; ++i) {
    // What it is sent now stands for that while the pose came: to a centimetre, by the limiter's 0.4 m/s in 0.1 s.
    const double position = motion.position_m[i] + motion.sent_mps[i] * motion.late_s;
    const double velocity = motion.sent_mps[i] + (motion.velocity_mps[i] - motion.sent_mps[i]) * kept;
    out.coasted_m[i] = position + braking.response_s * motion.velocity_mps[i];
    out.at_m[i] = out.coasted_m[i] - braking.response_s * velocity;
  }
  return out;
}

Capsule until_rest(const Coasting& coasting, const Braking& braking, const Vec3& sent_mps) noexcept {
  const double ramp_s = length(sent_mps) / (2 * braking.acceleration_mps2);
  const Vec3 &at = coasting.at_m, &coasted = coasting.coasted_m;
  Vec3 rest{};
  for (std::size_t i = 0; i < 3; ++i) rest[i] = coasted[i] + sent_mps[i] * (braking.reaction_s + ramp_s);
  const auto [low, high] = std::minmax({at[2], coasted[2], rest[2]});
  const double turn = std::sqrt(squared_to_segment({coasted[0], coasted[1]}, {at[0], at[1]}, {rest[0], rest[1]}));
  return {.from_m = {at[0], at[1]},
          .to_m = {rest[0], rest[1]},
          .low_m = low - coasting.blur_m,
          .high_m = high + coasting.blur_m,
          .radius_m = turn + coasting.blur_m};
}

Capsule stretched(const Capsule& capsule, const Vec3& way_m) noexcept {
  Capsule out = capsule;
  for (std::size_t i = 0; i < 2; ++i) out.to_m[i] += way_m[i];
  out.low_m += std::min(0.0, way_m[2]);
  out.high_m += std::max(0.0, way_m[2]);
  return out;
}

}  // namespace ledgerline::link
