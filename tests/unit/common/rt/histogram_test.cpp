#include "common/rt/histogram.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/random.hpp"

namespace ledgerline {
namespace {

/// The smallest sample that has the share q of all samples at or below it.
TimeNs exact(const std::vector<TimeNs>& sorted, double q) {
  const auto rank = static_cast<std::size_t>(std::max(1.0, std::ceil(q * static_cast<double>(sorted.size()))));
  return sorted[rank - 1];
}

void expect_close(const Histogram& histogram, std::vector<TimeNs> samples) {
  std::sort(samples.begin(), samples.end());
  for (const double q : {0.001, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999, 1.0}) {
    const auto wanted = static_cast<double>(exact(samples, q));
    // 1.6 % as promised, and a microsecond, which is what is counted in.
    EXPECT_NEAR(static_cast<double>(histogram.quantile(q)), wanted, wanted * 0.016 + 1000) << "q " << q;
  }
  EXPECT_EQ(histogram.max(), samples.back());
  EXPECT_EQ(histogram.count(), samples.size());
}

TEST(Histogram, AgreesWithSortedSamplesFromMicrosecondsToMinutes) {
  Random random(7);
  for (const double spread : {0.3, 1.0, 3.0}) {
    Histogram histogram;
    std::vector<TimeNs> samples;
    for (int i = 0; i < 20'000; ++i) {
      const auto sample = static_cast<TimeNs>(20e6 * std::exp(spread * random.normal()));
      samples.push_back(sample);
      histogram.add(sample);
    }
    expect_close(histogram, samples);
  }
}

TEST(Histogram, EachSampleAloneIsWithinItsPromise) {
  for (TimeNs us = 1; us < 4'000'000'000; us = us + us / 7 + 1) {
    Histogram histogram;
    histogram.add(us * ns_per_us);
    const auto got = static_cast<double>(histogram.quantile(0.5)), wanted = static_cast<double>(us * ns_per_us);
    ASSERT_NEAR(got, wanted, wanted * 0.008) << us << " us";
  }
}

TEST(Histogram, IsMonotonicOverItsBuckets) {
  TimeNs before = 0;
  for (TimeNs us = 0; us < 100'000; ++us) {
    Histogram histogram;
    histogram.add(us * ns_per_us);
    ASSERT_GE(histogram.quantile(1), before) << us;
    before = histogram.quantile(1);
  }
}

TEST(Histogram, EmptyHasZeros) {
  const Histogram histogram;
  EXPECT_EQ(histogram.quantile(0.5), 0);
  EXPECT_EQ(histogram.quantiles_ms().count, 0U);
}

TEST(Histogram, NegativeCountsAsZeroAndHugeAsTheLastBucket) {
  Histogram histogram;
  histogram.add(-5);
  EXPECT_EQ(histogram.quantile(1), 0);
  histogram.add(INT64_MAX);
  EXPECT_EQ(histogram.count(), 2U);
  EXPECT_EQ(histogram.max(), INT64_MAX);
  EXPECT_GT(histogram.quantile(1), 60 * 60 * ns_per_s);
}

TEST(Histogram, FiguresAreInMilliseconds) {
  Histogram histogram;
  for (int ms = 1; ms <= 100; ++ms) histogram.add(ms * ns_per_ms);
  const Quantiles q = histogram.quantiles_ms();
  EXPECT_NEAR(q.p5, 5, 0.1);
  EXPECT_NEAR(q.q1, 25, 0.5);
  EXPECT_NEAR(q.median, 50, 1);
  EXPECT_NEAR(q.q3, 75, 1.5);
  EXPECT_NEAR(q.p95, 95, 1.6);
  EXPECT_NEAR(q.p99, 99, 1.6);
  EXPECT_DOUBLE_EQ(q.max, 100);
  EXPECT_EQ(q.count, 100U);
}

}  // namespace
}  // namespace ledgerline
