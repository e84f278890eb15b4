#include "tools/timing/metrics.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "tests/unit/tools/timing/some_traces.hpp"

namespace ledgerline::timing {
namespace {

using nlohmann::json;
using testing::HasSubstr;

TEST(Perfetto, EveryEventHasItsMembersAndNoSliceIsNegativeOrCrossesAnother) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 50; ++n) flight.trace(start + static_cast<TimeNs>(n) * 4 * ms, n);  // four at a time
  std::ostringstream out;
  EXPECT_EQ(write_perfetto(out, flight.traces().pop(), turns({{5, 10, 1500}})), 0U);
  const json document = json::parse(out.str());
  std::map<std::pair<int, int>, std::vector<std::pair<double, double>>> samples;  // of each track
  std::set<std::pair<int, int>> named;
  std::size_t slices = 0, counters = 0;
  for (const json& event : document.at("traceEvents")) {
    for (const char* member : {"ph", "ts", "pid", "tid", "name"}) ASSERT_TRUE(event.contains(member)) << event;
    if (event["ph"] == "C") {
      ++counters;
      EXPECT_EQ(event["args"]["late_us"], 1500);
    }
    if (event["name"] == "thread_name") {
      EXPECT_TRUE(named.emplace(event["pid"], event["tid"]).second) << event;
      EXPECT_THAT(event["args"]["name"].get<std::string>(), HasSubstr("samples in flight, "));
    }
    if (event["ph"] != "X") continue;
    EXPECT_TRUE(named.contains({event["pid"], event["tid"]})) << event;
    ++slices;
    const double begin = event["ts"], duration = event.at("dur");
    ASSERT_GE(duration, 0) << event;
    if (event["name"] == "sample") samples[{event["pid"], event["tid"]}].push_back({begin, begin + duration});
  }
  EXPECT_EQ(slices, 50 * (1 + stages.size()));
  EXPECT_EQ(counters, 1U);
  EXPECT_EQ(samples.size(), 4U) << "lanes";
  for (const auto& [track, all] : samples) {
    for (std::size_t i = 1; i < all.size(); ++i) EXPECT_LE(all[i - 1].second, all[i].first);
  }
}

TEST(Perfetto, HasTheNewestWalksAndSaysHowManyItLeftOut) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 50; ++n) flight.trace(start + static_cast<TimeNs>(n) * 20 * ms, n);
  std::ostringstream out;
  EXPECT_EQ(write_perfetto(out, flight.traces().pop(), {}, 10), 40U);
  EXPECT_THAT(out.str(), testing::AllOf(HasSubstr("\"sequence\":50"), testing::Not(HasSubstr("\"sequence\":40}"))));
}

}  // namespace
}  // namespace ledgerline::timing
