#pragma once
#include <complex>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::tello {

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
/// is later than w. Standard deviations by leaving out one block after the other (jackknife), as in fit.hpp. Fails, in
/// words, where `cast` is neither, the lag is longer, or the scale has an sd above 5 %. Core.
Result<VelocityFit> fit_velocity(std::vector<VelocityBlock> blocks);

}  // namespace ledgerline::tello
