#include "ground/motion/open_course.hpp"

namespace ledgerline::motion {
namespace {

constexpr double closing_m = 0.3;  // beyond the bend of any corner, which misses its corner by 7 cm at most

}  // namespace

OpenCourse open_course(const Waypoint& here, const std::vector<Waypoint>& way) {
  OpenCourse course;
  if ((way.front().at_m - here.at_m).norm() >= min_apart_m) {
    course.waypoints.push_back(here);
    course.waypoints.back().speed_mps = way.front().speed_mps;
    course.first = 1;
  }
  course.waypoints.insert(course.waypoints.end(), way.begin(), way.end());
  course.last = course.waypoints.size() - 1;
  course.origin_m = course.waypoints.front().at_m;
  for (Waypoint& waypoint : course.waypoints) waypoint.at_m -= course.origin_m;

  // A single place has no direction: any will do.
  Eigen::Vector2d out(1, 0), in(1, 0);
  if (course.last > 0) {
    in = (course.waypoints[1].at_m - course.waypoints[0].at_m).normalized();
    out = (course.waypoints[course.last].at_m - course.waypoints[course.last - 1].at_m).normalized();
  }
  Waypoint behind{course.waypoints[course.last].at_m + closing_m * out, course.waypoints[course.last].height_m};
  const Waypoint before{-closing_m * in, course.waypoints[0].height_m};
  // There and back again: the closing pieces must not be of no length.
  if ((behind.at_m - before.at_m).norm() < 0.5 * closing_m) behind.at_m += closing_m * out;
  course.waypoints[course.last].speed_mps.reset();
  course.waypoints.push_back(behind);
  course.waypoints.push_back(before);
  return course;
}

}  // namespace ledgerline::motion
