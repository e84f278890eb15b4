#include "sim/core/parameters.hpp"

#include "common/base/random.hpp"

namespace ledgerline::sim {
namespace {

constexpr std::uint64_t tello_seed = 0x74656c6c6f;  // of random numbers beside all others of a seed

}  // namespace

Parameters draw_tello(const Parameters& parameters, std::uint64_t seed, const TelloRanges& ranges) {
  Random random(seed ^ tello_seed);
  // In this order always: one more is drawn at the end, so that a seed's drone stays the same in all else.
  const auto draw = [&](const Range& range) { return range.least + (range.most - range.least) * random.uniform(); };
  Parameters p = parameters;
  p.control.velocity_lag_s = draw(ranges.velocity_lag_s);
  p.sdk.rc_full_mps *= draw(ranges.rc_full_by_usual);
  p.control.max_acceleration_mps2 = draw(ranges.max_acceleration_mps2);
  p.body.drag_xy_per_s = draw(ranges.drag_xy_per_s);
  p.control.hold_after_s = draw(ranges.hold_after_s);
  p.control.hold_integral_per_s2 = draw(ranges.hold_integral_per_s2);
  p.control.attitude_after_s = draw(ranges.attitude_after_s);
  p.control.attitude_full_rad = draw(ranges.attitude_full_rad);
  p.control.takeoff_drift_m = draw(ranges.takeoff_drift_m);
  p.control.imu_ready_s = draw(ranges.imu_ready_s);
  p.sdk.command_latency_s = draw(ranges.command_latency_s);
  p.sdk.state_latency_s = draw(ranges.state_latency_s);
  p.air.jet_mps = draw(ranges.jet_mps);
  p.air.thrust_lost_per_mps = draw(ranges.thrust_lost_per_mps);
  p.air.turbulence = draw(ranges.turbulence);
  p.air.ground_effect_radius_m = draw(ranges.ground_effect_radius_m);
  p.battery.load_sag = draw(ranges.load_sag);
  p.heat.start_c = draw(ranges.start_c);
  p.heat.ground_c = draw(ranges.ground_c);
  p.heat.idling_c = p.heat.start_c;  // `motoron` cools
  p.heat.time_s = draw(ranges.heating_s);
  p.heat.shutdown_c = draw(ranges.shutdown_c);
  p.control.follows_floor = random.uniform() < ranges.follows_floor_share;
  return p;
}

}  // namespace ledgerline::sim
