#pragma once
#include <array>
#include <cstdint>
#include <vector>

namespace ledgerline::sim {

/// The body and what acts on it. Sources: [T] docs/sources.md (document or client named there), [R] Ryze Tello specs,
/// [F] Faessler et al. 2018, "Differential flatness of quadrotor dynamics subject to rotor drag", [A] assumed: nobody
/// published a measurement; change it here or in the config of a test.
struct BodyParameters {
  double mass_kg = 0.080;             ///< [T] with battery and propellers
  double length_m = 0.174;            ///< [R] frame 98 mm plus 76 mm propellers, along x and y: what bumps into others
  double height_m = 0.041;            ///< [R]
  double inertia_xy_kgm2 = 8.0e-5;    ///< [A] 80 g spread as motors at 65 mm: m r^2 / 4
  double inertia_z_kgm2 = 1.4e-4;     ///< [A]
  double drag_xy_per_s = 0.4;         ///< [F] 0.39..0.54 1/s: rotor drag by air speed and mass
  double drag_z_per_s = 0.3;          ///< [A]
  double drag_angular_per_s = 1.0;    ///< [A]
  double max_thrust_by_weight = 2.0;  ///< [A] Crazyflie-class quads have 1.7..2.2
  double motor_lag_s = 0.03;          ///< [A] first order, brushed motors of this size
  double ground_friction = 0.8;       ///< [A]
  double ground_restitution = 0.1;    ///< [A]
};

/// What the Tello's own flight controller does with a velocity setpoint.
struct ControlParameters {
  double velocity_lag_s = 0.3;          ///< [T] first order; of a two-dimensional model, assumed (docs/sources.md)
  double max_acceleration_mps2 = 4.0;   ///< [A] tilt of 22 degrees; [T] gazebo stand-in has 8 (fast mode)
  double max_vertical_mps2 = 3.0;       ///< [A]; [T] gazebo stand-in has 4
  double max_speed_mps = 3.0;           ///< [T] slow mode
  double attitude_rad_per_s = 22.0;     ///< [A] natural frequency of roll and pitch, critically damped
  double max_tilt_rad = 0.5;            ///< [A]
  double yaw_rate_lag_s = 0.1;          ///< [A]
  double max_yaw_rate_radps = 3.14159;  ///< [T] gazebo stand-in
  double takeoff_height_m = 1.0;        ///< [T] gazebo stand-in: to 1.0 m
  double takeoff_mps = 0.5;             ///< [T] gazebo stand-in: at 0.5 m/s
  double spin_up_s = 1.0;               ///< [A] motors before lift-off
  bool follows_floor = false;           ///< [A] over a table it climbs, as tof says that it sank
  double takeoff_drift_m = 0;           ///< [T] it goes away sideways by some 0.3 m as it rises; 0: it does not
  double imu_ready_s = 0;               ///< [A] after switching on; `takeoff` answers `error No valid imu` before [T]
  double takeoff_limit_s = 10.0;        ///< [A] what is not up by then is broken off: it lands, the answer is `error`
  double landing_mps = 0.5;             ///< [A] as takeoff
  double touchdown_mps = 0.25;          ///< [A] below 0.3 m
  double position_gain_per_s = 1.5;     ///< [A] hover and moves: velocity per metre of error
  double hold_after_s = 1.0;            ///< [A] sticks are centred for so long: it holds its position, at rest or not
  double hold_integral_per_s2 = 0.7;    ///< [A] learns in 2 s or so what pushes; 4 and more would swing (lag 0.3 s)
  double attitude_after_s = 0.5;        ///< [A] without flow for so long: attitude mode
  double attitude_full_rad = 0.33;      ///< [A] the lean of full sticks there: what the velocity loop asks for at rest
  double move_acceleration_mps2 = 1.5;  ///< [A] forward 500 must end within djitellopy's 7 s [T]
  double crash_tilt_rad = 1.2;          ///< [A] beyond it (and no flip) the motors stop: `error Motor stop` [T]
};

/// The air that rotors move. [J] arXiv 2403.13321: the jet of a small quadrotor stays a free one for 2.5 diameters.
struct AirParameters {
  double jet_mps = 4.0;               ///< below a drone that hovers; momentum theory says 4.2. 0: no downwash
  double jet_radius_m = 0.09;         ///< [A] of the four rotors' jet together
  double jet_core_m = 0.45;           ///< [J] it keeps its speed until here, then it widens and slows
  double thrust_lost_per_mps = 0.04;  ///< [A] share of a rotor's thrust by the speed of the air that comes from above
  double turbulence = 0.25;           ///< [A] standard deviation of the jet's speed, as a share of it
  /// Ground effect by Cheeseman and Bennett: thrust by 1 / (1 - (R / 4z)^2). [A] 0.09 for this size; 0: none.
  double ground_effect_radius_m = 0;
};

/// Gusts: an Ornstein-Uhlenbeck process a horizontal axis, one third of it vertically [A].
struct WindParameters {
  double gust_mps = 0.1;  ///< standard deviation
  double gust_s = 1.0;    ///< correlation time
};

struct BatteryParameters {
  double start = 1.0;              ///< 0..1
  double flight_s = 780;           ///< [T] 13 min from full to empty in flight
  double idle_share = 0.15;        ///< [A] of the flight's drain, on the ground with electronics on
  double no_takeoff_below = 0.06;  ///< [T] takeoff answers `error` at 5 %
  double land_below = 0.05;        ///< [A] lands by itself
  double flip_above = 0.50;        ///< [T] flips are refused at about 50 %
  /// [A] voltage sags: below sag_below the percent falls so many times as fast as above; flight_s stays the whole.
  double sag_below = 0.2, sag_factor = 1.5;
  /// [A] what the percent falls under the load of a hovering drone, and comes back without it; half a second late.
  double load_sag = 0;
};

/// Where its temperature goes, and how fast [A]; "85~88C" in flight [T]. Users report drones that switch themselves
/// off after some minutes on the ground, where no rotor cools them: with ground_c above shutdown_c.
struct HeatParameters {
  double start_c = 62;
  double ground_c = 62;    ///< switched on, on the ground
  double idling_c = 62;    ///< with `motoron`
  double flight_c = 85.5;  ///< in the rotors' air
  double time_s = 120;     ///< first order
  double shutdown_c = 95;  ///< hotter than this it lands, and switches itself off; 0: never
};

/// Standard deviations where nothing else is said.
struct SensorParameters {
  double mocap_m = 0.0005;         ///< [A] optical mocap: sub-millimetre
  double mocap_rad = 0.002;        ///< [A]
  double tof_m = 0.01;             ///< [A] VL53L0X class
  double tof_max_m = 8.0;          ///< [T] 8192 mm is the TT sensor's "nothing"; the Tello says 6553 cm
  double tof_max_tilt_rad = 0.7;   ///< [A] leaning more, it sees nothing
  double baro_m = 0.15;            ///< [A]
  double accelerometer_g = 0.004;  ///< [A]
  double attitude_rad = 0.003;     ///< [A]
  double flow_mps = 0.01;          ///< [A] slow error of the drone's own velocity estimate: why a hovering Tello drifts
  double flow_s = 5.0;             ///< [A] its correlation time
  double flow_scale = 0.02;        ///< [A] of the share by which one drone's velocities are too large or too small
  double flow_noise_mps = 0.02;    ///< [A] of each velocity in the state text, before it becomes whole dm/s
  double flow_needs = 0.2;         ///< [A] of Sensing's light and floor; with less flow is lost
  double flow_lost_s = 0.5;        ///< [A] time constant with which the velocity then fades to zero
  double baro_walk_m = 0.005;      ///< [A] random walk beside baro_m: after one second; after t with the root of t
  double height_baro_share = 1.0;  ///< [A] how much of the barometer's drift since take-off is in `h`
  double pad_m = 0.01;             ///< [A] of x, y, z above a mission pad
  double pad_rad = 0.02;           ///< [A] of the angles to it
  double pad_min_m = 0.3, pad_max_m = 1.2;  ///< [A] heights in which pads are seen
  double pad_reach_by_height = 0.6;         ///< [A] half of the downward picture is so wide a metre of height
  double pad_max_tilt_rad = 0.35;           ///< [A]

  // How one drone's own velocity differs from another's: drawn for tests, since nobody measured a Tello.
  double flow_scale_offset = 0;           ///< added to the share by which it is too large or too small
  std::array<double, 2> flow_bias_mps{};  ///< a slow error that it keeps; map frame
  double velocity_lag_s = 0;              ///< [A] vgx and vgy are behind the estimate by that (first order)
  bool velocity_truncated = false;        ///< [A] cast to whole dm/s, toward zero; else rounded
};

/// What a drone's sensors have to do with, and what is wrong with them, beyond noise.
struct Sensing {
  double light = 1;                       ///< 0 (dark) to 1
  double floor = 1;                       ///< what is to be seen on the floor: 0 (glossy, or of one colour) to 1
  bool imu = true;                        ///< false: take-off is refused with `error No valid imu`
  bool tof = true;                        ///< false: it sees nothing, whatever the height
  bool pads = true;                       ///< false: mission pads are covered
  double baro_drift_mps = 0;              ///< the barometer's zero goes away at this rate
  std::array<double, 2> flow_bias_mps{};  ///< added to the drone's own velocity; map frame
};

/// A mission pad on the floor, map frame.
struct Pad {
  int id = 1;  ///< 1 to 8
  double x_m = 0, y_m = 0;
  double yaw_rad = 0;    ///< where its rocket points, counter-clockwise from x
  double size_m = 0.22;  ///< [A] a square
};

/// A box on the floor that tof sees; nothing bumps into it. Its sides lie along x and y.
struct Table {
  double x_m = 0, y_m = 0;  ///< its middle
  double length_m = 1, width_m = 1, height_m = 0.5;
};

/// The SDK's side of a drone [T].
struct SdkParameters {
  double rc_full_mps = 1.0;         ///< rc 100: not documented; clients call it cm/s
  double rc_full_yaw_degps = 100;   ///< rc 100: clients call it degrees per second
  double default_speed_cmps = 100;  ///< `speed?` of a drone just started
  double turn_degps = 100;          ///< [A] of cw and ccw
  double state_hz = 10;
  double silence_s = 15;  ///< lands by itself
  /// Nobody knows it of a real Tello [A]: whether it flies on with its last rc when none comes any more, or stops by
  /// itself after rc_lasts_s; and whether `command` alone is a sign of life for those 15 s, as every other word is.
  bool keeps_rc = true;
  double rc_lasts_s = 0.5;
  bool command_counts = true;
  double command_latency_s = 0;  ///< [A] from a datagram's arrival until the firmware acts; tens of ms are likely
  double state_latency_s = 0;    ///< [A] how old a state text is when it leaves; tens of ms are likely
  int max_turn_deg = 360;        ///< SDK 1.3: 3600
  int first_serial = 1;          ///< last digits of what tello1 answers to `sn?`; the others count up
};

struct Parameters {
  int drones = 1;
  std::uint64_t seed = 1;
  double spacing_m = 3.0;
  int columns = 4;
  double start_yaw_rad = 0;  ///< of every drone when it is switched on, counter-clockwise from x
  double mocap_hz = 100;
  BodyParameters body;
  ControlParameters control;
  WindParameters wind;
  AirParameters air;
  BatteryParameters battery;
  HeatParameters heat;
  SensorParameters sensors;
  SdkParameters sdk;
  Sensing sensing;  ///< of every drone until Simulator::set_sensing
  std::vector<Pad> pads;
  std::vector<Table> tables;
};

/// Where drone `number` (from 1) stands when it is switched on, map frame [m].
inline std::array<double, 3> start_of(const Parameters& parameters, int number) {
  const int column = (number - 1) % parameters.columns, row = (number - 1) / parameters.columns;
  return {column * parameters.spacing_m, row * parameters.spacing_m, 0};
}

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
