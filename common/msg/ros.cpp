#include "common/msg/ros.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "common/base/enum_count.hpp"
#include "common/msg/cdr.hpp"
#include "common/msg/names.hpp"

namespace ledgerline {
namespace {

// builtin_interfaces/msg/Time.
void put_time(CdrWriter& out, TimeNs real_ns) {
  out.put(static_cast<std::int32_t>(real_ns / ns_per_s));
  out.put(static_cast<std::uint32_t>(real_ns % ns_per_s));
}

TimeNs get_time(CdrReader& in) {
  const TimeNs seconds_ns = static_cast<TimeNs>(in.get<std::int32_t>()) * ns_per_s;
  return seconds_ns + in.get<std::uint32_t>();
}

void put_header(CdrWriter& out, const Header& header) {
  put_time(out, header.stamp_ns);
  out.put(std::string_view(header.frame_id));
}

Header get_header(CdrReader& in) {
  Header header;
  header.stamp_ns = get_time(in);
  header.frame_id = in.get_string();
  return header;
}

// Rows and columns of x, y, z, roll, pitch, yaw.
using Covariance = std::array<double, 36>;
constexpr std::array<std::size_t, 4> reported_variances{0, 7, 14, 35};

Covariance covariance_of(const PoseVariance& variance) {
  Covariance covariance{};
  for (std::size_t i = 0; i < reported_variances.size(); ++i)
    covariance[reported_variances[i]] = static_cast<double>(variance[i]);
  return covariance;
}

template <typename T>
Result<T> checked(const CdrReader& in, T value, std::string_view type) {
  if (!in.ok()) return Error{"malformed CDR of " + std::string(type)};
  return value;
}

}  // namespace

std::array<double, 4> quaternion_from_attitude(double roll_rad, double pitch_rad, double yaw_rad) {
  const double cr = std::cos(roll_rad / 2), sr = std::sin(roll_rad / 2);
  const double cp = std::cos(pitch_rad / 2), sp = std::sin(pitch_rad / 2);
  const double cy = std::cos(yaw_rad / 2), sy = std::sin(yaw_rad / 2);
  return {sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
          cr * cp * cy + sr * sp * sy};
}

std::array<double, 4> quaternion_from_yaw(double yaw_rad) {
  return {0, 0, std::sin(yaw_rad / 2), std::cos(yaw_rad / 2)};
}

double yaw_from_quaternion(const std::array<double, 4>& q) {
  return std::atan2(2 * (q[3] * q[2] + q[0] * q[1]), 1 - 2 * (q[1] * q[1] + q[2] * q[2]));
}

std::string to_cdr(const Odometry& odometry) {
  CdrWriter out;
  put_header(out, odometry.header);
  out.put(std::string_view(odometry.child_frame_id));
  out.put(odometry.position_m);
  out.put(odometry.orientation);
  out.put(covariance_of(odometry.pose_variance));
  out.put(odometry.linear_mps);
  out.put(odometry.angular_radps);
  out.put(Covariance{});
  return out.take();
}

Result<Odometry> odometry_from_cdr(std::string_view cdr) {
  CdrReader in(cdr);
  Odometry odometry;
  odometry.header = get_header(in);
  odometry.child_frame_id = in.get_string();
  odometry.position_m = in.get_array<double, 3>();
  odometry.orientation = in.get_array<double, 4>();
  const auto covariance = in.get_array<double, 36>();
  for (std::size_t i = 0; i < reported_variances.size(); ++i)
    odometry.pose_variance[i] = static_cast<float>(covariance[reported_variances[i]]);
  odometry.linear_mps = in.get_array<double, 3>();
  odometry.angular_radps = in.get_array<double, 3>();
  (void)in.get_array<double, 36>();
  return checked(in, odometry, odometry_type);
}

std::string to_cdr(const PoseStamped& pose) {
  CdrWriter out;
  put_header(out, pose.header);
  out.put(pose.position_m);
  out.put(pose.orientation);
  return out.take();
}

Result<PoseStamped> pose_from_cdr(std::string_view cdr) {
  CdrReader in(cdr);
  PoseStamped pose;
  pose.header = get_header(in);
  pose.position_m = in.get_array<double, 3>();
  pose.orientation = in.get_array<double, 4>();
  return checked(in, pose, pose_type);
}

std::string to_cdr(const std::vector<TransformStamped>& transforms) {
  CdrWriter out;
  out.put(static_cast<std::uint32_t>(transforms.size()));
  for (const TransformStamped& t : transforms) {
    put_header(out, t.header);
    out.put(std::string_view(t.child_frame_id));
    out.put(t.translation_m);
    out.put(t.rotation);
  }
  return out.take();
}

Result<Twist> twist_from_cdr(std::string_view cdr) {
  CdrReader in(cdr);
  Twist twist;
  twist.linear_mps = in.get_array<double, 3>();
  twist.angular_radps = in.get_array<double, 3>();
  return checked(in, twist, twist_type);
}

std::string to_cdr(const Imu& imu) {
  constexpr std::array<double, 9> unknown{}, not_measured{-1};
  CdrWriter out;
  put_header(out, imu.header);
  out.put(imu.orientation);
  out.put(unknown);
  out.put(std::array<double, 3>{});  // angular_velocity
  out.put(not_measured);
  out.put(imu.acceleration_mps2);
  out.put(unknown);
  return out.take();
}

std::string to_cdr(const BatteryState& battery) {
  constexpr float unknown = std::numeric_limits<float>::quiet_NaN();
  CdrWriter out;
  put_header(out, battery.header);
  out.put(battery.voltage_v);
  out.put(unknown);  // temperature
  out.put(unknown);  // current
  out.put(unknown);  // charge
  out.put(unknown);  // capacity
  out.put(unknown);  // design_capacity
  out.put(battery.percentage);
  out.put(std::uint8_t{2});     // power_supply_status: DISCHARGING
  out.put(std::uint8_t{0});     // power_supply_health: UNKNOWN
  out.put(std::uint8_t{3});     // power_supply_technology: LIPO
  out.put(std::uint8_t{1});     // present
  out.put(std::uint32_t{0});    // cell_voltage: none measured
  out.put(std::uint32_t{0});    // cell_temperature
  out.put(std::string_view{});  // location
  out.put(std::string_view{});  // serial_number
  return out.take();
}

Result<BatteryState> battery_from_cdr(std::string_view cdr) {
  CdrReader in(cdr);
  BatteryState battery;
  battery.header = get_header(in);
  battery.voltage_v = in.get<float>();
  for (int i = 0; i < 5; ++i) (void)in.get<float>();
  battery.percentage = in.get<float>();
  return checked(in, battery, battery_type);
}

namespace {

/// Times and places that arithmetic can be done with: no clock and no room goes beyond.
bool is_time(TimeNs t) {
  constexpr TimeNs last = INT64_MAX / 4;
  return t >= 0 && t <= last;
}
template <typename Numbers>
bool are_sizes(const Numbers& values) {
  constexpr double largest = 1e6;                                                                     // m, m/s
  return std::all_of(values.begin(), values.end(), [](double v) { return std::abs(v) <= largest; });  // NaN fails
}

bool plausible(const StateSample& s) {
  return is_time(s.pose_stamp_ns) && is_time(s.arrived_ns) && is_time(s.playout_margin_ns) && are_sizes(s.position_m) &&
         are_sizes(s.velocity_mps) && are_sizes(s.sent_velocity_mps) && are_sizes(s.attitude_rad) &&
         are_sizes(s.acceleration_mps2) &&
         std::all_of(s.pose_variance.begin(), s.pose_variance.end(),
                     [](float v) { return v >= 0 && std::isfinite(v); }) &&
         are_sizes(std::array<double, 5>{s.yaw_rad, s.battery, s.tof_m, s.height_m, s.sent_yaw_rate_radps});
}

/// Around z: by +1 from the child frame, which is turned by yaw against the map (REP 105), by -1 into it.
std::array<double, 3> turned(const std::array<double, 3>& v, double yaw_rad, double sign) {
  const double c = std::cos(yaw_rad), n = sign * std::sin(yaw_rad);
  return {c * v[0] - n * v[1], n * v[0] + c * v[1], v[2]};
}

bool read_enums(CdrReader& in, StateSample& s) {
  const auto [phase, mode, cause] = in.get_array<std::uint8_t, 3>();
  s.phase = static_cast<FlightPhase>(phase);
  s.mode = static_cast<FailsafeMode>(mode);
  s.cause = static_cast<FailsafeCause>(cause);
  return phase < enum_count<FlightPhase> && mode < enum_count<FailsafeMode> && cause < enum_count<FailsafeCause>;
}

bool read_link_status(CdrReader& in, DroneState& state) {
  StateSample& s = state.sample;
  state.real_ns = get_time(in);
  s.stamp_ns = in.get<TimeNs>();
  s.boot_id = in.get<std::uint64_t>();
  s.sequence = in.get<std::uint64_t>();
  s.applied_sequence = in.get<std::uint64_t>();
  s.arrived_sequence = in.get<std::uint64_t>();
  s.arrived_ns = in.get<TimeNs>();
  s.playout_margin_ns = in.get<TimeNs>();
  s.sent_velocity_mps = in.get_array<float, 3>();
  s.sent_yaw_rate_radps = in.get<float>();
  s.attitude_rad = in.get_array<float, 3>();
  s.acceleration_mps2 = in.get_array<float, 3>();
  s.tof_m = in.get<float>();
  s.height_m = in.get<float>();
  s.sdk_state_fresh = in.get<std::uint8_t>() != 0;
  s.battery = -1;
  return read_enums(in, s);
}

/// Blocks written before have another layout, with the pose and the charge in it; it is known by its size.
constexpr std::size_t link_status_bytes_before = 224;

bool read_link_status_before(CdrReader& in, DroneState& state) {
  StateSample& s = state.sample;
  const bool known = read_enums(in, s);
  for (std::uint64_t* value : {&s.boot_id, &s.sequence}) *value = in.get<std::uint64_t>();
  for (TimeNs* value : {&s.stamp_ns, &s.pose_stamp_ns}) *value = in.get<TimeNs>();
  for (auto* vector : {&s.position_m, &s.velocity_mps}) *vector = in.get_array<double, 3>();
  s.yaw_rad = in.get<double>();
  for (float* value : {&s.battery, &s.tof_m, &s.height_m}) *value = in.get<float>();
  s.sdk_state_fresh = in.get<std::uint8_t>() != 0;
  s.applied_sequence = in.get<std::uint64_t>();
  (void)in.get_array<TimeNs, 2>();  // of the plan that was applied: its state's stamp, and how late
  s.arrived_sequence = in.get<std::uint64_t>();
  s.arrived_ns = in.get<TimeNs>();
  s.sent_velocity_mps = in.get_array<float, 3>();
  s.sent_yaw_rate_radps = in.get<float>();
  (void)in.get_array<std::uint32_t, 3>();  // plans that came late, were dropped, were applied
  for (auto* vector : {&s.attitude_rad, &s.acceleration_mps2}) *vector = in.get_array<float, 3>();
  s.pose_variance = in.get_array<float, 4>();
  return known;
}

}  // namespace

Odometry odometry_of(const StateSample& s, const std::string& drone, TimeNs real_offset_ns) {
  return {.header = {s.pose_stamp_ns + real_offset_ns, "map"},  // the pose's own: a lost mocap shows as an old one
          .child_frame_id = drone + "/base_link",
          .position_m = s.position_m,
          .orientation = quaternion_from_yaw(s.yaw_rad),
          .linear_mps = turned(s.velocity_mps, s.yaw_rad, -1),
          .angular_radps = {},
          .pose_variance = s.pose_variance};
}

std::string link_status_to_cdr(const StateSample& s, TimeNs real_offset_ns) {
  CdrWriter out;
  put_time(out, s.stamp_ns + real_offset_ns);
  out.put(s.stamp_ns);
  out.put(s.boot_id);
  out.put(s.sequence);
  out.put(s.applied_sequence);
  out.put(s.arrived_sequence);
  out.put(s.arrived_ns);
  out.put(s.playout_margin_ns);
  out.put(s.sent_velocity_mps);
  out.put(s.sent_yaw_rate_radps);
  out.put(s.attitude_rad);
  out.put(s.acceleration_mps2);
  out.put(s.tof_m);
  out.put(s.height_m);
  out.put(std::array{static_cast<std::uint8_t>(s.sdk_state_fresh), static_cast<std::uint8_t>(s.phase),
                     static_cast<std::uint8_t>(s.mode), static_cast<std::uint8_t>(s.cause)});
  return out.take();
}

Result<DroneState> state_from_cdr(std::string_view link_status, std::string_view odometry) {
  CdrReader in(link_status);
  DroneState state;
  StateSample& s = state.sample;
  const bool has_own_pose = link_status.size() == link_status_bytes_before;
  if (!(has_own_pose ? read_link_status_before(in, state) : read_link_status(in, state))) {
    return Error{"ledgerline_msgs/msg/LinkStatus: phase, mode or cause is none that this version knows"};
  }
  if (!in.ok()) return checked(in, state, link_status_type);
  const Error absurd{"a drone's state: a time or a number is beyond what a drone can say"};
  if (!is_time(s.stamp_ns) || !is_time(state.real_ns)) return absurd;
  if (!odometry.empty() && !has_own_pose) {
    const auto o = odometry_from_cdr(odometry);
    if (!o) return o.error();
    s.pose_stamp_ns = o->header.stamp_ns - state.real_ns + s.stamp_ns;
    s.position_m = o->position_m;
    s.yaw_rad = yaw_from_quaternion(o->orientation);
    s.velocity_mps = turned(o->linear_mps, s.yaw_rad, 1);
    s.pose_variance = o->pose_variance;
  }
  if (!plausible(s)) return absurd;
  return state;
}

namespace {

constexpr std::uint8_t level_ok = 0, level_warn = 1, level_error = 2;  // diagnostic_msgs/msg/DiagnosticStatus

std::uint8_t level(const Transition& t) {
  if (t.mode >= FailsafeMode::land) return level_error;
  return t.mode == FailsafeMode::none && t.cause == FailsafeCause::none ? level_ok : level_warn;
}

template <typename Number>
bool read_number(std::string_view text, Number& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  return error == std::errc() && end == text.data() + text.size();
}

template <typename Enum>
bool read_name(std::string_view text, Enum& out) {
  const auto value = from_name<Enum>(text);
  if (value) out = *value;
  return value.has_value();
}

// Keys that are none of ours are of a later version.
bool read_value(std::string_view key, std::string_view value, Transition& t) {
  if (key == "boot_id") return read_number(value, t.boot_id);
  if (key == "number") return read_number(value, t.number);
  if (key == "lost") return read_number(value, t.lost);
  if (key == "stamp_ns") return read_number(value, t.stamp_ns) && is_time(t.stamp_ns);
  if (key == "phase") return read_name(value, t.phase);
  if (key == "mode") return read_name(value, t.mode);
  // Blocks of earlier versions have another word.
  if (key == "cause") return read_name(value == "ledger_doubted" ? "ledger_untrusted" : value, t.cause);
  return true;
}

using Values = std::vector<std::pair<std::string_view, std::string>>;

void put_status(CdrWriter& out, std::uint8_t level, const std::string& name, const std::string& message,
                const std::string& hardware, const Values& values) {
  out.put(level);
  for (const std::string* text : {&name, &message, &hardware}) out.put(std::string_view(*text));
  out.put(static_cast<std::uint32_t>(values.size()));
  for (const auto& [key, value] : values) {
    out.put(key);
    out.put(std::string_view(value));
  }
}

/// A DiagnosticArray: of each status first level and name, then each of its values; `read`: whether the value can be.
template <typename Item, typename Begin, typename Read>
Result<std::vector<Item>> statuses_from_cdr(std::string_view cdr, const char* what, Begin begin, Read read) {
  CdrReader in(cdr);
  (void)get_header(in);
  std::vector<Item> items;
  bool known = true;
  const auto count = in.get<std::uint32_t>();
  for (std::uint32_t i = 0; i < count && in.ok(); ++i) {
    Item item;
    const auto level = in.get<std::uint8_t>();
    begin(level, in.get_string(), item);
    for (int text = 0; text < 2; ++text) (void)in.get_string();
    const auto values = in.get<std::uint32_t>();
    for (std::uint32_t k = 0; k < values && in.ok(); ++k) {
      const std::string key = in.get_string(), value = in.get_string();
      known = known && read(key, value, item);
    }
    items.push_back(std::move(item));
  }
  if (in.ok() && !known)
    return Error{"diagnostic_msgs/msg/DiagnosticArray: a value of " + std::string(what) + " is none that can be"};
  return checked(in, items, transitions_type);
}

}  // namespace

std::string transitions_to_cdr(const Header& header, const std::string& drone,
                               const std::vector<Transition>& transitions) {
  CdrWriter out;
  put_header(out, header);
  out.put(static_cast<std::uint32_t>(transitions.size()));
  for (const Transition& t : transitions) {
    put_status(out, level(t), drone + "/failsafe",
               std::string(name(t.phase)) + ", failsafe " + name(t.mode) + " (" + name(t.cause) + ")", drone,
               {{"boot_id", std::to_string(t.boot_id)},
                {"number", std::to_string(t.number)},
                {"lost", std::to_string(t.lost)},
                {"stamp_ns", std::to_string(t.stamp_ns)},
                {"phase", name(t.phase)},
                {"mode", name(t.mode)},
                {"cause", name(t.cause)}});
  }
  return out.take();
}

Result<std::vector<Transition>> transitions_from_cdr(std::string_view cdr) {
  return statuses_from_cdr<Transition>(
      cdr, "a transition", [](std::uint8_t, const std::string&, Transition&) {}, read_value);
}

std::string alarms_to_cdr(const Header& header, const std::string& drone, const std::vector<Alarm>& alarms) {
  CdrWriter out;
  put_header(out, header);
  out.put(static_cast<std::uint32_t>(alarms.size()));
  for (const Alarm& alarm : alarms) {
    put_status(
        out, alarm.stands ? level_error : level_ok, drone + "/alarm/" + alarm.kind,
        (alarm.stands ? "the ledger is not trusted: " : "over: ") + alarm.words, drone,
        {{"count", std::to_string(alarm.count)}, {"words", alarm.words}, {"block", std::to_string(alarm.block)}});
  }
  return out.take();
}

Result<std::vector<Alarm>> alarms_from_cdr(std::string_view cdr) {
  return statuses_from_cdr<Alarm>(
      cdr, "an alarm",
      [](std::uint8_t level, const std::string& name, Alarm& alarm) {
        alarm.stands = level >= level_error;
        alarm.kind = name.substr(name.rfind('/') + 1);
      },
      [](const std::string& key, const std::string& value, Alarm& alarm) {
        if (key == "count") return read_number(value, alarm.count);
        if (key == "block") return read_number(value, alarm.block);
        if (key == "words") alarm.words = value;
        return true;
      });
}

}  // namespace ledgerline
