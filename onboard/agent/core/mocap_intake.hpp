#pragma once
#include <array>
#include <optional>
#include <utility>

#include "onboard/agent/core/fusion.hpp"
#include "onboard/agent/core/mocap_clock.hpp"

namespace ledgerline::agent {

/// A pose as it came from a mocap system.
struct MocapMessage {
  TimeNs source_real_ns = 0;  ///< its stamp, of the mocap computer's real-time clock
  TimeNs arrived_ns = 0;      ///< on this host's CLOCK_MONOTONIC
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{};  ///< x, y, z, w
};

/// Whether a mocap pose is accepted at all, before it is fused: its orientation is a unit quaternion, to 5 % of the
/// squared norm (a message of zeros is none), and its stamp is one that MocapClock accepts. Whether it fits the ones
/// before it, or repeats them, is Fusion's to say. One thread.
class MocapIntake {
 public:
  /// `stamps_of_this_host`: false where the mocap computer's clock is not held to this one's: arrival counts.
  MocapIntake(MocapClock::ReadOffset read, bool stamps_of_this_host = true)
      : clock_(std::move(read)), stamps_of_this_host_(stamps_of_this_host) {}

  /// The pose on this host's clock; nothing where it is not accepted.
  std::optional<MocapPose> take(const MocapMessage& message);

  /// Of the orientation; 1 for one that is accepted.
  static double norm(const MocapMessage& message);
  MocapClock& clock() { return clock_; }

 private:
  MocapClock clock_;
  bool stamps_of_this_host_;
};

}  // namespace ledgerline::agent
