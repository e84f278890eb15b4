#include "hil/shim/scripted_agent.hpp"

#include <gtest/gtest.h>

namespace ledgerline::hil::shim {
namespace {

TEST(ShimPlanScript, ReadsWhatAgentSays) {
  const auto script = parse_plan_script(R"(
drones = 2
[[say]]
at_s = 1
for_s = 4
what = "takeoff"
[[say]]
at_s = 8
for_s = 2.5
drone = "tello2"
velocity_mps = [0.5, 0, -0.1]
yaw_rate_radps = 0.2
[[silence]]
at_s = 9
for_s = 0.3
[[fault]]
at_s = 2
for_s = 1
do = "sdk * answers late 200ms"
)",
                                        "plans.toml");
  ASSERT_TRUE(script) << script.error().message;
  ASSERT_EQ(script->says.size(), 2U);
  EXPECT_EQ(script->says[0].drone, 0);
  EXPECT_EQ(script->says[0].action, PlanAction::takeoff);
  EXPECT_EQ(script->says[1].drone, 2);
  EXPECT_EQ(script->says[1].until_ns, from_seconds(10.5));
  EXPECT_FLOAT_EQ(script->says[1].velocity_mps[2], -0.1F);
  ASSERT_EQ(script->silences.size(), 1U);
  EXPECT_EQ(script->faults.size(), 1U);
  EXPECT_EQ(script->end_ns, from_seconds(15.5));
}

TEST(ShimPlanScript, NamesThePlaceOfEverythingThatIsWrong) {
  const auto script = parse_plan_script(R"(drones = 1
[[say]]
at_s = 1
drone = "tello2"
velocity_mps = [11, 0, 0]
[[silence]]
at_s = 1
[[fault]]
at_s = 2
do = "drone tello1 video loss 5%"
[[fault]]
at_s = 2
do = "server agent cut"
speed = 3
)",
                                        "plans.toml");
  ASSERT_FALSE(script);
  const std::string& what = script.error().message;
  for (const char* expected :
       {"plans.toml:4: say.0.drone", "plans.toml:5: say.0.velocity_mps", "silence.0.for_s", "plans.toml:10: fault.0.do",
        "plans.toml:13: fault.1.do", "plans.toml:14: fault.1.speed"})
    EXPECT_NE(what.find(expected), std::string::npos) << expected << " in\n" << what;
  EXPECT_FALSE(parse_plan_script("", "empty.toml")) << "nobody says anything";
}

}  // namespace
}  // namespace ledgerline::hil::shim
