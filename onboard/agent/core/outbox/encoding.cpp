#include <algorithm>
#include <limits>

#include "common/msg/contract.hpp"
#include "common/msg/ros.hpp"
#include "common/verification/calls.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/outbox/batcher.hpp"
#include "onboard/agent/core/outbox/integrity.hpp"
#include "onboard/agent/core/outbox/transition_sender.hpp"

namespace ledgerline::agent {
namespace {

void add_asset(SetCall& call, const std::string& id, std::string_view type, std::string cdr) {
  Asset* asset = call.add_assets();
  asset->set_id(id);
  asset->set_topic("/" + id);
  asset->set_msg_type(std::string(type));
  asset->set_msg_data(std::move(cdr));
}

void add_battery(SetCall& call, const StateSample& sample, const std::string& drone, TimeNs real_offset_ns) {
  BatteryState battery;
  battery.header = {sample.stamp_ns + real_offset_ns, drone + "/base_link"};
  battery.voltage_v = std::numeric_limits<float>::quiet_NaN();  // a Tello does not report it
  battery.percentage = sample.battery;
  add_asset(call, drone + "/battery", battery_type, to_cdr(battery));
}

// The status last: who reads it then knows the others.
void add_state(SetCall& call, const StateSample& sample, const std::string& drone, TimeNs real_offset_ns) {
  if (sample.pose_stamp_ns != 0) {
    add_asset(call, drone + "/odom", odometry_type, to_cdr(odometry_of(sample, drone, real_offset_ns)));
  }
  add_asset(call, drone + "/link", link_status_type, link_status_to_cdr(sample, real_offset_ns));
}

}  // namespace

fabric::Call encode_batch(const StateBatch& batch, const std::vector<DroneName>& drones, TimeNs real_offset_ns) {
  SetCall call;
  call.set_stream(true);
  for (const auto* samples : {&batch.samples, &batch.repeated}) {
    for (const StateSample& sample : *samples) {
      const auto it = std::ranges::find(drones, sample.drone, &DroneName::number);
      if (it == drones.end()) continue;
      const bool with_battery =
          std::find(batch.batteries.begin(), batch.batteries.end(), sample.drone) != batch.batteries.end();
      if (with_battery) add_battery(call, sample, it->name, real_offset_ns);
      add_state(call, sample, it->name, real_offset_ns);
    }
  }
  return fabric::Call{.function = contract::set,
                      .args = {call.SerializeAsString()},
                      .reported_by_block = true,
                      .need = verification::batch_need()};
}

fabric::Call encode_transitions(const TransitionSender::Sending& sending, TimeNs real_offset_ns) {
  SetCall call;
  for (const auto& part : sending.parts) {
    const std::string& drone = part.drone->name;
    const Header header{part.transitions.back().stamp_ns + real_offset_ns, drone + "/base_link"};
    add_asset(call, drone + "/failsafe", transitions_type, transitions_to_cdr(header, drone, part.transitions));
  }
  return fabric::Call{.function = contract::set, .args = {call.SerializeAsString()}};
}

fabric::Call encode_alarm(const AlarmSender::Sending& sending, const IntegrityMonitor& integrity, TimeNs now,
                          TimeNs real_offset_ns) {
  std::vector<Alarm> alarms;
  for (std::size_t i = 0; i < violation_kinds; ++i) {
    const auto kind = static_cast<IntegrityViolation>(i);
    const IntegrityMonitor::Reason& reason = integrity.of(kind);
    if (reason.count > 0)
      alarms.push_back(
          {std::string(name(kind)), integrity.stands(now, kind), reason.count, reason.words, reason.block});
  }
  SetCall call;
  for (const DroneName* drone : sending.drones) {
    const Header header{now + real_offset_ns, drone->name + "/base_link"};
    add_asset(call, drone->name + "/alarm", alarms_type, alarms_to_cdr(header, drone->name, alarms));
  }
  return fabric::Call{.function = contract::set, .args = {call.SerializeAsString()}};
}

}  // namespace ledgerline::agent
