#include "tools/timing/metrics.hpp"

#include <gtest/gtest.h>

#include "tests/unit/tools/timing/some_traces.hpp"

namespace ledgerline::timing {
namespace {

TEST(LoopLateness, CountsEveryTurnItsOverrunsAndWhatTheTraceLost) {
  auto records = turns({{5, 10, 1000}, {1001, 20}, {3}});
  const Metrics whole = make_metrics({}, records);
  EXPECT_EQ(whole.loop.late.count(), 6U);
  EXPECT_EQ(whole.loop.overruns, 1U) << "a turn that is 1 ms late is not later than 1 ms";
  EXPECT_EQ(whole.loop.lost, 0U);
  EXPECT_NEAR(tail_of(*whole.find(late)).max, 1.001, 1e-9);
  records.insert(records.begin() + 1, records[0]);  // there twice
  EXPECT_EQ(make_metrics({}, records).loop.late.count(), 6U);
  records.erase(records.begin() + 2);
  const Metrics torn = make_metrics({}, records);
  EXPECT_EQ(torn.loop.late.count(), 4U);
  EXPECT_EQ(torn.loop.lost, 2U);
}

}  // namespace
}  // namespace ledgerline::timing
