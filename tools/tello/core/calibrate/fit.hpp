#pragma once
#include <array>
#include <optional>
#include <vector>

namespace ledgerline::tello {

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

}  // namespace ledgerline::tello
