#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "onboard/link/core/settings.hpp"

/// What link.toml says of where drones are: [pose], [[pad]], and the keys of [[drone]] that belong to it.
namespace ledgerline::link {

struct PoseSettings {
  PoseSource source = PoseSource::mocap;  ///< of the drones that do not say their own
  OdometrySettings odometry;
  TimeNs odometry_after_ns = DroneSettings{}.odometry_after_ns;
  bool has_signs = false;
  std::vector<PadSettings> pads;
};

PoseSettings read_pose(Config& config);
/// `key`: "drone.0."
void read_drone_pose(Config& config, const std::string& key, const PoseSettings& pose, DroneSettings& drone);
/// What of all drones together cannot be flown; `path` is the file's.
Status check_poses(const std::string& path, const LinkSettings& link);

}  // namespace ledgerline::link
