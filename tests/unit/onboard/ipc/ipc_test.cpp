#include "onboard/ipc/ipc.hpp"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "onboard/ipc/roudi_probe.hpp"
#include "tests/unit/child.hpp"

/// Runs in a namespace of its own (in_namespace.sh); argv[1] is ledgerline-roudi.
namespace ledgerline::ipc {
namespace {

const char* roudi_program = nullptr;
const char* own_program = nullptr;

template <typename Take>
bool within_two_seconds(Take take) {
  for (int i = 0; i < 2000; ++i) {
    if (take()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

// In a process of its own, which is then killed: what it holds nobody gives back, since nobody takes its name again.
int hold_a_plan(const char* name) {
  if (!connect(name)) return 1;
  auto agent = AgentEnd::create();
  if (!agent || !(*agent)->send_plan({})) return 1;
  std::puts("{\"ready\":true}");
  std::fflush(stdout);
  ::pause();
  return 0;
}

/// Somebody has taken RouDi's name in /tmp; nobody reads what comes.
class TakenName {
 public:
  explicit TakenName(uid_t owner) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(::chown(path.c_str(), owner, owner), 0);
  }
  ~TakenName() {
    ::close(fd_);
    ::unlink(path.c_str());
  }

 private:
  const std::string path = "/tmp/roudi";
  const int fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
};

TEST(Ipc, NobodyRegistersWithARouDiOfAnotherUserOrTakesANameThatAnotherUserHas) {
  {
    const TakenName foreign(65534);
    const Status with = connect("ipc-test");
    ASSERT_FALSE(with);
    EXPECT_NE(with.error().message.find("another user"), std::string::npos) << with.error().message;
    EXPECT_FALSE(is_roudi_alive());
  }
  const TakenName own(::geteuid());
  ASSERT_EQ(::symlink("/tmp/elsewhere", "/tmp/ipc-test.lock"), 0);
  const Status with = connect("ipc-test");
  ASSERT_FALSE(with);
  EXPECT_NE(with.error().message.find("rm /tmp/ipc-test.lock"), std::string::npos) << with.error().message;
  ::unlink("/tmp/ipc-test.lock");
}

TEST(Ipc, WhoWaitsForARouDiThatNeverAnswersHearsThatItIsToEnd) {
  const TakenName deaf(::geteuid());
  const pid_t waiting = ::fork();
  if (waiting == 0) {
    int looks = 0;
    const Status with = connect("ipc-test", [&] { return ++looks > 3; });
    ::_exit(!with && with.error().message.find("asked to end") != std::string::npos ? 0 : 1);
  }
  int status = 0;
  ::waitpid(waiting, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

// One process may connect to RouDi once, so one test walks the whole way.
TEST(Ipc, TheWholeWayWithRoudiMissingThereAndGone) {
  const Status without = connect("ipc-test");
  ASSERT_FALSE(without);
  EXPECT_NE(without.error().message.find("ledgerline-roudi"), std::string::npos);  // says the cure, and did not wait

  Child roudi;
  ASSERT_TRUE(roudi.start({roudi_program, "--summary", "/tmp/roudi.json"}));
  const Status with = connect("ipc-test");
  ASSERT_TRUE(with) << with.error().message;
  EXPECT_TRUE(is_roudi_alive());
  EXPECT_TRUE(older_than_roudi({"ipc-test"}).empty());

  auto agent = AgentEnd::create();
  auto link = LinkEnd::create();
  ASSERT_TRUE(agent && link);

  Plan plan;
  plan.drone = 3;
  plan.sequence = 7;
  plan.count = max_setpoints;
  plan.setpoints[max_setpoints - 1].velocity_mps = {1, 2, 3};
  Plan plan_back;
  // Ends find each other within RouDi's discovery period: what is sent before that is lost, by design (no history).
  ASSERT_TRUE(within_two_seconds([&] { return (*agent)->send_plan(plan) && (*link)->receive_plan(plan_back); }));
  EXPECT_EQ(plan_back.sequence, 7U);
  EXPECT_EQ(plan_back.setpoints[max_setpoints - 1].velocity_mps[2], 3);

  Pose pose{.drone = 2, .stamp_ns = 5, .position_m = {1, 2, 3}, .velocity_mps = {}, .yaw_rad = 0.5};
  Pose pose_back;
  ASSERT_TRUE(within_two_seconds([&] { return (*agent)->send_pose(pose) && (*link)->receive_pose(pose_back); }));
  EXPECT_EQ(pose_back.yaw_rad, 0.5);

  AgentHeartbeat heartbeat_back;
  ASSERT_TRUE(within_two_seconds([&] {
    return (*agent)->send_heartbeat({.stamp_ns = 9, .ledger_alive = true}) &&
           (*link)->receive_heartbeat(heartbeat_back);
  }));
  EXPECT_TRUE(heartbeat_back.ledger_alive);

  StateSample state, state_back;
  state.sequence = 11;
  ASSERT_TRUE(within_two_seconds([&] { return (*link)->send_state(state) && (*agent)->receive_state(state_back); }));
  EXPECT_EQ(state_back.sequence, 11U);

  Transition transition, transition_back;
  transition.number = 13;
  ASSERT_TRUE(within_two_seconds(
      [&] { return (*link)->send_transition(transition) && (*agent)->receive_transition(transition_back); }));
  EXPECT_EQ(transition_back.number, 13U);

  // Who waits for link sleeps until it is woken, behind what was sent.
  (void)(*agent)->woken();
  const auto readable = [&] {
    pollfd fd{.fd = (*agent)->wake_fd(), .events = POLLIN, .revents = 0};
    return ::poll(&fd, 1, 0) == 1;
  };
  EXPECT_FALSE(readable());
  (*link)->wake_agent();
  EXPECT_TRUE(readable());
  EXPECT_TRUE((*agent)->woken());
  EXPECT_FALSE(readable());

  // A burst larger than any queue keeps the newest, in order, and never blocks or fails the sender.
  while ((*agent)->receive_state(state_back)) {
  }
  for (std::uint64_t i = 1; i <= 2000; ++i) {
    state.sequence = 1000 + i;
    ASSERT_TRUE((*link)->send_state(state));
  }
  std::uint64_t last = 0, count = 0;
  while ((*agent)->receive_state(state_back)) {
    EXPECT_GT(state_back.sequence, last);
    last = state_back.sequence;
    ++count;
  }
  EXPECT_EQ(last, 3000U);
  EXPECT_GE(count, 200U);

  // Three were killed with a plan in hand. RouDi looks at its pools every quarter of a second.
  for (const char* name : {"killed1", "killed2", "killed3"}) {
    Child killed;
    ASSERT_TRUE(killed.start({own_program, "hold-a-plan", name}));
    killed.end(SIGKILL);
  }
  std::this_thread::sleep_for(std::chrono::seconds(4));

  // RouDi ends: what is connected goes on, and its absence is seen.
  EXPECT_EQ(roudi.end(SIGTERM), 0);
  const auto summary = nlohmann::json::parse(std::ifstream("/tmp/roudi.json"));
  EXPECT_EQ(summary["leaked"], 3) << summary;
  EXPECT_FALSE(is_roudi_alive());
  plan.sequence = 8;
  ASSERT_TRUE((*agent)->send_plan(plan));
  while ((*link)->receive_plan(plan_back)) {
  }
  EXPECT_EQ(plan_back.sequence, 8U);

  // Another RouDi is not the one that this process knows.
  Child next;
  ASSERT_TRUE(next.start({roudi_program}));
  EXPECT_FALSE(is_roudi_alive());
  EXPECT_EQ(older_than_roudi({"ipc-test", "nobody"}), std::vector<std::string>{"ipc-test"});
}

}  // namespace
}  // namespace ledgerline::ipc

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc < 2) return 2;
  if (std::string_view(argv[1]) == "hold-a-plan") return ledgerline::ipc::hold_a_plan(argv[2]);
  ledgerline::ipc::own_program = argv[0];
  ledgerline::ipc::roudi_program = argv[1];
  return RUN_ALL_TESTS();
}
