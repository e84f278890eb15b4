#include "ground/core/flight/pilot_path.hpp"

#include <cmath>
#include <utility>

namespace ledgerline::ground {
namespace {

// The reference runs ahead of the drone by a leash at most (ControllerConfig::leash_m), so one that is two beyond a
// waypoint has the drone beyond it, too, however wide it flew.
constexpr double surely_behind_m = 0.8;

std::vector<Waypoint> with_heights(std::vector<Waypoint> way, double height_m) {
  for (Waypoint& waypoint : way) waypoint.height_m = waypoint.height_m.value_or(height_m);
  return way;
}

}  // namespace

PilotPath::PilotPath(std::vector<Waypoint> way, bool land_behind, const Waypoint& here, double height_m)
    : way_(with_heights(std::move(way), height_m)),
      land_behind_(land_behind),
      here_(here),
      course_(motion::open_path(here_, way_)) {}

void PilotPath::observe(const Follower& follower, const StateSample& state) {
  for (; next_ + 1 < way_.size(); ++next_) {
    const double beyond_m = follower.progress_m() - follower.length_to(course_.first + next_);
    if (beyond_m < 0) return;
    const double away_m =
        std::hypot(state.position_m[0] - way_[next_].at_m.x(), state.position_m[1] - way_[next_].at_m.y());
    if (away_m >= near_m && beyond_m < surely_behind_m) return;
  }
}

bool PilotPath::at_end(const Follower& follower, const StateSample& state) const {
  return follower.at_end() && is_settled(state, {way_.back().at_m.x(), way_.back().at_m.y(), *way_.back().height_m});
}

std::vector<Waypoint> PilotPath::rest() const {
  return {way_.begin() + static_cast<std::ptrdiff_t>(next_), way_.end()};
}

std::vector<std::array<double, 3>> PilotPath::corners() const {
  std::vector<std::array<double, 3>> corners;
  if (course_.first > 0) corners.push_back({here_.at_m.x(), here_.at_m.y(), here_.height_m.value_or(0)});
  for (const Waypoint& waypoint : way_)
    corners.push_back({waypoint.at_m.x(), waypoint.at_m.y(), waypoint.height_m.value_or(0)});
  return corners;
}

}  // namespace ledgerline::ground
