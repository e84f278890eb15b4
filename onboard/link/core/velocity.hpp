#pragma once
#include <array>

namespace ledgerline::link {

/// A velocity, of the map frame unless said otherwise, and a yaw rate, counter-clockwise.
struct Velocity {
  std::array<float, 3> mps{};
  float yaw_radps = 0;
};

}  // namespace ledgerline::link
