#include "onboard/link/core/watch/battery_watch.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {
namespace {

// A percent more or less is rounding, not a loss.
constexpr double step = 0.01;
// From one text to the next: a gauge that thinks again, not a rate. Where it lands counts by itself.
constexpr float jump_share = 0.05F;

}  // namespace

void BatteryWatch::take(TimeNs now, float battery) noexcept {
  const bool jump = std::abs(newest_ - battery) > jump_share;
  newest_ = battery;
  if (since_ns_ == 0 || battery > at_since_ || jump) {
    since_ns_ = now;
    at_since_ = battery;
    return;
  }
  const double lost = static_cast<double>(at_since_ - battery);
  const double seconds = to_seconds(now - since_ns_);
  // Within the window only what is faster than before counts, and no single step does.
  if (seconds > 0 && lost > 2.5 * step) rate_per_s_ = std::max(rate_per_s_, (lost - step) / std::max(seconds, 1.0));
  if (now - since_ns_ < window_ns) return;
  rate_per_s_ = std::max(0.0, lost - step) / seconds;
  since_ns_ = now;
  at_since_ = battery;
}

double BatteryWatch::needed(float height_m) const noexcept {
  const double seconds = std::max(0.0, static_cast<double>(height_m)) / landing_mps + landing_takes_s;
  return rate_per_s_ > 0 ? reserve + rate_per_s_ * seconds : 0;
}

}  // namespace ledgerline::link
