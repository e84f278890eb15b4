#include "tools/launcher/preflight/fence.hpp"

#include <fmt/format.h>

#include "sim/core/parameters.hpp"
#include "tools/launcher/configs.hpp"

namespace ledgerline::fly {

// Rows of four.
std::vector<Eigen::Vector2d> simulated_starts(const Options& options) {
  const sim::Parameters simulated;
  std::vector<Eigen::Vector2d> starts;
  for (int k = 1; k <= options.drones; ++k)
    starts.push_back(Eigen::Vector3d::Map(sim::start_of(simulated, k).data()).head<2>());
  return starts;
}

std::string beyond_fence(const Options& o, const link::FenceSettings& fence,
                         const std::vector<Eigen::Vector2d>& starts) {
  const auto low = Eigen::Vector3d::Map(fence.min_m.data()), high = Eigen::Vector3d::Map(fence.max_m.data());
  for (int k = 1; k <= o.drones; ++k) {
    const DroneTask task = task_of(o, k);
    for (const ground::Waypoint& point : ground::waypoints_of(task.course)) {
      const Eigen::Vector2d at = starts[static_cast<std::size_t>(k) - 1] + point.at_m;
      const Eigen::Vector3d place(at.x(), at.y(), point.height_m.value_or(height_m));
      if ((place.array() >= low.array()).all() && (place.array() <= high.array()).all()) continue;
      return fmt::format(
          "{}: {} would be at {:g}, {:g}, {:g} m, beyond link's fence: x {:g} to {:g}, y {:g} to {:g}, z {:g} "
          "to {:g} m",
          task.course.waypoints.empty()
              ? fmt::format("{} with --side {:g}", ground::name_of(task.course.shape), task.course.side_m)
              : fmt::format("{}:{}", task.file, point.line),
          drone_name(o, k), place.x(), place.y(), place.z(), low.x(), high.x(), low.y(), high.y(), low.z(), high.z());
    }
  }
  return "";
}

}  // namespace ledgerline::fly
