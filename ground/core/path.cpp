#include "ground/core/path.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ledgerline::ground {
namespace {

std::vector<Eigen::Vector2d> unit_corners(Shape shape) {
  switch (shape) {
    case Shape::square:
      return {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    case Shape::triangle:
      return {{0, 0}, {1, 0}, {0.5, std::sqrt(3.0) / 2}};
    case Shape::x:
      break;
  }
  return {{0, 0}, {1, 1}, {1, 0}, {0, 1}};
}

}  // namespace

Result<Shape> shape_from_name(const std::string& name) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x}) {
    if (name == name_of(shape)) return shape;
  }
  return Error{fmt::format("no shape \"{}\": square, triangle or x", name)};
}

std::string name_of(Shape shape) {
  return shape == Shape::square ? "square" : shape == Shape::triangle ? "triangle" : "x";
}

Path::Path(Shape shape, Eigen::Vector2d origin, double side_m) : corners_(unit_corners(shape)), starts_m_{0} {
  for (auto& corner : corners_) corner = origin + side_m * corner;
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const auto& next = corners_[(i + 1) % corners_.size()];
    starts_m_.push_back(starts_m_.back() + (next - corners_[i]).norm());
  }
}

// Takes the laps off `s_m` and the start of the piece; says which piece it is on.
std::size_t Path::piece_at(double& s_m) const {
  s_m = std::fmod(s_m, length_m());
  if (s_m < 0) s_m += length_m();
  const auto next = std::upper_bound(starts_m_.begin() + 1, starts_m_.end() - 1, s_m);
  const auto piece = static_cast<std::size_t>(next - starts_m_.begin()) - 1;
  s_m -= starts_m_[piece];
  return piece;
}

Eigen::Vector2d Path::point(double s_m) const {
  const std::size_t i = piece_at(s_m);
  const auto& next = corners_[(i + 1) % corners_.size()];
  return corners_[i] + s_m * (next - corners_[i]).normalized();
}

Eigen::Vector2d Path::direction(double s_m) const {
  const std::size_t i = piece_at(s_m);
  return (corners_[(i + 1) % corners_.size()] - corners_[i]).normalized();
}

double Path::distance_m(const Eigen::Vector2d& p) const {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const Eigen::Vector2d piece = corners_[(i + 1) % corners_.size()] - corners_[i];
    const double along = std::clamp((p - corners_[i]).dot(piece) / piece.squaredNorm(), 0.0, 1.0);
    nearest = std::min(nearest, (p - corners_[i] - along * piece).norm());
  }
  return nearest;
}

double Path::turn_at(std::size_t corner) const {
  const std::size_t n = corners_.size();
  const auto in = corners_[corner % n] - corners_[(corner + n - 1) % n];
  const auto out = corners_[(corner + 1) % n] - corners_[corner % n];
  return std::acos(std::clamp(in.normalized().dot(out.normalized()), -1.0, 1.0));
}

Path::Turn Path::turns(double s_m) const {
  const std::size_t i = piece_at(s_m);
  return {starts_m_[i + 1] - starts_m_[i] - s_m, turn_at(i + 1), s_m, turn_at(i)};
}

}  // namespace ledgerline::ground
