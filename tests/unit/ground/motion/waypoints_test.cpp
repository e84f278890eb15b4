#include "ground/motion/waypoints.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::ground::motion {
namespace {

using testing::HasSubstr;

std::string refused(const std::string& text) {
  const auto points = waypoints_from_csv(text, "way.csv");
  return points.ok() ? "taken" : points.error().message;
}

TEST(Course, WaypointsComeWithHeightAndSpeedWhereTheyAreGiven) {
  const auto points =
      waypoints_from_csv("x,y,z,speed\n# the start\n1,2\n2, 2, 1.5 # higher\r\n2,3,,0.4\n1,3,1,1\n", "f");
  ASSERT_TRUE(points.ok()) << points.error().message;
  ASSERT_EQ(points->size(), 4u);
  EXPECT_EQ((*points)[0].at_m, Eigen::Vector2d(0, 0));
  EXPECT_EQ((*points)[2].at_m, Eigen::Vector2d(1, 1));
  EXPECT_FALSE((*points)[0].height_m);
  EXPECT_DOUBLE_EQ((*points)[1].height_m.value(), 1.5);
  EXPECT_FALSE((*points)[2].height_m);
  EXPECT_DOUBLE_EQ((*points)[2].speed_mps.value(), 0.4);
}

TEST(Course, ABadLineIsNamedWithWhatIsAllowed) {
  EXPECT_THAT(refused("0,0\n1,x\n1,1\n"), HasSubstr("way.csv:2: y \"x\" is no number from -1000 to 1000"));
  EXPECT_THAT(refused("north,0\n1,0\n1,1\n"), HasSubstr("way.csv:1: x \"north\""));
  EXPECT_THAT(refused("0,0\n1\n1,1\n"), HasSubstr("way.csv:2: 1 columns, not x,y[,z[,speed]]"));
  EXPECT_THAT(refused("0,0\n1,0,1,1,1\n1,1\n"), HasSubstr("way.csv:2: 5 columns"));
  EXPECT_THAT(refused("0,0\n\n1,nan\n1,1\n"), HasSubstr("way.csv:3: y \"nan\""));
  EXPECT_THAT(refused("0,0\n1,0,0.1\n1,1\n"), HasSubstr("way.csv:2: z \"0.1\" is no number from 0.3 to 10"));
  EXPECT_THAT(refused("0,0\n1,0,,0\n1,1\n"), HasSubstr("way.csv:2: speed \"0\" is no number from 0.05 to 8"));
  EXPECT_THAT(refused("0,0\n1,0\n1,0.001\n"), HasSubstr("way.csv:3: closer than 1 cm"));
  EXPECT_THAT(refused("0,0\n1,0\n1,1\n0,0\n"), HasSubstr("way.csv:4: the first point again"));
  EXPECT_THAT(refused("-90,0\n90,0\n0,1\n"), HasSubstr("way.csv:2: more than 100 m from the first point"));
  EXPECT_THAT(refused("0,0\n1,0\n"), HasSubstr("way.csv: 2 points, at least 3"));
  EXPECT_THAT(refused(""), HasSubstr("way.csv: has no point"));
  EXPECT_THAT(refused("0,0\n1,0\nx,y\n1,1\n"), HasSubstr("way.csv:3"));  // a heading in the middle
  std::string many;
  for (int i = 0; i < 501; ++i) many += std::to_string(i % 90) + "," + std::to_string(i / 90) + "\n";
  EXPECT_THAT(refused(many), HasSubstr("way.csv:501: more than 500 points"));
}

TEST(Course, AFileThatDoesNotBeginAtTheOriginIsNotedAsMoved) {
  EXPECT_EQ(moved_note("x,y\n3,-2.5\n4,0\n4,1\n", "way.csv"),
            "way.csv:2: 3, -2.5 is flown from where the drone takes off, wherever that is");
  EXPECT_EQ(moved_note("0,0\n1,0\n1,1\n", "way.csv"), "");
  EXPECT_EQ(moved_note("north", "way.csv"), "");
}

TEST(Course, APathLiesWhereItsFileSays) {
  const auto path = path_from_csv("x,y\n300,2\n301,2,1.5\n300,2\n", "way.csv");
  ASSERT_TRUE(path) << path.error().message;
  ASSERT_EQ(path->size(), 3u);
  EXPECT_EQ((*path)[0].at_m, Eigen::Vector2d(300, 2));
  EXPECT_EQ((*path)[2].line, 4);
  EXPECT_EQ(path_from_csv("1,1\n", "way.csv")->size(), 1u);
}

TEST(Waypoints, OfFourWholeNumbersAreNotedAsMaybeOfDecimalCommas) {
  const auto note = [](const std::string& text) { return decimal_comma_note(text, "way.csv"); };
  EXPECT_EQ(note("0,0,1,1\n1,5,1,5\n3,0,1,5\n"),
            "way.csv:1: read as x 0, y 0, z 1 m and 1 m/s; if 0,0 and 1,1 are meant, write points: 0.0,1.1");
  EXPECT_THAT(note("# mine\n-1,5,1,5\r\n"), HasSubstr("way.csv:2: read as x -1, y 5, z 1 m and 5 m/s"));
  for (const char* plain : {"0,0\n1,0\n1,1\n", "0,0,1\n1,0,1\n", "0,0,1,1\n1,0,1,0.5\n", "0,0,,1\n1,0,1,1\n", "",
                            "x,y,z,speed\n0,0,1,1\n", "0,0,1,1\n1,1\n"})
    EXPECT_EQ(note(plain), "") << plain;
}

TEST(Course, TheEightIsAsWideAsItsSideHalfAsHighAndCrossesItself) {
  const auto points = waypoints_of(Shape::eight, 2);
  Eigen::Vector2d least(1e9, 1e9), most(-1e9, -1e9);
  int at_the_middle = 0;
  for (const Waypoint& point : points) {
    least = least.cwiseMin(point.at_m);
    most = most.cwiseMax(point.at_m);
    if ((point.at_m - Eigen::Vector2d(1, 0)).norm() < 1e-9) ++at_the_middle;
  }
  EXPECT_NEAR(least.x(), 0, 1e-9);
  EXPECT_NEAR(most.x(), 2, 1e-9);
  EXPECT_NEAR(most.y() - least.y(), 1, 1e-9);
  EXPECT_EQ(at_the_middle, 2);
  EXPECT_GT(points[1].at_m.y(), 0);
}

}  // namespace
}  // namespace ledgerline::ground::motion
