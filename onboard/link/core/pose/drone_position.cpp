#include "onboard/link/core/pose/drone_position.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

namespace {

// Where motion capture is there too, it says where the drone starts.
OdometrySettings odometry_settings_of(const DroneSettings& drone) noexcept {
  OdometrySettings settings = drone.odometry;
  if (!uses_mocap(drone.source)) return settings;
  settings.start_sigma_m = 100;    // any room
  settings.correction_mps = 1000;  // what jumps is held back behind it, by Failover
  settings.start_sigma_rad = std::numbers::pi;
  return settings;
}

bool finite(const Pose& pose) noexcept {
  return std::all_of(pose.position_m.begin(), pose.position_m.end(), [](double v) { return std::isfinite(v); }) &&
         std::all_of(pose.velocity_mps.begin(), pose.velocity_mps.end(), [](double v) { return std::isfinite(v); }) &&
         std::all_of(pose.variance.begin(), pose.variance.end(), [](float v) { return v >= 0 && std::isfinite(v); }) &&
         std::isfinite(pose.yaw_rad);
}

// What a pad's own place and the camera's look at it are worth together [A].
constexpr double pad_sigma_m = 0.03, pad_sigma_rad = 0.05;
// Motion capture's, carried on to the time of a text [A].
constexpr double mocap_sigma_m = 0.02, mocap_sigma_rad = 0.02;

Odometry::Fix on_map(const PadSettings& pad, const TelloState& state) noexcept {
  const double c = std::cos(pad.yaw_rad), s = std::sin(pad.yaw_rad);
  const double x = static_cast<double>(state.on_pad_m[0]), y = static_cast<double>(state.on_pad_m[1]);
  Odometry::Fix fix{.sigma_m = pad_sigma_m, .sigma_rad = pad_sigma_rad};
  fix.position_m = {pad.position_m[0] + c * x - s * y, pad.position_m[1] + s * x + c * y,
                    pad.position_m[2] + static_cast<double>(state.on_pad_m[2])};
  fix.yaw_rad = pad.yaw_rad - static_cast<double>(state.on_pad_yaw_deg * rad_per_deg);  // reported clockwise
  return fix;
}

// Motion capture as a fix of the own place, as old as a text is.
Odometry::Fix at_text(const Pose& pose, TimeNs now) noexcept {
  Odometry::Fix fix{.sigma_m = mocap_sigma_m, .yaw_rad = pose.yaw_rad, .sigma_rad = mocap_sigma_rad};
  const double seconds = to_seconds(now - pose.stamp_ns);
  for (std::size_t i = 0; i < 3; ++i) fix.position_m[i] = pose.position_m[i] + pose.velocity_mps[i] * seconds;
  return fix;
}

}  // namespace

DronePosition::DronePosition(const DroneSettings& drone, const std::vector<PadSettings>& pads, TimeNs pose_lost_ns)
    : source_(drone.source),
      pose_lost_ns_(pose_lost_ns),
      velocity_known_(drone.velocity_known),
      odometry_(odometry_settings_of(drone)),
      source_check_(pose_lost_ns),
      failover_(drone.odometry_after_ns, drone.odometry.correction_mps),
      pads_(drone.source == PoseSource::pads ? pads : std::vector<PadSettings>{}) {}

void DronePosition::on_state(TimeNs now, const TelloState& state, LinkPhase phase, bool stands,
                             const Velocity& sent) noexcept {
  watch_flow(now, state, phase == LinkPhase::flying, sent);
  drone_yaw_rad_ = static_cast<double>(attitude_rad(state)[2]);
  TelloState usable = state;
  usable.has_velocity = state.has_velocity && !flow_watch_.is_dark();
  odometry_.on_state(now, usable, stands);
  for (const PadSettings& pad : pads_) {
    if (pad.id == state.pad) odometry_.fix(on_map(pad, state));
  }
  if (uses_mocap(source_)) check_sources(now, state, phase == LinkPhase::flying);
  // Who stands while motion capture is missing may be carried away unnoticed.
  const bool stands_in = source_ == PoseSource::mocap_then_tello && failover_.is_missing(now) && is_in_flight(phase);
  if (!uses_mocap(source_) || stands_in) accept(now, odometry_.pose(), is_in_flight(phase));
}

void DronePosition::watch_flow(TimeNs now, const TelloState& state, bool flying, const Velocity& sent) noexcept {
  const Eigen::Vector2d lean =
      Eigen::Rotation2Dd(yaw_rad(now)) * Eigen::Map<const Eigen::Vector2d>(lean_mps2(state).data());
  motion_watch_.set_lean({lean.x(), lean.y()});
  if (!flying) {
    flow_watch_.reset();
  } else if (state.has_velocity) {
    flow_watch_.update(now, state,
                       {.expected = motion_watch_.expected(),
                        .sent_mps = {double(sent.mps[0]), double(sent.mps[1])},
                        .lean_mps2 = {lean.x(), lean.y()}});
  }
}

void DronePosition::on_phase(LinkPhase phase) noexcept {
  motion_watch_.reset();
  if (phase == LinkPhase::flying) moved_m_ = {};
}

TimeNs DronePosition::alone_since_ns(TimeNs now) const noexcept {
  if (!uses_mocap(source_)) return 1;
  const TimeNs stamp_ns = source_ == PoseSource::mocap ? pose_.stamp_ns : mocap_pose_.stamp_ns;
  const TimeNs since_ns = stamp_ns + pose_lost_ns_;
  if (source_ == PoseSource::mocap_then_tello && failover_.is_missing(now)) return std::min(now, since_ns);
  return now > since_ns ? since_ns : 0;
}

TimeNs DronePosition::dark_since_ns(TimeNs now) const noexcept {
  // A blind drone cannot brake by itself. If motion capture shows that it also outruns its commands, ground cannot stop
  // it either: as if motion capture were missing.
  const TimeNs alone_ns = alone_since_ns(now), outruns_ns = motion_watch_.outruns_since_ns();
  const TimeNs unheld_ns = alone_ns == 0 || outruns_ns == 0 ? alone_ns + outruns_ns : std::min(alone_ns, outruns_ns);
  return flow_watch_.is_dark() && unheld_ns != 0 ? std::max(flow_watch_.since_ns(), unheld_ns) : 0;
}

void DronePosition::check_sources(TimeNs now, const TelloState& state, bool flying) noexcept {
  using Sources = SourceCheck::Verdict;
  const Pose& own = odometry_.pose();
  // Less than half of what it should fly by what was sent, or of what is seen: flow that fades (FlowWatch),
  // no contradiction. A frame that creeps is followed, so that its drone flies faster than it is seen to.
  const double expected =
      std::max(motion_watch_.expected_mps(), std::hypot(mocap_pose_.velocity_mps[0], mocap_pose_.velocity_mps[1]));
  const bool fades = expected > FlowWatch::moving_mps && odometry_.velocity_mps().norm() < expected / 2;
  const OwnMotion motion{
      .velocity_mps = odometry_.velocity_mps(),
      .scale_sigma = odometry_.scale_sigma(),
      .lag_s = odometry_.settings().velocity_lag_s,
      .lag_sigma_s = odometry_.settings().velocity_lag_sigma_s,
      .height_m = static_cast<double>(state.height_m),
      .heading_rad = drone_yaw_rad_,
      .barometer_m = state.barometer_m,
      .usable = velocity_known_ && own.stamp_ns == now && !fades,
      .position_m = {own.position_m[0], own.position_m[1]},
      .sigma_m = std::sqrt(static_cast<double>(own.variance[0] + own.variance[1])),
  };
  const Sources before = source_check_.verdict();
  source_check_.on_state(now, motion, mocap_pose_, flying);
  if (before != Sources::unresolved && source_check_.verdict() == Sources::unresolved)
    odometry_.widen(source_check_.off_m());
  const bool fresh = mocap_pose_.stamp_ns != 0 && now - mocap_pose_.stamp_ns <= pose_lost_ns_;
  const bool fixes = source_check_.verdict() == Sources::agree && !failover_.is_missing(now);
  if (fresh && fixes) odometry_.fix(at_text(mocap_pose_, now));
}

void DronePosition::on_pose(TimeNs now, const Pose& pose, bool flies) noexcept {
  if (!uses_mocap(source_) || pose.stamp_ns > now || pose.stamp_ns <= mocap_pose_.stamp_ns || !finite(pose)) return;
  const bool stands_in = uses_odometry(source_);
  if (stands_in && now - pose.stamp_ns > pose_lost_ns_) return;
  if (!source_check_.accepts(pose, flies)) return;
  mocap_pose_ = pose;
  if (stands_in && source_check_.verdict() == SourceCheck::Verdict::unresolved) return;  // the odometry alone
  if (stands_in) failover_.on_mocap(now);
  Pose known = pose;
  const auto off = static_cast<float>(source_check_.off_m());
  for (std::size_t i = 0; i < 2; ++i) known.variance[i] += off * off;
  accept(now, known, flies);
}

bool DronePosition::is_by_odometry() const noexcept {
  return !uses_mocap(source_) || failover_.source() == Failover::Source::own;
}

void DronePosition::accept(TimeNs now, const Pose& pose, bool flies) noexcept {
  if (pose.stamp_ns <= pose_.stamp_ns || pose.stamp_ns > now || !finite(pose)) return;
  pose_ = published_pose_ = pose;
  if (source_ == PoseSource::mocap_then_tello) {
    const auto by = failover_.is_missing(now) ? Failover::Source::own : Failover::Source::mocap;
    published_pose_ = failover_.to_publish(by, pose, flies);
  }
  pose_came_ns_ = now;
  moved_m_ = {};
  drone_yaw_at_pose_rad_ = drone_yaw_rad_;
  motion_watch_.on_pose(now, pose.velocity_mps);
}

// A pose that is missing for long takes the heading along: the drone's own shows how it has turned since.
double DronePosition::yaw_rad(TimeNs now) const noexcept {
  if (now - pose_.stamp_ns <= pose_lost_ns_) return pose_.yaw_rad;
  return pose_.yaw_rad + drone_yaw_rad_ - drone_yaw_at_pose_rad_;
}

void DronePosition::grow_older(TimeNs slept_ns) noexcept {
  const auto age = [&](TimeNs& stamp) { stamp = stamp == 0 ? 0 : std::max<TimeNs>(1, stamp - slept_ns); };
  age(pose_.stamp_ns);
  age(published_pose_.stamp_ns);
  age(mocap_pose_.stamp_ns);
  odometry_.grow_older(slept_ns);
}

void DronePosition::dead_reckon(double seconds, const Velocity& sent) noexcept {
  motion_watch_.on_sent(seconds, sent.mps);
  for (std::size_t i = 0; i < 3; ++i) moved_m_[i] += static_cast<double>(sent.mps[i]) * seconds;
}

std::array<double, 3> DronePosition::position_m() const noexcept {
  std::array<double, 3> position_m{};
  for (std::size_t i = 0; i < 3; ++i) position_m[i] = pose_.position_m[i] + moved_m_[i];
  return position_m;
}

namespace {

// A heading that turns under a controller moves the drone sideways: 10 degrees in a second [A]. Double is felt in the
// path, half takes ten seconds for what a gyroscope drifts by in an hour.
constexpr double correction_radps = 0.17;
// Behind a longer gap nobody flies by the place of before: the drone brakes, and plans end.
constexpr double max_followed_s = 0.5;

Eigen::Vector3d vector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

}  // namespace

Pose Failover::to_publish(Source source, const Pose& pose, bool flies) noexcept {
  const double seconds = std::max(0.0, to_seconds(pose.stamp_ns - published_.stamp_ns));
  if (!flies || source_ == Source::none || seconds > max_followed_s) {
    ahead_m_.setZero();
    ahead_rad_ = 0;
  } else if (source != source_) {
    const Eigen::Vector3d flown_to = vector(published_.position_m) + vector(published_.velocity_mps) * seconds;
    ahead_m_ = flown_to - vector(pose.position_m);
    ahead_rad_ = std::remainder(published_.yaw_rad - pose.yaw_rad, 2 * std::numbers::pi);
  } else {
    const double distance = ahead_m_.norm(), let_in = correction_mps_ * seconds;
    ahead_m_ *= distance > let_in ? 1 - let_in / distance : 0;
    const double turn = correction_radps * seconds;
    ahead_rad_ -= std::clamp(ahead_rad_, -turn, turn);
  }
  source_ = source;
  published_ = pose;
  for (std::size_t i = 0; i < 3; ++i) {
    const double ahead = ahead_m_[static_cast<Eigen::Index>(i)];
    published_.position_m[i] += ahead;
    published_.variance[i] += static_cast<float>(ahead * ahead);
  }
  published_.yaw_rad = std::remainder(published_.yaw_rad + ahead_rad_, 2 * std::numbers::pi);
  published_.variance[3] += static_cast<float>(ahead_rad_ * ahead_rad_);
  return published_;
}

}  // namespace ledgerline::link
