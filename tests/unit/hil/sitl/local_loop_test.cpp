#include "hil/sitl/processes.hpp"

#include <gtest/gtest.h>

namespace ledgerline::hil {
namespace {

TEST(LocalLoop, SaysTwentyTimesASecondThatTheLedgerIsAlive) {
  LocalLoop loop(1);
  int heartbeats = 0;
  for (TimeNs now = ns_per_ms; now <= ns_per_s; now += ns_per_ms) {
    const auto heartbeat = loop.heartbeat(now);
    if (!heartbeat) continue;
    ++heartbeats;
    EXPECT_TRUE(heartbeat->ledger_alive);
    EXPECT_EQ(heartbeat->stamp_ns, now);
  }
  EXPECT_EQ(heartbeats, 20);
}

TEST(LocalLoop, FusesEachDronesMocapByItselfAndSaysWhose) {
  LocalLoop loop(2);
  const auto second = loop.fused(1, {1 * ns_per_s, {1, 2, 3}, 0.5});
  ASSERT_TRUE(second);
  EXPECT_EQ(second->drone, 2);
  EXPECT_DOUBLE_EQ(second->position_m[0], 1);
  EXPECT_FALSE(loop.fused(1, {1 * ns_per_s, {1, 2, 3}, 0.5})) << "not newer than the last one";
  EXPECT_TRUE(loop.fused(0, {1 * ns_per_s, {1, 2, 3}, 0.5}));
}

TEST(LocalLoop, CountsHowLongAnAnswerTookByDrone) {
  LocalLoop loop(2);
  loop.answered(1, 2 * ns_per_ms);
  EXPECT_EQ(loop.two_way_ms(0).count, 0U);
  EXPECT_EQ(loop.two_way_ms(1).count, 1U);
}

}  // namespace
}  // namespace ledgerline::hil
