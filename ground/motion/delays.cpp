#include "ground/motion/delays.hpp"

#include <algorithm>
#include <vector>

#include "common/rt/histogram.hpp"

namespace ledgerline::motion {

void Window::add(TimeNs t_ns) { samples_[count_++ % kept] = t_ns; }

std::optional<TimeNs> Window::quantile(double q) const {
  if (count_ == 0) return std::nullopt;
  auto samples = samples_;
  return ledgerline::quantile(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(size()), q);
}

void RoundTripEstimate::add(TimeNs submission_to_block_ns) { ways_.add(std::max<TimeNs>(0, submission_to_block_ns)); }

TimeNs RoundTripEstimate::quantile(double q) const {
  const std::size_t n = ways_.size();
  if (n == 0) return unknown_ns;
  const auto& ways = ways_.samples();
  std::vector<TimeNs> sums;
  sums.reserve(n * n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < n; ++k) sums.push_back(ways[i] + ways[k]);
  }
  return ledgerline::quantile(sums.begin(), sums.end(), q);
}

}  // namespace ledgerline::motion
