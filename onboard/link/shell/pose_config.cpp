#include "onboard/link/shell/link_config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "common/msg/names.hpp"

namespace ledgerline::link {
namespace {

void read_odometry(Config& config, PoseSettings& pose) {
  OdometrySettings& odometry = pose.odometry;
  const auto signs =
      config.numbers(Key{"pose.velocity_signs",
                         "sign of each of vgx, vgy, vgz against forward, left, up, as `calibrate` measures them; "
                         "must be there where onboard odometry is the source",
                         "none"},
                     3, {});
  pose.has_signs = signs.size() == 3;
  for (std::size_t i = 0; i < 3 && pose.has_signs; ++i) odometry.velocity_signs[i] = signs[i] < 0 ? -1.0F : 1.0F;
  odometry.velocity_in_body =
      config.choice(
          {"pose.velocity_frame",
           "the frame that vgx, vgy, vgz are reported in: the one it had at power on, or one that turns with it"},
          {"power_on", "body"}, "power_on") == "body";
  odometry.flow_mps =
      config.number({"pose.flow_mps", "standard deviation of its velocities' slow error, for the variance"},
                    odometry.flow_mps, 0.001, 1);
  odometry.flow_s =
      config.number({"pose.flow_s", "how long that error lasts (correlation time)"}, odometry.flow_s, 0.1, 600);
  odometry.flow_scale =
      config.number({"pose.flow_scale", "standard deviation of its velocities' scale, wide until somebody measured it"},
                    odometry.flow_scale, 0, 0.5);
  odometry.velocity_scale =
      config.number({"pose.velocity_scale", "what vgx and vgy are multiplied by to be metres a second"}, 1, 0.5, 2);
  odometry.velocity_truncated =
      config.boolean({"pose.velocity_truncated", "vgx and vgy are cast to whole dm/s; else they are rounded"}, false);
  odometry.velocity_lag_s =
      config.number({"pose.velocity_lag_s", "by how much vgx and vgy are late"}, odometry.velocity_lag_s, 0, 1);
  odometry.velocity_lag_sigma_s =
      config.number({"pose.velocity_lag_sd_s", "standard deviation of that"}, odometry.velocity_lag_sigma_s, 0, 1);
  odometry.max_unfixed_s =
      config.number({"pose.max_unfixed_s", "with pads: a path is flown for so long without one; then it brakes"},
                    odometry.max_unfixed_s, 1, 3600);
  odometry.max_unfixed_m = config.number({"pose.max_unfixed_m", "the same, so far"}, odometry.max_unfixed_m, 1, 10'000);
}

void read_pads(Config& config, std::vector<PadSettings>& pads) {
  for (std::size_t i = 0; i < config.table_count({"pad", "mission pads, where they lie; for source \"pads\""}); ++i) {
    const std::string key = fmt::format("pad.{}.", i);
    PadSettings pad;
    pad.id = static_cast<int>(config.number({key + "id", "the pad's number, printed on it"}, 1, 8));
    const auto place = config.numbers({key + "position_m", "x, y, z of its middle in `map`"}, 3, {});
    if (place.size() != 3 && !config.is_describing())
      config.wrong(key + "position_m", "must be there: where the pad lies");
    std::copy_n(place.begin(), std::min<std::size_t>(3, place.size()), pad.position_m.begin());
    pad.yaw_rad = config.number({key + "yaw_rad", "where its arrow points, counter-clockwise from x"}, 0, -7, 7);
    pads.push_back(pad);
  }
}

PoseSource read_source(Config& config, const Key& key, PoseSource otherwise) {
  return from_name<PoseSource>(config.choice(key,
                                             {name(PoseSource::mocap), name(PoseSource::tello), name(PoseSource::pads),
                                              name(PoseSource::mocap_then_tello)},
                                             name(otherwise)))
      .value_or(otherwise);
}

void read_start(Config& config, const std::string& key, OdometrySettings& odometry) {
  const auto start = config.numbers(
      {key + "start_m", "where it stands when link first sees it, x, y, z in `map`; for its own odometry"}, 3,
      {0, 0, 0});
  std::copy_n(start.begin(), std::min<std::size_t>(3, start.size()), odometry.start_m.begin());
  odometry.start_yaw_rad =
      config.number({key + "start_yaw_rad", "where its nose points then, counter-clockwise from x"}, 0, -7, 7);
}

// Two that would be at one place have no common frame: they would not know of each other.
Status check_starts(const std::string& path, const LinkSettings& link) {
  for (std::size_t i = 0; i < link.drones.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      const DroneSettings &one = link.drones[k], &other = link.drones[i];
      if (uses_mocap(one.source) || uses_mocap(other.source)) continue;
      if (!one.in_common_frame || !other.in_common_frame) continue;
      const auto &a = one.odometry.start_m, &b = other.odometry.start_m;
      if (std::hypot(a[0] - b[0], a[1] - b[1]) >= link.separation.min_m) continue;
      return Error{fmt::format(
          "{}: drones {} and {} fly by onboard odometry from one place ({:.2f}, {:.2f}): say start_m of each, or "
          "common_frame = false of those that you keep apart by yourself",
          path, one.name, other.name, b[0], b[1])};
    }
  }
  return done;
}

Status check_pads(const std::string& path, const LinkSettings& link) {
  std::set<int> ids;
  for (const PadSettings& pad : link.pads) {
    if (!ids.insert(pad.id).second) return Error{fmt::format("{}: two [[pad]] have id {}", path, pad.id)};
  }
  const bool wanted = std::any_of(link.drones.begin(), link.drones.end(),
                                  [](const DroneSettings& drone) { return drone.source == PoseSource::pads; });
  if (wanted && link.pads.empty())
    return Error{fmt::format("{}: source \"pads\" needs a [[pad]] for each pad that lies there", path)};
  if (!wanted && !link.pads.empty())
    return Error{fmt::format("{}: [[pad]] goes with source \"pads\": no drone has it", path)};
  return done;
}

}  // namespace

PoseSettings read_pose(Config& config) {
  PoseSettings pose;
  pose.source =
      read_source(config,
                  {"pose.source",
                   "who says where drones are: motion capture (or any topic of poses) through agent, the "
                   "drone's own velocities and heights, these and mission pads, or motion capture, and onboard "
                   "odometry while its poses are missing"},
                  PoseSource::mocap);
  pose.odometry_after_ns = from_seconds(config.number({"pose.odometry_after_ms",
                                                       "with mocap+tello: onboard odometry takes over when no pose "
                                                       "of motion capture has come for so long; less than "
                                                       "failsafe.pose_lost_ms"},
                                                      to_ms(pose.odometry_after_ns), 20, 60'000) /
                                        1000);
  read_odometry(config, pose);
  read_pads(config, pose.pads);
  return pose;
}

void read_drone_pose(Config& config, const std::string& key, const PoseSettings& pose, DroneSettings& drone) {
  drone.source =
      read_source(config, {key + "pose_source", "as pose.source, of this drone", "pose.source"}, pose.source);
  drone.odometry = pose.odometry;
  drone.odometry_after_ns = pose.odometry_after_ns;
  const bool own = uses_odometry(drone.source);
  drone.velocity_known = pose.has_signs;
  if (own && !pose.has_signs && !config.is_describing()) {
    config.wrong("pose.velocity_signs",
                 fmt::format("must be there: drone {} flies by onboard odometry, or may, and with a wrong sign "
                             "it flies away",
                             drone.name));
  }
  read_start(config, key, drone.odometry);
  drone.in_common_frame = config.boolean(
      {key + "common_frame",
       "its poses are in the frame of the others': else it is not kept apart from them, and you see to it"},
      true);
  drone.by_hand_without_pose =
      config.boolean({key + "by_hand_without_pose",
                      "a pilot, who sees it, may fly it without a usable position: then the fence is its ceiling alone",
                      "true where onboard odometry alone is the source"},
                     !uses_mocap(drone.source));
}

Status check_poses(const std::string& path, const LinkSettings& link) {
  for (const DroneSettings& drone : link.drones) {
    if (drone.source != PoseSource::mocap_then_tello || drone.odometry_after_ns < link.failsafe.pose_lost_ns) continue;
    return Error{
        fmt::format("{}: pose.odometry_after_ms must be less than failsafe.pose_lost_ms: drone {} would brake "
                    "before onboard odometry takes over",
                    path, drone.name)};
  }
  if (auto status = check_starts(path, link); !status) return status;
  return check_pads(path, link);
}

}  // namespace ledgerline::link
