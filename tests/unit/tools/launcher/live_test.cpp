#include "tools/launcher/live.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::launcher {
namespace {

using testing::HasSubstr;

TEST(Live, AgentAndGroundTogetherMakeTheLineOfADrone) {
  Live live({"tello1", "tello2"}, false, 0);
  EXPECT_TRUE(
      live.on_status(R"({"agent":{"height":42,"drones":[{"name":"tello1","phase":"flying","mode":"none",)"
                     R"("position":[1.25,-2.5,1.0],"state_age_ms":7.0,"command_age_ms":12.0,"two_way_ms":15.0}]}})"));
  EXPECT_TRUE(
      live.on_status(R"({"ground":{"drones":[{"name":"tello1","phase":"path","lap":2,"progress":0.5}],"why":""}})"));
  const auto lines = live.lines(3 * ns_per_s);
  ASSERT_EQ(lines.size(), 2u);
  for (const char* part : {"3.0 s", "tello1", "path 50 %, lap 2", "1.25", "-2.50", "7 ms", "12 ms", "42", "15 ms"}) {
    EXPECT_THAT(lines[0], HasSubstr(part));
  }
  EXPECT_THAT(lines[1], HasSubstr("waiting"));
  EXPECT_TRUE(live.anything_in_air());
}

TEST(Live, WithoutAPoseALineHasTheDronesOwnHeight) {
  Live live({"tello1"}, false, 0);
  EXPECT_THAT(live.lines(0)[0], HasSubstr("  -  state")) << "nothing is known yet";
  live.on_status(R"({"agent":{"drones":[{"name":"tello1","position":null,"height_m":1.25}]}})");
  EXPECT_THAT(live.lines(0)[0], HasSubstr(" height 1.25 m  state"));
  EXPECT_THAT(live.lines(0, 80)[0], HasSubstr(" height 1.25 m"));
}

TEST(Live, ADroneAtTheOriginIsAtNoMinusZero) {
  Live live({"tello1"}, false, 0);
  live.on_status(R"({"agent":{"drones":[{"name":"tello1","position":[-0.004,0.004,-0.02]}]}})");
  EXPECT_THAT(live.lines(0)[0], HasSubstr("  0.00   0.00 -0.02 m"));
  EXPECT_THAT(live.lines(0, 80)[0], HasSubstr(" 0.0 0.0 0.0 m"));
}

TEST(Live, EightyColumnsHaveRoomForAgesTheBlockAndThePlace) {
  Live live({"tello1"}, false, 0);
  for (const char* mode : {"none", "brake"}) {
    live.on_status(
        fmt::format(R"({{"agent":{{"height":1042,"drones":[{{"name":"tello1","mode":"{}","position":[-1.25,-2.5,1.0],)"
                    R"("state_age_ms":107.0,"command_age_ms":12.0,"two_way_ms":115.0}}]}}}})",
                    mode));
    live.on_status(R"({"ground":{"drones":[{"name":"tello1","phase":"path","lap":2,"progress":0.5}]}})");
    const std::string line = live.lines(123 * ns_per_s, 80).at(0);
    EXPECT_LE(line.size(), 80U) << line;
    for (const char* part : {"123s", "path 50 %", "age  107", "2-way  115 ms", "block 1042", "-1.2 -2.5 1.0 m"})
      EXPECT_THAT(line, HasSubstr(part));
  }
}

TEST(Live, AWordOfItsOwnBeginsWhereTheLinesBegan) {
  Live live({"tello1"}, true, 0);
  testing::internal::CaptureStderr();
  live.show(ns_per_s);
  live.print("Landing");
  EXPECT_THAT(testing::internal::GetCapturedStderr(), testing::EndsWith("\n\r\033[1A\033[JLanding\n"));
}

TEST(Live, AReasonForWhichCommandsAreRefusedAgainAndAgainIsSaidOnce) {
  Live live({"tello1"}, false, 0);
  const auto printed = [&](TimeNs now, int too_old, int replayed) {
    live.on_status(R"({"agent":{"drones":[{"name":"tello1","refused_reasons":{"too_old":)" + std::to_string(too_old) +
                   R"(,"replayed":)" + std::to_string(replayed) + "}}]}}");
    testing::internal::CaptureStderr();
    live.show(now * ns_per_s);
    return testing::internal::GetCapturedStderr();
  };
  const auto silent = testing::Not(HasSubstr("refuses"));
  EXPECT_THAT(printed(1, 3, 1), silent);
  EXPECT_THAT(printed(2, 9, 1), silent) << "too soon";
  EXPECT_THAT(printed(3, 9, 1), testing::AllOf(HasSubstr("tello1: agent refuses its commands: too_old (docs/"),
                                               testing::Not(HasSubstr("replayed"))));
  EXPECT_THAT(printed(5, 20, 1), silent) << "once";
}

TEST(Live, LinesFitTheTerminal) {
  const std::vector<std::string> all{"tello1 flies", "tello2 flies", "tello3 flies", "tello4 flies"};
  EXPECT_EQ(fitted(all, 80, 24), all);
  EXPECT_THAT(fitted(all, 6, 24), testing::Each(testing::StartsWith("tello")));
  EXPECT_THAT(fitted(all, 6, 24), testing::Each(testing::SizeIs(6)));
  EXPECT_THAT(fitted(all, 80, 4), testing::ElementsAre("tello1 flies", "tello2 flies", HasSubstr("and 2 drones more")));
  EXPECT_THAT(fitted(all, 80, 1), testing::SizeIs(1));
  EXPECT_TRUE(fitted({}, 1, 1).empty());
}

TEST(Live, ADroneThatItsPilotFliesIsInTheAir) {
  Live live({"tello1"}, false, 0);
  live.on_status(R"({"ground":{"drones":[{"name":"tello1","phase":"manual"}]}})");
  EXPECT_TRUE(live.anything_in_air());
  EXPECT_THAT(live.lines(0)[0], HasSubstr("manual"));
}

TEST(Live, AFailsafeModeIsShown) {
  Live live({"tello1"}, false, 0);
  live.on_status(R"({"agent":{"height":1,"drones":[{"name":"tello1","mode":"hold"}]}})");
  EXPECT_THAT(live.lines(0)[0], HasSubstr("(hold)"));
}

TEST(Live, LinesThatAreNotWhatIsExpectedDoNoHarm) {
  Live live({"tello1"}, false, 0);
  for (const char* line :
       {"", "hello", "[]", "{}", R"({"agent":3})", R"({"agent":{"drones":{}}})", R"({"agent":{"drones":[1]}})",
        R"({"agent":{"drones":[{"name":7}]}})",
        R"({"agent":{"height":"x","drones":[{"name":"tello1","position":["a",null,{}],"state_age_ms":"old"}]}})"}) {
    live.on_status(line);
  }
  EXPECT_THAT(live.lines(0)[0], HasSubstr("waiting"));
  EXPECT_FALSE(live.anything_in_air());
}

}  // namespace
}  // namespace ledgerline::launcher
