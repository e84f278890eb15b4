#pragma once
#include <string>
#include <tuple>

#include "common/msg/ros.hpp"
#include "ledgerline.pb.h"

namespace ledgerline {

/// A drone's state as its host's agent sends it, of boot 7, 50 a second: the argument of a call of `set`.
inline std::string state_call(std::uint64_t sequence, TimeNs now_ns) {
  SetCall call;
  call.set_stream(true);
  StateSample sample;
  sample.boot_id = 7;
  sample.sequence = sequence;
  sample.stamp_ns = static_cast<TimeNs>(sequence) * 20 * ns_per_ms;
  sample.pose_stamp_ns = sample.stamp_ns;
  const TimeNs offset_ns = now_ns - sample.stamp_ns;
  for (const auto& [id, type, cdr] :
       {std::tuple("tello1/odom", odometry_type, to_cdr(odometry_of(sample, "tello1", offset_ns))),
        std::tuple("tello1/link", link_status_type, link_status_to_cdr(sample, offset_ns))}) {
    Asset& asset = *call.add_assets();
    asset.set_id(id);
    asset.set_msg_type(std::string(type));
    asset.set_msg_data(cdr);
  }
  return call.SerializeAsString();
}

}  // namespace ledgerline
