#include "onboard/link/core/watch/flow_watch.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {
namespace {

constexpr TimeNs max_gap_ns = 350 * ns_per_ms;  // of texts: what was before a longer one is not compared with
constexpr double steady_mps = 0.1;              // a stick that stands still

double part_along(const std::array<double, 2>& v, const std::array<double, 2>& direction) noexcept {
  const double length = std::hypot(direction[0], direction[1]);
  return length > 0 ? (v[0] * direction[0] + v[1] * direction[1]) / length : 0;
}

}  // namespace

void FlowWatch::update(TimeNs now, const TelloState& state, const Motion& motion) noexcept {
  const TimeNs step_ns = text_ns_ == 0 ? 0 : now - text_ns_;
  if (step_ns > max_gap_ns) {
    count_ = 0;
    faded_ = 0;
  }
  text_ns_ = now;
  const auto& [response, drift] = motion.expected;
  // As slow as the wind may make it, or not: where it holds its position it is not drifted.
  const double should_mps = length_without(response, {-drift[0], -drift[1]});
  const double leans_anyway = -part_along(drift, response) / MotionWatch::response_s;
  std::copy_backward(texts_.begin(), texts_.end() - 1, texts_.end());
  texts_[0] = {should_mps, part_along(motion.lean_mps2, response) - std::max(0.0, leans_anyway), motion.sent_mps};
  count_ = std::min(count_ + 1, kept);

  const double reported = static_cast<double>(std::hypot(state.velocity_dmps[0], state.velocity_dmps[1])) / 10;
  double at_least = should_mps;  // whichever of the last moments the text is of
  for (std::size_t i = 0; i < count_; ++i) at_least = std::min(at_least, texts_[i].should_mps);
  const bool fades = at_least > fading_mps && reported + rounding_mps < fade_share * at_least;
  const bool should_move = std::hypot(response[0], response[1]) > moving_mps;
  faded_ = fades ? faded_ + 1 : 0;
  zeros_ns_ = reported > 0 ? 0 : should_move ? zeros_ns_ + std::min(step_ns, max_gap_ns) : zeros_ns_;

  if (since_ns_ != 0) {
    least_mps_ = std::min(least_mps_, reported);
    if (reported < least_mps_ + sees_again_mps) return;
    since_ns_ = 0;
    faded_ = 0;
    return;
  }
  const double lean = texts_[0].lean_mps2;
  const bool slow = reported + rounding_mps < at_least;
  const bool lost = (fades && (lean > lean_mps2 || faded_ >= fade_texts)) || zeros_ns_ >= zeros_for_ns ||
                    (lasting_lean() && ((slow && lean > far_lean_mps2) || (reported <= 0 && should_move)));
  if (!lost) return;
  since_ns_ = now;
  least_mps_ = reported;
}

bool FlowWatch::lasting_lean() const noexcept {
  if (count_ < 3) return false;
  const Text &newest = texts_[0], &before = texts_[2];
  const double changed = std::hypot(newest.sent_mps[0] - before.sent_mps[0], newest.sent_mps[1] - before.sent_mps[1]);
  return changed < steady_mps && newest.lean_mps2 > lean_mps2 && before.lean_mps2 > lean_mps2 &&
         newest.lean_mps2 > lasting_share * before.lean_mps2;
}

}  // namespace ledgerline::link
