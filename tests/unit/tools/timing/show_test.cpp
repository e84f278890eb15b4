#include "tools/timing/metrics.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/unit/tools/timing/some_traces.hpp"

namespace ledgerline::timing {
namespace {

using nlohmann::json;
using testing::HasSubstr;

TEST(Show, TheTableAndTheJsonHaveEveryStage) {
  const Metrics metrics = some_figures();
  const auto verdicts = std::vector{check(parse_limit("p99.apply=1us").value(), metrics),
                                    check(parse_limit("p99.9.apply=1ms").value(), metrics)};
  const std::string table = to_table(metrics, 5) + to_table(verdicts);
  const json j = to_json(metrics, verdicts);
  for (std::size_t i = 0; i < stages.size(); ++i) {
    EXPECT_THAT(table, HasSubstr(std::string(stages[i].name)));
    EXPECT_EQ(j["stages"][i]["name"].get<std::string>(), stages[i].name);
    EXPECT_EQ(j["stages"][i]["count"], 100);
    EXPECT_EQ(j["stages"][i]["max"], 1.0);
  }
  for (const char* part :
       {"two_way", "setpoint_at_once", "FIFO 80", "headroom 125.5 %", "NOT KEPT p99.apply=1us: 1.000 ms\n",
        "kept     p99.9.apply=1ms: 1.000 ms (p99.9 of 100 samples is their maximum)\n"})
    EXPECT_THAT(table, HasSubstr(part));
  EXPECT_EQ(j["limits"][1]["note"], "p99.9 of 100 samples is their maximum");
  EXPECT_FALSE(j["limits"][0].contains("note")) << "a hundred samples carry a p99";
  EXPECT_EQ(j["ok"], false);
  EXPECT_EQ(j["budget"]["headroom_percent"], 125.5);
  EXPECT_EQ(j["threads"][0]["major_faults"], 3);
  EXPECT_EQ(j["loop"]["overruns"], 1);
}

TEST(Show, BarsAreHighestWhereMostAreAndEmptyWhereNoneIs) {
  Histogram histogram;
  EXPECT_EQ(bars_text(histogram), "");
  for (int i = 0; i < 100; ++i) histogram.add((i < 70 ? 10 : 50) * ns_per_ms);
  const std::string text = bars_text(histogram);
  EXPECT_THAT(text, testing::StartsWith("  two_way, "));
  EXPECT_THAT(text, HasSubstr(": \u2588  "));
  EXPECT_THAT(text, HasSubstr("  \u2584\n"));
}

TEST(Show, ThePageNeedsNoNetworkAndNoNameCanEndItsScript) {
  json document = to_json(some_figures(), {});
  document["asked"] = {{"directory", "/run"}};
  document["machine"] = {{"cores", 2}};
  const std::string page = to_page(document);
  EXPECT_THAT(page, HasSubstr("loop\\u003c/script>"));
  for (const char* outside : {"src=", "href=", "http", "@DATA@", "@STYLE@"})
    EXPECT_THAT(page, testing::Not(HasSubstr(outside)));
}

}  // namespace
}  // namespace ledgerline::timing
