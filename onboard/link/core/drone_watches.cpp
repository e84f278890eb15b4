#include "onboard/link/core/drone_watches.hpp"

#include <algorithm>
#include <cmath>

#include "common/rt/since.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs max_text_gap_ns = 500 * ns_per_ms;  // of texts: what was before a longer one says nothing of now
// At rest the accelerometer feels 1 g; a drone that falls or is thrown about feels something else.
constexpr double rest_mg = 1000, rest_within_mg = 250;
// Upright it feels -1000 downward. Half of that is a tilt of 60 degrees, at rest.
constexpr double upright_mg = -500;

// A percent more or less is rounding, not a loss.
constexpr double percent = 0.01;
// A jump between two texts is a gauge correction, not a discharge rate.
constexpr float jump_share = 0.05F;

}  // namespace

void TiltWatch::update(TimeNs now, const TelloState& state) noexcept {
  if (now - text_ns_ > max_text_gap_ns) tilted_since_ns_ = lies_since_ns_ = 0;
  text_ns_ = now;
  const auto attitude = attitude_rad(state);
  tilt_rad_ = static_cast<double>(std::acos(std::clamp(std::cos(attitude[0]) * std::cos(attitude[1]), -1.0F, 1.0F)));
  const auto& feels = state.acceleration_mg;
  const auto all = static_cast<double>(std::hypot(feels[0], feels[1], feels[2]));
  const bool rests = std::abs(all - rest_mg) < rest_within_mg;
  const bool turned = static_cast<double>(feels[2]) > upright_mg;
  const bool tilted = tilt_rad_ > tilted_rad;
  update_since(now, tilted, tilted_since_ns_);
  update_since(now, tilted && rests && turned, lies_since_ns_);
}

void BatteryWatch::update(TimeNs now, float battery) noexcept {
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
  if (seconds > 0 && lost > 2.5 * percent)
    rate_per_s_ = std::max(rate_per_s_, (lost - percent) / std::max(seconds, 1.0));
  if (now - since_ns_ < window_ns) return;
  rate_per_s_ = std::max(0.0, lost - percent) / seconds;
  since_ns_ = now;
  at_since_ = battery;
}

double BatteryWatch::needed(float height_m) const noexcept {
  const double seconds = std::max(0.0, static_cast<double>(height_m)) / landing_mps + landing_takes_s;
  return rate_per_s_ > 0 ? reserve + rate_per_s_ * seconds : 0;
}

void ClientWatch::on_text(TimeNs now) noexcept {
  const bool was_away = text_ns_ != 0 && command_ns_ - text_ns_ > away_ns;
  if (was_away && now - command_ns_ <= at_once_ns) returned_ns_ = {now, returned_ns_[0]};
  text_ns_ = now;
}

void ClientWatch::on_answer(TimeNs now) noexcept {
  if (now - text_ns_ > away_ns && answered_ns_ <= text_ns_) answered_ns_ = now;
}

void DroneWatches::on_state(TimeNs now, const TelloState& state, LinkPhase phase) noexcept {
  tilt.update(now, state);
  heat.update(state, is_in_flight(phase));
  client.on_text(now);
  if (phase == LinkPhase::flying) {
    battery.update(now, state.battery);
  } else {
    battery.reset();
  }
}

}  // namespace ledgerline::link
