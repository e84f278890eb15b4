#include "tools/tello/core/calibrate/estimate.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

namespace ledgerline::tello {
namespace {

constexpr double pose_window_s = 0.04;  // 0.5 mm of noise is 18 mm/s then, and a lag of 0.1 s is still seen
constexpr double yaw_window_s = 0.2;    // of whole degrees in state text, ten times a second
constexpr double rise_window_s = 0.3;   // of whole centimetres
constexpr double tilt_window_s = 0.1;
constexpr std::size_t min_samples = 25;  // a turn through a right angle has fewer where there is state text alone
constexpr double min_correlation = 0.3;  // of tilt and acceleration; a flight of noise alone has below 0.1
constexpr double clear = 0.25;           // squares of one frame of vg by those of the other, at most
constexpr double quarter = std::numbers::pi / 2;

int sign_of(double x) { return x < 0 ? -1 : 1; }
double radians(float deg) { return static_cast<double>(deg) * std::numbers::pi / 180; }

/// A block and what was measured meanwhile, all in seconds since the flight's first rc.
struct CommandBlock {
  int channel = 0;
  Stretch stretch;
  std::vector<const TelloStateSample*> states;
  std::vector<const PoseSample*> poses;
};

class Times {
 public:
  explicit Times(TimeNs zero) : zero_(zero) {}
  double s(TimeNs t) const { return to_seconds(t - zero_); }

 private:
  TimeNs zero_;
};

std::vector<CommandBlock> blocks_of(const Record& record, const Times& times) {
  std::vector<CommandBlock> out;
  for (const RcBlock& block : record.blocks) {
    CommandBlock flown;
    flown.channel = block.channel;
    flown.stretch.end_s = times.s(block.end_ns);
    for (const SentRc& sent : record.sent_rc)
      if (sent.sent_ns >= block.begin_ns && sent.sent_ns < block.end_ns)
        flown.stretch.steps.push_back(
            {times.s(sent.sent_ns), sent.rc[static_cast<std::size_t>(block.channel)] / 100.0});
    for (const TelloStateSample& state : record.states)
      if (state.came_ns >= block.begin_ns && state.came_ns < block.end_ns) flown.states.push_back(&state);
    for (const PoseSample& pose : record.poses)
      if (pose.stamp_ns >= block.begin_ns && pose.stamp_ns < block.end_ns) flown.poses.push_back(&pose);
    if (!flown.stretch.steps.empty()) out.push_back(std::move(flown));
  }
  return out;
}

/// Mean velocities between samples that are `window_s` apart or a little more. `moved`: from one sample to another.
template <typename Sample, typename Time, typename Moved>
std::vector<Measured> windows(const std::vector<const Sample*>& samples, double window_s, Time time, Moved moved) {
  std::vector<Measured> out;
  const Sample* from = nullptr;
  for (const Sample* sample : samples) {
    if (from != nullptr && time(*sample) - time(*from) < window_s - 1e-3) continue;
    if (from != nullptr && time(*sample) - time(*from) < 2 * window_s)
      out.push_back({time(*from), time(*sample), moved(*from, *sample) / (time(*sample) - time(*from))});
    from = sample;
  }
  return out;
}

std::vector<Measured> posed(const CommandBlock& flown, const Times& times, std::size_t axis) {
  return windows(
      flown.poses, pose_window_s, [&](const PoseSample& p) { return times.s(p.stamp_ns); },
      [&](const PoseSample& a, const PoseSample& b) { return b.position_m[axis] - a.position_m[axis]; });
}

std::vector<Measured> reported_velocity(const CommandBlock& flown, const Times& times, std::size_t axis) {
  std::vector<Measured> out;
  for (const TelloStateSample* sample : flown.states)
    if (sample->state.has_velocity)
      out.push_back({times.s(sample->came_ns), times.s(sample->came_ns),
                     static_cast<double>(sample->state.velocity_dmps[axis]) / 10});
  return out;
}

std::vector<Measured> turning(const CommandBlock& flown, const Times& times, bool poses) {
  const double whole = 2 * std::numbers::pi;
  if (poses)
    return windows(
        flown.poses, pose_window_s, [&](const PoseSample& p) { return times.s(p.stamp_ns); },
        [&](const PoseSample& a, const PoseSample& b) { return std::remainder(b.yaw_rad - a.yaw_rad, whole); });
  return windows(
      flown.states, yaw_window_s, [&](const TelloStateSample& s) { return times.s(s.came_ns); },
      [&](const TelloStateSample& a, const TelloStateSample& b) {
        return std::remainder(radians(a.state.attitude_deg[2]) - radians(b.state.attitude_deg[2]), whole);
      });
}

std::vector<Measured> rising(const CommandBlock& flown, const Times& times) {
  return windows(
      flown.states, rise_window_s, [&](const TelloStateSample& s) { return times.s(s.came_ns); },
      [&](const TelloStateSample& a, const TelloStateSample& b) {
        return static_cast<double>(height_of(b.state) - height_of(a.state));
      });
}

Estimate mean_of(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double value : values) sum += value;
  const auto n = static_cast<double>(values.size());
  for (const double value : values) squares += (value - sum / n) * (value - sum / n);
  return {sum / n, values.size() < 2 ? 0 : std::sqrt(squares / (n - 1) / n)};
}

/// Of angles that lie together.
Estimate mean_angle(const std::vector<double>& angles) {
  std::vector<double> away;
  for (const double angle : angles) away.push_back(std::remainder(angle - angles.front(), 2 * std::numbers::pi));
  Estimate mean = mean_of(away);
  mean.value = std::remainder(mean.value + angles.front(), 2 * std::numbers::pi);
  return mean;
}

class Estimator {
 public:
  explicit Estimator(const Record& record)
      : times_(record.sent_rc.front().sent_ns), blocks_(blocks_of(record, times_)) {
    out_.poses = !record.poses.empty();
  }

  Result<Calibration> run() {
    for (const auto& step :
         {&Estimator::along, &Estimator::up_and_down, &Estimator::turns, &Estimator::tilts, &Estimator::reported_frame})
      if (Status status = (this->*step)(); !status) return status.error();
    if (out_.poses) {
      nose();
      out_.velocity = fit_velocity(velocity_blocks());
    }
    return out_;
  }

 private:
  std::vector<const CommandBlock*> of(std::initializer_list<int> channels) const {
    std::vector<const CommandBlock*> out;
    for (const CommandBlock& flown : blocks_)
      for (const int channel : channels)
        if (flown.channel == channel) out.push_back(&flown);
    return out;
  }

  static Status answering(std::vector<Stretch> stretches, const char* what, Answering& out, Fit& fit) {
    // One step alone, as a turn's, does not distinguish a gain from a bias.
    std::erase_if(stretches, [](const Stretch& s) { return s.steps.size() < 2 || s.axes[0].size() < min_samples; });
    const auto fitted = fit_response(stretches);
    if (!fitted)
      return Error{
          fmt::format("how it answers rc {} is not seen: it has too few samples, or answers otherwise than a "
                      "first order with a lag up to 1 s and a dead time up to 0.4 s",
                      what)};
    fit = *fitted;
    std::vector<double> scales;
    for (const auto& gain : fit.gains) scales.push_back(std::hypot(gain[0], gain[1]));
    out = {mean_of(scales), {fit.lag_s, fit.lag_sigma_s}, {fit.dead_s, fit.dead_sigma_s}};
    return done;
  }

  Status along() {
    std::vector<Stretch> stretches;
    for (const CommandBlock* flown : of({right, forward})) {
      stretches.push_back(flown->stretch);
      for (const std::size_t axis : {0, 1})
        stretches.back().axes.push_back(out_.poses ? posed(*flown, times_, axis)
                                                   : reported_velocity(*flown, times_, axis));
    }
    const std::size_t all = stretches.size();
    if (auto status = answering(std::move(stretches), "a and b (left and forward)", out_.along, along_); !status)
      return status;
    if (along_.gains.size() != all) return Error{"samples are missing while it flew forward or to the side"};
    return done;
  }

  Status up_and_down() {
    std::vector<Stretch> stretches;
    for (const CommandBlock* flown : of({up})) {
      stretches.push_back(flown->stretch);
      stretches.back().axes.push_back(out_.poses ? posed(*flown, times_, 2) : reported_velocity(*flown, times_, 2));
    }
    Fit fit;
    if (auto status = answering(std::move(stretches), "c (up)", out_.up, fit); !status) return status;
    double rise = 0, reported = 0;
    for (const CommandBlock* flown : of({up})) {
      rise += gain_of(flown->stretch, out_.poses ? posed(*flown, times_, 2) : rising(*flown, times_), fit.lag_s,
                      fit.dead_s);
      reported += gain_of(flown->stretch, reported_velocity(*flown, times_, 2), fit.lag_s, fit.dead_s);
    }
    out_.rc_signs[2] = sign_of(rise);
    out_.velocity_signs[2] = sign_of(reported * rise);
    return done;
  }

  Status turns() {
    std::vector<Stretch> stretches;
    for (const CommandBlock* flown : of({clockwise})) {
      stretches.push_back(flown->stretch);
      stretches.back().axes.push_back(turning(*flown, times_, out_.poses));
    }
    Fit fit;
    if (auto status = answering(std::move(stretches), "d (yaw)", out_.turning, fit); !status) return status;
    double sum = 0;
    for (const auto& gain : fit.gains) sum += gain[0];
    out_.rc_signs[3] = sign_of(sum);
    return done;
  }

  // It tilts towards where it speeds up: pitch (up positive) falls for forward, roll (right positive) for left.
  Status tilts() {
    for (const int channel : {right, forward}) {
      double product = 0, tilts = 0, changes = 0;
      for (const CommandBlock* flown : of({channel})) {
        std::vector<Measured> around;
        for (const TelloStateSample* s : flown->states)
          around.push_back({times_.s(s->came_ns) - tilt_window_s / 2, times_.s(s->came_ns) + tilt_window_s / 2, 0});
        const auto change = changes_of(flown->stretch, around, along_.lag_s, along_.dead_s);
        for (std::size_t i = 0; i < change.size(); ++i) {
          const double tilt = -radians(flown->states[i]->state.attitude_deg[channel == forward ? 1 : 0]);
          product += tilt * change[i];
          tilts += tilt * tilt;
          changes += change[i] * change[i];
        }
      }
      const double correlation = product / std::sqrt(std::max(1e-12, tilts * changes));
      if (std::abs(correlation) < min_correlation)
        return Error{fmt::format("its tilt does not show which way rc {} leads", channel == forward ? 'b' : 'a')};
      out_.rc_signs[static_cast<std::size_t>(channel)] = sign_of(correlation);
    }
    return done;
  }

  /// Counter-clockwise from the nose, where a positive rc of this channel leads.
  double leads_rad(int channel) const {
    if (channel == forward) return out_.rc_signs[1] > 0 ? 0 : std::numbers::pi;
    return out_.rc_signs[0] > 0 ? quarter : -quarter;
  }

  static double heading_rad(const CommandBlock& flown) {  // since power on
    std::vector<double> yaws;
    for (const TelloStateSample* s : flown.states) yaws.push_back(-radians(s->state.attitude_deg[2]));
    return mean_angle(yaws).value;
  }

  Status reported_frame() {
    std::array<double, 2> best{1e9, 1e9};  // of the frame at power on, of the body's
    std::array<std::array<int, 2>, 2> signs{};
    for (const int frame : {0, 1})
      for (const int sx : {1, -1})
        for (const int sy : {1, -1}) {
          // Their scale is another matter: only the directions of the gains are compared.
          double all = 0, along = 0, blocks = 0;
          for (const CommandBlock* flown : of({right, forward})) {
            const double way = leads_rad(flown->channel) + (frame == 0 ? heading_rad(*flown) : 0);
            const double gx =
                gain_of(flown->stretch, reported_velocity(*flown, times_, 0), along_.lag_s, along_.dead_s);
            const double gy =
                gain_of(flown->stretch, reported_velocity(*flown, times_, 1), along_.lag_s, along_.dead_s);
            all += gx * gx + gy * gy;
            along += sx * gx * std::cos(way) + sy * gy * std::sin(way);
            ++blocks;
          }
          const double squares = all - std::pow(std::max(0.0, along), 2) / blocks;
          const auto f = static_cast<std::size_t>(frame);
          if (squares < best[f]) {
            best[f] = squares;
            signs[f] = {sx, sy};
          }
        }
    out_.velocity_in_body = best[1] < best[0];
    const std::size_t chosen = out_.velocity_in_body ? 1 : 0;
    if (!(best[chosen] < clear * best[1 - chosen]))  // of a drone that reported nothing both are 0
      return Error{"vgx and vgy fit neither the frame at power on nor one that turns with the drone"};
    out_.velocity_signs[0] = signs[chosen][0];
    out_.velocity_signs[1] = signs[chosen][1];
    return done;
  }

  void nose() {
    std::vector<double> noses, power_on;
    std::size_t i = 0;
    for (const CommandBlock* flown : of({right, forward})) {
      std::vector<double> yaws;
      for (const PoseSample* pose : flown->poses) yaws.push_back(pose->yaw_rad);
      const double yaw = mean_angle(yaws).value;
      const auto& gain = along_.gains[i++];
      const double nose = std::atan2(gain[1], gain[0]) - leads_rad(flown->channel);  // in the source's frame
      noses.push_back(nose - yaw);
      power_on.push_back(nose - heading_rad(*flown));
    }
    out_.nose_rad = mean_angle(noses);
    out_.power_on_rad = mean_angle(power_on);
  }

  /// In the frame at power on, by the signs and the frame that were found.
  std::complex<double> reported_mps(const link::TelloState& state) const {
    const std::complex<double> reported(out_.velocity_signs[0] * static_cast<double>(state.velocity_dmps[0]) / 10,
                                        out_.velocity_signs[1] * static_cast<double>(state.velocity_dmps[1]) / 10);
    return out_.velocity_in_body ? reported * std::polar(1.0, -radians(state.attitude_deg[2])) : reported;
  }

  std::vector<VelocityBlock> velocity_blocks() const {
    std::vector<VelocityBlock> out;
    for (const CommandBlock* flown : of({right, forward})) {
      VelocityBlock& block = out.emplace_back();
      for (const PoseSample* pose : flown->poses)
        block.positions.push_back({times_.s(pose->stamp_ns), {pose->position_m[0], pose->position_m[1]}});
      for (const TelloStateSample* text : flown->states)
        if (text->state.has_velocity) block.reported.push_back({times_.s(text->came_ns), reported_mps(text->state)});
    }
    return out;
  }

  Calibration out_;
  Times times_;
  std::vector<CommandBlock> blocks_;
  Fit along_;
};

}  // namespace

Result<Calibration> estimate(const Record& record) {
  if (record.sent_rc.empty()) return Error{"nothing was flown"};
  return Estimator(record).run();
}

}  // namespace ledgerline::tello
