#include "tools/bench/metrics.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

namespace ledgerline::bench {
namespace {

using testing::HasSubstr;
using testing::Not;

/// 100 messages, each answered after `ms`; CPU so that a message takes `cpu_ms`.
Turn run(const std::string& competitor, int rate, int alternation, double ms, double cpu_ms) {
  Turn r{.competitor = competitor, .rate = rate, .alternation = alternation, .sent = 100, .answered = 100};
  r.times_ms.assign(100, ms);
  r.answers = 100;
  r.cpu_s = 200 * cpu_ms / 1e3;
  r.ledger_cpu_s = competitor == "ledgerline" ? 0.1 : 0.2;
  return r;
}

TEST(Turn, QuantilesAreNearestRank) {
  Turn r;
  EXPECT_EQ(r.quantile_ms(0.5), 0);
  for (int i = 200; i >= 1; --i) r.times_ms.push_back(i);
  EXPECT_EQ(r.quantile_ms(0.5), 101);
  EXPECT_EQ(r.quantile_ms(0.99), 198);
  EXPECT_EQ(r.quantile_ms(1), 200);
  EXPECT_EQ(r.quantile_ms(0), 1);
}

TEST(Turn, AnExchangeIsTwoMessages) {
  EXPECT_DOUBLE_EQ(*run("gateway", 70, 0, 10, 4).cpu_ms_per_message(), 4);
  EXPECT_FALSE(Turn{}.cpu_ms_per_message());
}

TEST(Turn, IsSaturatedByMissingAnswersOrByASlowTail) {
  Turn r = run("gateway", 70, 0, 10, 4);
  EXPECT_FALSE(r.saturated());
  r.answered = 99;
  EXPECT_FALSE(r.saturated()) << "one in a hundred is tolerated";
  r.answered = 98;
  EXPECT_TRUE(r.saturated());
  r.replaced = 2;
  EXPECT_TRUE(r.saturated()) << "a newer one's answer is not its own";
  r = run("gateway", 70, 0, 10, 4);
  r.times_ms[0] = r.times_ms[1] = 1001;
  EXPECT_TRUE(r.saturated());
  EXPECT_TRUE(Turn{}.saturated()) << "nothing was even sent";
}

TEST(Turn, CollapsesByLossOrByItsTimeLimit) {
  Turn r = run("gateway", 70, 0, 10, 4);
  EXPECT_FALSE(r.collapsed());
  r.answered = 90;
  r.replaced = 9;
  EXPECT_FALSE(r.collapsed());
  r.replaced = 8;
  EXPECT_TRUE(r.collapsed());
  r = run("gateway", 70, 0, 10, 4);
  r.timed_out = true;
  EXPECT_TRUE(r.collapsed());
}

TEST(SpreadOf, HasMedianAndExtremes) {
  EXPECT_FALSE(spread_of({}));
  const auto odd = spread_of({3, 1, 2});
  EXPECT_EQ(odd->median, 2);
  EXPECT_EQ(odd->low, 1);
  EXPECT_EQ(odd->high, 3);
  EXPECT_EQ(odd->count, 3);
  EXPECT_EQ(spread_of({4, 1, 2, 3})->median, 2.5);
}

TEST(Summary, RatiosAreTakenWithinEachAlternation) {
  // The second alternation was twice as slow for both: the ratio does not see it, a ratio of medians would.
  const Summary s = summarize({run("gateway", 70, 0, 20, 8), run("ledgerline", 70, 0, 10, 2),
                               run("gateway", 70, 1, 40, 8), run("ledgerline", 70, 1, 24, 2),
                               run("gateway", 70, 2, 20, 8), run("ledgerline-mbedtls", 70, 2, 10, 4)});
  ASSERT_EQ(s.ratios.size(), 3u) << "of mbedtls two, the second against the usual way";
  const Ratios& r = s.ratios[0];
  EXPECT_EQ(r.ours, "ledgerline");
  EXPECT_EQ(r.against, "gateway");
  EXPECT_EQ(r.rate, 70);
  EXPECT_DOUBLE_EQ(r.p50->low, 0.5);
  EXPECT_DOUBLE_EQ(r.p50->high, 0.6);
  EXPECT_DOUBLE_EQ(r.p50->median, 0.55);
  EXPECT_EQ(r.p50->count, 2);
  EXPECT_DOUBLE_EQ(r.cpu->median, 0.25);
  EXPECT_EQ(s.ratios[1].ours, "ledgerline-mbedtls");
  EXPECT_DOUBLE_EQ(s.ratios[1].cpu->median, 0.5);
  EXPECT_EQ(s.ratios[1].cpu->count, 1);
  EXPECT_EQ(s.ratios[2].against, "ledgerline");
  EXPECT_FALSE(s.ratios[2].cpu) << "no alternation has both";
}

TEST(Summary, EachRateAndBaselineHasItsOwnRatio) {
  const Summary s =
      summarize({run("direct", 30, 0, 20, 8), run("gateway", 30, 0, 40, 8), run("ledgerline", 30, 0, 10, 2),
                 run("gateway", 70, 0, 80, 8), run("ledgerline", 70, 0, 10, 2)});
  ASSERT_EQ(s.ratios.size(), 3u);
  EXPECT_EQ(s.ratios[0].against, "gateway");
  EXPECT_DOUBLE_EQ(s.ratios[0].p50->median, 0.25);
  EXPECT_EQ(s.ratios[1].against, "direct");
  EXPECT_DOUBLE_EQ(s.ratios[1].p50->median, 0.5);
  EXPECT_EQ(s.ratios[2].rate, 70);
  EXPECT_DOUBLE_EQ(s.ratios[2].p50->median, 0.125);
}

TEST(Summary, ARunWithoutAnyAnswerGivesNoRatioAndNoZero) {
  Turn dead{.competitor = "gateway", .rate = 1000, .sent = 500, .timed_out = true};
  const Summary s = summarize({dead, run("ledgerline", 1000, 0, 20, 1)});
  ASSERT_EQ(s.ratios.size(), 1u);
  EXPECT_FALSE(s.ratios[0].p50);
  EXPECT_FALSE(s.ratios[0].cpu);
  EXPECT_EQ(s.metrics.at(1000).at("gateway").lost, 500u);
  EXPECT_EQ(s.metrics.at(1000).at("gateway").collapsed, 1);
  EXPECT_THAT(to_table(s), HasSubstr("collapsed 1 of 1"));
}

TEST(Summary, SaturatesAtTheLowestRateWhereHalfOfTheRunsDo) {
  const Summary s =
      summarize({run("gateway", 70, 0, 10, 1), run("gateway", 70, 1, 10, 1), run("gateway", 70, 2, 5000, 1),
                 run("gateway", 110, 0, 5000, 1), run("gateway", 110, 1, 10, 1), run("gateway", 250, 0, 5000, 1),
                 run("direct", 250, 0, 10, 1)});
  EXPECT_EQ(s.saturates_at.at("gateway"), 110);
  EXPECT_FALSE(s.saturates_at.at("direct"));
}

TEST(Summary, TableAndJsonSayTheSame) {
  const Summary s = summarize({run("gateway", 70, 0, 20, 8), run("ledgerline", 70, 0, 5, 2),
                               run("gateway", 70, 1, 30, 8), run("ledgerline", 70, 1, 6, 2)});
  const std::string table = to_table(s);
  EXPECT_THAT(table, HasSubstr("25.0 (20.0-30.0)"));
  EXPECT_THAT(table, HasSubstr("0.23 (0.20-0.25)"));
  EXPECT_THAT(table, HasSubstr("Ledgerline, libcrypto"));
  EXPECT_THAT(table, Not(HasSubstr("direct path"))) << "it was not measured";
  const nlohmann::json json = to_json(s);
  EXPECT_EQ(json["figures"][0]["client"], "gateway");
  EXPECT_EQ(json["figures"][0]["p50_ms"]["median"], 25.0);
  EXPECT_EQ(json["figures"][0]["sent"], 200);
  EXPECT_EQ(json["ratios"][0]["p50"]["median"], 0.225);
  EXPECT_EQ(json["ratios"][0]["cpu"]["high"], 0.25);
  EXPECT_EQ(json["ratios"][0]["client"], "ledgerline");
  EXPECT_EQ(json["ratios"][0]["ledger_cpu"]["median"], 0.5);
  EXPECT_TRUE(json["saturates_at"]["ledgerline"].is_null());
}

TEST(Turn, JsonKeepsEveryTime) {
  Turn r = run("direct", 30, 2, 1.5, 1);
  r.times_ms = {1.5, 2.25};
  const nlohmann::json json = to_json(r);
  EXPECT_EQ(json["latencies_ms"], nlohmann::json::array({1.5, 2.25}));
  EXPECT_EQ(json["alternation"], 2);
  EXPECT_EQ(json["p50_ms"], 2.25);
}

TEST(Competitors, AreFoundByTheirIds) {
  EXPECT_EQ(find_competitor("polling")->design, Design::polling);
  EXPECT_TRUE(find_competitor("published")->published_settings);
  EXPECT_EQ(find_competitor("nobody"), nullptr);
}

}  // namespace
}  // namespace ledgerline::bench
