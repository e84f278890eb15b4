#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "common/base/file.hpp"
#include "common/rt/clock.hpp"
#include "onboard/ipc/ipc.hpp"
#include "tests/unit/child.hpp"
#include "tests/unit/onboard/link/shell/stand_in_agent.hpp"

/// Two plain Tellos, as they come out of the box: each with a Wi-Fi of its own, and both at 192.168.10.1. One link
/// flies both, each behind its interface; a third drone is not the one that the config means. Runs in a namespace of
/// its own (in_namespace.sh); arguments: roudi, sim, link. The drones are in network namespaces behind veth pairs,
/// which are the adapters wlan1 to wlan3 here. Poses are made up.
namespace ledgerline::ipc {
namespace {

std::string roudi_program, sim_program, link_program;
constexpr DroneNumber drones = 3;

bool shell(const std::string& command) { return std::system(command.c_str()) == 0; }  // NOLINT: a test's own words

class TwoInterfaces : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(roudi.start({roudi_program}));
    std::string config;
    for (int k = 1; k <= drones; ++k) {
      const std::string adapter = "wlan" + std::to_string(k);
      ASSERT_TRUE(
          air[k].start({"/usr/bin/env", "unshare", "-n", "sh", "-c", "echo '\"ready\":true'; exec sleep 1000"}));
      ASSERT_TRUE(plug_in(k));
      const std::string space = std::to_string(air[k].pid());
      std::vector<std::string> drone{"/usr/bin/env", "nsenter", "-n", "-t", space};
      for (const std::string& word : {sim_program, std::string("--address"), std::string("192.168.10.1"),
                                      std::string("--mocap-hz"), std::string("0"), std::string("--first-serial"),
                                      std::to_string(k), std::string("--summary"), "/tmp/sim" + std::to_string(k)})
        drone.push_back(word);
      ASSERT_TRUE(sim[k].start(drone));
      const int wanted = k < drones ? k : 77;
      config += "[[drone]]\nname = \"tello" + std::to_string(k) + "\"\naddress = \"192.168.10.1\"\ninterface = \"" +
                adapter + "\"\nserial = \"0TQDG00SIM00" + (wanted < 10 ? "0" : "") + std::to_string(wanted) + "\"\n";
    }
    config += "[fence]\nmin_m = [-20, -20, 0]\nmax_m = [20, 20, 3]\n";
    std::ofstream("/tmp/link.toml") << config << "[output]\nsummary = \"/tmp/link.json\"\n";
    ASSERT_TRUE(connect("stand-in-agent"));
    auto end = AgentEnd::create();
    ASSERT_TRUE(end);
    agent = std::move(*end);
    ASSERT_TRUE(link.start({"/bin/sh", "-c", "exec " + link_program + " --config /tmp/link.toml 2>/tmp/link.log"}));
  }

  /// The adapter, and behind it the drone.
  bool plug_in(int k) {
    const std::string adapter = "wlan" + std::to_string(k), space = std::to_string(air[k].pid());
    return shell("ip link add " + adapter + " type veth peer name eth0 netns " + space) &&
           shell("ip address add 192.168.10.2/24 dev " + adapter + " && ip link set " + adapter + " up") &&
           shell("nsenter -n -t " + space +
                 " sh -c 'ip link set lo up; ip address add 192.168.10.1/24 dev eth0; ip link set eth0 up'");
  }

  /// Does agent's run_periodic_tasks until `reached`, or says false after `bound`.
  bool run_until(TimeNs bound, const std::function<bool()>& reached) {
    for (const TimeNs end = monotonic_ns() + bound; monotonic_ns() < end;) {
      heartbeat_and_pose(*agent, {}, drones);
      take_states(*agent, newest);
      if (reached()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }
  void command(DroneNumber drone, PlanAction action) {
    Plan plan;
    plan.drone = drone;
    plan.action = action;
    plan.epoch = 1;
    plan.sequence = ++sequence;
    plan.state_stamp_ns = newest[drone].stamp_ns;
    (void)agent->send_plan(plan);
  }
  static std::string log() { return read_file("/tmp/link.log").value(); }

  Child roudi, link;
  std::array<Child, drones + 1> air, sim;
  std::unique_ptr<AgentEnd> agent;
  std::array<StateSample, drones + 1> newest{};
  std::uint64_t sequence = 0;
};

// One process may connect to RouDi once, so one flight shows it all.
TEST_F(TwoInterfaces, TwoDronesAtOneAddressFlyAndOneWithAnotherSerialStaysDown) {
  const auto all = [&](LinkPhase phase) { return newest[1].phase == phase && newest[2].phase == phase; };
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] {
    return all(LinkPhase::on_ground) && newest[3].phase == LinkPhase::on_ground && newest[3].sdk_state_fresh;
  })) << log();
  ASSERT_TRUE(run_until(5 * ns_per_s, [&] { return log().find("0TQDG00SIM0003 answers") != std::string::npos; }))
      << log();

  // An adapter that is pulled out and plugged in again is another one by the same name.
  ASSERT_TRUE(shell("ip link delete wlan1"));
  ASSERT_TRUE(run_until(5 * ns_per_s, [&] { return !newest[1].sdk_state_fresh; }));
  ASSERT_TRUE(plug_in(1));
  ASSERT_TRUE(run_until(15 * ns_per_s, [&] {
    return newest[1].phase == LinkPhase::on_ground && newest[1].sdk_state_fresh;
  })) << log();
  EXPECT_TRUE(all(LinkPhase::on_ground));

  // The first alone: nothing that is said to it, and nothing that it says, is the other's.
  const auto take_off = [&](DroneNumber drone) {
    return run_until(30 * ns_per_s, [&, asked = TimeNs{0}]() mutable {
      if (newest[drone].phase == LinkPhase::on_ground && monotonic_ns() - asked > 100 * ns_per_ms) {
        asked = monotonic_ns();
        command(drone, PlanAction::takeoff);
      }
      return newest[drone].phase == LinkPhase::flying && newest[drone].height_m > 0.5F;
    });
  };
  ASSERT_TRUE(take_off(1)) << log();
  EXPECT_EQ(newest[2].phase, LinkPhase::on_ground);
  EXPECT_EQ(newest[2].height_m, 0);
  ASSERT_TRUE(take_off(2)) << log();
  EXPECT_GT(newest[1].height_m, 0.5F);

  for (int i = 0; i < 10; ++i) {
    command(3, PlanAction::takeoff);
    run_until(100 * ns_per_ms, [] { return false; });
  }
  EXPECT_EQ(newest[3].phase, LinkPhase::on_ground);

  link.signal(SIGTERM);
  EXPECT_EQ(link.wait(), 0) << log();
  for (int k = 1; k <= drones; ++k) {
    EXPECT_EQ(sim[k].end(SIGTERM), 0);
    const auto summary = nlohmann::json::parse(std::ifstream("/tmp/sim" + std::to_string(k)));
    EXPECT_EQ(summary["drones"][0]["landed"], k < drones) << summary;
  }
  const auto summary = nlohmann::json::parse(std::ifstream("/tmp/link.json"));
  for (const auto& drone : summary["drones"]) EXPECT_EQ(drone["landed"], drone["name"] != "tello3") << drone;
}

}  // namespace
}  // namespace ledgerline::ipc

int main(int argc, char** argv) {
  using namespace ledgerline::ipc;
  return run_with_programs(argc, argv, {&roudi_program, &sim_program, &link_program});
}
