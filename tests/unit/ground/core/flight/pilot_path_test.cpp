#include "ground/core/flight/planner.hpp"

#include <gtest/gtest.h>

namespace ledgerline::ground {
namespace {

/// Flies a course by saying how far its reference is.
class SaidFollower final : public Follower {
 public:
  explicit SaidFollower(const motion::OpenPath& course) : path_(course.waypoints, course.origin_m) {}
  void start(TimeNs, double end_m) override { end_m_ = end_m; }
  void observe(const StateSample&) override {}
  bool ready() const override { return true; }
  std::vector<Setpoint> plan(std::uint64_t, TimeNs, std::size_t) override { return {}; }
  double progress_m() const override { return reference_m; }
  bool at_end() const override { return reference_m >= end_m_; }
  double lap_m() const override { return path_.length_m(); }
  double length_to(std::size_t corner) const override { return path_.length_to(corner); }
  const Path& path() const override { return path_; }
  double start_height_m() const override { return 1; }
  double expected_s(int) const override { return 1; }

  double reference_m = 0;

 private:
  Path path_;
  double end_m_ = 0;
};

class PilotPathParts : public testing::Test {
 protected:
  PilotPathParts() { follower.start(0, path.end_m(follower)); }
  static Waypoint at(double x, double y) { return {{x, y}, 1.0}; }
  std::size_t left(double reference_m, double x, double y) {
    follower.reference_m = reference_m;
    state.position_m = {x, y, 1};
    path.observe(follower, state);
    return path.rest().size();
  }

  PilotPath path{{at(2, 0), at(2, 2), at(0, 2)}, false, at(0, 0), 1};
  SaidFollower follower{path.course()};
  StateSample state;
};

TEST_F(PilotPathParts, AWaypointIsReachedWhenReferenceAndDroneAreThere) {
  EXPECT_EQ(left(1.9, 1.9, 0), 3U) << "the reference is on its way to it";
  EXPECT_EQ(left(2.3, 1.7, 0), 3U) << "the drone is";
  EXPECT_EQ(left(2.4, 1.9, 0), 2U);
  EXPECT_EQ(left(2.4, 1.9, 0), 2U);
}

TEST_F(PilotPathParts, AWaypointThatTheDronePassedWideIsReachedOnceTheReferenceIsFarBehindIt) {
  EXPECT_EQ(left(2.7, 1.7, 0.3), 3U);
  EXPECT_EQ(left(2.9, 1.7, 0.6), 2U);
}

TEST_F(PilotPathParts, TheLastWaypointIsLeftUntilTheDroneHasSettledThere) {
  EXPECT_EQ(left(6, 0, 2), 1U);
  EXPECT_TRUE(path.at_end(follower, state));
  state.velocity_mps[0] = 0.5;
  EXPECT_FALSE(path.at_end(follower, state)) << "it moves";
  state.velocity_mps[0] = 0;
  state.position_m[2] = 1.5;
  EXPECT_FALSE(path.at_end(follower, state)) << "it is too high";
  state.position_m[2] = 1;
  follower.reference_m = 5;
  EXPECT_FALSE(path.at_end(follower, state)) << "it is not where its reference is";
}

}  // namespace
}  // namespace ledgerline::ground
