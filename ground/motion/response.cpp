#include "ground/motion/response.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace ledgerline::ground::motion {
namespace {

constexpr TimeNs window_ns = 600 * ns_per_ms;  // from t1 to t2: as long as what is predicted, so that it fits that best
constexpr TimeNs gap_ns = 200 * ns_per_ms;
constexpr std::size_t points_kept = 160;  // a window at 200 states a second, and room
// Memory of about 1,500 samples, two a state: some 25 s of a flight at 30 Hz.
constexpr double forget = 1 - 1.0 / 1'500;
constexpr double excited_mps = 0.08;  // change of the sent velocity that says something
constexpr double first_gain_sigma = 0.5, first_lag_sigma_s = 0.3, first_wind_sigma_mps = 0.05;
constexpr double noise_m = 0.004;    // of a window's way, model's error included
constexpr std::size_t enough = 120;  // samples before the estimate is used
constexpr TimeNs quadrature_ns = 10 * ns_per_ms;

}  // namespace

ResponseEstimator::ResponseEstimator(const Response& first) : response_(first) {
  for (std::size_t i = 0; i < candidates; ++i) {
    // What a dead time leaves out is lag: their sum is what a ramp shows.
    const double dead_s = candidate_step_s * static_cast<double>(i);
    fits_[i].parameters << first.gain, std::max(min_lag_s, first.lag_s + first.dead_s - dead_s), 0, 0;
    fits_[i].covariance.diagonal() << first_gain_sigma * first_gain_sigma, first_lag_sigma_s * first_lag_sigma_s,
        first_wind_sigma_mps * first_wind_sigma_mps, first_wind_sigma_mps * first_wind_sigma_mps;
    fits_[i].covariance /= noise_m * noise_m;
  }
}

void ResponseEstimator::add(TimeNs stamp_ns, const Eigen::Vector2d& position_m,
                            const std::function<Eigen::Vector2d(TimeNs)>& sent) {
  if (!points_.empty() && stamp_ns <= points_.back().stamp_ns) return;
  if (!points_.empty() && stamp_ns - points_.back().stamp_ns > gap_ns) points_.clear();
  points_.push_back({stamp_ns, position_m});
  if (points_.size() > points_kept) points_.pop_front();
  // Velocities are central differences: each end of the window needs a neighbour on both sides.
  while (points_.size() > 4 && points_[points_.size() - 2].stamp_ns - points_[2].stamp_ns >= window_ns)
    points_.pop_front();
  if (points_.size() < 4) return;
  const std::size_t to = points_.size() - 2;
  const TimeNs from_ns = points_[1].stamp_ns, to_ns = points_[to].stamp_ns;
  if (to_ns - from_ns < window_ns) return;
  const auto velocity = [&](std::size_t i) -> Eigen::Vector2d {
    return (points_[i + 1].position_m - points_[i - 1].position_m) /
           to_seconds(points_[i + 1].stamp_ns - points_[i - 1].stamp_ns);
  };
  const Eigen::Vector2d change = velocity(to) - velocity(1);
  // The commanded displacement, from the maximum dead time before the window on, by trapezoids.
  const TimeNs first_ns = from_ns - from_seconds(candidate_step_s * (candidates - 1));
  std::vector<Eigen::Vector2d> way{Eigen::Vector2d::Zero()};
  Eigen::Vector2d before = sent(first_ns), least = before, most = before;
  for (TimeNs t = first_ns + quadrature_ns; t < to_ns + quadrature_ns; t += quadrature_ns) {
    const Eigen::Vector2d u = sent(t);
    way.emplace_back(way.back() + 0.5 * (before + u) * to_seconds(quadrature_ns));
    before = u;
    least = least.cwiseMin(u);
    most = most.cwiseMax(u);
  }
  const auto way_until = [&](TimeNs t) -> Eigen::Vector2d {
    const double cell = static_cast<double>(t - first_ns) / static_cast<double>(quadrature_ns);
    const auto i = std::min(static_cast<std::size_t>(std::max(0.0, cell)), way.size() - 2);
    return way[i] + (cell - static_cast<double>(i)) * (way[i + 1] - way[i]);
  };
  std::array<Eigen::Vector2d, candidates> integrals;
  for (std::size_t c = 0; c < candidates; ++c) {
    const TimeNs dead_ns = from_seconds(candidate_step_s * static_cast<double>(c));
    integrals[c] = way_until(to_ns - dead_ns) - way_until(from_ns - dead_ns);
  }
  if ((most - least).maxCoeff() < excited_mps) return;
  fit(to_seconds(to_ns - from_ns), points_[to].position_m - points_[1].position_m, change, integrals);
  choose();
}

void ResponseEstimator::fit(double span_s, const Eigen::Vector2d& moved, const Eigen::Vector2d& change,
                            const std::array<Eigen::Vector2d, candidates>& sent) {
  for (std::size_t c = 0; c < candidates; ++c) {
    Fit& f = fits_[c];
    for (int axis = 0; axis < 2; ++axis) {
      Vector4 x = Vector4::Zero();
      x[0] = sent[c][axis];
      x[1] = -change[axis];
      x[2 + axis] = span_s;
      const double error = moved[axis] - x.dot(f.parameters);
      const Vector4 px = f.covariance * x;
      const double scale = forget + x.dot(px);
      f.parameters += px / scale * error;
      f.covariance = (f.covariance - px * px.transpose() / scale) / forget;
      // A direction that nothing excites would be forgotten without end.
      if (const double trace = f.covariance.trace(); trace > 1e6) f.covariance *= 1e6 / trace;
      f.parameters[0] = std::clamp(f.parameters[0], min_gain, max_gain);
      f.parameters[1] = std::clamp(f.parameters[1], min_lag_s, max_lag_s);
      f.squares = forget * f.squares + error * error;
      f.weight = forget * f.weight + 1;
    }
  }
  fitted_ += 2;
}

void ResponseEstimator::choose() {
  if (fitted_ < enough) return;
  std::size_t best = 0;
  for (std::size_t c = 1; c < candidates; ++c) {
    if (fits_[c].squares < fits_[best].squares) best = c;
  }
  response_ = {fits_[best].parameters[0], fits_[best].parameters[1], candidate_step_s * static_cast<double>(best)};
  if (best == 0 || best + 1 == candidates) return;
  // Between the candidates: the vertex of the parabola through the three smallest.
  const double before = fits_[best - 1].squares, at = fits_[best].squares, after = fits_[best + 1].squares;
  const double bend = before - 2 * at + after;
  if (bend <= 0) return;
  const double shift = std::clamp(0.5 * (before - after) / bend, -0.5, 0.5);
  const Fit& other = fits_[shift < 0 ? best - 1 : best + 1];
  const double share = std::abs(shift);
  response_.gain += share * (other.parameters[0] - response_.gain);
  response_.lag_s += share * (other.parameters[1] - response_.lag_s);
  response_.dead_s += shift * candidate_step_s;
}

}  // namespace ledgerline::ground::motion
