#include "onboard/link/core/watch/flow_watch.hpp"

#include <algorithm>

namespace ledgerline::link {

void FlowWatch::take(TimeNs now, const TelloState& state, double expected_mps) noexcept {
  constexpr TimeNs max_step_ns = 200 * ns_per_ms;  // a gap of texts says nothing
  const TimeNs step_ns = text_ns_ == 0 ? 0 : std::min(now - text_ns_, max_step_ns);
  text_ns_ = now;
  if (state.velocity_dmps[0] != 0 || state.velocity_dmps[1] != 0) {
    unseen_ns_ = 0;
  } else if (expected_mps > moving_mps) {
    unseen_ns_ += step_ns;
  }
}

}  // namespace ledgerline::link
