#include "onboard/link/core/drone_watches.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {

namespace {

constexpr TimeNs max_text_gap_ns = 500 * ns_per_ms;  // of texts: what was before a longer one says nothing of now
// At rest the accelerometer feels 1 g; a drone that falls or is thrown about feels something else.
constexpr double rest_mg = 1000, rest_within_mg = 250;
// Upright it feels -1000 downward. Half of that is a tilt of 60 degrees, at rest.
constexpr double upright_mg = -500;

// A percent more or less is rounding, not a loss.
constexpr double percent = 0.01;
// From one text to the next: a gauge that thinks again, not a rate. Where it lands counts by itself.
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

void DroneWatches::on_state(TimeNs now, const TelloState& state, FlightPhase phase) noexcept {
  tilt.update(now, state);
  heat.update(state, in_flight(phase));
  client.on_text(now);
  if (phase == FlightPhase::flying) {
    battery.update(now, state.battery);
  } else {
    battery.reset();
  }
}

namespace {

constexpr TimeNs max_pose_gap_ns = 500 * ns_per_ms;  // of poses: what was before a longer one says nothing of now
constexpr double at_rest_mps = 0.05;                 // commanded: it is to hover
constexpr double drag_per_s = 0.4;  // in still air, as the simulator's drone; 0.39 to 0.54 (docs/sources.md)

double follow(double seconds, double within_s) noexcept { return 1 - std::exp(-seconds / within_s); }

}  // namespace

double length_without(const std::array<double, 2>& v, const std::array<double, 2>& part) noexcept {
  const double square = part[0] * part[0] + part[1] * part[1];
  const double share = square > 0 ? std::clamp((v[0] * part[0] + v[1] * part[1]) / square, 0.0, 1.0) : 0;
  return std::hypot(v[0] - share * part[0], v[1] - share * part[1]);
}

void MotionWatch::on_sent(double seconds, const std::array<float, 3>& sent_mps) noexcept {
  const double share = follow(seconds, response_s);
  for (std::size_t i = 0; i < 2; ++i) expected_mps_[i] += share * (static_cast<double>(sent_mps[i]) - expected_mps_[i]);
  learn_drift(seconds);
}

void MotionWatch::learn_drift(double seconds) noexcept {
  const double share = follow(seconds, expected_mps() < at_rest_mps ? learns_at_rest_s : learns_s);
  for (std::size_t i = 0; i < 2; ++i) {
    const double against_wind = lean_mps2_[i] - drag_per_s * expected_mps_[i];
    drift_mps_[i] += share * (-response_s * against_wind - drift_mps_[i]);
  }
  const double drift = std::hypot(drift_mps_[0], drift_mps_[1]);
  if (drift <= max_drift_mps) return;
  for (double& part : drift_mps_) part *= max_drift_mps / drift;
}

double MotionWatch::expected_mps() const noexcept { return std::hypot(expected_mps_[0], expected_mps_[1]); }

void MotionWatch::on_pose(TimeNs now, const std::array<double, 3>& velocity_mps) noexcept {
  const TimeNs gap = now - seen_ns_;
  if (gap > max_pose_gap_ns) {
    since_ns_ = outruns_since_ns_ = 0;
    smooth_mps_ = {velocity_mps[0], velocity_mps[1]};
  }
  seen_ns_ = now;
  const double share = follow(to_seconds(std::min(gap, max_pose_gap_ns)), response_s);
  std::array<double, 2> off_mps{};
  for (std::size_t i = 0; i < 2; ++i) {
    smooth_mps_[i] += share * (velocity_mps[i] - smooth_mps_[i]);
    off_mps[i] = smooth_mps_[i] - expected_mps_[i];
  }
  const double limit = std::max(limit_mps, limit_share * expected_mps());
  update_since(now, length_without(off_mps, drift_mps_) > limit, since_ns_);
  const std::array<double, 2> seen_mps{velocity_mps[0], velocity_mps[1]};
  update_since(now, length_without(seen_mps, drift_mps_) > expected_mps() + outrun_mps, outruns_since_ns_);
}

namespace {

constexpr TimeNs max_gap_ns = 350 * ns_per_ms;  // of texts: what was before a longer one is not compared with
constexpr double steady_mps = 0.1;              // a stick that stands still

double part_along(const std::array<double, 2>& v, const std::array<double, 2>& direction) noexcept {
  const double length = std::hypot(direction[0], direction[1]);
  return length > 0 ? (v[0] * direction[0] + v[1] * direction[1]) / length : 0;
}

}  // namespace

void FlowWatch::update(TimeNs now, const TelloState& state, const Inputs& inputs) noexcept {
  const TimeNs step_ns = text_ns_ == 0 ? 0 : now - text_ns_;
  if (step_ns > max_gap_ns) {
    count_ = 0;
    faded_ = 0;
  }
  text_ns_ = now;
  const auto& [response, drift] = inputs.expected;
  // As slow as the wind may make it, or not: where it holds its position it is not drifted.
  const double should_mps = length_without(response, {-drift[0], -drift[1]});
  const double leans_anyway = -part_along(drift, response) / MotionWatch::response_s;
  std::copy_backward(texts_.begin(), texts_.end() - 1, texts_.end());
  texts_[0] = {should_mps, part_along(inputs.lean_mps2, response) - std::max(0.0, leans_anyway), inputs.sent_mps};
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
