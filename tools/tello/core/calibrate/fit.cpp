#include "tools/tello/core/calibrate/estimate.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace ledgerline::tello {
namespace {

constexpr double min_lag_s = 0.02, max_lag_s = 1.0, max_dead_s = 0.4;
constexpr double coarse_s = 0.04, fine_s = 0.01;
constexpr int fine_points = 8;           // of the fine grid, to each side of the coarse one's best: two of its steps
constexpr double integration_s = 0.005;  // of the model's integration, between whose points it is interpolated
constexpr std::size_t min_measurements = 20;

/// The way that a unit gain goes: values of its integral every walk_s since the stretch began.
class UnitResponse {
 public:
  UnitResponse(const Stretch& stretch, double lag_s, double dead_s) : begin_s_(stretch.steps.front().at_s) {
    const double keep = std::exp(-integration_s / lag_s);
    const auto points = static_cast<std::size_t>(std::max(0.0, stretch.end_s - begin_s_) / integration_s) + 3;
    way_.reserve(points);
    velocity_.reserve(points);
    double v = 0, s = 0;
    std::size_t next = 0;
    double u = 0;
    for (std::size_t k = 0; k < points; ++k) {
      way_.push_back(s);
      velocity_.push_back(v);
      // What arrives within this step acts for its share of it.
      const double end = begin_s_ + integration_s * static_cast<double>(k + 1);
      double mean = u;
      while (next < stretch.steps.size() && stretch.steps[next].at_s + dead_s < end) {
        const double share = std::clamp((end - stretch.steps[next].at_s - dead_s) / integration_s, 0.0, 1.0);
        mean += (stretch.steps[next].u - u) * share;
        u = stretch.steps[next++].u;
      }
      const double after = keep * v + (1 - keep) * mean;
      s += integration_s * mean - lag_s * (after - v);  // the integral of lag dv/dt = u - v
      v = after;
    }
  }
  double mean(const Measured& m) const {
    if (m.until_s > m.from_s) return (at(way_, m.until_s) - at(way_, m.from_s)) / (m.until_s - m.from_s);
    return at(velocity_, m.from_s);
  }

 private:
  double at(const std::vector<double>& values, double t) const {
    const double x = std::clamp((t - begin_s_) / integration_s, 0.0, static_cast<double>(values.size() - 2));
    const auto k = static_cast<std::size_t>(x);
    const double part = x - static_cast<double>(k);
    return values[k] + part * (values[k + 1] - values[k]);
  }
  double begin_s_;
  std::vector<double> way_, velocity_;
};

struct Linear {
  double squares = 0, gain = 0, bias = 0;
};

// Gain, bias and the decay of what it did before, by least squares.
Linear solve(const UnitResponse& unit, const Stretch& stretch, const std::vector<Measured>& axis, double lag_s) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double all = 0;
  for (const Measured& m : axis) {
    const double since = (m.from_s + m.until_s) / 2 - stretch.steps.front().at_s;
    const Eigen::Vector3d row(unit.mean(m), 1, std::exp(-since / lag_s));
    normal += row * row.transpose();
    right += row * m.value;
    all += m.value * m.value;
  }
  normal.diagonal().array() += 1e-9;
  const Eigen::Vector3d solved = normal.ldlt().solve(right);
  return {std::max(0.0, all - solved.dot(right)), solved[0], solved[1]};
}

struct GridPoint {
  double dead_s = 0, lag_s = 0;
};

/// Dead times along the rows, lags along the columns.
struct Grid {
  GridPoint first;
  double step_s = 0;
  Eigen::Index deads = 0, lags = 0;
  GridPoint at(Eigen::Index d, Eigen::Index l) const {
    return {first.dead_s + step_s * static_cast<double>(d), first.lag_s + step_s * static_cast<double>(l)};
  }
};

Grid coarse_grid() {
  return {{0, min_lag_s},
          coarse_s,
          1 + std::lround(max_dead_s / coarse_s),
          1 + std::lround((max_lag_s - min_lag_s) / coarse_s)};
}

Grid fine_grid(const GridPoint& middle) {
  const GridPoint first{std::max(0.0, middle.dead_s - fine_points * fine_s),
                        std::max(min_lag_s, middle.lag_s - fine_points * fine_s)};
  return {first, fine_s, 1 + std::lround((middle.dead_s - first.dead_s) / fine_s) + fine_points,
          1 + std::lround((middle.lag_s - first.lag_s) / fine_s) + fine_points};
}

Eigen::MatrixXd squares_of(const Stretch& stretch, const Grid& grid) {
  Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(grid.deads, grid.lags);
  for (Eigen::Index l = 0; l < grid.lags; ++l)
    for (Eigen::Index d = 0; d < grid.deads; ++d) {
      const GridPoint point = grid.at(d, l);
      const UnitResponse unit(stretch, point.lag_s, point.dead_s);
      for (const auto& axis : stretch.axes) squares(d, l) += solve(unit, stretch, axis, point.lag_s).squares;
    }
  return squares;
}

std::vector<Eigen::MatrixXd> squares_of(const std::vector<Stretch>& stretches, const Grid& grid) {
  std::vector<Eigen::MatrixXd> all;
  for (const Stretch& stretch : stretches) all.push_back(squares_of(stretch, grid));
  return all;
}

Eigen::MatrixXd sum_of(const std::vector<Eigen::MatrixXd>& all) {
  Eigen::MatrixXd sum = all.front();
  for (std::size_t i = 1; i < all.size(); ++i) sum += all[i];
  return sum;
}

// The grid's least, and from there the least of the quadric through its neighbours. A dead time of 0 may be the best.
std::optional<GridPoint> best_of(const Eigen::MatrixXd& squares, const Grid& grid) {
  Eigen::Index d = 0, l = 0;
  squares.minCoeff(&d, &l);
  if (d == grid.deads - 1 || l == 0 || l == grid.lags - 1) return std::nullopt;
  GridPoint best = grid.at(d, l);
  if (d == 0) return grid.first.dead_s == 0 ? std::optional(best) : std::nullopt;
  const double here = squares(d, l);
  const Eigen::Vector2d slope((squares(d + 1, l) - squares(d - 1, l)) / 2, (squares(d, l + 1) - squares(d, l - 1)) / 2);
  Eigen::Matrix2d bend;
  bend(0, 0) = squares(d + 1, l) - 2 * here + squares(d - 1, l);
  bend(1, 1) = squares(d, l + 1) - 2 * here + squares(d, l - 1);
  bend(0, 1) = bend(1, 0) =
      (squares(d + 1, l + 1) - squares(d + 1, l - 1) - squares(d - 1, l + 1) + squares(d - 1, l - 1)) / 4;
  if (bend.determinant() <= 0 || bend(0, 0) <= 0) return best;
  const Eigen::Vector2d away = -bend.inverse() * slope;
  best.dead_s += grid.step_s * std::clamp(away[0], -1.0, 1.0);
  best.lag_s += grid.step_s * std::clamp(away[1], -1.0, 1.0);
  return best;
}

}  // namespace

double gain_of(const Stretch& stretch, const std::vector<Measured>& axis, double lag_s, double dead_s) {
  return solve(UnitResponse(stretch, lag_s, dead_s), stretch, axis, lag_s).gain;
}

std::vector<double> changes_of(const Stretch& stretch, const std::vector<Measured>& axis, double lag_s, double dead_s) {
  const UnitResponse unit(stretch, lag_s, dead_s);
  std::vector<double> out;
  for (const Measured& m : axis)
    out.push_back(unit.mean({m.until_s, m.until_s, 0}) - unit.mean({m.from_s, m.from_s, 0}));
  return out;
}

std::optional<Fit> fit_response(const std::vector<Stretch>& stretches) {
  if (stretches.empty()) return std::nullopt;
  for (const Stretch& stretch : stretches)
    for (const auto& axis : stretch.axes)
      if (axis.size() < min_measurements) return std::nullopt;
  const Grid coarse = coarse_grid();
  const Eigen::MatrixXd first = sum_of(squares_of(stretches, coarse));
  Eigen::Index d = 0, l = 0;
  first.minCoeff(&d, &l);
  const Grid grid = fine_grid(coarse.at(d, l));
  const auto all = squares_of(stretches, grid);
  const Eigen::MatrixXd sum = sum_of(all);
  const auto best = best_of(sum, grid);
  if (!best) return std::nullopt;
  Fit fit;
  fit.dead_s = best->dead_s;
  fit.lag_s = best->lag_s;
  // Errors of one stretch are not independent (gusts, a slow error of its optical flow), those of different ones are.
  double dead_squares = 0, lag_squares = 0;
  for (const Eigen::MatrixXd& one : all) {
    const auto without = best_of(sum - one, grid);
    if (!without) continue;
    dead_squares += (without->dead_s - fit.dead_s) * (without->dead_s - fit.dead_s);
    lag_squares += (without->lag_s - fit.lag_s) * (without->lag_s - fit.lag_s);
  }
  const auto n = static_cast<double>(all.size());
  fit.dead_sigma_s = std::sqrt(dead_squares * (n - 1) / n);
  fit.lag_sigma_s = std::sqrt(lag_squares * (n - 1) / n);
  for (const Stretch& stretch : stretches) {
    const UnitResponse unit(stretch, fit.lag_s, fit.dead_s);
    std::array<double, 2> gain{}, bias{};
    for (std::size_t i = 0; i < stretch.axes.size() && i < 2; ++i) {
      const Linear linear = solve(unit, stretch, stretch.axes[i], fit.lag_s);
      gain[i] = linear.gain;
      bias[i] = linear.bias;
    }
    fit.gains.push_back(gain);
    fit.at_rest.push_back(bias);
  }
  return fit;
}

}  // namespace ledgerline::tello
