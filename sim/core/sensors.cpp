#include "sim/core/sensors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ledgerline::sim {
namespace {

constexpr double degrees = 180 / std::numbers::pi;
// "85~88C" in flight (docs/sources.md); the rest is assumed.
constexpr double cool_c = 62, warm_c = 85.5, warming_s = 120;
constexpr int temperature_spread_c = 3;
constexpr int tof_on_ground_mm = 100;
constexpr int tof_nothing_mm = 65530;  // the state then says 6553 cm
constexpr double tof_max_tilt_rad = 0.7;

int rounded(double x) { return static_cast<int>(std::lround(x)); }

}  // namespace

Sensors::Sensors(const Parameters& parameters, std::uint64_t seed)
    : battery_parameters_(parameters.battery),
      noise_(parameters.sensors),
      random_(seed),
      battery_(parameters.battery.start),
      temperature_c_(cool_c),
      barometer_zero_m_(300 * random_.uniform() - 150) {}

void Sensors::step(bool flying) {
  const double share = flying ? 1.0 : battery_parameters_.idle_share;
  battery_ = std::max(0.0, battery_ - (share / battery_parameters_.flight_s + drain_per_s_) * step_s);
  temperature_c_ += ((flying ? warm_c : cool_c) - temperature_c_) * step_s / warming_s;
}

Telemetry Sensors::read(const Body& body, const Vector& estimated_velocity, double takeoff_z, double motor_s) {
  Telemetry t;
  const Rotation& q = body.attitude;
  const double noise = noise_.attitude_rad;
  // The body's y is left here and right on the Tello, so pitch and yaw change their sign.
  const double roll = std::atan2(2 * (q.w() * q.x() + q.y() * q.z()), 1 - 2 * (q.x() * q.x() + q.y() * q.y()));
  const double pitch = std::asin(std::clamp(2 * (q.w() * q.y() - q.z() * q.x()), -1.0, 1.0));
  t.roll_deg = rounded((roll + noise * random_.normal()) * degrees);
  t.pitch_deg = rounded((-pitch + noise * random_.normal()) * degrees);
  t.yaw_deg = rounded(-yaw_of(q) * degrees);
  for (std::size_t i = 0; i < 3; ++i) t.velocity_dmps[i] = rounded(estimated_velocity[static_cast<int>(i)] * 10);
  t.temperature_low_c = static_cast<int>(temperature_c_);
  t.temperature_high_c = t.temperature_low_c + temperature_spread_c;

  const double tilt = tilt_of(q);
  const double distance = body.position.z() / std::max(0.1, std::cos(tilt)) + noise_.tof_m * random_.normal();
  const bool seen = tilt < tof_max_tilt_rad && distance < noise_.tof_max_m;
  t.tof_mm = seen ? std::max(tof_on_ground_mm, rounded(distance * 1000)) : tof_nothing_mm;
  t.height_dm = rounded((body.position.z() - takeoff_z) * 10);
  t.battery_percent = rounded(battery_ * 100);
  t.barometer_m = barometer_zero_m_ + body.position.z() + noise_.baro_m * random_.normal();
  t.motor_time_s = static_cast<int>(motor_s);
  const Vector g = body.specific_force / gravity_mps2;
  const std::array<double, 3> axes{g.x(), -g.y(), -g.z()};
  for (std::size_t i = 0; i < 3; ++i)
    t.acceleration_mg[i] = 1000 * (axes[i] + noise_.accelerometer_g * random_.normal());
  return t;
}

std::string state_text(const Telemetry& t, bool pads_wanted) {
  // No pad is ever seen: -2 and -200 say "not looking", -1 and -100 "looked, none".
  const int id = pads_wanted ? -1 : -2;
  const int place = id * 100;
  return fmt::format(
      "mid:{};x:{};y:{};z:{};mpry:-1,-1,-1;pitch:{};roll:{};yaw:{};vgx:{};vgy:{};vgz:{};templ:{};temph:{};tof:{};h:{};"
      "bat:{};"
      "baro:{:.2f};time:{};agx:{:.2f};agy:{:.2f};agz:{:.2f};\r\n",
      id, place, place, place, t.pitch_deg, t.roll_deg, t.yaw_deg, t.velocity_dmps[0], t.velocity_dmps[1],
      t.velocity_dmps[2], t.temperature_low_c, t.temperature_high_c, t.tof_mm / 10, t.height_dm * 10, t.battery_percent,
      t.barometer_m, t.motor_time_s, t.acceleration_mg[0], t.acceleration_mg[1], t.acceleration_mg[2]);
}

}  // namespace ledgerline::sim
