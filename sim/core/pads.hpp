#pragma once
#include <optional>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// A mission pad as a drone sees it. The pad's frame: x where its rocket points, y left of that, z up.
struct PadSight {
  int id = 0;
  Vector position = Vector::Zero();  ///< of the drone, in the pad's frame [m]
  double yaw_rad = 0;                ///< of the drone, in the pad's frame, counter-clockwise
};

/// The pad whose middle is nearest, of those in the downward camera's sight (SensorParameters says what that is), with
/// the camera's noise; nothing where there is none. Pure but for `random`.
std::optional<PadSight> see_pad(const Parameters& parameters, const Body& body, Random& random);

/// "1:0:0,2:1.5:0:90": pads, each its id (1 to 8), the place of its middle (m, map frame), and if wanted where its
/// rocket points (degrees, counter-clockwise from x) and its size (m). An id may be there once.
Result<std::vector<Pad>> parse_pads(std::string_view text);
/// The text that parse_pads reads.
std::string pads_text(const std::vector<Pad>& pads);

}  // namespace ledgerline::sim
