#include "sim/core/sensors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "sim/core/firmware/odometry.hpp"

namespace ledgerline::sim {
namespace {

constexpr double degrees = 180 / std::numbers::pi;
constexpr int temperature_spread_c = 3;
constexpr int tof_on_ground_mm = 100;
constexpr int tof_nothing_mm = 65530;  // the state then says 6553 cm
constexpr int steps_per_walk = 100;    // the barometer's walk takes minutes
constexpr double load_follows_s = 0.5;
constexpr std::uint64_t second_seed = 0x73656e73;

int rounded(double x) { return static_cast<int>(std::lround(x)); }

}  // namespace

Sensors::Sensors(const Parameters& parameters, std::uint64_t seed)
    : p_(parameters),
      noise_(parameters.sensors),
      random_(seed),
      second_random_(seed ^ second_seed),
      sensing_(parameters.sensing),
      battery_(parameters.battery.start),
      temperature_c_(parameters.heat.start_c),
      barometer_zero_m_(300 * random_.uniform() - 150) {}

void Sensors::step(const Use& use) {
  const bool flying = use.flying;
  const BatteryParameters& b = p_.battery;
  const double share = flying ? 1.0 : b.idle_share;
  // Slower above sag_below by what it is faster below, so that all of it still lasts flight_s.
  const double above = 1 - b.sag_below + b.sag_below / b.sag_factor;
  const double sag = battery_ < b.sag_below ? above * b.sag_factor : above;
  battery_ = std::max(0.0, battery_ - (share * sag / b.flight_s + drain_per_s_) * step_s);
  barometer_drift_m_ += sensing_.baro_drift_mps * step_s;
  if (steps_++ % steps_per_walk == 0)
    barometer_drift_m_ += noise_.baro_walk_m * std::sqrt(steps_per_walk * step_s) * second_random_.normal();
  if (!flying) takeoff_drift_m_ = barometer_drift_m_;
  const HeatParameters& heat = p_.heat;
  const double towards_c = flying ? heat.flight_c : use.idling ? heat.idling_c : heat.ground_c;
  temperature_c_ += (towards_c - temperature_c_) * step_s / heat.time_s;
  if (b.load_sag > 0) load_ += (use.thrust_by_weight - load_) * step_s / load_follows_s;
}

int Sensors::tof_mm(const Body& body) {
  const double below_m = floor_height_m(p_, body.position);
  const double tilt = tilt_of(body.attitude);
  const double distance =
      (body.position.z() - below_m) / std::max(0.1, std::cos(tilt)) + noise_.tof_m * random_.normal();
  const bool seen = sensing_.tof && tilt < noise_.tof_max_tilt_rad && distance < noise_.tof_max_m;
  return seen ? std::max(tof_on_ground_mm, rounded(distance * 1000)) : tof_nothing_mm;
}

std::optional<PadSight> Sensors::pad(const Body& body) {
  if (!sensing_.pads) return std::nullopt;
  return visible_pad(p_, body, second_random_);
}

Telemetry Sensors::read(const Body& body, const FirmwareState& flown) {
  Telemetry t;
  const Rotation& q = body.attitude;
  const double noise = noise_.attitude_rad;
  // The body's y is left here and right on the Tello, so pitch and yaw change their sign.
  const double roll = std::atan2(2 * (q.w() * q.x() + q.y() * q.z()), 1 - 2 * (q.x() * q.x() + q.y() * q.y()));
  const double pitch = std::asin(std::clamp(2 * (q.w() * q.y() - q.z() * q.x()), -1.0, 1.0));
  t.roll_deg = rounded((roll + noise * random_.normal()) * degrees);
  t.pitch_deg = rounded((-pitch + noise * random_.normal()) * degrees);
  t.yaw_deg = rounded(-std::remainder(yaw_of(q) - power_on_yaw_rad_, 2 * std::numbers::pi) * degrees);
  Vector velocity = Eigen::AngleAxisd(-power_on_yaw_rad_, Vector::UnitZ()) * flown.velocity;
  // What fades after flow was lost is no measurement: it has no noise.
  if (!flown.flow_lost)
    for (int i = 0; i < 2; ++i) velocity[i] += noise_.flow_noise_mps * second_random_.normal();
  for (std::size_t i = 0; i < 3; ++i) {
    const double dmps = velocity[static_cast<int>(i)] * 10;
    t.velocity_dmps[i] = noise_.velocity_truncated ? static_cast<int>(dmps) : rounded(dmps);
  }
  t.temperature_low_c = static_cast<int>(temperature_c_);
  t.temperature_high_c = t.temperature_low_c + temperature_spread_c;

  t.tof_mm = tof_mm(body);
  const double height_error = noise_.height_baro_share * (barometer_drift_m_ - takeoff_drift_m_);
  t.height_dm = rounded((body.position.z() - flown.takeoff_z + height_error) * 10);
  t.battery_percent = rounded(battery() * 100);
  t.barometer_m = barometer_zero_m_ + barometer_drift_m_ + body.position.z() + noise_.baro_m * random_.normal();
  t.motor_time_s = static_cast<int>(flown.motor_s);
  const Vector g = body.specific_force / gravity_mps2;
  const std::array<double, 3> axes{g.x(), -g.y(), -g.z()};
  for (std::size_t i = 0; i < 3; ++i)
    t.acceleration_mg[i] = 1000 * (axes[i] + noise_.accelerometer_g * random_.normal());
  return t;
}

std::string state_text(const Telemetry& t, bool pads_wanted) {
  // Of no pad: -2 and -200 say "not looking", -1 and -100 "looked, none".
  int id = pads_wanted ? -1 : -2;
  std::array<int, 3> place{id * 100, id * 100, id * 100}, angles{-1, -1, -1};
  if (t.pad) {
    id = t.pad->id;
    for (std::size_t i = 0; i < 3; ++i) place[i] = rounded(t.pad->position[static_cast<int>(i)] * 100);
    angles = {t.pitch_deg, t.roll_deg, rounded(-t.pad->yaw_rad * degrees)};
  }
  return fmt::format(
      "mid:{};x:{};y:{};z:{};mpry:{},{},{};pitch:{};roll:{};yaw:{};vgx:{};vgy:{};vgz:{};templ:{};temph:{};tof:{};h:{};"
      "bat:{};"
      "baro:{:.2f};time:{};agx:{:.2f};agy:{:.2f};agz:{:.2f};\r\n",
      id, place[0], place[1], place[2], angles[0], angles[1], angles[2], t.pitch_deg, t.roll_deg, t.yaw_deg,
      t.velocity_dmps[0], t.velocity_dmps[1], t.velocity_dmps[2], t.temperature_low_c, t.temperature_high_c,
      t.tof_mm / 10, t.height_dm * 10, t.battery_percent, t.barometer_m, t.motor_time_s, t.acceleration_mg[0],
      t.acceleration_mg[1], t.acceleration_mg[2]);
}

namespace {

constexpr int max_pad_id = 8;  // there are eight of them
constexpr double max_pad_m = 100, max_pad_size_m = 2;

std::optional<double> number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::vector<std::string_view> parts(std::string_view text, char between) {
  std::vector<std::string_view> out;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(between, begin), text.size());
    out.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return out;
}

Result<Pad> parse_pad(std::string_view text) {
  const Error wrong{fmt::format(
      "\"{}\" is no mission pad: ID:X:Y[:DEGREES[:SIZE]], ID 1 to {}, X and Y up to {:g} m, DEGREES up to 360, "
      "SIZE up to {:g} m",
      text, max_pad_id, max_pad_m, max_pad_size_m)};
  std::vector<double> values;
  for (const std::string_view part : parts(text, ':')) {
    const auto value = number(part);
    if (!value) return wrong;
    values.push_back(*value);
  }
  if (values.size() < 3 || values.size() > 5) return wrong;
  Pad pad;
  if (values[0] != std::floor(values[0]) || values[0] < 1 || values[0] > max_pad_id) return wrong;
  pad.id = static_cast<int>(values[0]);
  if (std::abs(values[1]) > max_pad_m || std::abs(values[2]) > max_pad_m) return wrong;
  pad.x_m = values[1];
  pad.y_m = values[2];
  if (values.size() > 3) {
    if (std::abs(values[3]) > 360) return wrong;
    pad.yaw_rad = values[3] / degrees;
  }
  if (values.size() > 4) {
    if (values[4] <= 0 || values[4] > max_pad_size_m) return wrong;
    pad.size_m = values[4];
  }
  return pad;
}

}  // namespace

std::optional<PadSight> visible_pad(const Parameters& parameters, const Body& body, Random& random) {
  const SensorParameters& s = parameters.sensors;
  const double height = body.position.z();
  if (height < s.pad_min_m || height > s.pad_max_m || tilt_of(body.attitude) > s.pad_max_tilt_rad) return std::nullopt;
  const Pad* nearest = nullptr;
  double nearest_m = 0;
  for (const Pad& pad : parameters.pads) {
    const double off_m = std::hypot(pad.x_m - body.position.x(), pad.y_m - body.position.y());
    // All of it has to be in the picture.
    if (off_m + pad.size_m / 2 > s.pad_reach_by_height * height) continue;
    if (nearest && off_m >= nearest_m) continue;
    nearest = &pad;
    nearest_m = off_m;
  }
  if (!nearest) return std::nullopt;
  PadSight sight;
  sight.id = nearest->id;
  sight.position = body.position - Vector(nearest->x_m, nearest->y_m, 0);
  sight.position.head<2>() = Eigen::Rotation2Dd(-nearest->yaw_rad) * sight.position.head<2>();
  for (int axis = 0; axis < 3; ++axis) sight.position[axis] += s.pad_m * random.normal();
  sight.yaw_rad =
      std::remainder(yaw_of(body.attitude) - nearest->yaw_rad + s.pad_rad * random.normal(), 2 * std::numbers::pi);
  return sight;
}

Result<std::vector<Pad>> parse_pads(std::string_view text) {
  std::vector<Pad> pads;
  if (text.empty()) return pads;
  for (const std::string_view part : parts(text, ',')) {
    const auto pad = parse_pad(part);
    if (!pad) return pad.error();
    const bool twice = std::any_of(pads.begin(), pads.end(), [&](const Pad& other) { return other.id == pad->id; });
    if (twice)
      return Error{fmt::format("mission pad {} is there twice: a drone distinguishes pads by their id", pad->id)};
    pads.push_back(*pad);
  }
  return pads;
}

std::string pads_text(const std::vector<Pad>& pads) {
  std::string text;
  for (const Pad& pad : pads)
    text += fmt::format("{}{}:{:.10g}:{:.10g}:{:.10g}:{:.10g}", text.empty() ? "" : ",", pad.id, pad.x_m, pad.y_m,
                        pad.yaw_rad * degrees, pad.size_m);
  return text;
}

}  // namespace ledgerline::sim
