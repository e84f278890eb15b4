#include "onboard/agent/core/mocap_intake.hpp"

#include <cmath>

#include "common/msg/ros.hpp"

namespace ledgerline::agent {
namespace {

constexpr double norm_slack = 0.05;  // of the squared norm: mocap systems round, and none sends half a rotation

double squared_norm(const std::array<double, 4>& q) { return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]; }

}  // namespace

double MocapIntake::norm(const MocapMessage& message) { return std::sqrt(squared_norm(message.orientation)); }

std::optional<MocapPose> MocapIntake::take(const MocapMessage& message) {
  const auto stamp_ns = stamps_of_this_host_ ? clock_.stamp(message.source_real_ns, message.arrived_ns)
                                             : std::optional(message.arrived_ns);
  // Not a number is not near 1, either.
  if (!stamp_ns || !(std::abs(squared_norm(message.orientation) - 1) < norm_slack)) return std::nullopt;
  return MocapPose{*stamp_ns, message.position_m, yaw_from_quaternion(message.orientation)};
}

}  // namespace ledgerline::agent
