#include "common/fabric/tx/transaction.hpp"

#include <gtest/gtest.h>

namespace ledgerline::fabric {
namespace {

/// A second with ten transactions, so many of them by the flag alone.
void second(ValidatedShare& share, TimeNs& now, int by_flag) {
  Block block;
  for (int i = 0; i < 10; ++i) block.transactions.emplace_back().by_flag = i < by_flag;
  block.transactions.emplace_back().config = true;
  share.add(now += ns_per_s, block);
}

TEST(ValidatedShare, ARiseIsReportedOnceAndAStartIsNone) {
  ValidatedShare share;
  TimeNs now = 100 * ns_per_s;
  for (int i = 0; i < 30; ++i) second(share, now, 10);
  EXPECT_FALSE(share.pop_rise()) << "at a start most are";
  EXPECT_EQ(share.by_flag(), 300U);
  for (int i = 0; i < 30; ++i) second(share, now, 1);
  EXPECT_FALSE(share.pop_rise());
  EXPECT_EQ(share.validated(), 270U) << "a configuration is neither";
  for (int i = 0; i < 30; ++i) second(share, now, 8);
  const auto rise = share.pop_rise();
  ASSERT_TRUE(rise);
  EXPECT_GT(2 * rise->by_flag, rise->of);
  for (int i = 0; i < 30; ++i) second(share, now, 8);
  EXPECT_FALSE(share.pop_rise()) << "it was reported";
  for (int i = 0; i < 30; ++i) second(share, now, 0);
  for (int i = 0; i < 30; ++i) second(share, now, 8);
  EXPECT_TRUE(share.pop_rise()) << "another one";
}

TEST(ValidatedShare, OfFewTransactionsNothingIsReported) {
  ValidatedShare share;
  TimeNs now = 100 * ns_per_s;
  for (int i = 0; i < 30; ++i) second(share, now, 0);
  now += 60 * ns_per_s;
  second(share, now, 0);  // ends the window
  Block one;
  one.transactions.emplace_back().by_flag = true;
  for (int i = 0; i < 5; ++i) share.add(now += 20 * ns_per_s, one);
  EXPECT_FALSE(share.pop_rise());
}

}  // namespace
}  // namespace ledgerline::fabric
