#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/rt/clock.hpp"

namespace ledgerline {

/// The figures that every latency is reported with.
struct Quantiles {
  double p5 = 0, q1 = 0, median = 0, q3 = 0, p95 = 0, p99 = 0, max = 0;
  std::uint64_t count = 0;
};

/// Log-linear histogram of durations from 1 us to about 70 minutes: 64 steps an octave, so a quantile is within 1.6 %.
/// Fixed size, no allocation; one thread at a time. Negative durations count as zero, longer ones as the last bucket.
class Histogram {
 public:
  void add(TimeNs duration) noexcept;
  std::uint64_t count() const noexcept { return count_; }
  /// Duration below which the share `q` (0..1) of the samples lies; 0 when there are none.
  TimeNs quantile(double q) const noexcept;
  TimeNs max() const noexcept { return max_; }
  Quantiles quantiles_ms() const noexcept;

 private:
  static constexpr int steps = 64;
  static constexpr int octaves = 32;
  static int bucket_of(std::uint64_t us) noexcept;
  static std::uint64_t middle_us(int bucket) noexcept;

  std::array<std::uint64_t, steps * octaves> buckets_{};
  std::uint64_t count_ = 0;
  TimeNs max_ = 0;
};

/// Of samples that are all kept, at least one: that of nearest rank, q from 0 (the lowest) to 1 (the highest), halfway
/// between two the higher one. Reorders them.
template <typename Iterator>
auto quantile(Iterator first, Iterator last, double q) {
  const auto at = first + std::lround(std::clamp(q, 0.0, 1.0) * static_cast<double>(last - first - 1));
  std::nth_element(first, at, last);
  return *at;
}

/// Of few repetitions: halfway between two it is their mean. 0 of none.
inline double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return (values[(n - 1) / 2] + values[n / 2]) / 2;
}

/// For people's eyes: 1/1000 of the unit, or what `per_unit` says.
inline double rounded(double value, double per_unit = 1000) { return std::round(value * per_unit) / per_unit; }

/// For nlohmann::json, which finds it by name: `json{{"two_way_ms", quantiles}}`. Rounded to the histogram's 1 us.
template <typename Json>
void to_json(Json& out, const Quantiles& q) {
  out = {{"p5", rounded(q.p5)},   {"q1", rounded(q.q1)},   {"median", rounded(q.median)}, {"q3", rounded(q.q3)},
         {"p95", rounded(q.p95)}, {"p99", rounded(q.p99)}, {"max", rounded(q.max)},       {"count", q.count}};
}

}  // namespace ledgerline
