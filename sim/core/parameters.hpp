#pragma once
#include <cstdint>

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
  double takeoff_limit_s = 10.0;        ///< [A] what is not up by then is broken off: it lands, the answer is `error`
  double landing_mps = 0.5;             ///< [A] as takeoff
  double touchdown_mps = 0.25;          ///< [A] below 0.3 m
  double position_gain_per_s = 1.5;     ///< [A] hover and moves: velocity per metre of error
  double move_acceleration_mps2 = 1.5;  ///< [A] forward 500 must end within djitellopy's 7 s [T]
  double crash_tilt_rad = 1.2;          ///< [A] beyond it (and no flip) the motors stop: `error Motor stop` [T]
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
};

/// Standard deviations where nothing else is said.
struct SensorParameters {
  double mocap_m = 0.0005;         ///< [A] optical mocap: sub-millimetre
  double mocap_rad = 0.002;        ///< [A]
  double tof_m = 0.01;             ///< [A] VL53L0X class
  double tof_max_m = 8.0;          ///< [T] 8192 mm is the TT sensor's "nothing"; the Tello says 6553 cm
  double baro_m = 0.15;            ///< [A]
  double accelerometer_g = 0.004;  ///< [A]
  double attitude_rad = 0.003;     ///< [A]
  double flow_mps = 0.01;          ///< [A] slow error of the drone's own velocity estimate: why a hovering Tello drifts
  double flow_s = 5.0;             ///< [A] its correlation time
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
  int max_turn_deg = 360;  ///< SDK 1.3: 3600
  int first_serial = 1;    ///< last digits of what tello1 answers to `sn?`; the others count up
};

struct Parameters {
  int drones = 1;
  std::uint64_t seed = 1;
  double spacing_m = 3.0;
  int columns = 4;
  double mocap_hz = 100;
  BodyParameters body;
  ControlParameters control;
  WindParameters wind;
  BatteryParameters battery;
  SensorParameters sensors;
  SdkParameters sdk;
};

}  // namespace ledgerline::sim
