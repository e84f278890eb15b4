#pragma once
#include <array>
#include <complex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

/// What a calibration flight leaves behind, everything that the estimates are made from, and the estimates. All times
/// are of one monotonic clock of the computer that flies.
namespace ledgerline::tello {

/// Places in rc.
enum Channel : int { right = 0, forward = 1, up = 2, clockwise = 3 };

/// Above what is below it; where its sensor sees nothing (65.53 m), above where it took off.
inline float height_of(const link::TelloState& state) { return state.tof_m < 10 ? state.tof_m : state.height_m; }

/// From this moment on the drone was sent this: right, forward, up, clockwise by the SDK's words.
struct SentRc {
  TimeNs sent_ns = 0;
  link::Rc rc{};
};

struct TelloStateSample {
  TimeNs came_ns = 0;
  link::TelloState state;
};

struct PoseSample {
  TimeNs stamp_ns = 0;  ///< when it was measured
  std::array<double, 3> position_m{};
  double yaw_rad = 0;  ///< of its orientation: counter-clockwise about z, of x from x
};

/// One channel of rc at work, between two hovers.
struct RcBlock {
  int channel = 0;  ///< of SentRc::rc
  TimeNs begin_ns = 0, end_ns = 0;
};

struct Record {
  std::vector<SentRc> sent_rc;  ///< of the blocks
  std::vector<TelloStateSample> states;
  std::vector<PoseSample> poses;  ///< none: flown without a pose source
  std::vector<RcBlock> blocks;
};

/// A value and its standard deviation.
struct Estimate {
  double value = 0, sigma = 0;
};

/// One piece of flight, in which the drone speeds up, brakes and turns around: what its state texts reported, as x + iy
/// of a frame that stays [m/s], and where a reference saw it meanwhile, of another one [m].
struct VelocityBlock {
  struct Sample {
    double at_s = 0;
    std::complex<double> value;
  };
  std::vector<Sample> reported, positions;
};

/// What makes metres a second of vgx and vgy, as link's odometry applies it ([pose] of link.toml).
struct VelocityFit {
  Estimate scale;          ///< true velocity by reported one
  Estimate lag_s;          ///< the reported velocity is late by that
  bool truncated = false;  ///< cast to whole dm/s, toward zero; else rounded
  Estimate cast;           ///< how much of a cast is in them: 1 is one, 0 rounding
};

/// Least squares of the reported velocity v:
///
///     v = (1 - cast) R(u) + cast C(u), by axis; u = w e^(i turn) / scale + bias
///
/// w is the reference's velocity behind a first order of `lag` (0.02 to 0.6 s; a dead time of tens of ms looks the
/// same), R and C what rounding and a cast make of u on average, with noise of 0.03 m/s, and the bias (a slow error of
/// the flow) each block's own, so that a drift says nothing of the scale. `cast` is fitted first, and is 1 or 0 then.
/// It is v that errs. Gains of v and w behind one lag, without a cast, make a scale that is 6 to 59 % too large, for v
/// is later than w. Standard deviations by leaving out one block after the other (jackknife). Fails, in
/// words, where `cast` is neither, the lag is longer, or the scale has an sd above 5 %. Core.
Result<VelocityFit> fit_velocity(std::vector<VelocityBlock> blocks);

/// The velocity v of one axis answers the share u (-1..1) of rc's full scale by a first order with dead time:
///
///     lag dv/dt = gain u(t - dead) + bias - v
///
/// (Seborg, Edgar, Mellichamp: Process Dynamics and Control, 5.4 and 7.2), as ground's motion::Response has it. Units:
/// seconds, and m/s or rad/s.

/// A mean velocity from `from_s` to `until_s`; the same twice: at that moment.
struct Measured {
  double from_s = 0, until_s = 0, value = 0;
};

/// Commanded u from `at_s` on.
struct Step {
  double at_s = 0, u = 0;
};

/// One stretch of flight in which u was never zero: a Tello whose sticks are centred holds its place by a loop of its
/// own, which is no first order. One or two axes that were measured (x and y of a frame).
struct Stretch {
  std::vector<Step> steps;  ///< the first is where it begins
  double end_s = 0;
  std::vector<std::vector<Measured>> axes;
};

struct Fit {
  double lag_s = 0, dead_s = 0;
  double lag_sigma_s = 0, dead_sigma_s = 0;    ///< by leaving out one stretch after the other (jackknife)
  std::vector<std::array<double, 2>> gains;    ///< of each stretch, by axis; the second is 0 where there is one axis
  std::vector<std::array<double, 2>> at_rest;  ///< of each stretch: the part that u has nothing to do with (bias)
};

/// Least squares: gains, biases and first velocities of all stretches are linear once lag and dead time are given,
/// which are searched for on a grid (dead time to 0.4 s, lag 0.02 to 1 s), a finer one of 10 ms around its best, and
/// then between its points by a parabola. Nothing where a stretch has too few measurements, or the best is at an edge.
/// Core.
std::optional<Fit> fit_response(const std::vector<Stretch>& stretches);

/// The gain alone of one axis, which need not be of those that were fitted.
double gain_of(const Stretch& stretch, const std::vector<Measured>& axis, double lag_s, double dead_s);
/// By how much a unit gain's velocity changes from `from_s` to `until_s` of each.
std::vector<double> changes_of(const Stretch& stretch, const std::vector<Measured>& axis, double lag_s, double dead_s);

/// How one kind of motion answers rc: rc 100 means `full_scale` (m/s, rad/s) ...
struct Answering {
  Estimate full_scale;
  Estimate lag_s, dead_s;  ///< ... by a first order with dead time
};

/// What a calibration flight shows. Frames are REP 103's: forward, left, up, counter-clockwise. Standard deviations are
/// by the spread among the blocks of the flight; what is the same in all of them (the scale of a drone's own flow,
/// without poses) is not in them.
struct Calibration {
  Answering along, up, turning;         ///< forward and left together; up and down; yaw
  std::array<int, 4> rc_signs{};        ///< 1 or -1: rc a, b, c, d against left, forward, up, counter-clockwise
  std::array<int, 3> velocity_signs{};  ///< vgx, vgy, vgz against forward, left, up
  bool velocity_in_body = false;        ///< they turn with the drone; else they are reported in the frame at power on
  bool poses = false;                   ///< velocities are of the pose source; else the drone's own
  /// What vgx and vgy are worth; or why that is not seen. What was sent is no reference: a drone flies by its own flow.
  Result<VelocityFit> velocity = Error{"without poses nothing says how far it really flew"};
  /// With poses: where the nose is in the pose's own frame (counter-clockwise from the x of its orientation), and where
  /// it was in the source's frame at power on [rad].
  std::optional<Estimate> nose_rad, power_on_rad;
};

/// Senses that a frame does not know by itself are taken from the drone's own data, reported with it: forward and
/// left by its tilt (the nose goes down while it speeds up forward), up by height, counter-clockwise by its yaw, or by
/// the poses, where there are any. Fails, in words, where the flight does not show something. Core; takes seconds.
Result<Calibration> estimate(const Record& record);

/// As TOML: [rc] and [pose] for link.toml, [flight] for ground's, each key with how well it is known.
std::string toml(const Calibration& calibration);

}  // namespace ledgerline::tello
