#include "common/msg/ros.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>

#include "common/base/enum_count.hpp"
#include "common/msg/cdr.hpp"
#include "common/msg/names.hpp"

namespace ledgerline {
namespace {

// Each message's fields are written down once, for both directions.
template <typename Cdr, typename T>
using Of = std::conditional_t<std::is_same_v<Cdr, CdrWriter>, const T, T>;

// builtin_interfaces/msg/Time.
void time(CdrWriter& out, TimeNs real_ns) {
  out(static_cast<std::int32_t>(real_ns / ns_per_s), static_cast<std::uint32_t>(real_ns % ns_per_s));
}
void time(CdrReader& in, TimeNs& real_ns) {
  real_ns = static_cast<TimeNs>(in.get<std::int32_t>()) * ns_per_s;
  real_ns += in.get<std::uint32_t>();
}

template <typename Cdr>
void fields(Cdr& cdr, Of<Cdr, Header>& header) {
  time(cdr, header.stamp_ns);
  cdr(header.frame_id);
}

// Rows and columns of x, y, z, roll, pitch, yaw.
using Covariance = std::array<double, 36>;
constexpr std::array<std::size_t, 4> of_pose{0, 7, 14, 35};
constexpr std::array<std::size_t, 3> angular_diagonal{21, 28, 35};

template <std::size_t N>
void diagonal(CdrWriter& out, const std::array<std::size_t, N>& indices, const std::array<float, N>& variance) {
  Covariance covariance{};
  for (std::size_t i = 0; i < N; ++i) covariance[indices[i]] = static_cast<double>(variance[i]);
  out(covariance);
}
template <std::size_t N>
void diagonal(CdrReader& in, const std::array<std::size_t, N>& indices, std::array<float, N>& variance) {
  const auto covariance = in.get_array<double, 36>();
  for (std::size_t i = 0; i < N; ++i) variance[i] = static_cast<float>(covariance[indices[i]]);
}

template <typename Cdr>
void fields(Cdr& cdr, Of<Cdr, Odometry>& odometry) {
  fields(cdr, odometry.header);
  cdr(odometry.child_frame_id, odometry.position_m, odometry.orientation);
  diagonal(cdr, of_pose, odometry.pose_variance);
  cdr(odometry.linear_mps, odometry.angular_radps);
  diagonal(cdr, angular_diagonal, odometry.angular_variance);
}

template <typename Cdr>
void fields(Cdr& cdr, Of<Cdr, PoseStamped>& pose) {
  fields(cdr, pose.header);
  cdr(pose.position_m, pose.orientation);
}

template <typename Cdr>
void fields(Cdr& cdr, Of<Cdr, Twist>& twist) {
  cdr(twist.linear_mps, twist.angular_radps);
}

// As far as we read it.
template <typename Cdr>
void fields(Cdr& cdr, Of<Cdr, BatteryState>& battery) {
  fields(cdr, battery.header);
  std::array<float, 5> unknown;  // temperature, current, charge, capacity, design_capacity
  unknown.fill(std::numeric_limits<float>::quiet_NaN());
  cdr(battery.voltage_v, unknown, battery.percentage);
}

// A LinkStatus behind its time, but for the four bytes at its end.
template <typename Cdr>
void link_fields(Cdr& cdr, Of<Cdr, StateSample>& s) {
  cdr(s.stamp_ns, s.boot_id, s.sequence, s.applied_sequence, s.arrived_sequence, s.arrived_ns, s.playout_margin_ns,
      s.sent_velocity_mps, s.sent_yaw_rate_radps, s.attitude_rad, s.acceleration_mps2, s.tof_m, s.height_m);
}

template <typename Message>
std::string written(const Message& message) {
  CdrWriter out;
  fields(out, message);
  return out.release();
}

template <typename T>
Result<T> checked(const CdrReader& in, T value, std::string_view type) {
  if (!in.ok()) return Error{"malformed CDR of " + std::string(type)};
  return value;
}

template <typename Message>
Result<Message> read(std::string_view cdr, std::string_view type) {
  CdrReader in(cdr);
  Message message;
  fields(in, message);
  return checked(in, std::move(message), type);
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

std::string to_cdr(const Odometry& odometry) { return written(odometry); }
Result<Odometry> odometry_from_cdr(std::string_view cdr) { return read<Odometry>(cdr, odometry_type); }

std::string to_cdr(const PoseStamped& pose) { return written(pose); }
Result<PoseStamped> pose_from_cdr(std::string_view cdr) { return read<PoseStamped>(cdr, pose_type); }

Result<Twist> twist_from_cdr(std::string_view cdr) { return read<Twist>(cdr, twist_type); }

std::string to_cdr(const std::vector<TransformStamped>& transforms) {
  CdrWriter out;
  out.put(static_cast<std::uint32_t>(transforms.size()));
  for (const TransformStamped& t : transforms) {
    fields(out, t.header);
    out(t.child_frame_id, t.translation_m, t.rotation);
  }
  return out.release();
}

std::string to_cdr(const Imu& imu) {
  constexpr std::array<double, 9> unknown{}, not_measured{-1};
  constexpr std::array<double, 3> angular_velocity{};
  CdrWriter out;
  fields(out, imu.header);
  out(imu.orientation, unknown, angular_velocity, not_measured, imu.acceleration_mps2, unknown);
  return out.release();
}

std::string to_cdr(const BatteryState& battery) {
  constexpr std::uint8_t discharging = 2, unknown_health = 0, lipo = 3, present = 1;
  constexpr std::uint32_t no_cells = 0;  // measured: neither voltages nor temperatures
  constexpr std::string_view no_location, no_serial_number;
  CdrWriter out;
  fields(out, battery);
  out(discharging, unknown_health, lipo, present, no_cells, no_cells, no_location, no_serial_number);
  return out.release();
}
Result<BatteryState> battery_from_cdr(std::string_view cdr) { return read<BatteryState>(cdr, battery_type); }

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
  s.phase = static_cast<LinkPhase>(phase);
  s.mode = static_cast<FailsafeMode>(mode);
  s.cause = static_cast<FailsafeCause>(cause);
  return phase < enum_count<LinkPhase> && mode < enum_count<FailsafeMode> && cause < enum_count<FailsafeCause>;
}

bool read_link_status(CdrReader& in, DroneState& state) {
  StateSample& s = state.sample;
  time(in, state.real_ns);
  link_fields(in, s);
  s.sdk_state_fresh = in.get<std::uint8_t>() != 0;
  s.battery = -1;
  return read_enums(in, s);
}

/// Blocks written before have another layout, with the pose and the charge in it; it is known by its size.
constexpr std::size_t link_status_bytes_before = 224;

bool read_link_status_before(CdrReader& in, DroneState& state) {
  StateSample& s = state.sample;
  const bool known = read_enums(in, s);
  in(s.boot_id, s.sequence, s.stamp_ns, s.pose_stamp_ns, s.position_m, s.velocity_mps, s.yaw_rad, s.battery, s.tof_m,
     s.height_m);
  s.sdk_state_fresh = in.get<std::uint8_t>() != 0;
  std::array<TimeNs, 2> of_applied_plan;           // its state's stamp, and how late
  std::array<std::uint32_t, 3> counters_of_plans;  // that came late, were dropped, were applied
  in(s.applied_sequence, of_applied_plan, s.arrived_sequence, s.arrived_ns, s.sent_velocity_mps, s.sent_yaw_rate_radps,
     counters_of_plans, s.attitude_rad, s.acceleration_mps2, s.pose_variance);
  return known;
}

}  // namespace

Odometry odometry_of(const StateSample& s, const std::string& drone, TimeNs real_offset_ns) {
  // Filters of ROS take a zero for exact, and leave out what is as uncertain as this.
  constexpr float not_measured = 1e6F;
  return {.header = {s.pose_stamp_ns + real_offset_ns, "map"},  // the pose's own: a lost mocap shows as an old one
          .child_frame_id = drone + "/base_link",
          .position_m = s.position_m,
          .orientation = quaternion_from_yaw(s.yaw_rad),
          .linear_mps = turned(s.velocity_mps, s.yaw_rad, -1),
          .angular_radps = {},
          .pose_variance = s.pose_variance,
          .angular_variance = {not_measured, not_measured, not_measured}};
}

std::string link_status_to_cdr(const StateSample& s, TimeNs real_offset_ns) {
  CdrWriter out;
  time(out, s.stamp_ns + real_offset_ns);
  link_fields(out, s);
  out.put(std::array{static_cast<std::uint8_t>(s.sdk_state_fresh), static_cast<std::uint8_t>(s.phase),
                     static_cast<std::uint8_t>(s.mode), static_cast<std::uint8_t>(s.cause)});
  return out.release();
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

DiagnosticLevel level(const Transition& t) {
  if (t.mode >= FailsafeMode::land) return DiagnosticLevel::error;
  return t.mode == FailsafeMode::none && t.cause == FailsafeCause::none ? DiagnosticLevel::ok : DiagnosticLevel::warn;
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

void put_status(CdrWriter& out, DiagnosticLevel level, const std::string& name, const std::string& message,
                const std::string& hardware, const Values& values) {
  out(static_cast<std::uint8_t>(level), name, message, hardware, static_cast<std::uint32_t>(values.size()));
  for (const auto& [key, value] : values) out(key, value);
}

/// A DiagnosticArray: of each status first level and name, then each of its values; `read`: whether the value can be.
template <typename Item, typename Begin, typename Read>
Result<std::vector<Item>> statuses_from_cdr(std::string_view cdr, const char* what, Begin begin, Read read) {
  CdrReader in(cdr);
  Header header;
  fields(in, header);
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
  fields(out, header);
  out.put(static_cast<std::uint32_t>(transitions.size()));
  for (const Transition& t : transitions) {
    std::string message(name(t.phase));
    message.append(", failsafe ").append(name(t.mode)).append(" (").append(name(t.cause)).append(")");
    put_status(out, level(t), drone + "/failsafe", message, drone,
               {{"boot_id", std::to_string(t.boot_id)},
                {"number", std::to_string(t.number)},
                {"lost", std::to_string(t.lost)},
                {"stamp_ns", std::to_string(t.stamp_ns)},
                {"phase", std::string(name(t.phase))},
                {"mode", std::string(name(t.mode))},
                {"cause", std::string(name(t.cause))}});
  }
  return out.release();
}

Result<std::vector<Transition>> transitions_from_cdr(std::string_view cdr) {
  return statuses_from_cdr<Transition>(
      cdr, "a transition", [](std::uint8_t, const std::string&, Transition&) {}, read_value);
}

std::string diagnostic_to_cdr(const Header& header, const std::string& drone, DiagnosticLevel level,
                              const std::string& message) {
  CdrWriter out;
  fields(out, header);
  out.put(std::uint32_t{1});
  put_status(out, level, drone + "/flight", message, drone, {});
  return out.release();
}

std::string alarms_to_cdr(const Header& header, const std::string& drone, const std::vector<Alarm>& alarms) {
  CdrWriter out;
  fields(out, header);
  out.put(static_cast<std::uint32_t>(alarms.size()));
  for (const Alarm& alarm : alarms) {
    put_status(
        out, alarm.stands ? DiagnosticLevel::error : DiagnosticLevel::ok, drone + "/alarm/" + alarm.kind,
        (alarm.stands ? "the ledger is not trusted: " : "over: ") + alarm.words, drone,
        {{"count", std::to_string(alarm.count)}, {"words", alarm.words}, {"block", std::to_string(alarm.block)}});
  }
  return out.release();
}

Result<std::vector<Alarm>> alarms_from_cdr(std::string_view cdr) {
  return statuses_from_cdr<Alarm>(
      cdr, "an alarm",
      [](std::uint8_t level, const std::string& name, Alarm& alarm) {
        alarm.stands = level >= static_cast<std::uint8_t>(DiagnosticLevel::error);
        alarm.kind = name.substr(name.rfind('/') + 1);
      },
      [](const std::string& key, const std::string& value, Alarm& alarm) {
        if (key == "count") return read_number(value, alarm.count);
        if (key == "block") return read_number(value, alarm.block);
        if (key == "words") alarm.words = value;
        return true;
      });
}

namespace {

constexpr std::uint32_t max_poses = 1'024;
constexpr std::size_t max_name = 255;

Result<std::optional<PoseStamped>> named_pose(std::string_view cdr, std::string_view drone) {
  const Error malformed{std::string("malformed CDR of ") + name(PoseMessage::named_pose_array)};
  CdrReader in(cdr);
  PoseStamped pose;
  fields(in, pose.header);
  const auto count = in.get<std::uint32_t>();
  if (!in.ok() || count > max_poses) return malformed;
  bool found = false;
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::string of = in.get_string();
    const auto position_m = in.get_array<double, 3>();
    const auto orientation = in.get_array<double, 4>();
    if (!in.ok() || of.size() > max_name) return malformed;
    if (of != drone || found) continue;
    pose.position_m = position_m;
    pose.orientation = orientation;
    found = true;
  }
  return found ? std::optional(pose) : std::nullopt;
}

}  // namespace

Result<std::optional<PoseStamped>> pose_from_message(PoseMessage message, std::string_view cdr,
                                                     std::string_view drone) {
  switch (message) {
    case PoseMessage::pose_stamped: {
      auto pose = pose_from_cdr(cdr);
      if (!pose) return pose.error();
      return std::optional(std::move(pose).value());
    }
    case PoseMessage::odometry: {
      auto odometry = odometry_from_cdr(cdr);
      if (!odometry) return odometry.error();
      return std::optional(PoseStamped{odometry->header, odometry->position_m, odometry->orientation});
    }
    case PoseMessage::named_pose_array:
      return named_pose(cdr, drone);
  }
  return Error{"no message of poses"};
}

std::string pose_topic_of(const std::string& pattern, const std::string& drone) {
  constexpr std::string_view place = "{drone}";
  std::string topic = pattern;
  const auto at = topic.find(place);
  if (at != std::string::npos) topic.replace(at, place.size(), drone);
  return topic;
}

}  // namespace ledgerline
