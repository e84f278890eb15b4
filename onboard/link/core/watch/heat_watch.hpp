#pragma once
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Whether a drone is too hot. In flight its rotors cool it and it says up to 88 degrees; on the ground nothing does,
/// and users report Tellos that switched themselves off there after some minutes (docs/sources.md). Core; one thread.
class HeatWatch {
 public:
  static constexpr float warm_c = 85;         ///< beyond it on the ground: half of the way is what a room does
  static constexpr float warm_in_air_c = 90;  ///< beyond what it says there all the time
  static constexpr float margin_c = 3;        ///< its two values are 3 apart: a warning ends below both

  void update(const TelloState& state, bool flies) noexcept {
    const float limit_c = flies ? warm_in_air_c : warm_c;
    hot_ = state.temperature_c > (hot_ ? limit_c - margin_c : limit_c);
  }
  bool hot() const noexcept { return hot_; }

 private:
  bool hot_ = false;
};

}  // namespace ledgerline::link
