#include "common/fabric/client/orderer_choice.hpp"

#include <gtest/gtest.h>

#include <array>

#include "common/base/random.hpp"

namespace ledgerline::fabric {
namespace {

/// Three orderers, thirty envelopes a second, each alone on its way.
class World {
 public:
  explicit World(std::uint64_t seed) : random_(seed) {}

  std::array<int, 3> run(int envelopes) {
    std::array<int, 3> went{};
    for (int i = 0; i < envelopes; ++i) {
      now += 33 * ns_per_ms;
      const std::size_t at = choice.next(now, alone);
      ++went[at];
      if (at == dead) {
        choice.failed(at, (at + 1) % 3, now);
        continue;
      }
      choice.on_committed(at, took(at), now + 10 * ns_per_ms);
    }
    return went;
  }

  OrdererChoice choice{3};
  std::size_t leader = 0, dead = 3;
  bool alone = true;
  TimeNs now = 0, hop = ns_per_ms;

 private:
  /// 6 ms and a tail of up to 4, all of it twice as long while the machine is busy; a follower's hop more.
  TimeNs took(std::size_t orderer) {
    TimeNs tail = 0;
    for (int k = 0; k < 4; ++k) tail += static_cast<TimeNs>(random_.next() % static_cast<std::uint64_t>(ns_per_ms));
    const bool busy = now / (7 * ns_per_s) % 2 == 1;
    return (busy ? 2 : 1) * (6 * ns_per_ms + tail) + (orderer == leader ? 0 : hop);
  }
  Random random_;
};

TEST(OrdererChoice, FindsTheLeaderAndStaysWithIt) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    for (std::size_t leader = 0; leader < 3; ++leader) {
      World world(seed);
      world.leader = leader;
      world.run(1500);
      const auto went = world.run(600);
      EXPECT_GE(went[leader], 500) << "seed " << seed;
      EXPECT_LE(went[(leader + 1) % 3] + went[(leader + 2) % 3], 100);
    }
  }
}

TEST(OrdererChoice, FollowsANewLeaderThatNobodyAnnounced) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    World world(seed);
    world.run(600);
    world.leader = 2;
    world.run(9000);
    EXPECT_EQ(world.choice.best(), 2U) << "seed " << seed;
  }
}

TEST(OrdererChoice, ProbesAreFewAndEqualOnesAreNotSwapped) {
  World world(3);
  world.hop = 0;
  world.run(100);
  const std::size_t best = world.choice.best();
  int changes = 0;
  std::size_t before = best;
  int elsewhere = 0;
  for (int i = 0; i < 6000; ++i) {
    const auto went = world.run(1);
    elsewhere += went[world.choice.best()] == 0 ? 1 : 0;
    changes += std::exchange(before, world.choice.best()) != world.choice.best() ? 1 : 0;
  }
  EXPECT_LE(elsewhere, 400) << "one in twenty, and more behind a change";
  EXPECT_LE(changes, 12) << "in 200 s";
}

TEST(OrdererChoice, OneThatFailsIsLeftAtOnceAndRests) {
  World world(5);
  world.run(600);
  ASSERT_EQ(world.choice.best(), 0U);
  world.dead = 0;
  world.leader = 2;
  EXPECT_EQ(world.run(1)[0], 1);
  EXPECT_NE(world.choice.best(), 0U);
  EXPECT_EQ(world.run(290)[0], 0) << "it is not asked for ten seconds";
  world.run(1500);
  EXPECT_EQ(world.choice.best(), 2U);
}

TEST(OrdererChoice, AProbeThatFailsChangesNothing) {
  World world(6);
  world.dead = 1;
  const auto went = world.run(9000);
  EXPECT_EQ(world.choice.best(), 0U);
  EXPECT_LE(went[1], 5) << "in five minutes: it rests longer each time";
}

TEST(OrdererChoice, WhileAnEnvelopeIsOnItsWayTheNextOneGoesBehindIt) {
  World world(7);
  world.leader = 1;
  world.alone = false;
  EXPECT_EQ(world.run(600)[0], 600);
}

TEST(OrdererChoice, OneOrdererIsAlwaysTheOne) {
  OrdererChoice one(1);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(one.next(i * ns_per_s, true), 0U);
    one.on_committed(0, ns_per_ms, i * ns_per_s);
  }
  one.failed(0, 0, 200 * ns_per_s);
  EXPECT_EQ(one.next(201 * ns_per_s, true), 0U);
}

}  // namespace
}  // namespace ledgerline::fabric
