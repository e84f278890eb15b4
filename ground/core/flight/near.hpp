#pragma once
#include <array>
#include <cmath>

#include "common/msg/onboard.hpp"

namespace ledgerline::ground {

constexpr double near_m = 0.2;  ///< of a place: close enough to call it reached
constexpr double still_mps = 0.2;

/// Near this place of the map, and no longer on its way.
inline bool is_settled(const StateSample& state, const std::array<double, 3>& place_m) {
  return std::hypot(state.position_m[0] - place_m[0], state.position_m[1] - place_m[1]) < near_m &&
         std::abs(state.position_m[2] - place_m[2]) < near_m &&
         std::hypot(state.velocity_mps[0], state.velocity_mps[1], state.velocity_mps[2]) < still_mps;
}

}  // namespace ledgerline::ground
