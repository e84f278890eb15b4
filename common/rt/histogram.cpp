#include "common/rt/histogram.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace ledgerline {

// Buckets 0..63 hold 0..63 us one by one; from there every octave [2^k, 2^(k+1)) is cut into 64 equal steps.
int Histogram::bucket_of(std::uint64_t us) noexcept {
  if (us < steps) return static_cast<int>(us);
  const int octave = static_cast<int>(std::bit_width(us)) - 7;  // 64..127 -> 0
  const int step = static_cast<int>(us >> octave) - steps;
  return std::min((octave + 1) * steps + step, steps * octaves - 1);
}

std::uint64_t Histogram::middle_us(int bucket) noexcept {
  if (bucket < steps) return static_cast<std::uint64_t>(bucket);
  const int octave = bucket / steps - 1;
  const auto low = static_cast<std::uint64_t>(bucket % steps + steps) << octave;
  return low + ((1ULL << octave) >> 1);
}

void Histogram::add(TimeNs duration) noexcept {
  duration = std::max<TimeNs>(duration, 0);
  ++buckets_[static_cast<std::size_t>(bucket_of(static_cast<std::uint64_t>(duration / ns_per_us)))];
  ++count_;
  max_ = std::max(max_, duration);
}

TimeNs Histogram::quantile(double q) const noexcept {
  if (count_ == 0) return 0;
  const auto wanted =
      std::max<std::uint64_t>(1, static_cast<std::uint64_t>(std::ceil(q * static_cast<double>(count_))));
  std::uint64_t seen = 0;
  for (int b = 0; b < steps * octaves; ++b) {
    seen += buckets_[static_cast<std::size_t>(b)];
    if (seen >= wanted) return std::min(static_cast<TimeNs>(middle_us(b)) * ns_per_us, max_);
  }
  return max_;
}

Quantiles Histogram::quantiles_ms() const noexcept {
  return {to_ms(quantile(0.05)), to_ms(quantile(0.25)), to_ms(quantile(0.5)), to_ms(quantile(0.75)),
          to_ms(quantile(0.95)), to_ms(quantile(0.99)), to_ms(max_),          count_};
}

}  // namespace ledgerline
