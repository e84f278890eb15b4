#include "onboard/link/core/watch/tilt_watch.hpp"

#include <algorithm>
#include <cmath>

#include "onboard/link/core/tello/axes.hpp"
#include "onboard/link/core/watch/held.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs max_text_gap_ns = 500 * ns_per_ms;  // of texts: what was before a longer one says nothing of now
// At rest the accelerometer feels 1 g; a drone that falls or is thrown about feels something else.
constexpr double rest_mg = 1000, rest_within_mg = 250;
// Upright it feels -1000 downward. Half of that is a tilt of 60 degrees, at rest.
constexpr double upright_mg = -500;

}  // namespace

void TiltWatch::take(TimeNs now, const TelloState& state) noexcept {
  if (now - text_ns_ > max_text_gap_ns) tilted_since_ns_ = lies_since_ns_ = 0;
  text_ns_ = now;
  const auto attitude = attitude_rad(state);
  tilt_rad_ = static_cast<double>(std::acos(std::clamp(std::cos(attitude[0]) * std::cos(attitude[1]), -1.0F, 1.0F)));
  const auto& feels = state.acceleration_mg;
  const auto all = static_cast<double>(std::hypot(feels[0], feels[1], feels[2]));
  const bool rests = std::abs(all - rest_mg) < rest_within_mg;
  const bool turned = static_cast<double>(feels[2]) > upright_mg;
  const bool tilted = tilt_rad_ > tilted_rad;
  note_since(now, tilted, tilted_since_ns_);
  note_since(now, tilted && rests && turned, lies_since_ns_);
}

}  // namespace ledgerline::link
