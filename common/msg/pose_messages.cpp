#include "common/msg/pose_messages.hpp"

#include <string>

#include "common/msg/cdr.hpp"

namespace ledgerline {
namespace {

constexpr std::uint32_t max_poses = 1'024;
constexpr std::size_t max_name = 255;

Result<std::optional<PoseStamped>> named_pose(std::string_view cdr, std::string_view drone) {
  const Error malformed{std::string("malformed CDR of ") + name(PoseMessage::named_pose_array)};
  CdrReader in(cdr);
  PoseStamped pose;
  pose.header.stamp_ns = static_cast<TimeNs>(in.get<std::int32_t>()) * ns_per_s;
  pose.header.stamp_ns += in.get<std::uint32_t>();
  pose.header.frame_id = in.get_string();
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
