#include "ground/motion/track.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::ground::motion {
namespace {

constexpr double grain_m = 0.01;
constexpr std::size_t max_knots = 20'000;
constexpr double creep_mps = 0.05;  // the reference must get through a corner in the end

/// A piece of the rounded path: a line (bend 0) or an arc.
struct Piece {
  Eigen::Vector2d from, direction;
  double length = 0;
  double bend = 0;  ///< 1/m, positive to the left
  double height_from = 0, height_to = 0;
  double speed = 0;  ///< the waypoint's own limit
};

Eigen::Vector2d left_of(const Eigen::Vector2d& d) { return {-d.y(), d.x()}; }

Eigen::Vector2d direction_on(const Piece& piece, double s) {
  const double turn = s * piece.bend;
  return std::cos(turn) * piece.direction + std::sin(turn) * left_of(piece.direction);
}

Eigen::Vector2d point_on(const Piece& piece, double s) {
  if (piece.bend == 0) return piece.from + s * piece.direction;
  const double turn = s * piece.bend;
  return piece.from + (std::sin(turn) * piece.direction + (1 - std::cos(turn)) * left_of(piece.direction)) / piece.bend;
}

double climb_of(const Piece& piece) { return (piece.height_to - piece.height_from) / piece.length; }

double limit_of(const Piece& piece, const TrackLimits& limits) {
  double limit = piece.speed;
  if (piece.bend != 0) limit = std::min(limit, std::sqrt(limits.acceleration_mps2 / std::abs(piece.bend)));
  if (const double climb = climb_of(piece); climb != 0) limit = std::min(limit, limits.vertical_mps / std::abs(climb));
  return limit;
}

}  // namespace

double from_rest_to_rest_mps(double s_m, double end_m) {
  const double a = TrackLimits{}.acceleration_mps2;
  const double from_rest = std::sqrt(2 * a * std::max(0.0, s_m) + 0.01);
  const double to_rest = std::sqrt(2 * a * std::max(0.0, end_m - s_m) + 0.0025);
  return std::min(from_rest, to_rest);
}

Track::Track(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin, double height_m,
             const TrackLimits& limits) {
  lay(waypoints, origin, height_m, limits);
  pace(limits);
}

void Track::lay(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin, double height_m,
                const TrackLimits& limits) {
  const std::size_t n = waypoints.size();
  const auto point = [&](std::size_t i) -> Eigen::Vector2d { return origin + waypoints[i % n].at_m; };
  const auto height = [&](std::size_t i) { return waypoints[i % n].height_m.value_or(height_m); };
  const auto edge = [&](std::size_t i) -> Eigen::Vector2d { return point(i + 1) - point(i); };
  constexpr double any_speed = 1e3;

  struct Corner {
    double cut = 0, turn = 0;
  };
  std::vector<Corner> corners(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d in = edge(i + n - 1).normalized(), out = edge(i).normalized();
    corners[i].turn = std::atan2(in.x() * out.y() - in.y() * out.x(), in.dot(out));
    const double room = 0.5 * std::min(edge(i + n - 1).norm(), edge(i).norm());
    // A circle of radius r misses its corner by r (1 / cos(turn / 2) - 1), and begins r tan(turn / 2) before it.
    const double half = 0.5 * std::abs(corners[i].turn);
    if (half > 1e-6)
      corners[i].cut = std::min(limits.cut_m * std::sin(half) / std::max(1e-9, 1 - std::cos(half)), room);
  }

  // The origin is the first corner itself in the waypoints' words; on the rounded track arc length 0 is the middle of
  // its bend, the place that is nearest.
  std::vector<Piece> pieces;
  for (std::size_t i = 0; i < n; ++i) {
    const Corner& here = corners[i];
    const Corner& next = corners[(i + 1) % n];
    const Eigen::Vector2d in = edge(i + n - 1).normalized(), out = edge(i).normalized();
    const double speed_in = waypoints[(i + n - 1) % n].speed_mps.value_or(any_speed);
    const double speed_out = waypoints[i].speed_mps.value_or(any_speed);
    corners_m_.push_back(length_m_);
    if (here.cut > 0) {
      const double radius = here.cut / std::tan(0.5 * std::abs(here.turn));
      // Turning back on itself: no arc can be that tight.
      const double tight = std::max(radius, 1e-3);
      pieces.push_back({point(i) - here.cut * in, in, tight * std::abs(here.turn), (here.turn > 0 ? 1 : -1) / tight,
                        height(i), height(i), std::min(speed_in, speed_out)});
      corners_m_.back() += 0.5 * pieces.back().length;
      length_m_ += pieces.back().length;
    }
    const double straight = edge(i).norm() - here.cut - next.cut;
    if (straight > 1e-9) {
      pieces.push_back({point(i) + here.cut * out, out, straight, 0, height(i), height(i + 1), speed_out});
      length_m_ += straight;
    }
  }
  const auto count = std::clamp<std::size_t>(static_cast<std::size_t>(std::ceil(length_m_ / grain_m)), 8, max_knots);
  step_m_ = length_m_ / static_cast<double>(count);
  const double offset = corners_m_.front();
  for (double& corner_m : corners_m_) corner_m -= offset;
  std::size_t k = 0;
  double begin = 0;
  for (std::size_t i = 0; i < count; ++i) {
    double s = offset + static_cast<double>(i) * step_m_;
    if (s >= length_m_) {
      if (begin > s - length_m_) k = 0, begin = 0;
      s -= length_m_;
    }
    while (k + 1 < pieces.size() && s - begin >= pieces[k].length) begin += pieces[k++].length;
    const Piece& piece = pieces[k];
    const double along = s - begin;
    const Eigen::Vector2d direction = direction_on(piece, along);
    const Eigen::Vector2d place = point_on(piece, along);
    const double climb = climb_of(piece);
    // The least of all pieces up to the next knot: a bend may be shorter than the way between two.
    double limit = limit_of(piece, limits);
    std::size_t ahead = k;
    for (double end = begin + piece.length; end <= s + step_m_; end += pieces[ahead].length) {
      ahead = (ahead + 1) % pieces.size();
      limit = std::min(limit, limit_of(pieces[ahead], limits));
    }
    limit = std::clamp(limit, creep_mps, limits.full_scale_mps);
    knots_.push_back({{place.x(), place.y(), piece.height_from + along * climb},
                      direction,
                      piece.bend * left_of(direction),
                      climb,
                      limit,
                      limit});
  }
}

void Track::pace(const TrackLimits& limits) {
  const std::size_t n = knots_.size();
  // What is left for speeding up and braking where part of the acceleration bends the way.
  const auto along = [&](const PathPoint& knot, double speed) {
    const double across = speed * speed * knot.bend.norm();
    const double a = limits.acceleration_mps2;
    return std::sqrt(std::max(0.0, a * a - across * across));
  };
  const auto reached = [&](double speed, double acceleration) {
    return std::sqrt(speed * speed + 2 * acceleration * step_m_);
  };
  for (std::size_t i = 2 * n; i-- > 0;) {
    PathPoint& knot = knots_[i % n];
    const PathPoint& next = knots_[(i + 1) % n];
    const double braking = std::min(along(knot, next.speed), along(next, next.speed));
    knot.speed = std::min(knot.speed, reached(next.speed, braking));
  }
  for (std::size_t i = 0; i < 2 * n; ++i) {
    const PathPoint& knot = knots_[i % n];
    PathPoint& next = knots_[(i + 1) % n];
    const double room = std::max(0.0, limits.full_scale_mps - knot.speed) / limits.lag_s;
    const double gaining = std::min({along(knot, knot.speed), along(next, knot.speed), room});
    next.speed = std::min(next.speed, reached(knot.speed, gaining));
  }
}

Track::Point Track::at(double s_m) const {
  const auto n = static_cast<double>(knots_.size());
  double cell = std::fmod(s_m / step_m_, n);
  if (cell < 0) cell += n;
  const auto i = std::min(static_cast<std::size_t>(cell), knots_.size() - 1);
  const double share = cell - static_cast<double>(i);
  const PathPoint& a = knots_[i];
  const PathPoint& b = knots_[(i + 1) % knots_.size()];
  Point place;
  place.position_m = a.position + share * (b.position - a.position);
  const Eigen::Vector2d direction = (a.direction + share * (b.direction - a.direction)).normalized();
  place.direction = {direction.x(), direction.y(), a.climb + share * (b.climb - a.climb)};
  place.bend_per_m = a.bend + share * (b.bend - a.bend);
  place.speed_mps = a.speed + share * (b.speed - a.speed);
  place.gain_mps2 = (b.speed * b.speed - a.speed * a.speed) / (2 * step_m_);
  return place;
}

double Track::speed_at(double s_m) const { return at(s_m).speed_mps; }

double Track::lap_s(double speed_mps) const {
  double lap = 0;
  for (const PathPoint& knot : knots_) lap += step_m_ / std::min(knot.speed, speed_mps);
  return lap;
}

}  // namespace ledgerline::ground::motion
