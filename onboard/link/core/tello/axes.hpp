#pragma once
#include <array>
#include <numbers>

#include "onboard/link/core/tello/tello_text.hpp"

/// A Tello's axes are forward, right, down; REP 103's forward, left, up. Angles in radians, SI units.
namespace ledgerline::link {

inline constexpr std::array<float, 3> forward_left_up{1, -1, -1};
inline constexpr float rad_per_deg = std::numbers::pi_v<float> / 180;

/// Roll, pitch, yaw.
inline std::array<float, 3> attitude_rad(const TelloState& state) noexcept {
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.attitude_deg[i] * rad_per_deg;
  return out;
}

inline std::array<float, 3> acceleration_mps2(const TelloState& state) noexcept {
  constexpr float mps2_per_mg = 9.80665F / 1000;
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.acceleration_mg[i] * mps2_per_mg;
  return out;
}

}  // namespace ledgerline::link
