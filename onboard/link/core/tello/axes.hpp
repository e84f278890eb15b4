#pragma once
#include <array>
#include <cmath>
#include <numbers>

#include "onboard/link/core/tello/tello_text.hpp"

/// A Tello's axes are forward, right, down; REP 103's forward, left, up. Angles in radians, SI units.
namespace ledgerline::link {

inline constexpr std::array<float, 3> forward_left_up{1, -1, -1};
/// Beyond, tof sees nothing: it says 65.53, and a Tello's flow ends before.
inline constexpr float tof_sees_m = 6;
inline constexpr float rad_per_deg = std::numbers::pi_v<float> / 180;

/// Roll, pitch, yaw.
inline std::array<float, 3> attitude_rad(const TelloState& state) noexcept {
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.attitude_deg[i] * rad_per_deg;
  return out;
}

/// The level part of a hovering drone's thrust by its lean, forward and left: what it gathers speed with in still air.
inline std::array<double, 2> lean_mps2(const TelloState& state) noexcept {
  constexpr double gravity_mps2 = 9.80665;
  const auto attitude = attitude_rad(state);
  return {gravity_mps2 * std::tan(static_cast<double>(attitude[1])),
          -gravity_mps2 * std::tan(static_cast<double>(attitude[0]))};
}

inline std::array<float, 3> acceleration_mps2(const TelloState& state) noexcept {
  constexpr float mps2_per_mg = 9.80665F / 1000;
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.acceleration_mg[i] * mps2_per_mg;
  return out;
}

}  // namespace ledgerline::link
