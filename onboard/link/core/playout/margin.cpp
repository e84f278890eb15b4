#include "onboard/link/core/playout/margin.hpp"

#include <algorithm>

namespace ledgerline::link {
namespace {

constexpr TimeNs look_gap_ns = 100 * ns_per_ms;
constexpr std::size_t min_plans = 32;  // fewer say nothing about a quantile

}  // namespace

void Margin::add(TimeNs now, TimeNs lateness_ns) noexcept {
  lateness_ns_[count_ % lateness_ns_.size()] = lateness_ns;
  ++count_;
  // A burst of plans pays for one look only.
  if (count_ < min_plans || now - target_since_ns_ < look_gap_ns) return;
  target_since_ns_ = now;
  auto sorted = lateness_ns_;
  const std::size_t known = std::min(count_, sorted.size());
  const auto rank = static_cast<std::size_t>(settings_.margin_quantile * static_cast<double>(known - 1));
  std::nth_element(sorted.begin(), sorted.begin() + rank, sorted.begin() + known);
  target_ns_ = std::clamp<TimeNs>(sorted[rank], 0, settings_.max_margin_ns);
}

TimeNs Margin::step(TimeNs now) noexcept {
  const TimeNs passed = std::max<TimeNs>(0, now - last_ns_);
  last_ns_ = now;
  if (margin_ns_ < target_ns_) {
    margin_ns_ = std::min(target_ns_, margin_ns_ + passed / 2);
  } else {
    margin_ns_ = std::max(target_ns_, margin_ns_ - passed / 20);
  }
  return margin_ns_;
}

}  // namespace ledgerline::link
