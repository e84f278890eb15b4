#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <string>
#include <thread>

#include "common/rt/clock.hpp"
#include "tests/unit/child.hpp"

/// The real ledgerline-sim in a network of its own: 10,000 datagrams a second at one drone leave its neighbour served.
namespace ledgerline::sim {
namespace {

std::string program;  // the path of ledgerline-sim

constexpr int datagrams_a_second = 10'000;
constexpr TimeNs duration = 4 * ns_per_s;

class Client {
 public:
  Client(const char* own, std::uint16_t port, const char* drone) : fd_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    const sockaddr_in from = address(own, port);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&from), sizeof from), 0);
    drone_ = address(drone, 8889);
  }
  ~Client() { ::close(fd_); }

  bool tell(std::string_view text) {
    return ::sendto(fd_, text.data(), text.size(), 0, reinterpret_cast<const sockaddr*>(&drone_), sizeof drone_) >= 0;
  }
  /// What comes within a second from the drone; "" for nothing.
  std::string hear(int within_ms = 1000) {
    pollfd polled{fd_, POLLIN, 0};
    if (::poll(&polled, 1, within_ms) != 1) return "";
    char bytes[2048];
    const ssize_t size = ::recv(fd_, bytes, sizeof bytes, 0);
    return size > 0 ? std::string(bytes, static_cast<std::size_t>(size)) : "";
  }
  std::string ask(std::string_view text) { return tell(text) ? hear() : ""; }

 private:
  static sockaddr_in address(const char* text, std::uint16_t port) {
    sockaddr_in out{};
    out.sin_family = AF_INET;
    out.sin_port = htons(port);
    EXPECT_EQ(::inet_pton(AF_INET, text, &out.sin_addr), 1);
    return out;
  }
  int fd_;
  sockaddr_in drone_{};
};

/// Garbage and commands, at a steady rate, from its construction to its end.
class Flood {
 public:
  Flood() : thread_([this] { run(); }) {}
  ~Flood() { end(); }
  void end() {
    over_ = true;
    if (thread_.joinable()) thread_.join();
  }
  std::atomic<int> sent{0};

 private:
  void run() {
    Client client("127.0.0.100", 0, "127.0.0.2");
    const std::string inputs[] = {"battery?", std::string(1400, '\xff'), "rc 1 2 3 4", "", "speed 9999999999999999999"};
    const TimeNs begin = monotonic_ns();
    while (!over_) {
      const auto due = static_cast<int>((monotonic_ns() - begin) * datagrams_a_second / ns_per_s);
      for (int i = sent; i < due; ++i) {
        if (client.tell(inputs[static_cast<std::size_t>(i) % std::size(inputs)])) ++sent;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  std::atomic<bool> over_{false};
  std::thread thread_;
};

TEST(Flood, AtOneDroneLeavesItsNeighbourServed) {
  Child sim;
  ASSERT_TRUE(sim.start({program, "--drones", "2"}));
  Client neighbour("127.0.0.50", 40000, "127.0.0.3"), states("127.0.0.50", 8890, "127.0.0.3");
  ASSERT_EQ(neighbour.ask("command"), "ok");
  ASSERT_NE(neighbour.ask("battery?"), "");

  Flood flood;
  const TimeNs begin = monotonic_ns();
  int asked = 0, state_count = 0;
  TimeNs max_answer = 0, max_gap = 0, last_state = begin;
  while (monotonic_ns() - begin < duration) {
    const TimeNs asked_at = monotonic_ns();
    ASSERT_NE(neighbour.ask("battery?"), "") << "no answer after " << asked << " during the flood";
    max_answer = std::max(max_answer, monotonic_ns() - asked_at);
    ++asked;
    while (!states.hear(10).empty()) {
      max_gap = std::max(max_gap, monotonic_ns() - last_state);
      last_state = monotonic_ns();
      ++state_count;
    }
  }
  flood.end();
  EXPECT_GT(flood.sent, datagrams_a_second * duration / ns_per_s / 2) << "there was no flood";
  EXPECT_GT(state_count, 10 * duration / ns_per_s * 8 / 10) << "ten a second are due";
  std::printf("%d datagrams; neighbour: %d answers, the slowest after %.1f ms, %d states, the maximum gap %.0f ms\n",
              flood.sent.load(), asked, to_ms(max_answer), state_count, to_ms(max_gap));

  Client afterwards("127.0.0.51", 40001, "127.0.0.2");
  EXPECT_EQ(afterwards.ask("command"), "ok") << "the flooded drone is served again";
  EXPECT_EQ(sim.end(SIGTERM), 0);
}

}  // namespace
}  // namespace ledgerline::sim

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc != 2) return std::fprintf(stderr, "usage: %s LEDGERLINE-SIM\n", argv[0]), 2;
  ledgerline::sim::program = argv[1];
  return RUN_ALL_TESTS();
}
