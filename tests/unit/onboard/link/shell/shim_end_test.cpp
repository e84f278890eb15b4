#include "onboard/link/shell/transport/shim_end.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <thread>

#include "onboard/shim/mapping.hpp"

namespace ledgerline::link {
namespace {

using drone_shim::Datagram;

class ShimEnd : public ::testing::Test {
 protected:
  void SetUp() override {
    auto made = drone_shim::DronesEnd::open(path);
    ASSERT_TRUE(made) << made.error().message;
    drones.emplace(std::move(*made));
    auto opened = drone_shim::Mapping::open(path, drone_shim::End::link);
    ASSERT_TRUE(opened) << opened.error().message;
    link.emplace(std::move(*opened));
  }
  static std::vector<DroneSettings> two_drones() {
    DroneSettings one, two;
    one.number = 1;
    two.number = 2;
    return {one, two};
  }
  std::string path = "/dev/shm/ledgerline_shim_end_test_" + std::to_string(::getpid());
  std::optional<drone_shim::DronesEnd> drones;
  std::optional<drone_shim::Mapping> link;
};

TEST_F(ShimEnd, CarriesTheBytesAsTheyAreAndTrustsNoDroneThatItDoesNotKnow) {
  ShimTransport transport(link->memory(), two_drones());
  ASSERT_TRUE(drones->send(1, Datagram::Port::answer, "ok"));
  ASSERT_TRUE(drones->send(3, Datagram::Port::answer, "of an outsider"));
  ASSERT_TRUE(drones->send(60'000, Datagram::Port::answer, "of nobody"));
  ASSERT_TRUE(drones->send(2, Datagram::Port::state, "bat:90;"));
  const auto received = transport.receive();
  ASSERT_EQ(received.size(), 2U);
  EXPECT_EQ(received[0].drone, 1);
  EXPECT_EQ(received[0].port, Port::answer);
  EXPECT_EQ(received[0].bytes, "ok");
  EXPECT_EQ(received[1].drone, 2);
  EXPECT_EQ(received[1].port, Port::state);
  EXPECT_EQ(received[1].bytes, "bat:90;");
  EXPECT_TRUE(transport.receive().empty());

  Datagram reported;
  const ToSend land{2, CommandText("land")};
  ASSERT_TRUE(transport.send(land));
  ASSERT_TRUE(drones->receive(reported));
  EXPECT_EQ(reported.drone, 2);
  EXPECT_EQ(reported.view(), "land");
}

TEST_F(ShimEnd, TakesABoundedNumberATurnAndSaysWhenThereIsNoRoom) {
  ShimTransport transport(link->memory(), two_drones());
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(drones->send(1, Datagram::Port::state, std::to_string(i)));
  EXPECT_EQ(transport.receive().size(), 64U);
  const auto rest = transport.receive();
  ASSERT_EQ(rest.size(), 36U);
  EXPECT_EQ(rest[35].bytes, "99");

  const ToSend land{1, CommandText("land")};
  for (std::size_t i = 0; i < drone_shim::Memory::datagrams; ++i) ASSERT_TRUE(transport.send(land));
  EXPECT_FALSE(transport.send(land));
}

TEST_F(ShimEnd, OutsidersDatagramsDoNotHoldTheLoop) {
  ShimTransport transport(link->memory(), two_drones());
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(drones->send(9, Datagram::Port::state, "of an outsider"));
  ASSERT_TRUE(drones->send(1, Datagram::Port::state, "behind them"));
  EXPECT_TRUE(transport.receive().empty()) << "all of them in one turn";
  EXPECT_EQ(transport.receive().size(), 1U);
}

class Lockstep : public ShimEnd {
 protected:
  /// link's loop, until its clock is lost.
  void run_loop() {
    loop = std::thread([this] {
      LockstepClock clock(*link);
      while (true) {
        const TimeNs now = clock.wait(stopping);
        if (clock.is_lost()) return;
        turns.push_back(now);
      }
    });
  }
  drone_shim::DronesEnd::Turn turn(TimeNs now) {
    drones->request_turn(now);
    return drones->wait_turn(10 * ns_per_s);
  }
  std::atomic<bool> stopping{false};
  std::vector<TimeNs> turns;
  std::thread loop;
};

TEST_F(Lockstep, TheOtherEndSaysWhatTimeItIsUntilItIsGone) {
  run_loop();
  const std::vector<TimeNs> asked{ns_per_ms, 2 * ns_per_ms, 500 * ns_per_ms, 500 * ns_per_ms + 1};
  for (const TimeNs now : asked) EXPECT_EQ(turn(now), drone_shim::DronesEnd::Turn::made);
  drones.reset();
  loop.join();
  EXPECT_EQ(turns, asked);
}

TEST_F(Lockstep, AStopEndsALinkWhoseClockStands) {
  run_loop();
  EXPECT_EQ(turn(ns_per_ms), drone_shim::DronesEnd::Turn::made);
  stopping = true;
  loop.join();
  EXPECT_EQ(turns.size(), 1U);
}

TEST_F(Lockstep, ATurnIsOverWhenTheLoopEndsInIt) {
  drones->request_turn(ns_per_ms);
  {
    LockstepClock clock(*link);
    EXPECT_EQ(clock.wait(stopping), ns_per_ms);
    EXPECT_EQ(drones->wait_turn(20 * ns_per_ms), drone_shim::DronesEnd::Turn::in_progress);
  }
  EXPECT_EQ(drones->wait_turn(ns_per_s), drone_shim::DronesEnd::Turn::made);
}

}  // namespace
}  // namespace ledgerline::link
