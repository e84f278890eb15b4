#pragma once
#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// A mission pad as a drone sees it. The pad's frame: x where its rocket points, y left of that, z up.
struct PadSight {
  int id = 0;
  Vector position = Vector::Zero();  ///< of the drone, in the pad's frame [m]
  double yaw_rad = 0;                ///< of the drone, in the pad's frame, counter-clockwise
};

/// The pad whose middle is nearest, of those in the downward camera's sight (SensorParameters says what that is), with
/// the camera's noise; nothing where there is none. Pure but for `random`.
std::optional<PadSight> visible_pad(const Parameters& parameters, const Body& body, Random& random);

/// "1:0:0,2:1.5:0:90": pads, each its id (1 to 8), the place of its middle (m, map frame), and if wanted where its
/// rocket points (degrees, counter-clockwise from x) and its size (m). An id may be there once.
Result<std::vector<Pad>> parse_pads(std::string_view text);
/// The text that parse_pads reads.
std::string pads_text(const std::vector<Pad>& pads);

/// What the Tello's SDK says about itself, in its own units and signs: pitch up, roll right and yaw clockwise are
/// positive; accelerations have z down. Yaw is 0 as the drone stood when it was switched on; velocities (dm/s) are in
/// that frame: x where it looked then, y left of it, z up.
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
  std::optional<PadSight> pad;
};

/// What the firmware knows by itself, for Sensors::read.
struct FirmwareState {
  Vector velocity = Vector::Zero();  ///< by flow, map frame
  bool flow_lost = false;
  double takeoff_z = 0;
  double motor_s = 0;
};

/// What a drone does, for Sensors::step.
struct Use {
  bool flying = false;
  bool idling = false;  ///< its motors turn on the ground
  double thrust_by_weight = 0;
};

/// Battery, temperature and the sensors' noise of one drone. One thread.
class Sensors {
 public:
  Sensors(const Parameters& parameters, std::uint64_t seed);

  /// Every millisecond.
  void step(const Use& use);
  /// The drone is switched on, where it stands.
  void power_on(const Body& body) { power_on_yaw_rad_ = yaw_of(body.attitude); }
  void set_sensing(const Sensing& sensing) { sensing_ = sensing; }
  const Sensing& sensing() const { return sensing_; }
  /// All but the pad.
  Telemetry read(const Body& body, const FirmwareState& flown);
  /// What the camera that looks down sees now.
  std::optional<PadSight> pad(const Body& body);

  /// 0..1, as its voltage says under the load that it has; charge() is what is left in truth.
  double battery() const { return std::max(0.0, battery_ - p_.battery.load_sag * load_); }
  double charge() const { return battery_; }
  double temperature_c() const { return temperature_c_; }
  void set_temperature(double celsius) { temperature_c_ = celsius; }
  bool overheated() const { return p_.heat.shutdown_c > 0 && temperature_c_ > p_.heat.shutdown_c; }
  void set_battery(double share) { battery_ = share; }
  /// So much of the whole a second beside what flying takes.
  void drain(double per_s) { drain_per_s_ = per_s; }

 private:
  int tof_mm(const Body& body);

  Parameters p_;
  SensorParameters noise_;
  Random random_;
  /// Of flow's noise, pads and the barometer's walk: a separate stream, so that the older sensors' draws do not change.
  Random second_random_;
  Sensing sensing_;
  double power_on_yaw_rad_ = 0;
  double battery_;
  double drain_per_s_ = 0;
  double load_ = 0;  ///< thrust by weight, as the voltage follows it
  double temperature_c_;
  double barometer_zero_m_;
  double barometer_drift_m_ = 0, takeoff_drift_m_ = 0;
  int steps_ = 0;
};

/// The line that goes to port 8890 ten times a second.
std::string state_text(const Telemetry& telemetry, bool pads_wanted);

}  // namespace ledgerline::sim
