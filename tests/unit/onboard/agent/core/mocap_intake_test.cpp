#include "onboard/agent/core/mocap.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

namespace ledgerline::agent {
namespace {

constexpr TimeNs offset_ns = 1'000'000 * ns_per_s;

/// Measured at 5 s, turned by 90 degrees, 3 ms on its way.
MocapMessage good() {
  const double half = std::sqrt(0.5);
  return {offset_ns + 5 * ns_per_s, 5 * ns_per_s + 3 * ns_per_ms, {1, 2, 3}, {0, 0, half, half}};
}

Result<MocapPose> taken(const MocapMessage& message, bool stamps_of_this_host = true) {
  return MocapIntake([] { return offset_ns; }, stamps_of_this_host).check(message);
}

TEST(MocapIntake, APoseComesOutOnThisHostsClockWithItsYaw) {
  const auto pose = taken(good());
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->stamp_ns, 5 * ns_per_s);
  EXPECT_EQ(pose->position_m, good().position_m);
  EXPECT_NEAR(pose->yaw_rad, M_PI / 2, 1e-12);
}

TEST(MocapIntake, WhatIsNoUnitQuaternionIsNotTrusted) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& q :
       {std::array<double, 4>{0, 0, 0, 0}, {0, 0, 0, 1.03}, {0, 0, 0, 0.97}, {1, 1, 1, 1}, {nan, 0, 0, 1}}) {
    MocapMessage message = good();
    message.orientation = q;
    EXPECT_FALSE(taken(message)) << q[0] << " " << q[3];
  }
  MocapMessage message = good();
  message.orientation = {0, 0, 0, 1.02};
  EXPECT_TRUE(taken(message)) << "rounded";
  message.position_m[2] = nan;
  EXPECT_EQ(taken(message).error().message, "its position is not a number");
}

TEST(MocapIntake, AStampThatCannotBeIsNotTrustedUnlessArrivalCounts) {
  for (const TimeNs wrong : {-2 * ns_per_s, 30 * ns_per_ms}) {
    MocapMessage message = good();
    message.source_real_ns += wrong;
    EXPECT_THAT(taken(message).error().message, ::testing::HasSubstr("before its arrival"));
    const auto pose = taken(message, false);
    ASSERT_TRUE(pose);
    EXPECT_EQ(pose->stamp_ns, message.arrived_ns);
  }
}

TEST(MocapIntake, SaysWhichNumbersItRefuses) {
  const double nan = std::nan("");
  EXPECT_TRUE(MocapIntake::check_numbers({1, 2, 3}, {0, 0, 0, 1}));
  EXPECT_TRUE(MocapIntake::check_numbers({1, 2, 3}, {0, 0, 0, 1.01}));
  EXPECT_EQ(MocapIntake::check_numbers({1, nan, 3}, {0, 0, 0, 1}).error().message, "its position is not a number");
  EXPECT_EQ(MocapIntake::check_numbers({}, {0, 0, 0, 2}).error().message, "its orientation has the length 2.00, not 1");
  EXPECT_EQ(MocapIntake::check_numbers({}, {}).error().message, "its orientation has the length 0.00, not 1");
  EXPECT_FALSE(MocapIntake::check_numbers({}, {0, 0, nan, 1}));
}

}  // namespace
}  // namespace ledgerline::agent
