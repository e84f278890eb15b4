#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"

/// The ROS 2 messages that a drone's state travels in, to and from CDR.

/// Messages that say where drones are.

namespace ledgerline {

/// std_msgs/msg/Header; real time.
struct Header {
  TimeNs stamp_ns = 0;
  std::string frame_id;
};

/// nav_msgs/msg/Odometry. Of its covariances the diagonals of the pose (x, y, z, yaw) and of the angular velocity are
/// filled in; zeros mean "unknown", as in ROS. Quaternion order x, y, z, w.
struct Odometry {
  Header header;  ///< frame_id "map"
  std::string child_frame_id;
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{0, 0, 0, 1};
  std::array<double, 3> linear_mps{};  ///< in the child frame (REP 105)
  std::array<double, 3> angular_radps{};
  PoseVariance pose_variance{};
  std::array<float, 3> angular_variance{};
};
inline constexpr std::string_view odometry_type = "nav_msgs/msg/Odometry";
std::string to_cdr(const Odometry& odometry);
Result<Odometry> odometry_from_cdr(std::string_view cdr);

/// geometry_msgs/msg/PoseStamped.
struct PoseStamped {
  Header header;  ///< real time
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< x, y, z, w
};
inline constexpr std::string_view pose_type = "geometry_msgs/msg/PoseStamped";
std::string to_cdr(const PoseStamped& pose);
Result<PoseStamped> pose_from_cdr(std::string_view cdr);

/// geometry_msgs/msg/TransformStamped: where the child frame is in the header's.
struct TransformStamped {
  Header header;
  std::string child_frame_id;
  std::array<double, 3> translation_m{};
  std::array<double, 4> rotation{0, 0, 0, 1};
};
/// As tf2_msgs/msg/TFMessage.
inline constexpr std::string_view transforms_type = "tf2_msgs/msg/TFMessage";
std::string to_cdr(const std::vector<TransformStamped>& transforms);

/// geometry_msgs/msg/Twist. Numbers are as they came: a caller that flies them must check them first.
struct Twist {
  std::array<double, 3> linear_mps{};
  std::array<double, 3> angular_radps{};
};
inline constexpr std::string_view twist_type = "geometry_msgs/msg/Twist";
Result<Twist> twist_from_cdr(std::string_view cdr);

/// std_msgs/msg/Empty: that it came is all it says.
inline constexpr std::string_view empty_type = "std_msgs/msg/Empty";

/// sensor_msgs/msg/Imu of a drone that reports no angular velocity (its covariance begins with -1, as the message's
/// comments ask); the other covariances are zeros ("unknown").
struct Imu {
  Header header;
  std::array<double, 4> orientation{0, 0, 0, 1};
  std::array<double, 3> acceleration_mps2{};  ///< with gravity: 0, 0, 9.8 at rest
};
inline constexpr std::string_view imu_type = "sensor_msgs/msg/Imu";
std::string to_cdr(const Imu& imu);

/// sensor_msgs/msg/BatteryState, the fields that a Tello knows; all others NaN or unknown, as the message's comments
/// ask.
struct BatteryState {
  Header header;
  float voltage_v = 0;
  float percentage = 0;  ///< 0..1
};
inline constexpr std::string_view battery_type = "sensor_msgs/msg/BatteryState";
std::string to_cdr(const BatteryState& battery);
Result<BatteryState> battery_from_cdr(std::string_view cdr);

/// A drone's state on the ledger, each fact in one message: where it is and how fast in nav_msgs/msg/Odometry, which it
/// has when there is a pose, its charge in sensor_msgs/msg/BatteryState, which is not sent with every state, and the
/// rest in ledgerline_msgs/msg/LinkStatus (common/msg/ledgerline_msgs/msg/LinkStatus.msg).
/// `real_offset_ns`: real time minus the clock of the sample's stamps.
inline constexpr std::string_view link_status_type = "ledgerline_msgs/msg/LinkStatus";
Odometry odometry_of(const StateSample& sample, const std::string& drone, TimeNs real_offset_ns);
std::string link_status_to_cdr(const StateSample& sample, TimeNs real_offset_ns);

/// What a LinkStatus and the Odometry beside it say together.
struct DroneState {
  StateSample sample;  ///< no number: its name is in the id; battery below 0: not known from these
  TimeNs real_ns = 0;  ///< sample.stamp_ns as real time
};
/// `odometry`: empty without a pose. Times that are negative or would overflow and numbers that are not finite or
/// beyond 1e6 are refused: what is read goes into controllers. A LinkStatus of blocks written before, which has a pose
/// and a charge of its own, is read, too.
Result<DroneState> state_from_cdr(std::string_view link_status, std::string_view odometry);

/// diagnostic_msgs/msg/DiagnosticArray: transitions of one drone, oldest first, a DiagnosticStatus each. Its name is
/// "<drone>/failsafe", its level 0 (OK), 1 (WARN: a cause, hold, brake) or 2 (ERROR: land, cut), its message a
/// sentence, its values boot_id, number, lost, stamp_ns (the drone host's CLOCK_MONOTONIC), phase, mode and cause.
inline constexpr std::string_view transitions_type = "diagnostic_msgs/msg/DiagnosticArray";
std::string transitions_to_cdr(const Header& header, const std::string& drone,
                               const std::vector<Transition>& transitions);
/// The drone's number is left out: its name is in the id.
Result<std::vector<Transition>> transitions_from_cdr(std::string_view cdr);

enum class DiagnosticLevel : std::uint8_t { ok = 0, warn = 1, error = 2 };  ///< diagnostic_msgs/msg/DiagnosticStatus
/// diagnostic_msgs/msg/DiagnosticArray of one status, "<drone>/flight", without values.
std::string diagnostic_to_cdr(const Header& header, const std::string& drone, DiagnosticLevel level,
                              const std::string& message);

/// diagnostic_msgs/msg/DiagnosticArray: why the drone's agent does not or did not trust the ledger, a
/// DiagnosticStatus each. Its name is "<drone>/alarm/<kind>", its level 2 (ERROR) while it stands, else 0 (OK), its
/// message a sentence, its values count, words and block.
struct Alarm {
  std::string kind;
  bool stands = false;
  std::uint64_t count = 0;  ///< since agent's start
  std::string words;        ///< of the newest
  std::uint64_t block = 0;  ///< of the newest; 0: of none
};
inline constexpr std::string_view alarms_type = transitions_type;
std::string alarms_to_cdr(const Header& header, const std::string& drone, const std::vector<Alarm>& alarms);
Result<std::vector<Alarm>> alarms_from_cdr(std::string_view cdr);

/// From roll about x, pitch about y and yaw about z (REP 103), turned in the order yaw, pitch, roll.
std::array<double, 4> quaternion_from_attitude(double roll_rad, double pitch_rad, double yaw_rad);
/// Rotation about z only, from yaw.
std::array<double, 4> quaternion_from_yaw(double yaw_rad);
double yaw_from_quaternion(const std::array<double, 4>& xyzw);

/// Where a drone's poses are looked for unless a config says otherwise, "{drone}" for its name: as vrpn_mocap has it.
inline constexpr const char* usual_pose_topic = "/vrpn_mocap/{drone}/pose";
std::string pose_topic_of(const std::string& pattern, const std::string& drone);

enum class PoseMessage : std::uint8_t {
  pose_stamped = 0,     ///< of one drone
  odometry = 1,         ///< of one drone; its twist is left out
  named_pose_array = 2  ///< of many, by name: what motion_capture_tracking and Crazyswarm2 publish on /poses
};
/// Its ROS 2 type.
constexpr const char* name(PoseMessage message) noexcept {
  constexpr std::array names{"geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry",
                             "motion_capture_tracking_interfaces/msg/NamedPoseArray"};
  static_assert(names.size() == enum_count<PoseMessage>);
  const auto at = static_cast<std::size_t>(message);
  return at < names.size() ? names[at] : "unknown";
}

/// The pose of the drone of that name; nothing where an array has none of it. An array of more than 1,024 poses, or
/// with a name longer than 255 bytes, is malformed.
Result<std::optional<PoseStamped>> pose_from_message(PoseMessage message, std::string_view cdr, std::string_view drone);

}  // namespace ledgerline
