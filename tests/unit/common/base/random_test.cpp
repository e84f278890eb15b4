#include "common/base/random.hpp"

#include <gtest/gtest.h>

namespace ledgerline {
namespace {

TEST(Random, IsSplitmix64) {
  // First values of the reference implementation (Vigna, splitmix64.c) for seed 1234567.
  Random random(1234567);
  for (const std::uint64_t expected :
       {6457827717110365317ULL, 3203168211198807973ULL, 9817491932198370423ULL, 4593380528125082431ULL}) {
    EXPECT_EQ(random.next(), expected);
  }
}

TEST(Random, UniformAndNormalHaveTheirMoments) {
  Random random(1);
  double sum = 0, squares = 0, uniform_sum = 0;
  constexpr int n = 100'000;
  for (int i = 0; i < n; ++i) {
    const double x = random.normal(), u = random.uniform();
    ASSERT_TRUE(u >= 0 && u < 1);
    sum += x;
    squares += x * x;
    uniform_sum += u;
  }
  EXPECT_NEAR(sum / n, 0, 0.02);
  EXPECT_NEAR(squares / n, 1, 0.02);
  EXPECT_NEAR(uniform_sum / n, 0.5, 0.01);
}

}  // namespace
}  // namespace ledgerline
