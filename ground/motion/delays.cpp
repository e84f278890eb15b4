#include "ground/motion/delays.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace ledgerline::motion {

void Window::add(TimeNs t_ns) { samples_[count_++ % kept] = t_ns; }

std::array<TimeNs, Window::kept> Window::sorted() const {
  auto sorted = samples_;
  std::sort(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(size()));
  return sorted;
}

namespace {

std::size_t rank(double q, std::size_t count) {
  return static_cast<std::size_t>(std::lround(std::clamp(q, 0.0, 1.0) * static_cast<double>(count - 1)));
}

}  // namespace

std::optional<TimeNs> Window::quantile(double q) const {
  if (count_ == 0) return std::nullopt;
  return sorted()[rank(q, size())];
}

void TwoWay::add(TimeNs submission_to_block_ns) { ways_.add(std::max<TimeNs>(0, submission_to_block_ns)); }

TimeNs TwoWay::quantile(double q) const {
  const std::size_t n = ways_.size();
  if (n == 0) return unknown_ns;
  const auto ways = ways_.sorted();
  std::vector<TimeNs> sums;
  sums.reserve(n * n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < n; ++k) sums.push_back(ways[i] + ways[k]);
  }
  const auto at = sums.begin() + static_cast<std::ptrdiff_t>(rank(q, sums.size()));
  std::nth_element(sums.begin(), at, sums.end());
  return *at;
}

}  // namespace ledgerline::motion
