#include "tools/bench/utm/figures.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

namespace ledgerline::utm {
namespace {

using testing::HasSubstr;

Turn run(const std::string& contender, const std::string& settings, int alternation, double ms) {
  Turn r{.contender = contender, .settings = settings, .rate = 30, .alternation = alternation};
  for (int i = 0; i < 98; ++i) r.count(End::registered, 1, 0, ms);
  r.count(End::refused, 2, 1, 2 * ms);
  r.count(End::lost, 6, 6, 9'000);
  r.length_s = 7;
  return r;
}

TEST(UtmTurn, CountsRefusalsAndMvccConflictsApart) {
  const Turn r = run("gateway", "ours", 0, 10);
  EXPECT_EQ(r.submitted, 100u);
  EXPECT_EQ(r.registered, 98u);
  EXPECT_EQ(r.refused, 1u);
  EXPECT_EQ(r.lost(), 1u);
  EXPECT_EQ(r.retried, 2u);
  EXPECT_EQ(r.conflicts, 7u);
  EXPECT_DOUBLE_EQ(r.registered_per_s(), 14);
}

TEST(UtmTurn, LatencyIsOfThoseRegisteredAlone) {
  const Turn r = run("gateway", "ours", 0, 10);
  EXPECT_EQ(r.times_ms.size(), 98u);
  EXPECT_EQ(quantile(r.times_ms, 1), 10);
  EXPECT_EQ(quantile(r.refused_ms, 0.5), 20);
  EXPECT_EQ(quantile({}, 0.5), std::nullopt);
}

TEST(UtmSummary, ComparesWithTheGatewayOfTheSameSettingsAndAlternation) {
  const auto figures =
      summarize({run("gateway", "ours", 0, 40), run("ledgerline", "ours", 0, 10), run("ledgerline", "ours", 1, 30),
                 run("gateway", "ours", 1, 60), run("gateway", "stock", 0, 2000), run("ledgerline", "stock", 0, 1000)});
  ASSERT_EQ(figures.size(), 4u);
  EXPECT_EQ(figures[0].contender, "gateway");
  EXPECT_FALSE(figures[0].p50_of_gateway);
  ASSERT_TRUE(figures[1].p50_of_gateway);
  EXPECT_DOUBLE_EQ(figures[1].p50_of_gateway->low, 0.25);
  EXPECT_DOUBLE_EQ(figures[1].p50_of_gateway->high, 0.5);
  EXPECT_EQ(figures[1].conflicts, 14u);
  EXPECT_DOUBLE_EQ(figures[3].p50_of_gateway->median, 0.5);
}

TEST(UtmSummary, ItsTableHasThePublishedFigureBeside) {
  const std::string table = to_table(summarize({run("gateway", "ours", 0, 40)}));
  EXPECT_THAT(table, HasSubstr("arXiv 2511.02171"));
  EXPECT_THAT(table, HasSubstr("more than 3 s"));
}

}  // namespace
}  // namespace ledgerline::utm
