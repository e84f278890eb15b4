#include "hil/fault/run/run.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace ledgerline::hil {
namespace {

/// One drone that stands 0.5 m above the ground, and a script that must end within a second.
struct Recorded {
  Recorded() {
    script.name = "stands";
    script.must.push_back(*parse_rule("ends within 1 s"));
    drones.resize(1);
    drones[0].name = "tello1";
    drones[0].truth.position_m = {0.25, 0, 0.5};
  }
  void pass(RunRecorder& recorder, TimeNs until) {
    for (; moment.now < until; moment.now += ns_per_ms) {
      moment.drones = drones;
      moment.events = events;
      recorder.observe(moment);
      events.clear();
    }
  }

  Script script;
  std::vector<DroneObservation> drones;
  std::vector<WorldEvent> events;
  Moment moment;
};

TEST(RunRecorder, KeepsAPointOfEachDroneEveryFiftyMilliseconds) {
  Recorded run;
  RunRecorder recorder(run.script, 7, run.drones);
  run.pass(recorder, ns_per_s);
  const RunResult result = recorder.finish({.now = run.moment.now, .over = true, .ok = true});
  EXPECT_EQ(result.script, "stands");
  EXPECT_EQ(result.seed, 7U);
  ASSERT_EQ(result.timeline.size(), 1U);
  ASSERT_EQ(result.timeline[0].size(), 20U);
  EXPECT_EQ(result.timeline[0][1].t_ns - result.timeline[0][0].t_ns, timeline_period_ns);
  EXPECT_FLOAT_EQ(result.timeline[0][1].at_m[0], 0.25F);
}

TEST(RunRecorder, TheLimitsLeaveRoomForTheErrorOfOnboardOdometryAndNoMore) {
  const auto max_m = [](const char* pose, const char* fault) {
    const auto script =
        parse_script(fmt::format("title = \"t\"\n[flight]\npose = \"{}\"\npads = \"1:0:0\"\nlimit = \"20 s\"\n"
                                 "[[fault]]\nwhat = \"{}\"\nfor = \"4s\"\n",
                                 pose, fault),
                     "t.toml");
    EXPECT_TRUE(script.ok()) << fault;
    return limits_of(*script, std::vector<DroneObservation>(1)).max_m[0];
  };
  const double usual_m = max_m("tello", "agent stop");
  EXPECT_DOUBLE_EQ(usual_m, max_m("mocap", "agent stop"));
  EXPECT_NEAR(max_m("tello", "drone * flow bias 0.3 0.4") - usual_m, 4 * 0.5, 1e-9);
  EXPECT_NEAR(max_m("tello", "drone * baro drift -0.1") - usual_m, 4 * 0.1, 1e-9);
  EXPECT_NEAR(max_m("tello", "sensor * yaw bias 30") - usual_m, 4 * 2, 1e-9);
  for (const char* none : {"sensor * bat stuck", "drone * tof nothing", "pads gone", "drone * flow lost"})
    EXPECT_DOUBLE_EQ(max_m("tello", none), usual_m) << none;
  // Motion capture sees it.
  for (const char* seen : {"drone * flow bias 0.3 0.4", "drone * flow lost", "sensor * yaw bias 30"})
    EXPECT_DOUBLE_EQ(max_m("mocap", seen), usual_m) << seen;
}

TEST(RunRecorder, KeepsEventsButThoseOfEachPlanAndSaysTheModeInWords) {
  Recorded run;
  RunRecorder recorder(run.script, 1, run.drones);
  run.drones[0].phase = LinkPhase::flying;
  run.drones[0].mode = FailsafeMode::hold;
  run.drones[0].cause = FailsafeCause::pose_lost;
  run.events = {{1, WorldEvent::Kind::applied, 0, 0.1, {}, 5},
                {2, WorldEvent::Kind::handed, 0, 0, {}, 5},
                {3, WorldEvent::Kind::mode, 0, 0, {}, 0},
                {4, WorldEvent::Kind::mode, 0, 0, "as commanded", 0}};
  run.pass(recorder, ns_per_ms);
  run.drones[0].mode = FailsafeMode::none;
  run.drones[0].cause = FailsafeCause::none;
  run.events = {{5, WorldEvent::Kind::mode, 0, 0, {}, 0}};
  run.pass(recorder, 2 * ns_per_ms);
  const RunResult result = recorder.finish({.now = run.moment.now, .over = true, .ok = true});
  ASSERT_EQ(result.events.size(), 3U);
  EXPECT_EQ(result.events[0].text, "flying, hold (pose_lost)");
  EXPECT_EQ(result.events[1].text, "as commanded");
  EXPECT_EQ(result.events[2].text, "flying");
}

TEST(RunRecorder, KeepsNoMoreEventsThanItMay) {
  Recorded run;
  RunRecorder recorder(run.script, 1, run.drones);
  for (std::size_t i = 0; i < max_events + 10; ++i) run.events.push_back({1, WorldEvent::Kind::sent, 0, 0, "land", 0});
  run.pass(recorder, ns_per_ms);
  EXPECT_EQ(recorder.finish({.now = run.moment.now}).events.size(), max_events);
}

TEST(RunRecorder, HasTheRunChecked) {
  Recorded run;
  RunRecorder recorder(run.script, 1, run.drones);
  run.pass(recorder, 2 * ns_per_s);
  Ending ending{.now = run.moment.now, .over = true, .ok = true};
  ending.in_the_air = in_the_air(run.drones);
  const RunResult result = recorder.finish(ending);
  EXPECT_FALSE(result.all_held());
  EXPECT_FALSE(result.verdicts[0].held) << "it took two seconds";
  EXPECT_EQ(ending.in_the_air, std::vector<std::string>{"tello1"});
}

}  // namespace
}  // namespace ledgerline::hil
