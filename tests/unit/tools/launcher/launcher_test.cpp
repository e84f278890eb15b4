#include "tools/launcher/launcher.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "tools/launcher/machine.hpp"

namespace ledgerline::launcher {
namespace {

using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

constexpr int timeout_s = 60;  // not a limit on speed: only how long a broken test may take

template <typename Condition>
bool eventually(Condition condition) {
  const TimeNs until_ns = monotonic_ns() + timeout_s * ns_per_s;
  while (!condition()) {
    if (monotonic_ns() > until_ns) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

/// A directory of programs that only look like ours: each says it is ready, notes its pid, and when it is asked to end,
/// notes its name and ends.
class FakePrograms : public testing::Test {
 protected:
  FakePrograms() {
    char name[] = "/tmp/ledgerline-launcher-XXXXXX";
    files.directory = mkdtemp(name);
    for (const char* program : {"roudi", "node", "sim", "link", "agent"}) write(program, stays);
    write("ground", R"(echo '{"ground":{"drones":[{"name":"tello1","phase":"path"}]}}'
sleep 0.2; exit 0)");
    write("control", "exit 0", false);
    // Verbs are asked for by name.
    const std::string command = files.in("ledgerline");
    std::ofstream(command) << "#!/bin/sh\nverb=$1\nshift\nexec " << files.directory << "/ledgerline-$verb \"$@\"\n";
    ::chmod(command.c_str(), 0755);
    // Of the ledger's files fly itself looks for the host's certificate.
    const fs::path host = files.in("ledger/crypto/peerOrganizations/org1.ledgerline/users/User1@org1.ledgerline/msp");
    for (const char* file : {"signcerts/cert.pem", "keystore/key_sk"}) {
      fs::create_directories((host / file).parent_path());
      std::ofstream(host / file) << "x";
    }
  }
  ~FakePrograms() override { fs::remove_all(files.directory); }

  void write(const std::string& program, const std::string& then, bool ready = true) const {
    const std::string path = files.in("ledgerline-" + program);
    const std::string say_ready = ready ? R"(echo '{"ready":true,"endpoint":"127.0.0.1:1"}')" : "";
    std::ofstream(path) << "#!/bin/sh\ncd " << files.directory << "\necho $$ >> pids\necho \"" << program
                        << " $*\" >> started\necho started >&2\n"
                        << "trap 'echo " << program << " >> ended; exit ${code:-0}' TERM\n"
                        << say_ready << "\n"
                        << then << "\n";
    ::chmod(path.c_str(), 0755);
  }
  std::vector<std::string> lines(const std::string& file) const {
    std::ifstream in(files.in(file));
    std::vector<std::string> all;
    for (std::string line; std::getline(in, line);) all.push_back(line);
    return all;
  }
  bool all_gone() const {
    const auto pids = lines("pids");
    return std::all_of(pids.begin(), pids.end(), [](const std::string& pid) { return ::kill(std::stoi(pid), 0) != 0; });
  }
  RunRecord run() {
    Launcher launcher({}, files, files.directory, false, interrupts);
    return launcher.run();
  }
  /// Interrupts once the flight goes on.
  std::thread interrupter(int times) {
    return std::thread([this, times] {
      eventually([&] { return lines("started").size() >= 8; });
      for (int i = 0; i < times; ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        ++interrupts;
      }
    });
  }

  /// What the programs do is shell: once in the first process of that name only, then it stays.
  std::string once(const std::string& program, const std::string& what) const {
    return fmt::format("[ -e {0}.done ] || {{ touch {0}.done; {1}; }}\n{2}", program, what, stays);
  }
  static std::string until_started(const std::string& program, int times) {
    return fmt::format("while [ $(grep -c '^{} ' started) -lt {} ]; do sleep 0.02; done; sleep 0.2; exit 0", program,
                       times);
  }
  std::vector<std::string> started_since_take_off() const {
    std::vector<std::string> names;
    for (const auto& line : lines("started")) {
      const std::string name = line.substr(0, line.find(' '));
      if (name == "take-off") {
        names.clear();
      } else {
        names.push_back(name);
      }
    }
    return names;
  }

  const std::string in_the_air = R"(echo '{"ground":{"drones":[{"name":"tello1","phase":"path"}]}}'
sleep 0.3; echo take-off >> started
)";
  const std::string on_the_ground = R"(echo '{"ground":{"drones":[{"name":"tello1","phase":"landed"}]}}'
)";
  const std::string after_take_off = "while ! grep -q take-off started; do sleep 0.02; done";
  const std::string stays = "while :; do sleep 0.02; done";
  RunFiles files;
  std::atomic<int> interrupts{0};
};

TEST_F(FakePrograms, AGoodFlightStartsAndEndsEverythingInOrder) {
  const RunRecord record = run();
  EXPECT_TRUE(record.ok) << record.why;
  std::vector<std::string> started;
  for (const auto& line : lines("started")) started.push_back(line.substr(0, line.find(' ')));
  std::sort(started.begin(), started.begin() + 3);
  EXPECT_THAT(std::vector<std::string>(started.begin(), started.begin() + 5),
              testing::ElementsAre("node", "roudi", "sim", "control", "control"));
  EXPECT_THAT(lines("ended"), testing::ElementsAre("agent", "link", "sim", "node", "roudi"));
  EXPECT_TRUE(all_gone());
  EXPECT_TRUE(record.cpu_percent.contains("node"));
  EXPECT_GT(record.memory_mb.at("node"), 0);
}

TEST_F(FakePrograms, EnrolsAndAcquiresBeforeAnythingCanFly) {
  (void)run();
  const auto started = lines("started");
  ASSERT_GE(started.size(), 8u);
  EXPECT_THAT(started[3], HasSubstr("control --config " + files.config("admin") + " enroll --msp Org1MSP"));
  EXPECT_THAT(started[4], HasSubstr("control --config " + files.config("operator") + " acquire tello1"));
}

TEST_F(FakePrograms, AnAdministratorWhoIsNotNamedHasNoFile) {
  Options options;
  options.own.emplace().network.emplace().pilot = "[ledger]\n";
  options.own->drones.resize(1);
  options.own->network->agent = options.own->network->ground = "[ledger]\n";
  ASSERT_TRUE(write_configs(files, options, {}));
  EXPECT_TRUE(std::filesystem::exists(files.config("operator")));
  EXPECT_FALSE(std::filesystem::exists(files.config("admin")));
}

TEST_F(FakePrograms, WhatIsSwitchedStandsInTheConfigs) {
  const auto text = [&](const std::string& program) {
    std::ifstream in(files.config(program));
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  ASSERT_TRUE(write_configs(files, {}, {"127.0.0.1:1", {"127.0.0.1:2"}, {}}));
  for (const char* side : {"agent", "ground"}) {
    EXPECT_THAT(text(side), HasSubstr("[[orderer]]\nendpoint = \"127.0.0.1:2\""));
    EXPECT_THAT(text(side), HasSubstr("config_block = \"" + files.in("ledger/teleop.block")));
  }

  Options options;
  options.gateway = true;
  ASSERT_TRUE(write_configs(files, options, {"127.0.0.1:1", {"127.0.0.1:2"}, {}}));
  for (const char* side : {"agent", "ground"}) EXPECT_THAT(text(side), Not(HasSubstr("[[orderer]]")));
}

TEST_F(FakePrograms, GroundChecksMissionsAgainstTheFenceThatLinkHas) {
  Options options;
  options.manual = options.watch = true;
  options.approvals = 2;
  const auto ground = [&] {
    EXPECT_TRUE(write_configs(files, options, {"127.0.0.1:1", {"127.0.0.1:2"}, {}}));
    std::ifstream in(files.config("ground"));
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_THAT(ground(), HasSubstr("approvals = 2\n"));
  EXPECT_THAT(ground(), HasSubstr("fence_min_m = [-20, -20, 0]\nfence_max_m = [20, 20, 3]\n"));
  options.own.emplace();
  options.own->pose_source = "mocap";
  options.own->drones.push_back({"tello1", "192.168.10.1", "", ""});
  options.own->link.fence.min_m = {-2, -1.5, 0};
  options.own->link.fence.max_m = {2, 1.5, 2};
  EXPECT_THAT(ground(), HasSubstr("fence_min_m = [-2, -1.5, 0]\nfence_max_m = [2, 1.5, 2]\n"));
}

TEST_F(FakePrograms, DdsStaysOnThisMachineWhateverTheShellSaysUnlessAFileIsNamed) {
  const auto dds = [&](const std::string& program) {
    std::ifstream in(files.config(program));
    const std::string text(std::istreambuf_iterator<char>(in), {});
    return text.substr(std::min(text.find("[dds]"), text.size()));
  };
  Options options;
  for (const auto& [file, line] :
       {std::pair{"", "local_only = true\n"}, {"/etc/lan.xml", "cyclonedds = \"/etc/lan.xml\"\n"}}) {
    options.cyclonedds = file;
    ASSERT_TRUE(write_configs(files, options, {"127.0.0.1:1", {}, {}}));
    ASSERT_TRUE(write_sim_config(files, options));
    for (const char* program : {"agent", "ground", "sim"}) EXPECT_THAT(dds(program), HasSubstr(line)) << program;
    ASSERT_TRUE(write_local_configs(files, options));
    EXPECT_THAT(dds("local"), HasSubstr(line));
  }
  options.cyclonedds.clear();
  options.ros_release = "jazzy";
  ASSERT_TRUE(write_configs(files, options, {"127.0.0.1:1", {}, {}}));
  for (const char* program : {"agent", "ground"})
    EXPECT_THAT(dds(program), AllOf(HasSubstr("local_only = true\n"), HasSubstr("ros_release = \"jazzy\"\n")));
}

TEST_F(FakePrograms, AProxyStandsBetweenBothHostsAndTheLedgerAndBetweenLinkAndTheDrones) {
  write("hil", "echo '{\"ready\":true,\"servers\":{\"agent\":\"127.0.0.1:11\",\"ground\":\"127.0.0.1:12\"}}'\n" + stays,
        false);
  const auto fly = [&] {
    Options options;
    options.proxy = true;
    options.faults = "faults.toml";
    return Launcher(options, files, files.directory, false, interrupts).run();
  };
  const RunRecord record = fly();
  EXPECT_TRUE(record.ok) << record.why;
  const auto text = [&](const std::string& program) {
    std::ifstream in(files.config(program));
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_THAT(text("agent"), HasSubstr("endpoint = \"127.0.0.1:11\""));
  EXPECT_THAT(text("ground"), HasSubstr("endpoint = \"127.0.0.1:12\""));
  EXPECT_THAT(text("admin"), HasSubstr("endpoint = \"127.0.0.1:1\""));
  EXPECT_THAT(text("link"), HasSubstr("address = \"127.0.1.2\""));
  EXPECT_THAT(text(proxy_name), HasSubstr("listen = \"127.0.1.2\"\naddress = \"127.0.0.2\""));
  const auto started = lines("started");
  ASSERT_GE(started.size(), 9u);
  EXPECT_EQ(started[3], "hil proxy --config " + files.config(proxy_name) + " --script faults.toml");
  EXPECT_THAT(lines("ended"), testing::ElementsAre("agent", "link", "hil", "sim", "node", "roudi"));
  EXPECT_TRUE(all_gone());

  write("hil", stays);
  EXPECT_THAT(fly().why, HasSubstr("the proxy did not say where it listens"));
  write("hil", "echo 'no such fault' >&2; exit 2", false);
  EXPECT_THAT(fly().why, HasSubstr("no such fault"));
}

TEST_F(FakePrograms, SwitchesOfFaultsAreServedWhileItFliesAndGroundLearnsWhere) {
  write("hil", "echo '{\"ready\":true,\"servers\":{\"agent\":\"127.0.0.1:11\",\"ground\":\"127.0.0.1:12\"}}'\n" + stays,
        false);
  write("ground", "test -S " + files.fault_switches() + " || exit 1; sleep 0.2; exit 0");
  Options options;
  options.watch = options.proxy = options.fault_switches = true;
  const RunRecord record = Launcher(options, files, files.directory, false, interrupts).run();
  EXPECT_TRUE(record.ok) << record.why;
  std::ifstream in(files.config("ground"));
  EXPECT_THAT(std::string(std::istreambuf_iterator<char>(in), {}),
              HasSubstr("faults = \"" + files.fault_switches() + "\"\n"));
  EXPECT_FALSE(fs::exists(files.fault_switches()));
}

TEST_F(FakePrograms, OrderersAreBehindTheProxyTooForEachHostByItself) {
  Options options;
  options.proxy = true;
  ASSERT_TRUE(write_proxy_config(files, options, {"127.0.0.1:1", {"127.0.0.1:2", "127.0.0.1:3"}, {}}));
  std::ifstream in(files.config(proxy_name));
  const std::string text(std::istreambuf_iterator<char>(in), {});
  for (const char* server :
       {"agent", "ground", "agent-orderer1", "agent-orderer2", "ground-orderer1", "ground-orderer2"})
    EXPECT_THAT(text, HasSubstr(fmt::format("name = \"{}\"", server)));
  ASSERT_TRUE(write_configs(files, options, {"127.0.0.1:1", {"127.0.0.1:2", "127.0.0.1:3"}, {}},
                            {{"agent", "127.0.0.1:11"}, {"agent-orderer2", "127.0.0.1:13"}}));
  std::ifstream agent(files.config("agent"));
  EXPECT_THAT(std::string(std::istreambuf_iterator<char>(agent), {}),
              AllOf(HasSubstr("127.0.0.1:11"), HasSubstr("127.0.0.1:2"), HasSubstr("127.0.0.1:13")));
}

TEST_F(FakePrograms, ACrashInFlightIsNamedWithItsLastWordsAndEverythingEnds) {
  for (const char* victim : {"agent", "node", "link", "sim"}) {
    SCOPED_TRACE(victim);
    for (const char* program : {"roudi", "node", "sim", "link", "agent"}) write(program, stays);
    write("ground", R"(echo '{"ground":{"drones":[{"name":"tello1","phase":"path"}]}}'
)" + stays);
    write(victim,
          "(while ! grep -q ground started; do sleep 0.02; done); sleep 0.3; echo 'last words' >&2; kill -9 $$");
    fs::remove(files.in("ended"));
    fs::remove(files.in("started"));
    const RunRecord record = run();
    EXPECT_FALSE(record.ok);
    EXPECT_THAT(record.why, HasSubstr(fmt::format("{} was ended by signal 9", victim)));
    EXPECT_THAT(record.why, HasSubstr("last words"));
    ASSERT_FALSE(record.ended_early.empty());
    EXPECT_EQ(record.ended_early[0].first, victim);
    const bool started_again = std::string(victim) == "agent" || std::string(victim) == "link";
    EXPECT_EQ(record.why.find("is given up") != std::string::npos, started_again) << record.why;
    EXPECT_EQ(record.restarts.contains(victim) ? record.restarts.at(victim) : 0, started_again ? 6U : 0U);
    EXPECT_TRUE(all_gone());
    const auto ended = lines("ended");
    ASSERT_FALSE(ended.empty());
    const bool link_can_land = std::string(victim) != "link" && std::string(victim) != "sim";
    if (!link_can_land) continue;
    EXPECT_EQ(ended[0], "link") << "where the way through the ledger is broken, link lands first";
  }
}

TEST_F(FakePrograms, AgentAndLinkThatDieInFlightAreStartedAgainAndTheFlightGoesOn) {
  for (const char* victim : {"agent", "link"}) {
    SCOPED_TRACE(victim);
    for (const char* program : {"link", "agent"}) write(program, stays);
    for (const char* file : {"started", "ended", "pids"}) fs::remove(files.in(file));
    write(victim, fmt::format("echo first > {0}.trace; [ -e {0}.died ] || {{ {1}; touch {0}.died; kill -9 $$; }}\n{2}",
                              victim, after_take_off, stays));
    write("ground", in_the_air + until_started(victim, 2));
    const RunRecord record = run();
    EXPECT_TRUE(record.ok) << record.why;
    EXPECT_EQ(record.restarts, (std::map<std::string, std::uint64_t>{{victim, 1}}));
    ASSERT_EQ(record.ended_early.size(), 1U);
    EXPECT_EQ(record.ended_early[0].first, victim);
    EXPECT_THAT(record.ended_early[0].second, HasSubstr("signal 9"));
    EXPECT_THAT(lines(std::string(victim) + ".1.trace"), testing::ElementsAre("first")) << "what it recorded is kept";
    EXPECT_TRUE(all_gone());
  }
}

TEST_F(FakePrograms, ARoudiThatDiesInFlightIsStartedAgainOnTheGround) {
  write("roudi", once("roudi", after_take_off + "; kill -9 $$"));
  write("ground", in_the_air + "sleep 0.7; echo landed >> started\n" + on_the_ground + until_started("roudi", 2));
  const RunRecord record = run();
  EXPECT_TRUE(record.ok) << record.why;
  EXPECT_THAT(started_since_take_off(), testing::ElementsAre("landed", "roudi"));
}

TEST_F(FakePrograms, AnAgentThatDiesInFlightBringsBackARoudiThatDiedBeforeItAndALinkThatItCanHear) {
  write("roudi", once("roudi", after_take_off + "; kill -9 $$"));
  write("agent", once("agent", after_take_off + "; sleep 0.5; kill -9 $$"));
  write("ground", in_the_air + until_started("agent", 2));
  const RunRecord record = run();
  EXPECT_TRUE(record.ok) << record.why;
  EXPECT_THAT(started_since_take_off(), testing::ElementsAre("roudi", "link", "agent"));
  std::vector<std::string> early;  // not link, which the launcher ends itself
  for (const auto& [program, how] : record.ended_early) early.push_back(program);
  EXPECT_THAT(early, testing::UnorderedElementsAre("roudi", "agent"));
}

TEST_F(FakePrograms, LeakedSharedMemoryIsRecreatedWhenNothingFlies) {
  write("roudi", once("roudi", after_take_off + "; echo '{\"leaked\":3}'"));
  write("ground", in_the_air + "sleep 0.7; echo landed >> started\n" + on_the_ground + until_started("roudi", 2));
  const RunRecord record = run();
  EXPECT_TRUE(record.ok) << record.why;
  EXPECT_THAT(started_since_take_off(), testing::ElementsAre("landed", "roudi"));
  EXPECT_EQ(lines("ended")[0], "roudi");
}

TEST_F(FakePrograms, AGroundThatGivesUpIsNoSuccessAndItsSummarySaysWhy) {
  write("ground", R"(echo '{"why":"tello1: it has no pose"}' > ground.summary.json; exit 1)");
  const RunRecord record = run();
  EXPECT_FALSE(record.ok);
  EXPECT_EQ(record.why, "tello1: it has no pose");
  EXPECT_TRUE(all_gone());
}

TEST_F(FakePrograms, CtrlCAsksGroundToLandAndThenEndsEverything) {
  write("ground", "code=1\n" + stays);
  auto thread = interrupter(1);
  const RunRecord record = run();
  thread.join();
  EXPECT_FALSE(record.ok);
  EXPECT_THAT(lines("ended"), testing::ElementsAre("ground", "agent", "link", "sim", "node", "roudi"));
  EXPECT_TRUE(all_gone());
}

TEST_F(FakePrograms, ASecondCtrlCDoesNotWaitForTheLanding) {
  write("ground", "trap 'echo asked >> ended' TERM\n" + stays);
  auto thread = interrupter(2);
  const RunRecord record = run();
  thread.join();
  EXPECT_FALSE(record.ok);
  EXPECT_THAT(record.why, HasSubstr("interrupted twice"));
  EXPECT_TRUE(all_gone());
}

TEST_F(FakePrograms, AProgramThatFailsAtItsStartEndsTheRunBeforeTakeOff) {
  write("node", "echo 'the disk is full' >&2; exit 3", false);
  const RunRecord record = run();
  EXPECT_FALSE(record.ok);
  EXPECT_THAT(record.why, HasSubstr("node ended with exit code 3 before take-off"));
  EXPECT_THAT(record.why, HasSubstr("the disk is full"));
  EXPECT_EQ(record.begin_ns, 0);
  EXPECT_TRUE(all_gone());
}

TEST_F(FakePrograms, ARefusedLeaseEndsTheRunBeforeTakeOff) {
  write("control", "echo 'tello1: the lease is held by another' >&2; exit 1", false);
  const RunRecord record = run();
  EXPECT_FALSE(record.ok);
  EXPECT_THAT(record.why, HasSubstr("the lease is held by another"));
  EXPECT_TRUE(all_gone());
}

TEST_F(FakePrograms, AMissingProgramIsNamedWithTheCure) {
  fs::remove(files.in("ledgerline-sim"));
  const RunRecord record = run();
  EXPECT_THAT(record.why, HasSubstr("ledgerline-sim cannot be run"));
  EXPECT_THAT(record.why, HasSubstr("Build it"));
  EXPECT_TRUE(all_gone());
}

TEST_F(FakePrograms, NothingOutlivesALauncherThatIsKilled) {
  write("ground", stays);
  const pid_t launcher = ::fork();
  if (launcher == 0) {
    (void)run();
    ::_exit(0);
  }
  ASSERT_TRUE(eventually([&] { return lines("started").size() >= 8; }));
  ::kill(launcher, SIGKILL);
  ::waitpid(launcher, nullptr, 0);
  EXPECT_TRUE(eventually([&] { return all_gone(); }));
  EXPECT_THAT(lines("ended"), testing::ElementsAre("roudi")) << "it alone has shared memory to remove";
}

TEST_F(FakePrograms, TheLinkOfRealDronesIsAskedToLandWhereTheLauncherIsKilled) {
  write("link", "touch link.flies\n" + stays);
  const pid_t launcher = ::fork();
  if (launcher == 0) {
    Options options;
    options.own.emplace();
    options.own->pose_source = "mocap";
    options.own->drones.push_back({"tello1", "192.168.10.1", "", ""});
    options.own->flight.wait_ns = timeout_s * ns_per_s;
    (void)Launcher(options, files, files.directory, false, interrupts).run();
    ::_exit(0);
  }
  EXPECT_TRUE(eventually([&] { return fs::exists(files.in("link.flies")); }));
  ::kill(launcher, SIGKILL);
  ::waitpid(launcher, nullptr, 0);
  EXPECT_TRUE(eventually([&] { return all_gone(); }));
  EXPECT_THAT(lines("ended"), testing::UnorderedElementsAre("link", "roudi"));
}

TEST_F(FakePrograms, ASecondRunLearnsWhoFlies) {
  const std::string file = files.in("lock");
  const auto first = RunLock::acquire(file, "process 123, into /somewhere");
  ASSERT_TRUE(first);
  const auto second = RunLock::acquire(file, "process 456, into /elsewhere");
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("in progress: process 123, into /somewhere"));
}

// Anybody may put a link at a name in /tmp.
TEST_F(FakePrograms, TheLockIsNoLinkAndNoPipeAndWhatALinkNamesStays) {
  const std::string file = files.in("lock"), precious = files.in("precious");
  std::ofstream(precious) << "text";
  const auto is_refused = [&] {
    const auto lock = RunLock::acquire(file, "x");
    fs::remove(file);
    return !lock && read_file(precious).value() == "text";
  };
  fs::create_symlink(precious, file);
  EXPECT_TRUE(is_refused());
  fs::create_hard_link(precious, file);
  EXPECT_TRUE(is_refused());
  fs::create_symlink(files.in("nothing"), file);
  EXPECT_TRUE(is_refused());
  EXPECT_FALSE(fs::exists(files.in("nothing")));
  ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
  EXPECT_TRUE(is_refused());
}

TEST_F(FakePrograms, TheLockLastsUntilTheLastProcessOfARunIsGone) {
  const std::string file = files.in("lock");
  write("late", stays);
  Children children({});
  {
    const auto lock = RunLock::acquire(file, "x");
    ASSERT_TRUE(lock);
    ASSERT_TRUE(children.start({"late", {files.in("ledgerline-late")}, files.log("late"), SIGKILL}));
  }
  EXPECT_FALSE(RunLock::acquire(file, "y"));
  EXPECT_TRUE(eventually([&] { return !lines("pids").empty(); }));
  EXPECT_TRUE(children.stop("late", 10 * ns_per_s));
  EXPECT_TRUE(eventually([&] { return RunLock::acquire(file, "z").ok(); }));
}

TEST_F(FakePrograms, TheTimeOfAProcessThatIsJustEndingIsNoError) {
  Children children({});
  for (int i = 0; i < 100; ++i) {
    // With a child of its own, which ends at another moment.
    ASSERT_TRUE(children.start({"short",
                                {"/bin/sh", "-c", "for i in 1 2 3 4 5 6 7 8; do /bin/true & done; wait"},
                                files.log("short"),
                                SIGKILL}));
    while (children.is_running("short")) {
      for (int k = 0; k < 200; ++k) EXPECT_GE(children.cpu_seconds("short"), 0);
      children.poll(0);
    }
  }
}

TEST(Children, ASignalThatComesBeforeTheProgramBeginsEndsItAllTheSame) {
  struct sigaction before {};
  ::sigaction(SIGTERM, nullptr, &before);
  catch_stop_signals({SIGTERM});
  Children children({});
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(children.start({"early", {"/bin/sleep", "60"}, "/dev/null", SIGKILL}));
    ASSERT_TRUE(children.stop("early", 5 * ns_per_s)) << i;
  }
  ::sigaction(SIGTERM, &before, nullptr);
}

TEST_F(FakePrograms, AChildThatDoesNotListenIsKilledAfterItsTimeout) {
  write("deaf", "trap '' TERM\necho deaf >> ended\n" + stays);
  Children children({});
  ASSERT_TRUE(children.start({"deaf", {files.in("ledgerline-deaf")}, files.log("deaf"), SIGKILL}));
  ASSERT_TRUE(eventually([&] { return !lines("ended").empty(); }));
  EXPECT_FALSE(children.stop("deaf", 50 * ns_per_ms));
  EXPECT_FALSE(children.is_running("deaf"));
  EXPECT_THAT(children.how_it_ended("deaf"), HasSubstr("signal 9"));
}

}  // namespace
}  // namespace ledgerline::launcher
