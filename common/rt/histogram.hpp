#pragma once
#include <array>
#include <cstdint>

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
  /// All figures in milliseconds.
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

}  // namespace ledgerline
