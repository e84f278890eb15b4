#include "ground/core/flight/plan_timing.hpp"

#include <gtest/gtest.h>

#include "common/base/random.hpp"

namespace ledgerline::ground {
namespace {

TEST(RoundTripEstimate, IsTheDistributionOfTheSumOfTwoWays) {
  RoundTripEstimate two_way;
  Random random(1);
  for (int i = 0; i < 64; ++i) two_way.add(from_seconds(random.uniform() < 0.5 ? 0.1 : 0.3));
  // 0.2, 0.4 or 0.6 s, about 1 : 2 : 1.
  EXPECT_NEAR(to_ms(two_way.quantile(0.05)), 200, 1e-6);
  EXPECT_NEAR(to_ms(two_way.quantile(0.5)), 400, 1e-6);
  EXPECT_NEAR(to_ms(two_way.quantile(0.95)), 600, 1e-6);
}

TEST(RoundTripEstimate, ForgetsWhatTheLedgerWasLikeBefore) {
  RoundTripEstimate two_way;
  EXPECT_EQ(two_way.quantile(0.9), RoundTripEstimate::unknown_ns);
  two_way.add(from_seconds(3));
  for (std::size_t i = 0; i < Window::kept; ++i) two_way.add(10 * ns_per_ms);
  EXPECT_EQ(two_way.quantile(1), 20 * ns_per_ms);
}

TEST(RoundTripEstimate, AClockThatWentBackIsNoNegativeDelay) {
  RoundTripEstimate two_way;
  two_way.add(-5);
  EXPECT_EQ(two_way.quantile(0.5), 0);
}

TEST(RoundTripEstimate, ItsOwnPartIsOneWayAlone) {
  RoundTripEstimate two_way;
  EXPECT_EQ(two_way.own(0.1), 0);
  for (int i = 1; i <= 10; ++i) two_way.add(i * 10 * ns_per_ms);
  EXPECT_EQ(two_way.own(0), 10 * ns_per_ms);
  EXPECT_EQ(two_way.own(1), 100 * ns_per_ms);
}

}  // namespace
}  // namespace ledgerline::ground
