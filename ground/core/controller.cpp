#include "ground/core/controller.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>
#include <utility>

namespace ledgerline::ground {
namespace {

constexpr double peaks = 3;               // of the prediction's error over its rms
constexpr double gain_by_age = 1.6;       // position gain times age at application, at most
constexpr double short_way_m = 0.1;       // over less, gusts and noise hide the model's error
constexpr double gusts_m = 0.015;         // of a prediction's error is no model's fault
constexpr double forget = 1 - 1.0 / 100;  // of predictions: about three seconds
constexpr std::size_t expected_kept = 512;
constexpr TimeNs plain_apart_ns = 500 * ns_per_ms;  // link holds the last setpoint of a plan so long
constexpr int plain_setpoints = 4;

double wrap(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

motion::PredictorConfig predictor_of(const ControllerConfig& config) {
  motion::PredictorConfig predictor;
  // The configured lag of a drone is its whole delay; a third of that goes into leaning over.
  const double dead_s = config.lag_s / 3;
  predictor.first.dead_s = dead_s;
  predictor.first.lag_s = config.lag_s - dead_s;
  predictor.sent_acceleration_mps2 = config.max_acceleration_mps2;
  return predictor;
}

}  // namespace

motion::TrackLimits track_limits(const ControllerConfig& config) {
  motion::TrackLimits limits;
  limits.full_scale_mps = config.full_scale_mps;
  limits.lag_s = config.lag_s;
  limits.vertical_mps = 0.8 * config.max_vertical_mps;
  return limits;
}

Result<Ramp> ramp_from(const std::string& text) {
  const auto number = [](std::string_view cell, double& out) {
    const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), out);
    return error == std::errc{} && end == cell.data() + cell.size();
  };
  const std::string_view whole = text;
  const auto colon = whole.find(':');
  Ramp ramp;
  if (colon == std::string_view::npos || !number(whole.substr(0, colon), ramp.start_mps) ||
      !number(whole.substr(colon + 1), ramp.step_mps) || !(ramp.start_mps >= 0.05 && ramp.start_mps <= 8) ||
      !(ramp.step_mps >= 0 && ramp.step_mps <= 2)) {
    return Error{"\"" + text + "\" is no START:STEP in m/s, such as 0.5:0.1 (0.05 to 8, 0 to 2)"};
  }
  return ramp;
}

void PredictionError::expect(TimeNs at_ns, const Eigen::Vector2d& position_m) {
  if (!expected_.empty() && at_ns <= expected_.back().at_ns) return;
  expected_.push_back({at_ns, position_m, last_.position_m.head<2>()});
  if (expected_.size() > expected_kept) expected_.pop_front();
}

void PredictionError::observe(const Motion& state) {
  while (!expected_.empty() && expected_.front().at_ns <= state.stamp_ns) {
    const Expected expected = expected_.front();
    expected_.pop_front();
    const double ago_s = to_seconds(state.stamp_ns - expected.at_ns);
    if (ago_s > 0.2) continue;  // behind a gap nobody knows where it was then
    const Eigen::Vector2d was = state.position_m.head<2>() - ago_s * state.velocity_mps.head<2>();
    const double way_m = (was - expected.from_m).norm();
    if (way_m < short_way_m) continue;
    const double error_m2 = std::max(0.0, (was - expected.position_m).squaredNorm() - gusts_m * gusts_m);
    errors_m2_ = forget * errors_m2_ + error_m2;
    ways_m2_ = forget * ways_m2_ + way_m * way_m;
  }
  last_ = state;
}

double PredictionError::share() const {
  constexpr double prior_m2 = 0.5;  // metres of way, squared, until what was seen weighs as much as not knowing
  const double mean = (errors_m2_ + unknown * unknown * prior_m2) / (ways_m2_ + prior_m2);
  return std::max(least, std::sqrt(mean));
}

DroneModel::DroneModel(const ControllerConfig& config) : predictor(predictor_of(config)) {}

PathController::PathController(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin,
                               ControllerConfig config, double yaw_rad, std::shared_ptr<DroneModel> model)
    : config_(config),
      path_(waypoints, origin),
      track_(waypoints, origin, config.height_m, track_limits(config)),
      yaw_rad_(yaw_rad),
      model_(model ? std::move(model) : std::make_shared<DroneModel>(config)),
      position_gain_(config.position_gain) {}

void PathController::start(TimeNs from_ns, double end_m) {
  started_ = true;
  end_m_ = end_m;
  reference_ns_ = from_ns;
}

void PathController::observe(const StateSample& state) {
  if (state.stamp_ns <= raw_stamp_ns_) return;
  raw_stamp_ns_ = state.stamp_ns;
  waits_ = state.mode == FailsafeMode::brake || state.stamp_ns - state.pose_stamp_ns > config_.pose_lost_ns;
  model_->predictor.observe(state);
  if (state.pose_stamp_ns <= raw_.stamp_ns) return;
  raw_.stamp_ns = state.pose_stamp_ns;
  raw_.position_m = Eigen::Vector3d::Map(state.position_m.data());
  raw_.velocity_mps = Eigen::Vector3d::Map(state.velocity_mps.data());
  raw_.yaw_rad = state.yaw_rad;
  model_->error.observe(model_->predictor.newest());
}

double PathController::requested_mps(double s_m) const {
  if (config_.ramp.start_mps <= 0) return config_.speed_mps;
  return config_.ramp.start_mps + config_.ramp.step_mps * std::floor(std::max(0.0, s_m) / lap_m() + 1e-9);
}

double PathController::expected_s(int laps) const {
  const double slowest = std::min(requested_mps(0), slowed_to_mps_.value_or(limit_mps_));
  return laps * track_.lap_s(slowest);
}

double PathController::speed_at(double s_m) const {
  const double max_mps =
      std::min({requested_mps(s_m), limit_mps_, config_.full_scale_mps * model_->predictor.response().gain});
  return std::min({track_.speed_at(s_m), max_mps, motion::from_rest_to_rest_mps(s_m, end_m_)});
}

// The share of its speed that the reference moves with: whole up to half the leash, none at its end. For a drone that
// is ahead it need not wait; for one that link keeps from flying plans it does.
double PathController::pace(double s_m, const Eigen::Vector2d& drone) const {
  if (!started_ || waits_ || s_m >= end_m_) return 0;
  const motion::Track::Point place = track_.at(s_m);
  const Eigen::Vector2d direction = place.direction.head<2>();
  Eigen::Vector2d behind = place.position_m.head<2>() - drone;
  if (const double along = behind.dot(direction); along < 0) behind -= along * direction;
  return std::clamp(2.0 - 2.0 * behind.norm() / config_.leash_m, 0.0, 1.0);
}

double PathController::advance(double s_m, const Eigen::Vector2d& drone, double dt_s) const {
  return std::min(std::max(s_m, end_m_), s_m + pace(s_m, drone) * speed_at(s_m) * dt_s);
}

// Height and yaw alone.
Setpoint PathController::level(const Motion& from, double height_m, double climb_mps) const {
  const double vertical = std::clamp(climb_mps + config_.height_gain * (height_m - from.position_m.z()),
                                     -config_.max_vertical_mps, config_.max_vertical_mps);
  const double yaw_rate = std::clamp(config_.yaw_gain * wrap(yaw_rad_ - from.yaw_rad), -config_.max_yaw_rate_radps,
                                     config_.max_yaw_rate_radps);
  Setpoint setpoint;
  setpoint.velocity_mps[2] = static_cast<float>(vertical);
  setpoint.yaw_rate_radps = static_cast<float>(yaw_rate);
  return setpoint;
}

PathController::Wanted PathController::wanted_at(double s_m, const Eigen::Vector2d& drone) const {
  const motion::Track::Point place = track_.at(s_m);
  const Eigen::Vector2d direction = place.direction.head<2>();
  Wanted wanted{.position_m = place.position_m};
  // A reference that waits has no velocity: with it the drone would come to rest beside a reference that waits for it.
  if (const double share = pace(s_m, drone); share > 0) {
    constexpr double ds_m = 0.01;
    const double speed = share * speed_at(s_m);
    const double gained = speed_at(s_m + ds_m) - speed_at(s_m);
    const double a = motion::TrackLimits{}.acceleration_mps2;
    const double along = share * std::clamp(speed * gained / ds_m, -a, a);
    wanted.velocity_mps << speed * direction, speed * place.direction.z();
    wanted.acceleration_mps2 = along * direction + speed * speed * place.bend_per_m;
  }
  return wanted;
}

Setpoint PathController::steer(const Motion& from, double s_m) const {
  const motion::Response& model = model_->predictor.response();
  const Wanted reference = wanted_at(s_m, from.position_m.head<2>());
  const Eigen::Vector2d velocity = reference.velocity_mps.head<2>();
  Eigen::Vector2d wanted = velocity + model.lag_s * reference.acceleration_mps2 +
                           position_gain_ * (reference.position_m.head<2>() - from.position_m.head<2>()) +
                           config_.velocity_gain * (velocity - from.velocity_mps.head<2>());
  wanted = (wanted - model_->predictor.drift_mps().head<2>()) / model.gain;
  const double max_mps = std::min(config_.full_scale_mps, 1.5 * requested_mps(s_m) / model.gain + 0.3);
  if (wanted.norm() > max_mps) wanted *= max_mps / wanted.norm();
  Setpoint setpoint = level(from, reference.position_m.z(), reference.velocity_mps.z());
  setpoint.velocity_mps[0] = static_cast<float>(wanted.x());
  setpoint.velocity_mps[1] = static_cast<float>(wanted.y());
  return setpoint;
}

void PathController::limit(double age_s) {
  position_gain_ = std::min(config_.position_gain, gain_by_age / std::max(0.05, age_s));
  const double limit = config_.allowed_error_m / (peaks * model_->error.share() * std::max(0.05, age_s));
  limit_mps_ = std::max(config_.min_limit_mps, limit);
  if (started_ && !at_end() && limit_mps_ < requested_mps(progress_m_))
    slowed_to_mps_ = std::min(limit_mps_, slowed_to_mps_.value_or(limit_mps_));
}

std::vector<Setpoint> PathController::plan(std::uint64_t id, TimeNs first_ns, std::size_t count) {
  if (!config_.predict) return plan_plain(first_ns);
  motion::Rollout rollout = model_->predictor.until(first_ns);
  limit(to_seconds(rollout.effect().stamp_ns - model_->predictor.newest().stamp_ns));
  if (!waits_) model_->error.expect(rollout.effect().stamp_ns, rollout.effect().position_m.head<2>());

  reference_ns_ = started_ ? std::max(reference_ns_, first_ns - max_ns) : first_ns;
  while (reference_ns_ < first_ns) {
    const TimeNs dt_ns = std::min(step_ns, first_ns - reference_ns_);
    progress_m_ = advance(progress_m_, rollout.effect().position_m.head<2>(), to_seconds(dt_ns));
    reference_ns_ += dt_ns;
  }

  std::vector<Setpoint> plan;
  double s_m = progress_m_;
  const double dt_s = to_seconds(step_ns);
  for (std::size_t i = 0; i < std::clamp<std::size_t>(count, steps, max_setpoints); ++i) {
    const Motion now = rollout.effect();
    const double next_m = advance(s_m, now.position_m.head<2>(), dt_s);
    // A setpoint is flown over the whole step: its middle is what it is right for.
    Motion middle = now;
    middle.position_m += 0.5 * dt_s * now.velocity_mps;
    Setpoint setpoint = steer(middle, 0.5 * (s_m + next_m));
    setpoint.at_ns = first_ns + static_cast<TimeNs>(i) * step_ns;
    setpoint.has_reference = true;
    const Wanted at_start = wanted_at(s_m, now.position_m.head<2>());
    Eigen::Vector3f::Map(setpoint.reference.position_m.data()) = at_start.position_m.cast<float>();
    Eigen::Vector3f::Map(setpoint.reference.velocity_mps.data()) = at_start.velocity_mps.cast<float>();
    Eigen::Vector2f::Map(setpoint.reference.acceleration_mps2.data()) = at_start.acceleration_mps2.cast<float>();
    plan.push_back(setpoint);
    const Eigen::Vector3d sent(setpoint.velocity_mps[0], setpoint.velocity_mps[1], setpoint.velocity_mps[2]);
    rollout.send(sent, static_cast<double>(setpoint.yaw_rate_radps), rollout.sent_until_ns() + step_ns,
                 config_.max_acceleration_mps2);
    s_m = next_m;
  }
  model_->predictor.sent(id, plan);
  return plan;
}

// What the waypoint allows of the speed asked for; no more, either, than height can follow.
double PathController::plain_mps(double s_m) const {
  const double asked = std::min(requested_mps(s_m), path_.speed_mps(s_m).value_or(requested_mps(s_m)));
  const double climb = std::abs(path_.climb(s_m, config_.height_m));
  return climb > 0 ? std::min(asked, track_limits(config_).vertical_mps / climb) : asked;
}

std::vector<Setpoint> PathController::plan_plain(TimeNs first_ns) {
  reference_ns_ = started_ ? std::max(reference_ns_, first_ns - max_ns) : first_ns;
  if (started_ && !waits_ && first_ns > reference_ns_ && progress_m_ < end_m_) {
    progress_m_ = std::min(end_m_, progress_m_ + plain_mps(progress_m_) * to_seconds(first_ns - reference_ns_));
  }
  reference_ns_ = std::max(reference_ns_, first_ns);
  const bool moving = started_ && !waits_ && progress_m_ < end_m_;
  const Eigen::Vector2d reference =
      moving ? Eigen::Vector2d(plain_mps(progress_m_) * path_.direction(progress_m_)) : Eigen::Vector2d::Zero();
  Eigen::Vector2d wanted = reference + config_.position_gain * (path_.point(progress_m_) - raw_.position_m.head<2>()) +
                           config_.velocity_gain * (reference - raw_.velocity_mps.head<2>());
  const double max_mps = std::min(config_.full_scale_mps, 1.5 * plain_mps(progress_m_) + 0.3);
  if (wanted.norm() > max_mps) wanted *= max_mps / wanted.norm();
  const double climb_mps = moving ? plain_mps(progress_m_) * path_.climb(progress_m_, config_.height_m) : 0;
  Setpoint setpoint = level(raw_, path_.height_m(progress_m_, config_.height_m), climb_mps);
  setpoint.velocity_mps[0] = static_cast<float>(wanted.x());
  setpoint.velocity_mps[1] = static_cast<float>(wanted.y());
  std::vector<Setpoint> plan;
  for (int i = 0; i < plain_setpoints; ++i) {
    setpoint.at_ns = first_ns + i * plain_apart_ns;
    plan.push_back(setpoint);
  }
  return plan;
}

}  // namespace ledgerline::ground
