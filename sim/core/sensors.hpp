#pragma once
#include <array>
#include <string>

#include "common/base/random.hpp"
#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// What the Tello's SDK says about itself, in its own units and signs: pitch up, roll right and yaw clockwise are
/// positive; accelerations have z down; velocities (dm/s) agree with the map frame, since every drone is switched on at
/// yaw 0.
struct Telemetry {
  int pitch_deg = 0, roll_deg = 0, yaw_deg = 0;
  std::array<int, 3> velocity_dmps{};
  int temperature_low_c = 0, temperature_high_c = 0;
  int tof_mm = 0;
  int height_dm = 0;
  int battery_percent = 0;
  double barometer_m = 0;
  int motor_time_s = 0;
  std::array<double, 3> acceleration_mg{};
};

/// Battery, temperature and the sensors' noise of one drone. One thread.
class Sensors {
 public:
  Sensors(const Parameters& parameters, std::uint64_t seed);

  /// Every millisecond.
  void step(bool flying);
  Telemetry read(const Body& body, const Vector& estimated_velocity, double takeoff_z, double motor_s);

  double battery() const { return battery_; }  ///< 0..1
  void set_battery(double share) { battery_ = share; }
  /// So much of the whole a second beside what flying takes.
  void drain(double per_s) { drain_per_s_ = per_s; }

 private:
  BatteryParameters battery_parameters_;
  SensorParameters noise_;
  Random random_;
  double battery_;
  double drain_per_s_ = 0;
  double temperature_c_;
  double barometer_zero_m_;
};

/// The line that goes to port 8890 ten times a second.
std::string state_text(const Telemetry& telemetry, bool pads_wanted);

}  // namespace ledgerline::sim
