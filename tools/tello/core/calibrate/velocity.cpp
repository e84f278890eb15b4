#include "tools/tello/core/calibrate/estimate.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace ledgerline::tello {
namespace {

constexpr double step_mps = 0.1;
constexpr double noise_mps = 0.03;  // of what is then cast or rounded [A]
// A share of casts is clear that is so far from half, and known so well: then none or all is three deviations away.
constexpr double clear_share = 0.1, max_share_sigma = 0.2;
constexpr double max_scale_share = 0.05;       // known less well, a fit is worth little more than link's default
constexpr std::size_t min_blocks = 3;          // for a spread
constexpr std::size_t min_block_samples = 25;  // of a block: 2.5 s of state text
constexpr double max_gap_s = 0.3;              // between two poses
constexpr double lag_step_s = 0.02;            // between whose points a parabola is laid
constexpr std::size_t lags = 30;
// What is reported follows from a velocity, its bias and the share of casts, and these from what is reported: four more
// passes change a scale by 2 in 1000 at most.
constexpr int passes = 4, bias_passes = 3;

using Complex = std::complex<double>;
/// Products of columns: two of turn and scale, what a cast reports beyond rounding, and what was reported.
using Sums = Eigen::Matrix4d;
using ByLag = std::array<Sums, lags>;

struct Solution {
  Eigen::Vector2d by;  ///< that turns and scales the reference's velocity into the reported one, a complex number
  double cast = 0, scale = 0, lag_s = 0, squares = 0;
};

double lag_of(double index) { return lag_step_s * (index + 1); }

/// The reference's velocity behind a first order, at the time of each text: exact where the velocity stays between two
/// positions. The drone is at rest before.
std::vector<Complex> late_velocities(const VelocityBlock& block, double lag_s) {
  std::vector<Complex> out;
  const auto& positions = block.positions;
  Complex late;
  std::size_t next = 1;
  const auto late_at = [&](double at_s) {
    const auto &from = positions[next - 1], &to = positions[next];
    const Complex velocity = (to.value - from.value) / (to.at_s - from.at_s);
    return velocity + (late - velocity) * std::exp(-(at_s - from.at_s) / lag_s);
  };
  for (const auto& text : block.reported) {
    for (; next + 1 < positions.size() && positions[next].at_s < text.at_s; ++next)
      late = late_at(positions[next].at_s);
    out.push_back(late_at(text.at_s));
  }
  return out;
}

/// What is reported of a velocity on average, for it has noise before it is cast or rounded.
double expected_mps(double velocity_mps, bool cast) {
  constexpr std::array normal{-1.6, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.6};  // as likely as each other
  double sum = 0;
  for (const double z : normal) {
    const double steps = (velocity_mps + noise_mps * z) / step_mps;
    sum += step_mps * (cast ? std::trunc(steps) : std::round(steps));
  }
  return sum / normal.size();
}

/// One axis' products, without its means, which a bias explains. What rounding changes is taken off what was reported.
Sums sums_of_axis(Eigen::MatrixX4d rows, const std::optional<Solution>& known) {
  if (known) {
    const double share = std::clamp(known->cast, 0.0, 1.0);
    const Eigen::ArrayXd reported = rows.col(3);
    Eigen::ArrayXd velocity = rows.leftCols<2>() * known->by, rounded = velocity, cast = velocity;
    for (int pass = 0; pass < bias_passes; ++pass) {
      velocity += (reported - rounded - share * (cast - rounded)).mean();
      rounded = velocity.unaryExpr([](double v) { return expected_mps(v, false); });
      cast = velocity.unaryExpr([](double v) { return expected_mps(v, true); });
    }
    rows.col(2) = cast - rounded;
    rows.col(3) = reported - (rounded - velocity);
  }
  rows.rowwise() -= rows.colwise().mean().eval();
  return rows.transpose() * rows;
}

Sums sums_of(const VelocityBlock& block, double lag_s, const std::optional<Solution>& known) {
  const std::vector<Complex> late = late_velocities(block, lag_s);
  const auto n = static_cast<Eigen::Index>(late.size());
  Eigen::MatrixX4d x(n, 4), y(n, 4);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Complex w = late[at], reported = block.reported[at].value;
    x.row(i) << w.real(), -w.imag(), 0, reported.real();
    y.row(i) << w.imag(), w.real(), 0, reported.imag();
  }
  return sums_of_axis(std::move(x), known) + sums_of_axis(std::move(y), known);
}

std::vector<ByLag> sums_of(const std::vector<VelocityBlock>& blocks, const std::optional<Solution>& known) {
  std::vector<ByLag> out(blocks.size());
  for (std::size_t k = 0; k < blocks.size(); ++k)
    for (std::size_t i = 0; i < lags; ++i) out[k][i] = sums_of(blocks[k], lag_of(static_cast<double>(i)), known);
  return out;
}

/// With a share of casts that is given, or free.
Solution solve(const Sums& sums, std::optional<double> cast) {
  Eigen::Vector4d left(0, 0, -cast.value_or(0), 1);  // what is left of the columns, once it is explained
  if (cast) {
    const Eigen::Vector2d right = sums.topRows<2>() * left;
    left.head<2>() = -sums.topLeftCorner<2, 2>().ldlt().solve(right);
  } else {
    left.head<3>() = -sums.topLeftCorner<3, 3>().ldlt().solve(sums.topRightCorner<3, 1>());
  }
  return {.by = -left.head<2>(), .cast = -left[2], .squares = left.dot(sums * left)};
}

/// The least of the squares over the lags, and of the parabola through its neighbours; nothing at the far edge.
std::optional<Solution> solve(const ByLag& sums, std::optional<double> cast) {
  std::array<Solution, lags> all;
  for (std::size_t i = 0; i < lags; ++i) all[i] = solve(sums[i], cast);
  const auto less = [](const Solution& a, const Solution& b) { return a.squares < b.squares; };
  const auto best = std::min_element(all.begin(), all.end(), less);
  if (best == all.end() - 1) return std::nullopt;
  double off = 0;
  if (best != all.begin())
    off = (best[-1].squares - best[1].squares) / 2 / (best[-1].squares - 2 * best->squares + best[1].squares);
  const Solution& other = off < 0 ? best[-1] : best[1];
  Solution out = *best;
  out.by += std::abs(off) * (other.by - best->by);
  out.cast += std::abs(off) * (other.cast - best->cast);
  out.scale = 1 / out.by.norm();
  out.lag_s = lag_of(static_cast<double>(best - all.begin()) + off);
  return out;
}

ByLag sum_of(const std::vector<ByLag>& blocks) {
  ByLag all = blocks.front();
  for (std::size_t k = 1; k < blocks.size(); ++k)
    for (std::size_t i = 0; i < lags; ++i) all[i] += blocks[k][i];
  return all;
}

/// The solution, and the spread of those without one block each.
struct Spread {
  Solution value, sigma;
  Estimate operator[](double Solution::*figure) const { return {value.*figure, sigma.*figure}; }
};

std::optional<Spread> spread(const std::vector<ByLag>& blocks, std::optional<double> cast) {
  const ByLag all = sum_of(blocks);
  const auto value = solve(all, cast);
  if (!value) return std::nullopt;
  constexpr std::array figures{&Solution::scale, &Solution::cast, &Solution::lag_s};
  Spread out{*value, {}};
  for (const ByLag& block : blocks) {
    ByLag without = all;
    for (std::size_t i = 0; i < lags; ++i) without[i] -= block[i];
    const auto part = solve(without, cast);
    if (!part) return std::nullopt;
    for (const auto figure : figures) out.sigma.*figure += std::pow(*part.*figure - out.value.*figure, 2);
  }
  const auto n = static_cast<double>(blocks.size());
  for (const auto figure : figures) out.sigma.*figure = std::sqrt(out.sigma.*figure * (n - 1) / n);
  return out;
}

}  // namespace

Result<VelocityFit> fit_velocity(std::vector<VelocityBlock> blocks) {
  for (VelocityBlock& block : blocks) {  // what nobody saw
    std::erase_if(block.reported, [&](const auto& text) {
      return block.positions.empty() || text.at_s < block.positions.front().at_s ||
             text.at_s > block.positions.back().at_s;
    });
  }
  std::erase_if(blocks, [](const VelocityBlock& block) {
    const auto& seen = block.positions;
    const auto is_gap = [](const auto& one, const auto& next) { return next.at_s - one.at_s > max_gap_s; };
    return block.reported.size() < min_block_samples || seen.size() < min_block_samples ||
           std::adjacent_find(seen.begin(), seen.end(), is_gap) != seen.end();
  });
  if (blocks.size() < min_blocks)
    return Error{fmt::format("it was seen in {} blocks of flight, and {} are needed", blocks.size(), min_blocks)};
  const Error late{"they are later than 0.6 s, or do not follow what was seen"};
  auto known = solve(sum_of(sums_of(blocks, std::nullopt)), 0);
  for (int pass = 1; known && pass < passes; ++pass) known = solve(sum_of(sums_of(blocks, known)), std::nullopt);
  if (!known) return late;
  const auto sums = sums_of(blocks, known);
  const auto free = spread(sums, std::nullopt);
  if (!free) return late;
  const Estimate cast = (*free)[&Solution::cast];
  if (!(std::abs(cast.value - 0.5) > clear_share && cast.sigma < max_share_sigma))
    return Error{fmt::format("{:.2f} (sd {:.2f}) of them are cast: neither all nor none", cast.value, cast.sigma)};
  const bool truncated = cast.value > 0.5;
  const auto fit = spread(sums, truncated ? 1 : 0);
  if (!fit) return late;
  const Estimate scale = (*fit)[&Solution::scale];
  if (!(scale.sigma < max_scale_share * scale.value))
    return Error{fmt::format("their scale is {:.2f}, but with an sd of {:.2f}", scale.value, scale.sigma)};
  return VelocityFit{scale, (*fit)[&Solution::lag_s], truncated, cast};
}

}  // namespace ledgerline::tello
