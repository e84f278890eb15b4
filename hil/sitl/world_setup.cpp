#include "hil/sitl/world_setup.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/access/access.hpp"
#include "common/base/random.hpp"
#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"
#include "onboard/link/core/failsafe.hpp"
#include "sim/core/parameters.hpp"

namespace ledgerline::hil {

const crypto::IdentityName drone_host{"Org1MSP", "CN=User1@org1.ledgerline"};
const crypto::IdentityName operator_name{"Org2MSP", "CN=User1@org2.ledgerline"};
const crypto::IdentityName supervisor_name{"Org1MSP", "CN=User2@org1.ledgerline"};
const crypto::IdentityName outsider_name{"Org3MSP", "CN=User1@org3.ledgerline"};
const crypto::IdentityName administrator_name{"Org2MSP", "CN=Admin@org2.ledgerline"};

std::string drone_name(int number) { return fmt::format("tello{}", number); }

ground::Task task_of(const WorldConfig& config, int number) {
  if (const auto own = config.tasks.find(number); own != config.tasks.end()) return own->second;
  return {config.shape, config.side_m, config.waypoints, config.speed_mps, config.laps};
}

Reach reach_of(const ground::Task& task) {
  Reach reach;
  if (task.waypoints.empty()) {
    reach.max_m = {task.side_m, task.side_m};
    return reach;
  }
  for (const ground::Waypoint& waypoint : task.waypoints) {
    for (std::size_t i = 0; i < 2; ++i) {
      const double at_m = waypoint.at_m[static_cast<Eigen::Index>(i)];
      reach.min_m[i] = std::min(reach.min_m[i], at_m);
      reach.max_m[i] = std::max(reach.max_m[i], at_m);
    }
  }
  return reach;
}

link::FenceSettings fence_around(const WorldConfig& config, const std::vector<std::array<double, 2>>& starts_m) {
  const double room_m = config.room_m.value_or(3);
  link::FenceSettings fence;
  fence.min_m = {-std::abs(room_m), -std::abs(room_m), 0};
  fence.max_m = {0, 0, 3};
  for (std::size_t k = 0; k < starts_m.size(); ++k) {
    const Reach reach = reach_of(task_of(config, static_cast<int>(k) + 1));
    for (std::size_t i = 0; i < 2; ++i) {
      fence.min_m[i] = std::min(fence.min_m[i], starts_m[k][i] + reach.min_m[i] - std::abs(room_m));
      fence.max_m[i] = std::max(fence.max_m[i], starts_m[k][i] + reach.max_m[i] + room_m);
    }
  }
  return fence;
}

ground::Path course_of(const WorldConfig& config, int number, const std::array<double, 2>& start_m) {
  return {ground::waypoints_of(task_of(config, number)), Eigen::Vector2d(start_m[0], start_m[1])};
}

std::vector<std::array<double, 2>> corners_of(const ground::Path& path) {
  std::vector<std::array<double, 2>> corners;
  for (const Eigen::Vector2d& corner : path.corners()) corners.push_back({corner.x(), corner.y()});
  return corners;
}

node::CoreConfig node_config(const WorldConfig& config) {
  node::CoreConfig node;
  node.batch_count = config.batch_count;
  node.batch_timeout_ns = config.batch_timeout_ns;
  return node;
}

sim::Parameters sim_parameters(const WorldConfig& config) {
  sim::Parameters parameters;
  parameters.drones = config.drones;
  parameters.seed = config.seed;
  parameters.battery.start = config.battery;
  parameters.start_yaw_rad = config.yaw_deg / 180 * std::numbers::pi;
  parameters.pads = config.pads;
  parameters.sensors = config.sensors;
  parameters.sdk.keeps_rc = config.keeps_rc;
  parameters.sdk.command_counts = config.command_counts;
  parameters.wind.gust_mps = config.gust_mps;
  if (!link::uses_mocap(config.pose)) parameters.mocap_hz = 0;
  // A heavier drone hovers as well as any, its flight controller sees to that; but the same wind moves it less, and
  // its motors have less to spare.
  const double factor = 1 + config.model_error;
  parameters.body.mass_kg *= factor;
  parameters.body.drag_xy_per_s /= factor;
  parameters.body.drag_z_per_s /= factor;
  parameters.body.max_thrust_by_weight /= factor;
  parameters.control.velocity_lag_s *= factor;
  parameters.sdk.rc_full_mps = config.full_scale_mps * factor;
  parameters.control.max_speed_mps = std::max(parameters.control.max_speed_mps, 1.5 * config.full_scale_mps);
  return config.drawn_tello ? sim::draw_tello(parameters, config.seed) : parameters;
}

namespace {

// As somebody who measured the simulator's drone.
void set_calibrated(const sim::SensorParameters& sensors, link::OdometrySettings& odometry) {
  odometry.velocity_scale = 1 / (1 + sensors.flow_scale_offset);
  odometry.velocity_truncated = sensors.velocity_truncated;
  odometry.velocity_lag_s = sensors.velocity_lag_s;
  odometry.velocity_lag_sigma_s = 0.03;
  odometry.flow_scale = 0.02;
  const double bias_mps = std::hypot(sensors.flow_bias_mps[0], sensors.flow_bias_mps[1]) / std::numbers::sqrt2;
  odometry.flow_mps = std::hypot(1.1 * sensors.flow_mps, bias_mps);
  if (bias_mps < sensors.flow_mps) odometry.flow_s = sensors.flow_s;
}

}  // namespace

link::LinkSettings link_settings(const WorldConfig& config) {
  const sim::Parameters places;
  link::LinkSettings settings;
  settings.rate_hz = config.rate_hz;
  settings.rc.full_scale_mps = static_cast<float>(config.full_scale_mps);
  settings.playout.max_speed_mps =
      std::max(settings.playout.max_speed_mps, 1.5F * static_cast<float>(config.full_scale_mps));
  settings.playout.max_age_ns = std::max(settings.playout.max_age_ns, config.max_age_ns);
  settings.track.on_board = config.track;
  settings.failsafe.on_untrusted_ledger = config.on_untrusted_ledger;
  settings.playout.max_margin_ns = 0;  // as ./fly: ground counts on plans that take over as they come
  Random put(config.seed);
  for (int k = 1; k <= config.drones; ++k) {
    link::DroneSettings drone{.name = drone_name(k),
                              .number = static_cast<DroneNumber>(k),
                              .source = config.pose,
                              .by_hand_without_pose = !link::uses_mocap(config.pose)};
    drone.odometry.start_m = sim::start_of(places, k);
    drone.odometry.start_m[0] += config.start_error_m * put.normal();
    drone.odometry.start_m[1] += config.start_error_m * put.normal();
    drone.odometry.start_yaw_rad = config.yaw_deg / 180 * std::numbers::pi + config.start_error_rad * put.normal();
    if (config.calibrated) set_calibrated(config.sensors, drone.odometry);
    settings.drones.push_back(drone);
  }
  for (const sim::Pad& pad : config.pads)
    settings.pads.push_back({.id = pad.id, .position_m = {pad.x_m, pad.y_m, 0}, .yaw_rad = pad.yaw_rad});
  if (!config.room_m) return settings;
  std::vector<std::array<double, 2>> starts_m;
  for (int k = 1; k <= config.drones; ++k) {
    const auto start_m = sim::start_of(places, k);
    starts_m.push_back({start_m[0], start_m[1]});
  }
  settings.fence = fence_around(config, starts_m);
  return settings;
}

agent::AgentCoreSettings agent_settings(const WorldConfig& config, std::uint64_t starts) {
  agent::AgentCoreSettings agent;
  agent.seed = config.seed + starts;
  // A far ledger is not yet a silent one.
  agent.ledger_silent_after_ns += std::max<TimeNs>(0, config.max_age_ns - agent.check.max_age_ns);
  agent.check.max_age_ns = config.max_age_ns;
  agent.idle_evict_ns = config.idle_evict_ns;
  for (int k = 1; k <= config.drones; ++k) agent.drones.push_back({static_cast<DroneNumber>(k), drone_name(k)});
  return agent;
}

ground::FlightConfig ground_config(const WorldConfig& config, SimulatedLedger& ledger) {
  ground::FlightConfig ground;
  for (int k = 1; k <= config.drones; ++k) {
    ground.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
    if (const auto own = config.tasks.find(k); own != config.tasks.end()) ground.drones.back().task = own->second;
  }
  ground.shape = config.shape;
  ground.side_m = config.side_m;
  ground.waypoints = config.waypoints;
  ground.ledger = config.mode == WorldConfig::Mode::ledger;
  ground.laps = config.laps;
  ground.manual = config.manual;
  if (config.manual) ground.seconds = config.seconds;
  ground.follower = config.follower;
  ground.request_rule = config.request_rule;
  ground.request_after_ns = config.request_after_ns;
  ground.controller.speed_mps = config.speed_mps;
  ground.controller.predict = config.predict;
  ground.controller.ramp = config.ramp;
  const link::LinkSettings link = link_settings(config);
  ground.controller.full_scale_mps = static_cast<double>(link.rc.full_scale_mps);
  ground.controller.max_acceleration_mps2 = static_cast<double>(link.playout.max_acceleration_mps2);
  ground.controller.pose_lost_ns = link::pose_limit_ns(link.failsafe, link::uses_odometry(config.pose));
  ground.self = operator_name;
  ground.trusted = ledger.shared_registry();
  return ground;
}

Status prepare(SimulatedLedger& ledger, int drones) {
  const auto admin1 = ledger.add_client({"Org1MSP", "CN=Admin@org1.ledgerline"});
  const auto admin2 = ledger.add_client(administrator_name);
  const auto holder = ledger.add_client(operator_name);
  EnrollCall host;
  *host.mutable_identity() = to_message(drone_host);
  EnrollCall role;
  *role.mutable_identity() = to_message(operator_name);
  role.set_role(OPERATOR);
  GrantCall grant;
  grant.mutable_grant()->mutable_to()->set_msp_id(operator_name.msp_id);
  grant.mutable_grant()->set_fly(true);
  grant.mutable_grant()->set_max_priority(contract::max_priority);
  grant.mutable_grant()->set_stop(true);
  grant.mutable_grant()->set_cut(true);
  LeaseCall lease;
  for (int k = 1; k <= drones; ++k) {
    host.add_drones(drone_name(k));
    grant.add_drones(drone_name(k));
    lease.add_drones(drone_name(k));
  }
  if (auto s = ledger.commit_now(0, admin1, {contract::enroll, {host.SerializeAsString()}}); !s) return s;
  if (auto s = ledger.commit_now(0, admin1, {contract::grant, {grant.SerializeAsString()}}); !s) return s;
  if (auto s = ledger.commit_now(0, admin2, {contract::enroll, {role.SerializeAsString()}}); !s) return s;
  return ledger.commit_now(0, holder, {contract::acquire, {lease.SerializeAsString()}});
}

Status enroll_supervisors(SimulatedLedger& ledger, int drones) {
  for (const crypto::IdentityName& name : {supervisor_name, outsider_name}) {
    const auto domain = name.subject.substr(name.subject.find('@'));
    const auto admin = ledger.add_client({name.msp_id, "CN=Admin" + domain});
    EnrollCall role;
    *role.mutable_identity() = to_message(name);
    role.set_role(SUPERVISOR);
    if (auto s = ledger.commit_now(0, admin, {contract::enroll, {role.SerializeAsString()}}); !s) return s;
  }
  GrantCall grant;
  grant.mutable_grant()->mutable_to()->set_msp_id(outsider_name.msp_id);
  grant.mutable_grant()->set_stop(true);
  for (int k = 1; k <= drones; ++k) grant.add_drones(drone_name(k));
  const auto admin1 = ledger.add_client({"Org1MSP", "CN=Admin@org1.ledgerline"});
  return ledger.commit_now(0, admin1, {contract::grant, {grant.SerializeAsString()}});
}

}  // namespace ledgerline::hil
