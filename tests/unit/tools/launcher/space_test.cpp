#include "tools/launcher/space.hpp"

#include <gtest/gtest.h>

namespace ledgerline::fly {
namespace {

Options flight(const std::string& ledger, int drones, double seconds) {
  Options options;
  options.ledger = ledger;
  options.drones = drones;
  options.seconds = seconds;
  return options;
}

TEST(FlySpace, LapsTakeTheirTime) {
  Options options;  // three laps of 6 m at 0.5 m/s
  EXPECT_GT(expected_seconds(options), 36 + 10);
  EXPECT_LT(expected_seconds(options), 120);
  Options slow = options;
  slow.speed_mps = 0.05;
  EXPECT_GT(expected_seconds(slow), 360);
  EXPECT_GE(expected_seconds(flight("embedded", 1, 500)), 500);
}

// What was measured on two cores, in bytes a second; an estimate must not be below, nor far above.
TEST(FlySpace, TheEstimateIsAboveWhatWasMeasuredAndNotFar) {
  constexpr double hour_s = 3600;
  for (const auto& [ledger, drones, orderers, measured] : {std::tuple{"embedded", 1, 1, 0.40e6},
                                                           {"embedded", 16, 1, 2.36e6},
                                                           {"fabric", 1, 1, 1.53e6},
                                                           {"fabric", 16, 1, 8.08e6},
                                                           {"fabric", 1, 3, 2.23e6},
                                                           {"fabric", 16, 3, 11.6e6}}) {
    Options options = flight(ledger, drones, hour_s);
    options.orderers = orderers;
    const auto bytes = static_cast<double>(expected_ledger_bytes(options));
    EXPECT_GT(bytes, 1.2 * measured * hour_s) << ledger << " " << drones << " " << orderers;
    EXPECT_LT(bytes, 2.0 * measured * hour_s) << ledger << " " << drones << " " << orderers;
  }
}

TEST(FlySpace, MoreOfAnythingTakesMore) {
  const auto base = expected_ledger_bytes(flight("fabric", 2, 60));
  EXPECT_GT(expected_ledger_bytes(flight("fabric", 3, 60)), base);
  EXPECT_GT(expected_ledger_bytes(flight("fabric", 2, 120)), base);
  Options faster = flight("fabric", 2, 60);
  faster.rate_hz = 60;
  EXPECT_GT(expected_ledger_bytes(faster), base);
}

}  // namespace
}  // namespace ledgerline::fly
