#pragma once
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <vector>

#include "common/base/random.hpp"
#include "onboard/link/core/playout/setpoint_path.hpp"
#include "onboard/link/core/separation.hpp"

namespace ledgerline::link {

inline constexpr double landing_mps = 0.5;

/// A drone as a point that follows its setpoint as a first-order response, and flies straight to its goal.
struct PointDrone {
  DroneNumber number = 1;
  Vec3 place{}, goal{};
  double speed = 1;          ///< of its setpoint
  double pose_lag_s = 0.02;  ///< a pose is so old when it comes, one each 10 ms
  Neighbour::Kind kind = Neighbour::Kind::steered;
  Vec3 gust{};         ///< moves it besides
  bool lands = false;  ///< it is to land, once nobody is below

  Vec3 velocity{};
  Limiter limiter{PlayoutSettings{}};
  Vec3 sent{};  ///< the last rc
  TimeNs sent_at = 0;
  std::deque<std::pair<TimeNs, Vec3>> under_way;  ///< rc that it hears later
  Vec3 heard{};
  struct Seen {
    TimeNs stamp = 0;
    Vec3 place{}, velocity{};
  };
  std::deque<Seen> poses;  ///< in flight
  Seen pose;
  Vec3 moved{};  ///< since it came, by what was sent
  double late_s = 0;
  Clearance clearance;
  double waited_s = 0, arrived_s = 0;
  bool arrived() const { return std::hypot(place[0] - goal[0], place[1] - goal[1], place[2] - goal[2]) < 0.1; }
};

/// Drones, their limiters and a Separation on a simulated clock.
class TrafficWorld {
 public:
  explicit TrafficWorld(TimeNs tick = 5 * ns_per_ms, SeparationSettings settings = {})
      : tick_(tick), settings_(settings), separation(settings, PlayoutSettings{}.max_acceleration_mps2) {}

  PointDrone& add(const Vec3& place, const Vec3& goal) {
    PointDrone drone;
    drone.number = static_cast<DroneNumber>(drones.size() + 1);
    drone.place = place;
    drone.goal = goal;
    drone.pose = {now, place, {}};
    drone.limiter.reset(now);
    drones.push_back(drone);
    return drones.back();
  }

  /// Until all are at their goals; false: some are not after so long.
  bool fly(double seconds) {
    for (const TimeNs end = now + from_seconds(seconds); now < end;) {
      step();
      if (all_arrived()) return true;
    }
    return false;
  }
  bool all_arrived() const {
    return std::all_of(drones.begin(), drones.end(), [](const PointDrone& d) { return d.arrived(); });
  }

  void step() {
    now += tick_;
    const double dt = to_seconds(tick_);
    std::vector<Neighbour> in;
    for (PointDrone& d : drones) in.push_back(seen(d, dt));
    const auto clearances = separation.step(dt, in);
    for (std::size_t i = 0; i < drones.size(); ++i) {
      PointDrone& d = drones[i];
      d.clearance = clearances[i];
      if (d.lands && !d.clearance.landing_blocked) d.kind = Neighbour::Kind::sinking;
      const bool steered = d.kind == Neighbour::Kind::steered;
      const Vec3 sent = steered ? clipped(d, clearances[i].velocity_mps) : Vec3{};
      Velocity desired;
      for (std::size_t k = 0; k < 3; ++k) desired.mps[k] = static_cast<float>(sent[k]);
      send(d, d.limiter.step(now, desired, false));
      move(d, dt);
      if (!d.arrived()) d.arrived_s = to_seconds(now);
    }
    measure();
  }

  std::deque<PointDrone> drones;
  TimeNs now = ns_per_s;
  double floor_m = 0, ceiling_m = 3;
  double nearest_m = std::numeric_limits<double>::infinity();  ///< of all steps so far
  TimeNs tick_;
  SeparationSettings settings_;
  Separation separation;

 private:
  Neighbour seen(PointDrone& d, double dt) {
    for (std::size_t k = 0; k < 3; ++k) d.moved[k] += d.sent[k] * dt;
    if (now % (10 * ns_per_ms) == 0) d.poses.push_back({now, d.place, d.velocity});
    while (!d.poses.empty() && now - d.poses.front().stamp >= from_seconds(d.pose_lag_s)) {
      d.pose = d.poses.front();
      d.poses.pop_front();
      d.late_s = to_seconds(now - d.pose.stamp);
      d.moved = {};
    }
    Neighbour n{.number = d.number, .kind = d.kind, .motion = {}, .floor_m = floor_m, .ceiling_m = ceiling_m};
    for (std::size_t k = 0; k < 3; ++k) n.motion.position_m[k] = d.pose.place[k] + d.moved[k];
    n.motion.velocity_mps = d.pose.velocity;
    for (std::size_t k = 0; k < 3; ++k) n.motion.sent_mps[k] = static_cast<double>(d.limiter.output().mps[k]);
    n.motion.late_s = d.late_s;
    n.motion.age_s = to_seconds(now - d.pose.stamp);
    Vec3 way{};
    for (std::size_t k = 0; k < 3; ++k) way[k] = d.goal[k] - n.motion.position_m[k];
    const double length = std::hypot(way[0], way[1], way[2]);
    const double speed = std::min(d.speed, 1.2 * length);
    for (std::size_t k = 0; k < 3; ++k) n.desired_mps[k] = length > 0 ? way[k] / length * speed : 0;
    n.lands = d.lands && d.kind == Neighbour::Kind::steered;
    if (n.lands) n.desired_mps = {0, 0, -landing_mps};
    n.desired_mps = clipped(d, n.desired_mps);
    return n;
  }
  Vec3 clipped(const PointDrone& d, Vec3 desired) const {  // at floor and ceiling, as clip_at_fence() does
    const double z = d.pose.place[2] + d.moved[2];
    desired[2] = std::clamp(desired[2], -std::max(0.0, z - floor_m) / 0.7, std::max(0.0, ceiling_m - z) / 0.7);
    return desired;
  }
  void send(PointDrone& d, const Velocity& sent) {
    Vec3 rc{};
    for (std::size_t k = 0; k < 3; ++k) rc[k] = std::round(static_cast<double>(sent.mps[k]) * 100) / 100;
    if (now - d.sent_at < (rc == d.sent ? 50 : 20) * ns_per_ms) return;
    d.sent = rc;
    d.sent_at = now;
    d.under_way.emplace_back(now + 15 * ns_per_ms, rc);
  }
  void move(PointDrone& d, double dt) const {
    while (!d.under_way.empty() && d.under_way.front().first <= now) {
      d.heard = d.under_way.front().second;
      d.under_way.pop_front();
    }
    if (d.lands && d.kind == Neighbour::Kind::sinking) d.heard = {0, 0, d.place[2] > 0.05 ? -landing_mps : 0};
    const double kept = std::exp(-dt / 0.3);
    for (std::size_t k = 0; k < 3; ++k) {
      d.velocity[k] = d.heard[k] + (d.velocity[k] - d.heard[k]) * kept;
      d.place[k] += (d.velocity[k] + d.gust[k]) * dt;
    }
  }
  void measure() {
    for (std::size_t i = 0; i < drones.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) {
        const Vec3 &a = drones[i].place, &b = drones[j].place;
        nearest_m = std::min(nearest_m, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
      }
  }
};

/// 16 drones of a seed, in a room: straight paths that cross, at random heights and speeds.
inline TrafficWorld random_traffic(std::uint64_t seed, TimeNs tick) {
  Random random(seed);
  TrafficWorld world(tick);
  const auto far = [](const Vec3& a, const std::vector<Vec3>& others) {
    return std::all_of(others.begin(), others.end(),
                       [&](const Vec3& b) { return std::hypot(a[0] - b[0], a[1] - b[1]) > 1; });
  };
  std::vector<Vec3> places, goals;
  const auto draw = [&](std::vector<Vec3>& taken) {
    Vec3 place{};
    do {
      place = {10 * random.uniform(), 10 * random.uniform(), 0.7 + 1.6 * random.uniform()};
    } while (!far(place, taken));
    taken.push_back(place);
    return place;
  };
  for (std::size_t i = 0; i < max_drones; ++i) {
    const Vec3 place = draw(places), goal = draw(goals);
    PointDrone& drone = world.add(place, goal);
    drone.speed = 0.4 + 0.6 * random.uniform();
    drone.pose_lag_s = 0.01 + 0.09 * random.uniform();
  }
  return world;
}

}  // namespace ledgerline::link
