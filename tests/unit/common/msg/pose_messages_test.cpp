#include "common/msg/ros.hpp"

#include <gtest/gtest.h>

#include "common/msg/cdr.hpp"

namespace ledgerline {
namespace {

std::string named_poses(const std::vector<std::string>& names) {
  CdrWriter out;
  out.put(std::int32_t{12});
  out.put(std::uint32_t{500});
  out.put(std::string_view("world"));
  out.put(static_cast<std::uint32_t>(names.size()));
  double x = 0;
  for (const std::string& one : names) {
    out.put(std::string_view(one));
    out.put(std::array<double, 3>{++x, 2, 3});
    out.put(std::array<double, 4>{0, 0, 0, 1});
  }
  return out.release();
}

TEST(PoseMessages, OfAnArrayTheDronesOwnPoseIsTaken) {
  const auto pose = pose_from_message(PoseMessage::named_pose_array, named_poses({"cf1", "tello2", "x"}), "tello2");
  ASSERT_TRUE(pose) << pose.error().message;
  ASSERT_TRUE(*pose);
  EXPECT_EQ((*pose)->position_m[0], 2);
  EXPECT_EQ((*pose)->header.stamp_ns, 12 * ns_per_s + 500);
  EXPECT_EQ((*pose)->header.frame_id, "world");
}

TEST(PoseMessages, AnArrayWithoutTheDroneIsNoErrorAndNoPose) {
  for (const auto& names : {std::vector<std::string>{}, {"tello22", "tello"}}) {
    const auto pose = pose_from_message(PoseMessage::named_pose_array, named_poses(names), "tello2");
    ASSERT_TRUE(pose);
    EXPECT_FALSE(*pose);
  }
}

TEST(PoseMessages, AnOdometryAndAPoseAreTakenAsTheyAre) {
  Odometry odometry;
  odometry.header = {7 * ns_per_s, "map"};
  odometry.position_m = {1, 2, 3};
  const auto of_odometry = pose_from_message(PoseMessage::odometry, to_cdr(odometry), "tello1");
  ASSERT_TRUE(of_odometry && *of_odometry);
  EXPECT_EQ((*of_odometry)->position_m, odometry.position_m);
  const auto of_pose =
      pose_from_message(PoseMessage::pose_stamped, to_cdr(PoseStamped{odometry.header, {4, 5, 6}, {0, 0, 0, 1}}), "");
  ASSERT_TRUE(of_pose && *of_pose);
  EXPECT_EQ((*of_pose)->position_m[2], 6);
}

TEST(PoseMessages, WhatIsCutOrOrderedToBeEndlessIsRefused) {
  const std::string good = named_poses({"tello1", "tello2"});
  for (std::size_t cut = 0; cut < good.size(); ++cut)
    EXPECT_FALSE(pose_from_message(PoseMessage::named_pose_array, good.substr(0, cut), "tello2")) << cut;
  CdrWriter endless;
  endless.put(std::int32_t{1});
  endless.put(std::uint32_t{0});
  endless.put(std::string_view("m"));
  endless.put(std::uint32_t{0xFFFFFFFF});
  EXPECT_FALSE(pose_from_message(PoseMessage::named_pose_array, endless.release(), "tello1"));
  EXPECT_FALSE(pose_from_message(PoseMessage::named_pose_array, named_poses({std::string(300, 'x')}), "tello1"));
}

}  // namespace
}  // namespace ledgerline
