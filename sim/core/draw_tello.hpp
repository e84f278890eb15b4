#pragma once
#include <cstdint>

#include "sim/core/parameters.hpp"

namespace ledgerline::sim {

/// Between which bounds a parameter may lie that nobody has measured of a real Tello.
struct Range {
  double least = 0, most = 0;
};

/// All that is assumed of a Tello and matters to a controller: so wide that a real one should lie within. Each
/// bound is an assumption [A], as the value in Parameters is; those with another source say it.
struct TelloRanges {
  Range velocity_lag_s{0.2, 0.45};
  Range rc_full_by_usual{0.9, 1.1};
  Range max_acceleration_mps2{2.5, 5};
  Range drag_xy_per_s{0.3, 0.6};  ///< [F] 0.39..0.54, and some more for the propeller guards
  Range hold_after_s{0.5, 1.5};
  Range hold_integral_per_s2{0.3, 1};
  Range attitude_after_s{0.2, 1};
  Range attitude_full_rad{0.17, 0.44};  ///< slow mode of an app leans 9 degrees, fast mode 25
  Range takeoff_drift_m{0, 0.3};        ///< [T] users' videos
  Range imu_ready_s{0, 1};
  Range command_latency_s{0.01, 0.08};
  Range state_latency_s{0.01, 0.1};
  Range jet_mps{3, 5};
  Range thrust_lost_per_mps{0.02, 0.06};
  Range turbulence{0.1, 0.4};
  Range ground_effect_radius_m{0.06, 0.11};
  Range load_sag{0, 0.05};
  Range start_c{50, 70};
  Range ground_c{85, 100};
  Range heating_s{120, 240};
  Range shutdown_c{93, 96};          ///< [T] off "after 4 minutes on the ground": three at the least with these
  double follows_floor_share = 0.5;  ///< of the drones
};

/// `parameters` with those of `ranges` drawn, each evenly. Same seed, same drone; pure.
Parameters draw_tello(const Parameters& parameters, std::uint64_t seed, const TelloRanges& ranges = {});

}  // namespace ledgerline::sim
