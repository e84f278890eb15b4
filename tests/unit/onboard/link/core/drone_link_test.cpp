#include "onboard/link/core/drone_link.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/onboard/link/core/playout/plans.hpp"

namespace ledgerline::link {
namespace {

/// One drone that obeys at once, and shows it in the next step.
class DroneLinkTest : public ::testing::Test {
 protected:
  LinkMoment at(bool healthy = true, bool stop_all = false) {
    return {.now = now, .healthy = healthy, .stop_all = stop_all, .out = out};
  }
  void step(bool healthy = true, bool stop_all = false) {
    now += ms;
    out.clear();
    drone.on_bytes(now, Port::state, height_m > 0.2 ? "h:100;tof:100;bat:90;" : "h:0;tof:10;bat:90;");
    drone.on_pose(now, {.drone = 1, .stamp_ns = now, .position_m = {0, 0, height_m}, .velocity_mps = {}, .yaw_rad = 0});
    for (; oks > 0; --oks) drone.on_bytes(now, Port::answer, "ok");
    AgentHeartbeat heartbeat;
    heartbeat.stamp_ns = now;
    heartbeat.ledger_alive = true;
    drone.on_heartbeat(heartbeat);
    drone.step(at(healthy, stop_all));
    for (const ToSend& message : out.to_send) hear(message.command.view());
  }
  void pass(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) step();
  }
  void hear(std::string_view text) {
    if (text == "takeoff" && refuses) {
      heard.emplace_back(text);
      return;
    }
    if (text == "takeoff") height_m = 1;
    if (text == "land" || text == "emergency") height_m = 0;
    if (text.substr(0, 2) != "rc") ++oks;
    heard.emplace_back(text);
  }
  PlanCounters give(PlanAction action, bool healthy = true) {
    Plan plan = plan_of(++sequence, now, action == PlanAction::fly ? 10 : 0, 0.5F, now);
    plan.action = action;
    drone.on_plan(at(healthy), plan);
    return drone.report().plans;
  }
  void take_off() {
    pass(ns_per_s);
    give(PlanAction::takeoff);
    pass(ns_per_s);
    ASSERT_EQ(drone.session().phase(), LinkPhase::flying);
  }

  LinkSettings settings;
  DroneLink drone{{"tello1", 1}, settings, 42, false};
  LinkOutputs out;
  TimeNs now = 1000 * ns_per_s;
  double height_m = 0;
  bool refuses = false;  ///< to take off
  int oks = 0;           ///< answers that are on their way
  std::uint64_t sequence = 0;
  std::vector<std::string> heard;
};

std::uint32_t dropped(const PlanCounters& plans, DropReason reason) {
  return plans.dropped_by[static_cast<std::size_t>(reason)];
}

TEST_F(DroneLinkTest, EachPlanEndsOnceAsAppliedLateOrDropped) {
  pass(ns_per_s);
  EXPECT_EQ(dropped(give(PlanAction::fly), DropReason::not_flying), 1U) << "on the ground";
  EXPECT_EQ(give(PlanAction::takeoff).applied, 1U);
  pass(ns_per_s);
  EXPECT_EQ(give(PlanAction::takeoff).applied, 2U) << "met already";
  give(PlanAction::fly);
  pass(5 * ms);
  EXPECT_EQ(drone.report().plans.applied, 3U);
  EXPECT_EQ(give(PlanAction::land).applied, 4U);
  drone.finish();
  const PlanCounters plans = drone.report().plans;
  EXPECT_EQ(plans.received, 5U);
  EXPECT_EQ(plans.received, plans.applied + plans.late + plans.dropped);
}

TEST_F(DroneLinkTest, ATakeOffThatTheDroneRefusesIsSaidInItsWordsForTenSecondsAndMayBeTriedAgain) {
  pass(ns_per_s);
  refuses = true;
  give(PlanAction::takeoff);
  step();
  drone.on_bytes(now, Port::answer, "error No valid imu");
  step();
  ASSERT_EQ(out.words.size(), 1U);
  EXPECT_EQ(out.words[0].kind, DroneWords::Kind::takeoff_refused);
  EXPECT_EQ(out.words[0].text.view(), "error No valid imu");
  const auto cause = [&] {
    out.states.clear();
    drone.sample(at());
    return out.states[0].cause;
  };
  EXPECT_EQ(cause(), FailsafeCause::takeoff_refused_by_drone);
  step();
  EXPECT_EQ(out.words.size(), 0U) << "once";
  pass(9 * ns_per_s);
  EXPECT_EQ(cause(), FailsafeCause::takeoff_refused_by_drone);
  pass(ns_per_s);
  EXPECT_EQ(cause(), FailsafeCause::none);
  give(PlanAction::takeoff);
  step();
  drone.on_bytes(now, Port::answer, "error No valid imu");
  pass(settings.session.refused_pause_ns + ms);
  refuses = false;
  give(PlanAction::takeoff);
  pass(ns_per_s);
  EXPECT_EQ(drone.session().phase(), LinkPhase::flying);
}

TEST_F(DroneLinkTest, AStopLandsAndATakeOffFromAnOlderStateIsTooOld) {
  take_off();
  Plan again = plan_of(0, 0, 0, 0, now);
  again.action = PlanAction::takeoff;
  pass(10 * ms);
  EXPECT_EQ(give(PlanAction::stop).applied, 2U);
  step();
  EXPECT_EQ(drone.mode(), FailsafeMode::land);
  EXPECT_EQ(heard.back(), "land");
  pass(2 * ns_per_s);
  ASSERT_FALSE(drone.session().is_possibly_in_flight());
  again.sequence = ++sequence;
  drone.on_plan(at(), again);
  EXPECT_EQ(dropped(drone.report().plans, DropReason::too_old), 1U);
  EXPECT_EQ(dropped(give(PlanAction::takeoff), DropReason::too_old), 1U) << "from the moment of the stop";
}

TEST_F(DroneLinkTest, WithoutAHealthyLinkNoPlanIsTakenAndOneZeroIsSent) {
  take_off();
  give(PlanAction::fly);
  pass(100 * ms);
  EXPECT_NE(heard.back(), "rc 0 0 0 0");
  step(false);
  EXPECT_EQ(heard.back(), "rc 0 0 0 0");
  const std::size_t until_now = heard.size();
  EXPECT_EQ(dropped(give(PlanAction::fly, false), DropReason::not_flying), 1U);
  for (int i = 0; i < 200; ++i) step(false);
  EXPECT_EQ(heard.size(), until_now) << "silence, so that the Tello lands by itself";
}

TEST_F(DroneLinkTest, TheLocalStopKeyLandsIt) {
  take_off();
  step(true, true);
  EXPECT_EQ(drone.mode(), FailsafeMode::land);
  EXPECT_EQ(heard.back(), "land");
}

TEST_F(DroneLinkTest, APoseOfTheFutureOrThePastIsNotTaken) {
  step();
  const TimeNs stamp = now;
  drone.on_pose(now, {.drone = 1, .stamp_ns = now + ms, .position_m = {5, 0, 0}, .velocity_mps = {}, .yaw_rad = 0});
  drone.on_pose(now, {.drone = 1, .stamp_ns = now - ms, .position_m = {5, 0, 0}, .velocity_mps = {}, .yaw_rad = 0});
  drone.sample(at());
  ASSERT_EQ(out.states.size(), 1U);
  EXPECT_EQ(out.states[0].pose_stamp_ns, stamp);
  EXPECT_EQ(out.states[0].position_m[0], 0);
}

}  // namespace
}  // namespace ledgerline::link
