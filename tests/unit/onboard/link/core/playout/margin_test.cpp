#include "onboard/link/core/playout/playout.hpp"

#include <gtest/gtest.h>

#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

/// Plans 33 ms apart that come `late` after the time of their first setpoint; the margin is stepped every ms.
class MarginTest : public ::testing::Test {
 protected:
  void plans(int count, TimeNs late) {
    for (int i = 0; i < count; ++i) {
      margin.add(t, late);
      for (const TimeNs next = t + 33 * ms; t < next; t += ms) {
        margin.step(t);
        EXPECT_GE(t - margin.value(), time) << "the time of playout never goes back";
        time = t - margin.value();
      }
    }
  }
  PlayoutSettings settings;
  Margin margin{settings};
  TimeNs t = 100 * ns_per_s;
  TimeNs time = 0;
};

TEST_F(MarginTest, PlansThatComeInTimeAreFlownAtTheirTime) {
  plans(300, -5 * ms);
  EXPECT_EQ(margin.value(), 0);
}

TEST_F(MarginTest, PlansThatComeLateAreFlownLaterByAsMuch) {
  plans(300, 80 * ms);
  EXPECT_EQ(margin.value(), 80 * ms);
}

TEST_F(MarginTest, FewerPlansThanAQuantileNeedsMoveNothing) {
  plans(31, 80 * ms);
  EXPECT_EQ(margin.value(), 0);
  plans(4, 80 * ms);
  EXPECT_GT(margin.value(), 0);
}

TEST_F(MarginTest, ItRisesByHalfASecondASecondAndFallsByATwentieth) {
  plans(32, 1000 * ms);
  const TimeNs rising = margin.value();
  margin.step(t += 99 * ms);
  EXPECT_EQ(margin.value() - rising, 50 * ms) << "100 ms since the last step";
  plans(300, 0);
  const TimeNs falling = margin.value();
  ASSERT_GT(falling, 10 * ms);
  margin.step(t += 99 * ms);
  EXPECT_EQ(falling - margin.value(), 5 * ms);
}

TEST_F(MarginTest, AFewLatePlansAreNotWaitedFor) {
  for (int i = 0; i < 6; ++i) {
    plans(60, 0);
    plans(1, 300 * ms);
  }
  EXPECT_EQ(margin.value(), 0);
}

TEST_F(MarginTest, TheMarginEndsAtItsLimitAndGoesWhenPlansComeInTimeAgain) {
  plans(300, 1'500 * ms);
  EXPECT_EQ(margin.value(), settings.max_margin_ns);
  plans(900, 0);
  EXPECT_EQ(margin.value(), 0);
}

TEST_F(MarginTest, ALimitOfZeroMeansNone) {
  settings.max_margin_ns = 0;
  margin = Margin(settings);
  plans(300, 80 * ms);
  EXPECT_EQ(margin.value(), 0);
}

}  // namespace
}  // namespace ledgerline::link
