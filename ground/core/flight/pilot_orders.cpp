#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/msg/names.hpp"
#include "ground/core/flight/phases.hpp"

/// Phases, continued: what a pilot orders of a drone in the air.
namespace ledgerline::ground {

std::string Phases::take_order(TimeNs now, const PilotOrder& order, TimeNs delay_ns) {
  std::string why = not_under_way(now);
  // What makes link brake outlasts a plan; a pose that is lost is said below, in its own words.
  if (why.empty() && seen_.state.mode == FailsafeMode::brake && no_pose(now).empty())
    why = fmt::format("its failsafe brakes it ({})", words_for(seen_.state.cause));
  switch (order.kind) {
    case PilotOrder::Kind::path:
      if (why.empty()) why = fly_checked(now, order.waypoints, order.land_behind, delay_ns);
      return why.empty() ? "" : "no path: " + why;
    case PilotOrder::Kind::resume:
      if (why.empty() && !status_.paused)
        why = status_.phase == DronePhase::path ? "it flies its path" : "no path of it is paused";
      if (why.empty())
        why = fly_checked(now, planner_.pilot_path()->rest(), planner_.pilot_path()->land_behind(), delay_ns);
      return why.empty() ? "" : "no resume: " + why;
    case PilotOrder::Kind::return_home:
      if (why.empty() && !origin_known_)
        why = "where it took off is not known (it was found in the air, or had no pose then)";
      if (why.empty()) {
        const double height_m = std::clamp(seen_.state.position_m[2], motion::min_height_m, motion::max_height_m);
        // However far it has got: this place is nobody's mistake in writing.
        why = fly(now, {{{status_.origin_m[0], status_.origin_m[1]}, height_m}}, false, delay_ns);
      }
      return why.empty() ? "" : "no return: " + why;
  }
  return "";
}

std::string Phases::take_pause(TimeNs now) {
  std::string why = not_under_way(now);
  if (why.empty() && status_.phase != DronePhase::path)
    why = status_.paused ? "it is paused already" : "it flies no path";
  if (!why.empty()) return "no pause: " + why;
  auto planned = std::move(status_.planned);
  enter(now, DronePhase::manual);
  status_.planned = std::move(planned);
  status_.paused = true;
  return "";
}

// What speaks against any order; empty: nothing.
std::string Phases::not_under_way(TimeNs now) const {
  if (!config_.manual) return "it flies the path of its flight";
  switch (status_.phase) {
    case DronePhase::path:
    case DronePhase::manual:
      return "";
    case DronePhase::takeoff:
      return "it is still taking off";
    case DronePhase::landing:
      return "it is landing";
    case DronePhase::waiting:
    case DronePhase::landed:
    case DronePhase::failed:
      break;
  }
  const std::string missing = not_ready(now);
  return missing.empty() ? "it is not in the air: let it take off first" : missing;
}

std::string Phases::no_pose(TimeNs now) const {
  const StateSample& s = seen_.state;
  if (s.pose_stamp_ns == 0) return "it has no pose (no motion capture, and [pose] source asks for it?)";
  if (s.stamp_ns - s.pose_stamp_ns + (now - seen_.received_ns) > config_.controller.pose_lost_ns)
    return "its pose is lost: nobody knows where it is";
  return "";
}

std::string Phases::fly_checked(TimeNs now, const std::vector<Waypoint>& way, bool land_behind, TimeNs delay_ns) {
  if (std::string why = no_pose(now); !why.empty()) return why;
  const Eigen::Vector2d here(seen_.state.position_m[0], seen_.state.position_m[1]);
  if (const Status checked = motion::check_way(way, here); !checked) return checked.error().what;
  return fly(now, way, land_behind, delay_ns);
}

std::string Phases::fly(TimeNs now, const std::vector<Waypoint>& way, bool land_behind, TimeNs delay_ns) {
  if (std::string why = no_pose(now); !why.empty()) return why;
  const TimeNs from_ns = seen_.state.stamp_ns + (now - seen_.received_ns) + delay_ns;
  if (const Status begun = planner_.begin_pilot_path(way, land_behind, from_ns); !begun) return begun.error().what;
  status_.progress = 0;
  status_.reached = 0;
  ++status_.paths;
  enter(now, DronePhase::path);
  return "";
}

}  // namespace ledgerline::ground
