#include "ground/motion/delays.hpp"

#include <gtest/gtest.h>

#include "common/rt/random.hpp"

namespace ledgerline::motion {
namespace {

TEST(TwoWay, IsTheDistributionOfTheSumOfTwoWays) {
  TwoWay two_way;
  Random random(1);
  for (int i = 0; i < 64; ++i) two_way.add(from_seconds(random.uniform() < 0.5 ? 0.1 : 0.3));
  // 0.2, 0.4 or 0.6 s, about 1 : 2 : 1.
  EXPECT_NEAR(to_ms(two_way.quantile(0.05)), 200, 1e-6);
  EXPECT_NEAR(to_ms(two_way.quantile(0.5)), 400, 1e-6);
  EXPECT_NEAR(to_ms(two_way.quantile(0.95)), 600, 1e-6);
}

TEST(TwoWay, ForgetsWhatTheLedgerWasLikeBefore) {
  TwoWay two_way;
  EXPECT_EQ(two_way.quantile(0.9), TwoWay::unknown_ns);
  two_way.add(from_seconds(3));
  for (std::size_t i = 0; i < Window::kept; ++i) two_way.add(10 * ns_per_ms);
  EXPECT_EQ(two_way.quantile(1), 20 * ns_per_ms);
}

TEST(TwoWay, AClockThatWentBackIsNoNegativeDelay) {
  TwoWay two_way;
  two_way.add(-5);
  EXPECT_EQ(two_way.quantile(0.5), 0);
}

TEST(Applications, TellAgeAndLatenessOnTheDronesClock) {
  Applications applications;
  EXPECT_EQ(applications.late_ns(), 0);
  EXPECT_FALSE(applications.age_ns(0.5));
  for (TimeNs late = 0; late <= 40 * ns_per_ms; late += 10 * ns_per_ms)
    applications.add(1'000 * ns_per_s, 1'000 * ns_per_s + 100 * ns_per_ms + late, late);
  EXPECT_EQ(applications.late_ns(), 20 * ns_per_ms);
  EXPECT_EQ(applications.age_ns(0.5), 120 * ns_per_ms);
}

}  // namespace
}  // namespace ledgerline::motion
