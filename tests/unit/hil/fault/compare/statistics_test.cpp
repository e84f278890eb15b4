#include "hil/fault/compare/comparison.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"

namespace ledgerline::hil::comparing {
namespace {

// The values are those of tables and of R's documentation.
TEST(SignedRank, HasTheExactChancesOfTheTables) {
  EXPECT_DOUBLE_EQ(signed_rank(std::vector<double>{1, 2, 3, 4, 5}).p, 2.0 / 32);
  EXPECT_EQ(signed_rank(std::vector<double>{1, 2, 3, 4, 5}).direction, 1);
  // n = 10, the lesser sum of ranks 8: 0.0244 on each side.
  EXPECT_DOUBLE_EQ(signed_rank(std::vector<double>{1, 2, 3, 4, 5, 6, 7, -8, 9, 10}).p, 50.0 / 1024);
  // R, ?wilcox.test, Hollander and Wolfe's depression data: V = 40, one-sided 0.01953.
  const std::vector<double> x{1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30};
  const std::vector<double> y{0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29};
  std::vector<double> differences;
  for (std::size_t i = 0; i < x.size(); ++i) differences.push_back(y[i] - x[i]);
  EXPECT_NEAR(signed_rank(differences).p, 0.0390625, 1e-12);
  EXPECT_EQ(signed_rank(differences).direction, -1);
}

TEST(SignedRank, LeavesZerosOutAndGivesTiesTheMiddleRank) {
  const TestResult ties = signed_rank(std::vector<double>{1, 1, 0, 1, 1, -1, 0});
  EXPECT_DOUBLE_EQ(ties.p, 12.0 / 32) << "as so many coins";
  EXPECT_DOUBLE_EQ(ties.least_p, 2.0 / 32);
  const TestResult nothing = signed_rank(std::vector<double>{0, 0, 0});
  EXPECT_EQ(nothing.p, 1);
  EXPECT_EQ(nothing.least_p, 1);
  EXPECT_EQ(nothing.direction, 0);
}

TEST(SignedRank, TheNormalDistributionTakesOverWithoutAStep) {
  const auto p_of = [](std::size_t n) {
    std::vector<double> differences;
    for (std::size_t i = 1; i <= n; ++i)
      differences.push_back(i % 3 == 0 ? -static_cast<double>(i) : static_cast<double>(i));
    return signed_rank(differences).p;
  };
  EXPECT_NEAR(std::log(p_of(max_exact_pairs + 2) / p_of(max_exact_pairs - 1)), std::log(p_of(50) / p_of(47)), 0.1);
  EXPECT_EQ(signed_rank(std::vector<double>(100, 1)).direction, 1);
  EXPECT_LT(signed_rank(std::vector<double>(100, 1)).p, 1e-15);
}

TEST(RankSum, HasTheExactChancesOfTheTables) {
  EXPECT_NEAR(rank_sum(std::vector<double>{1, 2, 3}, std::vector<double>{4, 5, 6}).p, 0.1, 1e-12);
  EXPECT_EQ(rank_sum(std::vector<double>{1, 2, 3}, std::vector<double>{4, 5, 6}).direction, 1);
  // R, ?wilcox.test, permeability constants: W = 35, one-sided 0.1272.
  const std::vector<double> x{0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46};
  const std::vector<double> y{1.15, 0.88, 0.90, 0.74, 1.21};
  EXPECT_NEAR(rank_sum(x, y).p, 0.2544, 5e-5);
  EXPECT_EQ(rank_sum(x, y).direction, -1);
  EXPECT_EQ(rank_sum(x, {}).p, 1);
  EXPECT_NEAR(rank_sum(std::vector<double>(5, 1), std::vector<double>(5, 1)).p, 1, 1e-12);
  std::vector<double> low, high;
  for (int i = 0; i < 30; ++i) {
    low.push_back(i);
    high.push_back(100 + i);
  }
  EXPECT_LT(rank_sum(low, high).p, 1e-9);
}

TEST(Shares, HaveFishersAndMcNemarsChances) {
  EXPECT_NEAR(fisher(3, 4, 1, 4).p, 0.4857, 5e-5) << "the lady tasting tea";
  EXPECT_NEAR(fisher(1, 10, 11, 14).p, 0.002759, 5e-7);
  EXPECT_EQ(fisher(1, 10, 11, 14).direction, 1);
  EXPECT_NEAR(fisher(0, 30, 0, 30).p, 1, 1e-12);
  EXPECT_NEAR(mcnemar(8, 1).p, 20.0 / 512, 1e-12);
  EXPECT_EQ(mcnemar(8, 1).direction, 1);
  EXPECT_EQ(mcnemar(0, 0).p, 1);
}

TEST(Holm, CorrectsForAllTests) {
  const auto corrected = holm({0.01, 0.04, 0.03, 0.005});
  const std::vector<double> wanted{0.03, 0.06, 0.06, 0.02};
  for (std::size_t i = 0; i < wanted.size(); ++i) EXPECT_NEAR(corrected[i], wanted[i], 1e-12);
  EXPECT_TRUE(holm({}).empty());
  EXPECT_EQ(pairs_needed(100, 0.01), 15U);
  EXPECT_LE(100 * std::pow(2.0, 1 - 15), 0.01);
  EXPECT_GT(100 * std::pow(2.0, 1 - 14), 0.01);
}

TEST(SignedRank, CallsNoiseAChangeAsOftenAsItSaysAndNoMore) {
  Random random(1);
  int called = 0;
  constexpr int trials = 4'000;
  for (int trial = 0; trial < trials; ++trial) {
    std::vector<double> differences;
    for (int i = 0; i < 30; ++i) differences.push_back(std::tan(3.1 * (random.uniform() - 0.5)));  // far flights, too
    if (signed_rank(differences).p <= 0.05) ++called;
  }
  EXPECT_NEAR(called, trials * 0.05, 4 * std::sqrt(trials * 0.05 * 0.95));
}

}  // namespace
}  // namespace ledgerline::hil::comparing
