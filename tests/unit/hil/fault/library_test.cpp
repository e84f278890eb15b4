#include <gtest/gtest.h>

#include <cstdio>

#include "hil/fault/own_code.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

TEST(FaultCampaign, EveryScenarioHolds) {
  const auto files = library();
  EXPECT_GE(files.size(), 60U);
  std::vector<Flight> flights;
  for (std::size_t i = 0; i < files.size(); i += slow ? 25 : 1) {
    auto script = load_script(files[i]);
    ASSERT_TRUE(script.ok()) << script.error().message;
    if (!check_sitl(*script)) continue;  // somebody's own program flies it: tests/system/own_code
    for (int seed = 1; seed <= seeds(1, 20); ++seed) flights.push_back({*script, static_cast<std::uint64_t>(seed)});
  }
  double flown_s = 0;
  const TimeNs begin = monotonic_ns();
  fly_all(
      flights.size(), 2, [&](std::size_t i) { return flights[i]; },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        EXPECT_TRUE(result.ok()) << flight.script.name;
        if (!result) return true;
        flown_s += to_seconds(result->flown_ns);
        EXPECT_TRUE(result->all_held()) << flight.script.name << " seed " << flight.seed << "\n"
                                        << broken_text(*result);
        return true;
      });
  std::printf("%zu flights, %.0f s flown, %.0f times real time in two threads\n", flights.size(), flown_s,
              flown_s / to_seconds(monotonic_ns() - begin));
}

}  // namespace
}  // namespace ledgerline::hil
