#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>

#include "onboard/shim/mapping.hpp"

/// The real ledgerline-link is asked to end, whatever has become of who reads its output. In lockstep: this test moves
/// its clock, and stands in for a drone that says nothing, which link tells to land all the same. Argument: link.
namespace ledgerline::link {
namespace {

std::string link_program;

class StoppedLink : public ::testing::Test {
 protected:
  void SetUp() override {
    auto opened = drone_shim::DronesEnd::open("/dev/shm/" + name, true);
    ASSERT_TRUE(opened) << opened.error().message;
    drones.emplace(std::move(*opened));
    std::ofstream(config) << "[tello]\ntransport = \"shim\"\n[shim]\nmemory = \"/dev/shm/" << name
                          << "\"\nlockstep = true\n"
                             "[[drone]]\nname = \"tello1\"\naddress = \"127.0.0.2\"\n"
                             "[state]\nlisten = \"127.0.0.1:8890\"\n[realtime]\npriority = 0\n";
  }
  void TearDown() override {
    if (link > 0) {
      ::kill(link, SIGKILL);
      ::waitpid(link, nullptr, 0);
    }
    close_output();
    ::unlink(config.c_str());
  }

  /// Until it says that it is ready. `hangup`: SIG_IGN as nohup has it.
  void start(void (*hangup)(int) = SIG_DFL) {
    ASSERT_EQ(::pipe2(output.data(), O_CLOEXEC), 0);
    link = ::fork();
    if (link == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      std::signal(SIGPIPE, SIG_DFL);
      std::signal(SIGHUP, hangup);
      ::dup2(output[1], STDOUT_FILENO);
      ::dup2(output[1], STDERR_FILENO);
      ::execl(link_program.c_str(), link_program.c_str(), "--config", config.c_str(), nullptr);
      ::_exit(127);
    }
    std::string said;
    while (said.find("\"ready\":true") == std::string::npos) {
      const std::string more = read_output(10'000);
      ASSERT_FALSE(more.empty()) << said;
      said += more;
    }
  }
  std::string read_output(int timeout_ms) const {
    std::array<char, 4096> part{};
    pollfd readable{output[0], POLLIN, 0};
    if (output[0] < 0 || ::poll(&readable, 1, timeout_ms) <= 0) return "";
    const ssize_t count = ::read(output[0], part.data(), part.size());
    return {part.data(), count > 0 ? static_cast<std::size_t>(count) : 0};
  }
  /// From here on who writes waits.
  void fill_output() const {
    ::fcntl(output[1], F_SETFL, O_NONBLOCK);
    while (::write(output[1], "x", 1) == 1) {
    }
    ::fcntl(output[1], F_SETFL, 0);
  }
  void close_output() {
    for (int& end : output) {
      if (end >= 0) ::close(end);
      end = -1;
    }
  }

  bool make_turn() {
    drones->request_turn(now += ns_per_ms);
    const bool made = drones->wait_turn(ns_per_s) == drone_shim::DronesEnd::Turn::made;
    for (drone_shim::Datagram reported; drones->receive(reported);)
      commanded_to_land = commanded_to_land || reported.view() == "land";
    return made;
  }
  /// Whether its loop ends, within 10 s, and has commanded the drone to land by then.
  bool lands() {
    commanded_to_land = false;
    for (const TimeNs until = monotonic_ns() + 10 * ns_per_s; monotonic_ns() < until;) {
      if (!make_turn()) return commanded_to_land;
    }
    return false;
  }
  /// As waitpid gives it.
  int wait() {
    int status = 0;
    while (::waitpid(link, &status, WNOHANG) == 0) (void)read_output(10);
    link = 0;
    return status;
  }

  const std::string name = "ledgerline_stopped_link_test_" + std::to_string(::getpid());
  const std::string config = ::testing::TempDir() + name + ".toml";
  std::optional<drone_shim::DronesEnd> drones;
  std::array<int, 2> output{-1, -1};  ///< its standard output and its log: here, and where link writes
  pid_t link = 0;
  TimeNs now = ns_per_s;
  bool commanded_to_land = false;
};

// systemd kills who is silent, in flight, too.
TEST_F(StoppedLink, NotifiesTheServiceManagerWhileItsLogReaderStandsStill) {
  const int manager = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string notify = ::testing::TempDir() + name + ".notify";
  notify.copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(::bind(manager, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ::setenv("NOTIFY_SOCKET", notify.c_str(), 1);
  ::setenv("WATCHDOG_USEC", "200000", 1);
  const auto heard = [&] {
    std::array<char, 64> text{};
    return std::string_view(text.data(), ::recv(manager, text.data(), text.size(), 0) > 0 ? 8 : 0) == "WATCHDOG";
  };

  ASSERT_NO_FATAL_FAILURE(start());
  ASSERT_TRUE(make_turn());
  fill_output();
  ::kill(link, SIGUSR1);  // which it logs
  ::usleep(100'000);      // ten times as long as its main thread needs to come to it
  while (heard()) {       // of the time before
  }
  int datagrams = 0;
  for (const TimeNs until = monotonic_ns() + 10 * ns_per_s; datagrams < 5 && monotonic_ns() < until; ::usleep(1000)) {
    ASSERT_TRUE(make_turn());
    datagrams += heard() ? 1 : 0;
  }
  EXPECT_EQ(datagrams, 5);
  ::unsetenv("NOTIFY_SOCKET");
  ::unsetenv("WATCHDOG_USEC");
  ::close(manager);
  ::unlink(notify.c_str());
  ::kill(link, SIGTERM);
  EXPECT_TRUE(lands());
  EXPECT_EQ(wait(), 0);
}

// Ctrl-C at `ledgerline link ... 2>&1 | tee log` ends both.
TEST_F(StoppedLink, LandsThoughNobodyReadsItsOutputAnyMore) {
  ASSERT_NO_FATAL_FAILURE(start());
  ASSERT_TRUE(make_turn());
  close_output();
  ::kill(link, SIGINT);
  EXPECT_TRUE(lands());
  EXPECT_EQ(wait(), 0);
}

TEST_F(StoppedLink, LandsWhileItsLogReaderStandsStill) {
  ASSERT_NO_FATAL_FAILURE(start());
  ASSERT_TRUE(make_turn());
  fill_output();
  ::kill(link, SIGUSR1);  // which it logs
  ::usleep(100'000);      // ten times as long as its main thread needs to come to it
  ::kill(link, SIGTERM);
  EXPECT_TRUE(lands());
  EXPECT_EQ(wait(), 0);
}

TEST_F(StoppedLink, LandsWhenItsTerminalIsClosedUnlessItIsToOutliveThat) {
  ASSERT_NO_FATAL_FAILURE(start());
  ASSERT_TRUE(make_turn());
  ::kill(link, SIGHUP);
  EXPECT_TRUE(lands());
  EXPECT_EQ(wait(), 0);

  close_output();
  ASSERT_NO_FATAL_FAILURE(start(SIG_IGN));
  ASSERT_TRUE(make_turn());
  ::kill(link, SIGHUP);
  for (int i = 0; i < 20; ++i, ::usleep(10'000)) ASSERT_TRUE(make_turn());
  ::kill(link, SIGTERM);
  EXPECT_TRUE(lands());
  EXPECT_EQ(wait(), 0);
}

}  // namespace
}  // namespace ledgerline::link

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc != 2) return 2;
  ledgerline::link::link_program = argv[1];
  return RUN_ALL_TESTS();
}
