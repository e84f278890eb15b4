#include "onboard/link/core/tello/tello_text.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace ledgerline::link {
namespace {

constexpr double quarter = std::numbers::pi / 2;
const RcSettings settings;

Rc rc(const Velocity& velocity, double yaw) { return to_body(settings, velocity, yaw).rc; }

TEST(BodyFrame, ADroneThatLooksEastFliesEastWithForwardAndNorthWithLeft) {
  EXPECT_EQ(rc({{0.5F, 0, 0}, 0}, 0), (Rc{0, 50, 0, 0}));
  EXPECT_EQ(rc({{0, 0.5F, 0}, 0}, 0), (Rc{-50, 0, 0, 0}));
  EXPECT_EQ(rc({{0, 0, 0.5F}, 0}, 0), (Rc{0, 0, 50, 0}));
}

TEST(BodyFrame, ADroneYawedByNinetyDegreesLooksNorth) {
  EXPECT_EQ(rc({{0.5F, 0, 0}, 0}, quarter), (Rc{50, 0, 0, 0}));  // east is on its right
  EXPECT_EQ(rc({{0, 0.5F, 0}, 0}, quarter), (Rc{0, 50, 0, 0}));
  EXPECT_EQ(rc({{0, -0.5F, 0}, 0}, -quarter), (Rc{0, 50, 0, 0}));
}

TEST(BodyFrame, CounterClockwiseIsANegativeRcD) {
  EXPECT_EQ(rc({{}, 100.0F * std::numbers::pi_v<float> / 180}, 0)[3], -100);
  EXPECT_EQ(rc({{}, -50.0F * std::numbers::pi_v<float> / 180}, 1)[3], 50);
}

TEST(BodyFrame, SignsAreSettings) {
  RcSettings other = settings;
  other.signs = {1, 1, 1, 1};
  EXPECT_EQ(to_body(other, {{0, 0.5F, 0}, 1.0F}, 0).rc[0], 50);
  EXPECT_GT(to_body(other, {{0, 0.5F, 0}, 1.0F}, 0).rc[3], 0);
}

TEST(BodyFrame, BeyondRcsRangeTheDirectionIsKeptAndWhatWasSentIsReported) {
  const BodyCommand command = to_body(settings, {{2, 1, 0}, 9}, 0);
  EXPECT_EQ(command.rc, (Rc{-50, 100, 0, -100}));
  EXPECT_FLOAT_EQ(command.sent.mps[0], 1);
  EXPECT_FLOAT_EQ(command.sent.mps[1], 0.5F);
  EXPECT_FLOAT_EQ(command.sent.yaw_radps, settings.full_scale_radps);
}

TEST(BodyFrame, FullScaleIsASetting) {
  RcSettings fast = settings;
  fast.full_scale_mps = 4;
  EXPECT_EQ(to_body(fast, {{1, 0, 0}, 0}, 0).rc[1], 25);
}

}  // namespace
}  // namespace ledgerline::link
