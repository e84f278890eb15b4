#pragma once
#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "common/msg/ros.hpp"

/// Messages that say where drones are.
namespace ledgerline {

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
