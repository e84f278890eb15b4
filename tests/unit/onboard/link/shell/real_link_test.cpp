#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/base/file.hpp"
#include "onboard/ipc/ipc.hpp"
#include "tests/unit/child.hpp"
#include "tests/unit/onboard/link/shell/stand_in_agent.hpp"

/// The real ledgerline-link flies the real ledgerline-sim, over UDP, or ledgerline hil's drones through the shim, if
/// that is the second program; this test stands in for agent. Runs in a namespace of its own (in_namespace.sh);
/// arguments: roudi, sim, link, and but with sanitizers loop_watch, which proves meanwhile that link's loop allocates,
/// locks and throws nothing and makes no system call but the allowed ones. Made-up poses are enough to fly, since
/// nothing here steers by position.
namespace ledgerline::ipc {
namespace {

std::string roudi_program, sim_program, link_program, loop_watch;

class RealLink : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(roudi.start({roudi_program}));
    std::vector<std::string> drones{sim_program, "--drones", "2", "--summary", "/tmp/sim.json"};
    if (through_shim()) drones.insert(drones.begin() + 1, {"hil", "shim", "--memory", "/dev/shm/real_link_test"});
    ASSERT_TRUE(sim.start(drones));
    if (through_shim()) {
      ASSERT_TRUE(wait_for_file("/dev/shm/real_link_test"));
    }
    const std::string transport =
        through_shim() ? "[tello]\ntransport = \"shim\"\n[shim]\nmemory = \"/dev/shm/real_link_test\"\n" : "";
    std::ofstream("/tmp/link.toml") << transport +
                                           "[[drone]]\nname = \"tello1\"\naddress = \"127.0.0.2\"\n"
                                           "[[drone]]\nname = \"tello2\"\naddress = \"127.0.0.3\"\n"
                                           "[[drone]]\nname = \"nobody\"\naddress = \"127.0.0.9\"\n"
                                           "[state]\nlisten = \"127.0.0.1:8890\"\n"
                                           "[failsafe]\nland_after_s = 1.0\n"
                                           "[output]\ntrace = \"/tmp/link.trace\"\nsummary = \"/tmp/link.json\"\n"
                                           "local_stops = \"/tmp/link.stops\"\n";
    std::ofstream("/tmp/link.stops") << "damaged";
    ASSERT_TRUE(connect("stand-in-agent"));
    auto end = AgentEnd::create();
    ASSERT_TRUE(end);
    agent = std::move(*end);
    std::vector<std::string> command{link_program, "--config", "/tmp/link.toml"};
    if (!loop_watch.empty())
      command.insert(command.begin(), {"/usr/bin/env", "LD_PRELOAD=" + loop_watch, "LOOP_WATCH_REPORT=/tmp/watch.txt",
                                       through_shim() ? "LOOP_WATCH_SHIM=1" : "LOOP_WATCH_UDP=1"});
    ASSERT_TRUE(link.start(command));
  }

  static bool through_shim() { return sim_program.ends_with("ledgerline-fault"); }
  static bool wait_for_file(const std::string& path) {
    for (int i = 0; i < 1000 && !std::ifstream(path); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return std::ifstream(path).good();
  }

  /// Does agent's run_periodic_tasks until `reached`, or says false after `bound`.
  bool run_until(TimeNs bound, const std::function<bool()>& reached) {
    for (const TimeNs end = monotonic_ns() + bound; monotonic_ns() < end;) {
      if (lives) heartbeat_and_pose(*agent, heartbeat, 2);
      take_states(*agent, newest);
      if (lives) take_transitions();
      if (reached()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }
  void take_transitions() {
    for (Transition t; agent->receive_transition(t);) {
      auto& drone = transitions[t.drone];
      if (t.number != drone.size() + 1) continue;
      drone.push_back(t);
      heartbeat.boot_id = t.boot_id;
      heartbeat.transitions_taken[t.drone] = heartbeat.transitions_on_ledger[t.drone] = t.number;
    }
  }
  bool all(LinkPhase phase) const { return newest[1].phase == phase && newest[2].phase == phase; }
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
  /// To the port of state texts, from an address that is no drone's.
  static void shout(int times) {
    const int fd = ::socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(8890);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    for (int i = 0; i < times; ++i)
      (void)!::sendto(fd, "bat:1;", 6, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    ::close(fd);
  }
  static nlohmann::json read(const std::string& path) { return nlohmann::json::parse(std::ifstream(path)); }

  Child roudi, sim, link;
  std::unique_ptr<AgentEnd> agent;
  bool lives = true;
  std::uint64_t sequence = 0;
  std::uint64_t commands = 0;
  std::array<StateSample, 4> newest{};
  AgentHeartbeat heartbeat;
  std::array<std::vector<Transition>, 4> transitions;
};

// A drone whose link died flies on by the newest rc, for as long as 15 s.
TEST(StartingLink, StopsItsDronesBeforeItNeedsFilesOrRouDi) {
  if (sim_program.ends_with("ledgerline-fault")) GTEST_SKIP() << "over UDP alone";
  const int drone = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(8889);
  ::inet_pton(AF_INET, "127.0.0.2", &address.sin_addr);
  ASSERT_EQ(::bind(drone, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  using Texts = std::vector<std::string>;
  const auto reported = [&](const std::string& output) {
    std::ofstream("/tmp/link.toml") << "[[drone]]\nname = \"tello1\"\naddress = \"127.0.0.2\"\n"
                                       "[state]\nlisten = \"127.0.0.1:8890\"\n[output]\n"
                                    << output;
    Child starting;
    EXPECT_FALSE(starting.start({link_program, "--config", "/tmp/link.toml"}));
    EXPECT_EQ(WEXITSTATUS(starting.wait()), 1);
    Texts texts;
    std::array<char, 64> text{};
    for (ssize_t size = 0; (size = ::recv(drone, text.data(), text.size(), 0)) > 0;)
      texts.emplace_back(text.data(), static_cast<std::size_t>(size));
    return texts;
  };
  // Started for ever, it must not keep a drone in the air for ever.
  const Texts stops{"command", "rc 0 0 0 0"}, lands{"command", "rc 0 0 0 0", "land"};
  EXPECT_EQ(reported("trace = \"/nowhere/link.trace\"\n"), lands) << "without the folder; nobody remembers its starts";
  for (int starts = 1; starts < 7; ++starts)
    EXPECT_EQ(reported("starts = \"/tmp/link.starts\"\n"), stops) << "no RouDi";
  EXPECT_EQ(reported("starts = \"/tmp/link.starts\"\n"), lands) << "the seventh within 15 s";
  ::close(drone);
}

// One process may connect to RouDi once, so one flight shows it all.
TEST_F(RealLink, HandshakeTakeOffPlansSilenceAndASecondFlightThatLosesRoudiAndThatSigtermEnds) {
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] { return all(LinkPhase::on_ground) && newest[1].sdk_state_fresh; }));
  EXPECT_NE(newest[1].boot_id, 0U);
  EXPECT_GT(newest[1].battery, 0.9F);

  // Nobody knows who was stopped, so all are, until somebody at this host clears it.
  const auto both = [&](FailsafeCause cause) { return newest[1].cause == cause && newest[2].cause == cause; };
  EXPECT_TRUE(both(FailsafeCause::stopped));
  command(PlanAction::takeoff);
  EXPECT_FALSE(run_until(ns_per_s, [&] { return !all(LinkPhase::on_ground); }));
  link.signal(SIGUSR1);
  ASSERT_TRUE(run_until(5 * ns_per_s, [&] { return both(FailsafeCause::none); }));
  EXPECT_EQ(read_file("/tmp/link.stops")->find("tello"), std::string::npos);

  ASSERT_TRUE(run_until(30 * ns_per_s, [&, asked = TimeNs{0}]() mutable {
    if (!all(LinkPhase::flying) && monotonic_ns() - asked > 100 * ns_per_ms) {
      asked = monotonic_ns();
      command(PlanAction::takeoff);
    }
    return all(LinkPhase::flying);
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
  for (int i = 0; i < 40; ++i) command(PlanAction::fly, 0.3F);
  if (!through_shim()) shout(200);
  run_until(ns_per_s / 5, [] { return false; });

  // agent falls silent: zero, then down.
  lives = false;
  agent.reset();
  auto again = AgentEnd::create();
  ASSERT_TRUE(again);
  agent = std::move(*again);
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] { return all(LinkPhase::landed); }));
  EXPECT_EQ(newest[1].sent_velocity_mps[0], 0);
  EXPECT_EQ(newest[1].phase, LinkPhase::landed);

  // What the failsafe did meanwhile is reported when agent is back.
  lives = true;
  run_until(ns_per_s, [] { return false; });
  for (const auto& drone : {transitions[1], transitions[2]}) {
    const auto silent = std::count_if(drone.begin(), drone.end(), [](const Transition& t) {
      return t.mode == FailsafeMode::hold && t.cause == FailsafeCause::agent_silent;
    });
    EXPECT_EQ(silent, 1);
    ASSERT_FALSE(drone.empty());
    EXPECT_EQ(drone.back().phase, LinkPhase::landed);
  }
  command(PlanAction::takeoff);
  ASSERT_TRUE(run_until(20 * ns_per_s, [&] { return all(LinkPhase::flying); }));
  // Without RouDi they fly on.
  roudi.end(SIGKILL);
  EXPECT_FALSE(run_until(3 * ns_per_s, [&, turn = 0]() mutable {
    if (turn++ % 3 == 0) command(PlanAction::fly);
    return !all(LinkPhase::flying);
  }));
  link.signal(SIGTERM);
  EXPECT_EQ(link.wait(), 0);
  EXPECT_EQ(sim.end(SIGTERM), 0);

  // Who was landed so stays down, for whichever link comes next.
  const std::string stops = *read_file("/tmp/link.stops");
  EXPECT_NE(stops.find("\ntello1\ntello2\n"), std::string::npos) << stops;
  struct stat info {};
  ASSERT_EQ(::stat("/tmp/link.stops", &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);

  const nlohmann::json sim_summary = read("/tmp/sim.json");
  const nlohmann::json link_summary = read("/tmp/link.json");
  for (const auto& drone : sim_summary["drones"]) EXPECT_TRUE(drone["landed"]) << drone;
  std::uint64_t received = 0;
  for (const auto& drone : link_summary["drones"]) {
    const bool flew = drone["name"] != "nobody";
    EXPECT_EQ(drone["landed"], flew) << drone;
    EXPECT_EQ(drone["commands_received"].get<int>(), drone["commands_applied"].get<int>() +
                                                         drone["commands_late"].get<int>() +
                                                         drone["commands_dropped"].get<int>());
    EXPECT_EQ(drone["states_lost"], 0);
    EXPECT_GT(drone["transitions"]["on_ledger"], flew ? 6 : -1) << drone;
    EXPECT_EQ(drone["transitions"]["lost"], 0);
    received += drone["commands_received"].get<std::uint64_t>();
  }
  EXPECT_EQ(received, commands);

  const auto cycles = link_summary["loop"]["cycles"].get<std::uint64_t>();
  EXPECT_GT(cycles, 1000U);
  if (!loop_watch.empty()) {
    // Every turn was watched, and none did what it must not.
    const auto report = read_file("/tmp/watch.txt");
    ASSERT_TRUE(report) << report.error().message;
    EXPECT_EQ(*report, "turns " + std::to_string(cycles) + "\n");
  }
  const nlohmann::json& lateness_us = link_summary["loop"]["lateness_us"];
  EXPECT_LE(lateness_us["p50"], lateness_us["p99_9"]);
  EXPECT_LE(lateness_us["p99_9"], lateness_us["max"]);
}

}  // namespace
}  // namespace ledgerline::ipc

int main(int argc, char** argv) {
  using namespace ledgerline::ipc;
  return run_with_programs(argc, argv, {&roudi_program, &sim_program, &link_program, &loop_watch}, 1);
}
