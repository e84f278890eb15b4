#include "tools/launcher/preflight/preflight.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::fly {
namespace {

using testing::HasSubstr;

Options options_of(int drones) {
  Options options;
  options.own.emplace();
  options.own->pose_source = "mocap";
  options.own->link.fence.min_m = {-2, -2, 0};
  options.own->link.fence.max_m = {2, 2, 2};
  for (int k = 1; k <= drones; ++k)
    options.own->drones.push_back({fmt::format("d{}", k), fmt::format("10.0.0.{}", k), k == 2 ? "wlan1" : "", ""});
  options.drones = drones;
  return options;
}

std::string line_of(const std::string& name, const std::string& phase, const std::string& cause,
                    const std::string& pose_age_ms = "12.0", double x_m = 0) {
  return fmt::format(
      R"({{"link":{{"drones":[{{"name":"{}","phase":"{}","mode":"none","cause":"{}","battery":0.87,"pose_age_ms":{},)"
      R"("position":[{},0.5,0.1]}}]}}}})",
      name, phase, cause, pose_age_ms, x_m);
}

TEST(Preflight, EveryDroneMustBeReady) {
  Preflight preflight(options_of(2));
  EXPECT_FALSE(preflight.ready());
  preflight.take(line_of("d1", "on_ground", "none"));
  EXPECT_FALSE(preflight.ready());
  EXPECT_EQ(preflight.missing(), "d2 at 10.0.0.2: does not answer: is it on, and does this computer reach it?");
  preflight.take(line_of("d2", "landed", "none"));
  EXPECT_TRUE(preflight.ready());
  EXPECT_EQ(preflight.missing(), "");
  preflight.take(line_of("d1", "on_ground", "battery_low"));
  EXPECT_FALSE(preflight.ready());
}

TEST(Preflight, TheListHasWhatAPersonChecks) {
  Preflight preflight(options_of(2));
  preflight.take(line_of("d2", "on_ground", "none"));
  const std::string list = preflight.list();
  EXPECT_THAT(list, HasSubstr("d1         10.0.0.1         not there"));
  EXPECT_THAT(list, HasSubstr("10.0.0.2        behind wlan1  battery 87 %  pose from mocap, 12 ms old: 0.00, 0.50"));
  EXPECT_THAT(list, HasSubstr("fence      x -2 to 2, y -2 to 2, z 0 to 2 m"));
}

TEST(Preflight, WhyADroneIsNotReadyIsSaid) {
  Preflight preflight(options_of(1));
  const auto why = [&](const std::string& line) {
    preflight.take(line);
    return preflight.missing();
  };
  EXPECT_EQ(why(line_of("d1", "on_ground", "pose_lost", "null")), "d1 at 10.0.0.1: no pose of it has come from mocap");
  EXPECT_EQ(why(line_of("d1", "on_ground", "pose_lost", "900")), "d1 at 10.0.0.1: its pose from mocap is 900 ms old");
  EXPECT_EQ(why(line_of("d1", "on_ground", "battery_low")), "d1 at 10.0.0.1: its battery has 87 %");
  EXPECT_EQ(why(line_of("d1", "on_ground", "stopped")), "d1 at 10.0.0.1: stopped");
  EXPECT_EQ(why(line_of("d1", "flying", "none")), "d1 at 10.0.0.1: it is not on the ground: flying");
}

TEST(Preflight, WithoutAnyPoseAPilotsDroneIsReady) {
  Options options = options_of(1);
  options.own->pose_source = "none";
  options.manual = true;
  Preflight preflight(options);
  preflight.take(line_of("d1", "on_ground", "battery_low", "null"));
  EXPECT_FALSE(preflight.ready());
  preflight.take(line_of("d1", "on_ground", "pose_lost", "null"));
  EXPECT_TRUE(preflight.ready()) << preflight.missing();
  EXPECT_THAT(preflight.list(), HasSubstr("battery 87 %  by hand, without a pose"));
  EXPECT_THAT(preflight.list(), HasSubstr("z 0 to 2 m: of these the ceiling alone holds"));
}

TEST(Preflight, WhatIsNoStatusLineChangesNothing) {
  Preflight preflight(options_of(1));
  for (const char* line : {"", "[1]", "{}", R"({"link":3})", R"({"link":{"drones":[1,{"name":7}]}})",
                           R"({"agent":{"drones":[{"name":"d1","phase":"on_ground","cause":"none"}]}})"})
    preflight.take(line);
  EXPECT_THAT(preflight.missing(), HasSubstr("does not answer"));
}

TEST(Preflight, APathIsJudgedFromWhereTheDroneStands) {
  Options options = options_of(1);
  options.side_m = 1.5;
  Preflight preflight(options);
  preflight.take(line_of("d1", "on_ground", "none", "12.0", 0));
  EXPECT_TRUE(preflight.path_fits());
  preflight.take(line_of("d1", "on_ground", "none", "12.0", 1.0));
  const Status status = preflight.path_fits();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().what, HasSubstr("d1 would be at 2.5, 0.5, 1 m, beyond link's fence"));
}

}  // namespace
}  // namespace ledgerline::fly
