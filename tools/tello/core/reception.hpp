#pragma once
#include <array>
#include <string_view>

#include "common/msg/ros.hpp"
#include "onboard/link/core/tello/tello_text.hpp"
#include "tools/checks/core/drone.hpp"

namespace ledgerline::tello {

/// A pose as it came, plain data so that it can come from a thread of DDS.
struct ReceivedPose {
  TimeNs arrived_ns = 0, stamp_ns = 0;  ///< real time
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{};  ///< x, y, z, w
  std::array<char, 61> frame{};         ///< of its header, cut; ends with a zero

  static ReceivedPose of(TimeNs arrived_ns, const PoseStamped& pose);
};

/// Counts what comes of one drone while it stands: state texts, and poses of motion capture; and says of them what a
/// preflight's list needs. A rate is that of the gaps between the first and the last, so that what came before it was
/// heard for the first time (a handshake, DDS finding its writer) does not count as silence. Core: no I/O, no clock;
/// one thread.
class Reception {
 public:
  void on_state(TimeNs now, std::string_view bytes);
  void on_pose(const ReceivedPose& pose);
  /// Battery, rates and pose, as of this moment. `stamps_count`: a pose is as old as its stamp says, not its arrival.
  void report(TimeNs now, TimeNs now_real_ns, bool stamps_count, checks::DroneInputs& drone) const;

 private:
  struct Count {
    std::size_t times = 0;
    TimeNs first_ns = 0, last_ns = 0;
    void add(TimeNs now);
    double rate_hz(TimeNs now) const;
  };
  Count states_, poses_;
  link::TelloState state_;
  link::Quote unreadable_;  ///< newest text that is no state text; empty: none
  ReceivedPose pose_;
  TimeNs least_delay_ns_ = 0;
};

}  // namespace ledgerline::tello
