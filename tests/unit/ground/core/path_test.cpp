#include "ground/core/path.hpp"

#include <gtest/gtest.h>

#include <numbers>

namespace ledgerline::ground {
namespace {

constexpr double pi = std::numbers::pi;
const Eigen::Vector2d origin(3, -2);

TEST(Path, EveryShapeBeginsAndEndsAtItsOrigin) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x}) {
    const Path path(shape, origin, 1.5);
    EXPECT_NEAR((path.point(0) - origin).norm(), 0, 1e-12) << name_of(shape);
    EXPECT_NEAR((path.point(path.length_m()) - origin).norm(), 0, 1e-12) << name_of(shape);
  }
}

TEST(Path, LengthsAreThoseOfGeometry) {
  EXPECT_NEAR(Path(Shape::square, origin, 1.5).length_m(), 6.0, 1e-12);
  EXPECT_NEAR(Path(Shape::triangle, origin, 1.5).length_m(), 4.5, 1e-12);
  EXPECT_NEAR(Path(Shape::x, origin, 1.0).length_m(), 2 + 2 * std::sqrt(2.0), 1e-12);
}

TEST(Path, AWalkAlongItIsContinuousAndLapsRepeat) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x}) {
    const Path path(shape, origin, 1.5);
    for (double s = 0; s < 2 * path.length_m(); s += 0.01) {
      EXPECT_LE((path.point(s + 0.01) - path.point(s)).norm(), 0.01 + 1e-9);
      EXPECT_NEAR((path.point(s + path.length_m()) - path.point(s)).norm(), 0, 1e-9);
      EXPECT_NEAR(path.direction(s).norm(), 1, 1e-12);
    }
  }
}

TEST(Path, StaysInItsQuadrantSoThatNeighboursNeverMeet) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x}) {
    const Path path(shape, origin, 1.5);
    for (double s = 0; s < path.length_m(); s += 0.01) {
      const Eigen::Vector2d p = path.point(s) - origin;
      EXPECT_GE(p.minCoeff(), -1e-9);
      EXPECT_LE(p.maxCoeff(), 1.5 + 1e-9);
    }
  }
}

TEST(Path, DistanceIsToTheNearestPointEvenOfAnotherPiece) {
  const Path path(Shape::square, {0, 0}, 2);
  EXPECT_NEAR(path.distance_m({1, 0.25}), 0.25, 1e-12);
  EXPECT_NEAR(path.distance_m({1, 1}), 1, 1e-12);
  EXPECT_NEAR(path.distance_m({-3, -4}), 5, 1e-12);
  EXPECT_NEAR(path.distance_m({1.9, 1.5}), 0.1, 1e-12);
  EXPECT_NEAR(Path(Shape::x, {0, 0}, 1).distance_m({0.5, 0.5}), 0, 1e-12);
}

TEST(Path, AnUnknownShapeIsRefusedWithTheKnownOnes) {
  EXPECT_EQ(*shape_from_name("triangle"), Shape::triangle);
  const auto circle = shape_from_name("circle");
  ASSERT_FALSE(circle);
  EXPECT_NE(circle.error().message.find("square, triangle, x or eight"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::ground
