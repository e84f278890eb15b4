#pragma once
#include <array>
#include <string_view>

namespace ledgerline::report {

/// Two-way latency as published for the bridge that this project starts from, in seconds: box (quartiles) and whiskers.
struct PublishedBox {
  std::string_view name;
  double low_s, q1_s, median_s, q3_s, high_s;
};
inline constexpr std::array published_boxes{
    PublishedBox{"square", .313, .396, .456, .525, .711},
    PublishedBox{"triangle", .295, .387, .458, .512, .697},
    PublishedBox{"x", .316, .439, .521, .618, .879},
    PublishedBox{"3 drones", .529, .731, .802, .873, 1.081},
};

/// The box to stand beside a flight.
constexpr const PublishedBox& published_for(std::string_view shape, int drones) {
  for (const PublishedBox& box : published_boxes) {
    if (drones > 1 ? box.name == "3 drones" : box.name == shape) return box;
  }
  return published_boxes[0];
}

}  // namespace ledgerline::report
