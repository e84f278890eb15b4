#include "tools/bench/utm/workload.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "common/msg/contract.hpp"

namespace ledgerline::utm {
namespace {

WorkloadOptions options_of_a_long_run() {
  WorkloadOptions o;
  o.rate_per_s = 50;
  o.overlapping = 0.3;
  o.racing = 0.4;
  o.warm_up_s = 10;
  o.seconds = 200;
  return o;
}

std::string text(const std::vector<Intent>& intents) { return to_json({.intents = intents}).dump(); }

TEST(UtmWorkload, TheSameSeedMakesTheSameIntentsAndAnotherSeedOthers) {
  WorkloadOptions o;
  const std::string first = text(make_workload(o));
  EXPECT_EQ(text(make_workload(o)), first);
  o.seed = 2;
  EXPECT_NE(text(make_workload(o)), first);
}

TEST(UtmWorkload, OverlapsAndRacesHaveTheSharesThatWereAskedFor) {
  const auto intents = make_workload(options_of_a_long_run());
  double overlapping = 0, racing = 0;
  for (std::size_t i = 1; i < intents.size(); ++i) {
    if (!intents[i].overlaps) continue;
    ++overlapping;
    racing += intents[i].at_ns == intents[i - 1].at_ns && intents[i].cell == intents[i - 1].cell;
  }
  EXPECT_NEAR(overlapping / static_cast<double>(intents.size()), 0.3, 0.02);
  EXPECT_NEAR(racing / overlapping, 0.4, 0.04);
}

TEST(UtmWorkload, AnIntentOverlapsIfAndOnlyIfAnEarlierOneHasItsAirspace) {
  std::set<std::string> asked;
  for (const Intent& intent : make_workload(options_of_a_long_run()))
    EXPECT_EQ(!asked.insert(intent.airspace).second, intent.overlaps) << intent.airspace;
}

TEST(UtmWorkload, NothingOverlapsWhereNothingShallAndAllButTheFirstWhereAllShall) {
  WorkloadOptions o;
  const auto overlapping = [&] {
    const auto intents = make_workload(o);
    return std::pair(std::count_if(intents.begin(), intents.end(), [](const Intent& i) { return i.overlaps; }),
                     static_cast<std::ptrdiff_t>(intents.size()));
  };
  o.overlapping = 0;
  EXPECT_EQ(overlapping().first, 0);
  o.overlapping = 1;
  const auto [all, of] = overlapping();
  EXPECT_EQ(all, of - 1);
}

TEST(UtmWorkload, ComesInOrderAtTheRateThatWasAskedFor) {
  WorkloadOptions o = options_of_a_long_run();
  for (const bool poisson : {true, false}) {
    o.poisson = poisson;
    const auto intents = make_workload(o);
    EXPECT_NEAR(static_cast<double>(intents.size()), 210 * 50, poisson ? 400 : 1);
    EXPECT_TRUE(std::is_sorted(intents.begin(), intents.end(), [](auto& a, auto& b) { return a.at_ns < b.at_ns; }));
    for (const Intent& intent : intents) EXPECT_EQ(intent.measured, intent.at_ns >= 10 * ns_per_s);
  }
}

TEST(UtmWorkload, ASlowRateWarmsUpFaster) {
  WorkloadOptions o;
  o.rate_per_s = 10;
  o.poisson = false;
  o.warm_up_s = 10;
  o.seconds = 10;
  const auto intents = make_workload(o);
  const auto measured = std::count_if(intents.begin(), intents.end(), [](const Intent& i) { return i.measured; });
  EXPECT_NEAR(static_cast<double>(measured), 100, 2);
  EXPECT_NEAR(static_cast<double>(intents.size()) - static_cast<double>(measured), 350, 2);
}

TEST(UtmWorkload, ARecordFitsTheContractAndNamesEverySupplier) {
  std::set<std::string> suppliers;
  for (const Intent& intent : make_workload(options_of_a_long_run())) {
    EXPECT_LE(intent.what.size(), contract::max_anchor_chars);
    const auto begin = intent.what.find(';') + 1;
    suppliers.insert(intent.what.substr(begin, intent.what.find(';', begin) - begin));
  }
  EXPECT_THAT(suppliers, testing::ElementsAre("uss1.Org1MSP", "uss2.Org2MSP", "uss3.Org3MSP", "uss4.Org1MSP",
                                              "uss5.Org2MSP", "uss6.Org3MSP"));
}

TEST(UtmRetries, PauseTwiceAsLongEachTimeWithJitterAndABound) {
  const RetryPolicy retry{.attempts = 6, .first_ms = 20, .max_ms = 500};
  EXPECT_EQ(retry.pause_ms(1, 0), 10);
  EXPECT_EQ(retry.pause_ms(1, 1), 20);
  EXPECT_EQ(retry.pause_ms(3, 1), 80);
  EXPECT_EQ(retry.pause_ms(1000, 1), 500);
}

TEST(UtmJob, IsReadAsItWasWritten) {
  const Job job{.intents = make_workload({}), .retry = {.attempts = 3}, .drain_s = 4, .seed = 7};
  const auto read = read_job(to_json(job).dump());
  ASSERT_TRUE(read) << read.error().what;
  EXPECT_EQ(to_json(*read), to_json(job));
}

TEST(UtmJob, ThatIsDamagedIsRefused) {
  EXPECT_FALSE(read_job("nonsense"));
  auto json = to_json(Job{.intents = make_workload({})});
  json["intents"][0].erase("what");
  EXPECT_FALSE(read_job(json.dump()));
}

}  // namespace
}  // namespace ledgerline::utm
