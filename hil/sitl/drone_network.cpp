#include "hil/sitl/drone_network.hpp"

#include <cassert>
#include <cmath>
#include <string>
#include <utility>

#include "common/msg/ros.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

constexpr std::uint64_t wifi_seed = 0x77696669;

}  // namespace

DroneNetwork::DroneNetwork(Random& seeds, std::uint64_t plans_seed) {
  for (std::size_t i = 0; i < drone_traffic_count - 1; ++i)
    links_.emplace_back(EmulatedLink::Kind::datagrams, seeds.next());
  noise_ = Random(seeds.next());
  links_.emplace_back(EmulatedLink::Kind::datagrams, plans_seed);
}

void DroneNetwork::push_state(TimeNs now, std::string_view text) {
  std::string bytes(text);
  if (misreport(now, sensors_, noise_, bytes)) push(now, DroneTraffic::states, bytes);
}

void DroneNetwork::push_mocap(TimeNs now, TimeNs real_offset_ns, const sim::MocapPose& measured) {
  sim::MocapPose pose = measured;
  if (mocap_.period_ns > 0) {
    if (now < next_mocap_ns_) return;
    next_mocap_ns_ = now + mocap_.period_ns;
  }
  if (mocap_.creep_mps == std::array<double, 3>{}) {
    creeps_since_ns_ = 0;
  } else if (creeps_since_ns_ == 0) {
    creeps_since_ns_ = now;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    pose.position_m[axis] += mocap_.offset_m[axis] + mocap_.creep_mps[axis] * to_seconds(now - creeps_since_ns_);
    if (mocap_.noise_m > 0) pose.position_m[axis] += mocap_.noise_m * noise_.normal();
  }
  if (mocap_.turn_rad != 0) {
    const double c = std::cos(mocap_.turn_rad / 2), s = std::sin(mocap_.turn_rad / 2);
    const auto [x, y, z, w] = pose.orientation;
    pose.orientation = {c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z};
  }
  if (mocap_.frozen) {
    if (!frozen_at_) frozen_at_ = pose;
    pose.position_m = frozen_at_->position_m;
    pose.orientation = frozen_at_->orientation;
  }
  PoseStamped message;
  message.header = {real_offset_ns + pose.stamp_ns, "map"};
  message.position_m = pose.position_m;
  message.orientation = pose.orientation;
  push(now, DroneTraffic::mocap, to_cdr(message));
}

void DroneNetwork::set_wifi(const Impairment::RecordedLink& wifi) {
  wifi_ = wifi;
  for (const DroneTraffic at : {DroneTraffic::to, DroneTraffic::answers, DroneTraffic::states})
    impair(at, link_of(at).impairment());
}

void DroneNetwork::impair(DroneTraffic at, const Impairment& wanted) {
  Impairment impairment = wanted;
  const bool by_radio = at == DroneTraffic::to || at == DroneTraffic::answers || at == DroneTraffic::states;
  if (wifi_ && by_radio && !impairment.recorded_link) impairment.recorded_link = wifi_;
  if (text_of(link_of(at).impairment()) == text_of(impairment)) return;
  [[maybe_unused]] const Status set = link_of(at).set(impairment);
  assert(set.ok());  // datagrams take every effect
}

void DroneNetwork::set_sensor_faults(std::vector<SensorFault> faults) { renew(sensors_, std::move(faults)); }

void DroneNetwork::set_mocap_fault(const MocapFault& fault) {
  mocap_ = fault;
  if (!fault.frozen) frozen_at_.reset();
}

Wires::Wires(const WorldConfig& config) : sdk(config.seed ^ 0x73646bULL, static_cast<std::size_t>(config.drones)) {
  Random seeds(config.seed ^ 0x6c696e6573ULL);
  for (int k = 1; k <= config.drones; ++k)
    drones.push_back({DroneNetwork(seeds, ~config.seed + static_cast<std::uint64_t>(k))});
  if (!config.wifi) return;
  auto wifi = *config.wifi;
  wifi.offset_ns +=
      static_cast<TimeNs>(Random(config.seed ^ wifi_seed).uniform() * static_cast<double>(wifi.recording->length_ns()));
  for (Drone& drone : drones) drone.network.set_wifi(wifi);
}

}  // namespace ledgerline::hil
