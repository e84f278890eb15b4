#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "onboard/ipc/ipc.hpp"
#include "tests/unit/child.hpp"

/// The real ledgerline-link flies the real ledgerline-sim; this test stands in for agent. Runs in a namespace of its
/// own (in_namespace.sh); arguments: roudi, sim, link. Virtual poses: the drone believes to stand still at the origin,
/// which is enough to fly, since nothing here steers by position.
namespace ledgerline::ipc {
namespace {

std::string roudi_program, sim_program, link_program;

class RealLink : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(roudi.start({roudi_program}));
    ASSERT_TRUE(sim.start({sim_program, "--drones", "2", "--summary", "/tmp/sim.json"}));
    std::ofstream("/tmp/link.toml") << "[[drone]]\nname = \"tello1\"\naddress = \"127.0.0.2\"\n"
                                       "[[drone]]\nname = \"tello2\"\naddress = \"127.0.0.3\"\n"
                                       "[state]\nlisten = \"127.0.0.1:8890\"\n"
                                       "[failsafe]\nland_after_s = 1.0\n"
                                       "[output]\ntrace = \"/tmp/link.trace\"\nsummary = \"/tmp/link.json\"\n";
    ASSERT_TRUE(connect("stand-in-agent"));
    auto end = AgentEnd::create();
    ASSERT_TRUE(end);
    agent = std::move(*end);
    ASSERT_TRUE(link.start({link_program, "--config", "/tmp/link.toml"}));
  }

  /// Does agent's chores until `reached`, or says false after `bound`.
  bool run_until(TimeNs bound, const std::function<bool()>& reached) {
    for (const TimeNs end = monotonic_ns() + bound; monotonic_ns() < end;) {
      const TimeNs now = monotonic_ns();
      if (lives) {
        (void)agent->send_beat({now, true});
        for (DroneNumber drone = 1; drone <= 2; ++drone) {
          (void)agent->send_pose(
              {.drone = drone, .stamp_ns = now, .position_m = {0, 0, 1}, .velocity_mps = {}, .yaw_rad = 0});
        }
      }
      for (StateSample sample; agent->take_state(sample);) newest[sample.drone] = sample;
      if (reached()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }
  bool all(FlightPhase phase) const { return newest[1].phase == phase && newest[2].phase == phase; }
  void command(PlanAction action, float vx = 0) {
    for (DroneNumber drone = 1; drone <= 2; ++drone) {
      Plan plan;
      plan.drone = drone;
      plan.action = action;
      plan.epoch = 1;
      plan.sequence = ++sequence;
      plan.state_stamp_ns = newest[drone].stamp_ns;
      plan.count = 10;
      for (std::uint32_t i = 0; i < plan.count; ++i) {
        plan.setpoints[i] = {monotonic_ns() + i * 50 * ns_per_ms, {vx, 0, 0}, 0};
      }
      ASSERT_TRUE(agent->send_plan(plan));
      ++commands;
    }
  }
  static nlohmann::json read(const std::string& path) { return nlohmann::json::parse(std::ifstream(path)); }

  Child roudi, sim, link;
  std::unique_ptr<AgentEnd> agent;
  bool lives = true;
  std::uint64_t sequence = 0;
  std::uint64_t commands = 0;
  std::array<StateSample, 3> newest{};
};

// One process may connect to RouDi once, so one flight shows it all.
TEST_F(RealLink, HandshakeTakeOffPlansSilenceAndASecondFlightThatLosesRoudiAndThatSigtermEnds) {
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] { return all(FlightPhase::on_ground) && newest[1].sdk_state_fresh; }));
  EXPECT_NE(newest[1].boot_id, 0U);
  EXPECT_GT(newest[1].battery, 0.9F);

  ASSERT_TRUE(run_until(30 * ns_per_s, [&, asked = TimeNs{0}]() mutable {
    if (!all(FlightPhase::flying) && monotonic_ns() - asked > 100 * ns_per_ms) {
      asked = monotonic_ns();
      command(PlanAction::takeoff);
    }
    return all(FlightPhase::flying);
  }));
  EXPECT_GT(newest[1].height_m, 0.3F);

  int flown = 0;
  run_until(1 * ns_per_s, [&] {
    if (flown++ % 3 == 0) command(PlanAction::fly, 0.3F);
    return false;
  });
  EXPECT_NEAR(newest[1].sent_velocity_mps[0], 0.3, 0.02);
  EXPECT_EQ(newest[1].mode, FailsafeMode::none);
  EXPECT_GT(newest[1].plans_applied, 20U);

  // agent falls silent: zero, then down.
  lives = false;
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] { return all(FlightPhase::landed); }));
  EXPECT_EQ(newest[1].sent_velocity_mps[0], 0);
  EXPECT_EQ(newest[1].phase, FlightPhase::landed);

  lives = true;
  run_until(ns_per_s, [] { return false; });
  command(PlanAction::takeoff);
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] { return all(FlightPhase::flying); }));
  // Without RouDi they fly on.
  roudi.end(SIGKILL);
  EXPECT_FALSE(run_until(3 * ns_per_s, [&, turn = 0]() mutable {
    if (turn++ % 3 == 0) command(PlanAction::fly);
    return !all(FlightPhase::flying);
  }));
  link.signal(SIGTERM);
  EXPECT_EQ(link.wait(), 0);
  EXPECT_EQ(sim.end(SIGTERM), 0);

  const nlohmann::json sim_summary = read("/tmp/sim.json");
  const nlohmann::json link_summary = read("/tmp/link.json");
  for (const auto& drone : sim_summary["drones"]) EXPECT_TRUE(drone["landed"]) << drone;
  std::uint64_t received = 0;
  for (const auto& drone : link_summary["drones"]) {
    EXPECT_TRUE(drone["landed"]);
    EXPECT_EQ(drone["commands_received"].get<int>(), drone["commands_applied"].get<int>() +
                                                         drone["commands_late"].get<int>() +
                                                         drone["commands_dropped"].get<int>());
    EXPECT_EQ(drone["states_lost"], 0);
    received += drone["commands_received"].get<std::uint64_t>();
  }
  EXPECT_EQ(received, commands);
}

}  // namespace
}  // namespace ledgerline::ipc

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc < 4) return 2;
  ledgerline::ipc::roudi_program = argv[1];
  ledgerline::ipc::sim_program = argv[2];
  ledgerline::ipc::link_program = argv[3];
  return RUN_ALL_TESTS();
}
