#pragma once
#include <array>
#include <vector>

#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

/// What a calibration flight leaves behind: everything that the estimates are made from. All times are of one monotonic
/// clock of the computer that flies.
namespace ledgerline::tello {

/// Places in rc.
enum Channel : int { right = 0, forward = 1, up = 2, clockwise = 3 };

/// Above what is below it; where its sensor sees nothing (65.53 m), above where it took off.
inline float height_of(const link::TelloState& state) { return state.tof_m < 10 ? state.tof_m : state.height_m; }

/// From this moment on the drone was sent this: right, forward, up, clockwise by the SDK's words.
struct SentRc {
  TimeNs sent_ns = 0;
  link::Rc rc{};
};

struct StateSample {
  TimeNs came_ns = 0;
  link::TelloState state;
};

struct PoseSample {
  TimeNs stamp_ns = 0;  ///< when it was measured
  std::array<double, 3> position_m{};
  double yaw_rad = 0;  ///< of its orientation: counter-clockwise about z, of x from x
};

/// One channel of rc at work, between two hovers.
struct Block {
  int channel = 0;  ///< of SentRc::rc
  TimeNs begin_ns = 0, end_ns = 0;
};

struct Record {
  std::vector<SentRc> sent_rc;  ///< of the blocks
  std::vector<StateSample> states;
  std::vector<PoseSample> poses;  ///< none: flown without a pose source
  std::vector<Block> blocks;
};

}  // namespace ledgerline::tello
