#include "onboard/shim/mapping.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <thread>

namespace ledgerline::drone_shim {
namespace {

class ShimDronesEnd : public ::testing::Test {
 protected:
  void SetUp() override {
    auto opened = DronesEnd::open(path);
    ASSERT_TRUE(opened) << opened.error().message;
    drones.emplace(std::move(*opened));
  }
  DronesEnd::Turn turn(TimeNs now, TimeNs max_ns = 10 * ns_per_s) {
    drones->request_turn(now);
    return drones->wait_turn(max_ns);
  }
  std::string path = "/dev/shm/ledgerline_drones_end_test_" + std::to_string(::getpid());
  std::optional<DronesEnd> drones;
};

TEST_F(ShimDronesEnd, GivesWhatFitsInItsOrderAndSaysWhatDoesNot) {
  const auto link = Mapping::open(path, End::link);
  ASSERT_TRUE(link);
  for (std::size_t i = 0; i < Memory::datagrams; ++i)
    ASSERT_TRUE(drones->send(1, Datagram::Port::state, std::to_string(i)));
  EXPECT_FALSE(drones->send(1, Datagram::Port::state, "one too many"));
  Datagram heard;
  for (std::size_t i = 0; i < Memory::datagrams; ++i) {
    ASSERT_TRUE(link->memory().to_link.pop(heard));
    EXPECT_EQ(heard.view(), std::to_string(i));
    EXPECT_EQ(heard.port, Datagram::Port::state);
  }
  EXPECT_FALSE(link->memory().to_link.pop(heard));
  EXPECT_FALSE(drones->send(1, Datagram::Port::answer, std::string(2000, 'x')));
}

TEST_F(ShimDronesEnd, ATurnIsOverWhenLinkSaysSo) {
  std::atomic<bool> ready{false};
  std::vector<TimeNs> turns;
  std::thread link([&] {
    const auto mapping = Mapping::open(path, End::link);
    ready = static_cast<bool>(mapping);
    if (!mapping) return;
    Memory::Turns& shared = mapping->memory().turns;
    for (std::uint32_t done = 0; done < 100; ++done) {
      while (shared.asked.load(std::memory_order_acquire) == done) wait_while(shared.asked, done, ns_per_s);
      turns.push_back(shared.now_ns);
      shared.done.store(done + 1, std::memory_order_release);
      wake(shared.done);
    }
  });
  while (!ready) std::this_thread::yield();
  for (int i = 1; i <= 100; ++i) EXPECT_EQ(turn(i * ns_per_ms), DronesEnd::Turn::made) << i;
  link.join();
  ASSERT_EQ(turns.size(), 100U);
  for (int i = 1; i <= 100; ++i) EXPECT_EQ(turns[static_cast<std::size_t>(i) - 1], i * ns_per_ms);
}

TEST_F(ShimDronesEnd, ALinkThatIsGoneIsDistinguishedFromOneThatStandsStill) {
  EXPECT_EQ(turn(ns_per_ms, 50 * ns_per_ms), DronesEnd::Turn::no_link);
  const auto link = Mapping::open(path, End::link);
  ASSERT_TRUE(link);
  EXPECT_EQ(drones->wait_turn(50 * ns_per_ms), DronesEnd::Turn::in_progress);
}

}  // namespace
}  // namespace ledgerline::drone_shim
