#include "hil/fault/compare/comparison.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>

#include "common/base/random.hpp"

namespace ledgerline::hil::comparing {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

/// Runs with metrics that vary as those of flights do; `change` makes another build of each.
struct Flights {
  int scripts = 3, first_seed = 1, seeds = 30;
  std::uint64_t build = 1;
  double age_ms = 80;
  std::function<void(FlownRun&)> change = [](FlownRun&) {};

  Runs runs() const {
    Runs all{"build" + std::to_string(build) + ".json", {}};
    for (int script = 1; script <= scripts; ++script) {
      for (int seed = first_seed; seed < first_seed + seeds; ++seed) {
        Random random(build * 1'000'003 + static_cast<std::uint64_t>(script) * 1'009 +
                      static_cast<std::uint64_t>(seed));
        (void)random.next();
        const auto noise = [&] { return random.uniform() + random.uniform() - 1; };
        FlownRun run;
        run.script = "script" + std::to_string(script);
        run.seed = static_cast<std::uint64_t>(seed);
        run.source = "s";
        run.digest = std::to_string(random.next());
        run.metrics = {{"path_rms_m", 0.05 * script + 0.004 * noise()},
                       {"command_age_median_ms", age_ms + 4 * noise()},
                       {"commands_hz", 30 + noise()},
                       {"holds", std::floor(random.uniform() * 1.1)},
                       {"flown_s", 20 + noise()},
                       {"transactions", 900 + 20 * noise()}};
        change(run);
        all.runs.push_back(std::move(run));
      }
    }
    return all;
  }
};

Comparison of(const Runs& a, const Runs& b, const Options& options = {}) {
  const auto comparison = compare(a, b, options);
  EXPECT_TRUE(comparison.ok()) << comparison.error().message;
  return comparison ? *comparison : Comparison{};
}

std::vector<std::string> sent(const Comparison& comparison, Change verdict) {
  std::vector<std::string> names;
  for (const MetricChange& metric : comparison.metrics) {
    if (metric.verdict == verdict) names.push_back(metric.script + ":" + metric.metric);
  }
  return names;
}

TEST(Comparison, TheSameBytesAreEqualWithoutATest) {
  const Runs runs = Flights{}.runs();
  const Comparison comparison = of(runs, runs);
  EXPECT_EQ(verdict_of(comparison), "equal");
  EXPECT_EQ(comparison.tests, 0U);
  EXPECT_EQ(comparison.same_bytes, 90U);
  EXPECT_THAT(table_text(comparison, {}, false), HasSubstr("equal: the same bytes"));
}

TEST(Comparison, NoiseIsEqualWithTheSameSeedsAndWithOthers) {
  for (std::uint64_t build = 2; build < 12; ++build) {
    const Comparison same_seeds = of(Flights{}.runs(), Flights{.build = build}.runs());
    EXPECT_EQ(verdict_of(same_seeds), "equal") << table_text(same_seeds, {}, true);
    EXPECT_EQ(same_seeds.pairs, 90U);
    EXPECT_GE(same_seeds.tests, 15U);
    const Comparison other_seeds =
        of(Flights{.build = build}.runs(), Flights{.first_seed = 100, .build = build}.runs());
    EXPECT_EQ(verdict_of(other_seeds), "equal") << table_text(other_seeds, {}, true);
    EXPECT_EQ(other_seeds.pairs, 0U);
    EXPECT_FALSE(other_seeds.metrics.at(0).paired);
  }
}

TEST(Comparison, EqualBuildsAreDistinguishedNoOftenerThanItSays) {
  Options options;
  options.error_rate = 0.1;
  options.least_share = 0;
  constexpr int trials = 300;
  int called = 0;
  for (int trial = 0; trial < trials; ++trial) {
    const auto build = 10'000 + static_cast<std::uint64_t>(trial);
    const Comparison comparison = of(Flights{.seeds = 20, .build = 2 * build}.runs(),
                                     Flights{.seeds = 20, .build = 2 * build + 1}.runs(), options);
    if (comparison.regression() || comparison.improvement()) ++called;
  }
  EXPECT_LE(called, trials * 0.1 + 3 * std::sqrt(trials * 0.1 * 0.9));
}

TEST(Comparison, ARegressionIsDistinguishedFromNoiseAndNamed) {
  const auto later = [](FlownRun& run) {
    if (run.script == "script2") run.metrics["command_age_median_ms"] += 5;
  };
  for (const int first_seed : {1, 100}) {
    const Comparison comparison =
        of(Flights{}.runs(), Flights{.first_seed = first_seed, .build = 7, .change = later}.runs());
    EXPECT_EQ(verdict_of(comparison), "regression");
    EXPECT_THAT(sent(comparison, Change::worse), Contains("script2:command_age_median_ms"));
    for (const std::string& name : sent(comparison, Change::worse))
      EXPECT_THAT(name, HasSubstr("command_age_median_ms"));
    EXPECT_TRUE(sent(comparison, Change::better).empty());
    EXPECT_THAT(table_text(comparison, {}, false), HasSubstr("worse  script2"));
    EXPECT_THAT(json_text(comparison), HasSubstr("\"verdict\": \"regression\""));
  }
  const Comparison back = of(Flights{.build = 7, .change = later}.runs(), Flights{}.runs());
  EXPECT_EQ(verdict_of(back), "improvement");
}

TEST(Comparison, LessIsWorseWhereTheTableSaysSo) {
  const auto fewer = [](FlownRun& run) { run.metrics["commands_hz"] -= 2; };
  const Comparison comparison = of(Flights{}.runs(), Flights{.build = 2, .change = fewer}.runs());
  EXPECT_THAT(sent(comparison, Change::worse), Contains("script1:commands_hz"));
  EXPECT_EQ(verdict_of(of(Flights{.build = 2, .change = fewer}.runs(), Flights{}.runs())), "improvement");
}

TEST(Comparison, WhatIsCertainAndSmallDoesNotCount) {
  const auto slightly = [](FlownRun& run) {
    run.metrics["command_age_median_ms"] += 0.9;
  };  // least: 1 ms, and 2 % of 80 ms
  const Runs runs = Flights{}.runs();
  Runs changed = runs;
  for (FlownRun& run : changed.runs) {
    slightly(run);
    run.digest += "x";
  }
  const Comparison comparison = of(runs, changed);
  EXPECT_EQ(verdict_of(comparison), "equal");
  EXPECT_THAT(sent(comparison, Change::small), Contains("script1:command_age_median_ms"));
  Options finer;
  finer.least_share = 0;
  for (FlownRun& run : changed.runs) slightly(run);
  EXPECT_EQ(verdict_of(of(runs, changed)), "regression") << "1.8 ms are more than 2 %";
  EXPECT_EQ(verdict_of(of(runs, changed, finer)), "regression");
}

TEST(Comparison, ARuleThatBreaksForTheFirstTimeIsAFact) {
  const auto breaks = [](FlownRun& run) {
    if (run.script == "script1" && run.seed == 2) run.broken = {"finishes"};
  };
  const Runs before = Flights{.seeds = 3}.runs(), now = Flights{.seeds = 3, .build = 2, .change = breaks}.runs();
  const Comparison comparison = of(before, now);
  EXPECT_EQ(verdict_of(comparison), "regression");
  ASSERT_EQ(comparison.rules.size(), 1U);
  EXPECT_TRUE(comparison.rules[0].fact);
  EXPECT_EQ(comparison.rules[0].newly, std::vector<std::uint64_t>{2});
  EXPECT_THAT(table_text(comparison, {}, false),
              HasSubstr("finishes: broke in 0 of 3 runs, then in 1 of 3, newly with seed 2"));
  EXPECT_EQ(of(now, before).rules[0].verdict, Change::better);
}

TEST(Comparison, ARuleThatBreaksNowAndThenIsDecidedByHowOften) {
  const auto every = [](std::uint64_t nth, std::uint64_t offset) {
    return [nth, offset](FlownRun& run) {
      if ((run.seed + offset) % nth == 0) run.broken = {"path within 0.4 m"};
    };
  };
  const Runs before = Flights{.scripts = 1, .change = every(10, 0)}.runs();
  const Comparison as_often = of(before, Flights{.scripts = 1, .build = 2, .change = every(10, 3)}.runs());
  EXPECT_EQ(verdict_of(as_often), "equal");
  ASSERT_EQ(as_often.rules.size(), 1U);
  EXPECT_FALSE(as_often.rules[0].fact);
  EXPECT_EQ(verdict_of(of(before, Flights{.scripts = 1, .build = 2, .change = every(1, 0)}.runs())), "regression");
  const auto other_seeds = Flights{.scripts = 1, .first_seed = 100, .change = every(1, 0)}.runs();
  EXPECT_EQ(verdict_of(of(before, other_seeds)), "regression");
  // Real flights promise no bytes: once is no fact there.
  const auto real = [](FlownRun& run) { run.digest.clear(); };
  const auto real_once = [](FlownRun& run) {
    run.digest.clear();
    if (run.seed == 5) run.broken = {"finishes"};
  };
  const Comparison once = of(Flights{.change = real}.runs(), Flights{.build = 2, .change = real_once}.runs());
  EXPECT_EQ(verdict_of(once), "unknown") << "nor is it equality";
}

TEST(Comparison, TheSameBytesWithOtherVerdictsAreAFact) {
  const auto breaks = [](FlownRun& run) {
    if (run.script == "script1" && run.seed <= 2) run.broken = {"finishes"};
  };
  const Runs held = Flights{}.runs(), broken = Flights{.change = breaks}.runs();
  const Comparison comparison = of(held, broken);
  EXPECT_EQ(comparison.same_bytes, 90U);
  EXPECT_EQ(verdict_of(comparison), "regression");
  ASSERT_EQ(comparison.rules.size(), 1U);
  EXPECT_EQ(comparison.rules[0].newly, (std::vector<std::uint64_t>{1, 2}));
  EXPECT_EQ(verdict_of(of(broken, held)), "improvement");
  EXPECT_EQ(verdict_of(of(broken, broken)), "equal");
  EXPECT_EQ(of(broken, broken).tests, 0U);
  // One more, where the rule breaks with both.
  Runs more = broken;
  more.runs[5].broken = {"finishes"};
  EXPECT_EQ(verdict_of(of(broken, more)), "regression");
  EXPECT_THAT(table_text(of(broken, more), {}, false), HasSubstr("without a test and outside of that chance: 1"));
}

TEST(Comparison, RunsAndMetricsThatTheNewBuildLacksAreNoEquality) {
  const Runs all = Flights{}.runs();
  const auto without = [&](const std::function<bool(const FlownRun&)>& gone) {
    Runs some{"new.json", {}};
    std::ranges::remove_copy_if(all.runs, std::back_inserter(some.runs), gone);
    return some;
  };
  const Runs no_script = without([](const FlownRun& run) { return run.script == "script3"; });
  const Runs no_seed = without([](const FlownRun& run) { return run.script == "script1" && run.seed == 4; });
  EXPECT_THAT(of(all, no_script).cannot_tell, ElementsAre("new.json lacks 30 runs that build1.json has"));
  EXPECT_THAT(of(all, no_seed).cannot_tell, ElementsAre("new.json lacks 1 runs that build1.json has"));
  EXPECT_EQ(verdict_of(of(all, no_script)), "unknown");
  EXPECT_THAT(table_text(of(all, no_seed), {}, false), HasSubstr("unknown: new.json lacks 1 runs"));
  EXPECT_EQ(verdict_of(of(no_script, all)), "equal") << "what only the new one has is a note";
  EXPECT_EQ(verdict_of(of(no_seed, all)), "equal");

  for (const int first_seed : {1, 100}) {  // also of other seeds
    const auto no_metric = [](FlownRun& run) { run.metrics.erase("path_rms_m"); };
    const Runs lacks = Flights{.first_seed = first_seed, .build = 2, .change = no_metric}.runs();
    EXPECT_THAT(of(all, lacks).cannot_tell, ElementsAre("build2.json lacks figures that build1.json has: path_rms_m"));
    EXPECT_EQ(verdict_of(of(lacks, all)), "equal");
  }
  Runs once = all, renamed = all;
  once.runs[7].metrics.erase("holds");
  EXPECT_EQ(verdict_of(of(all, once)), "unknown") << "the same bytes, too";
  for (FlownRun& run : renamed.runs) run.metrics["wings"] = 2;
  EXPECT_THAT(of(renamed, all).cannot_tell, ElementsAre("build1.json lacks figures that build1.json has: wings"));
}

TEST(Comparison, ARuleThatOnlyGotWorseInTooFewRunsIsShownAndIsNotEqual) {
  const auto first = [](std::uint64_t count) {
    return [count](FlownRun& run) {
      if (run.script == "script1" && run.seed <= count) run.broken = {"path within 0.4 m"};
    };
  };
  const Runs before = Flights{.change = first(1)}.runs();
  for (const std::uint64_t now : {7, 9}) {  // no test at all; a test that is not certain behind the correction
    const Comparison comparison = of(before, Flights{.build = 2, .change = first(now)}.runs());
    EXPECT_EQ(verdict_of(comparison), "unknown") << now;
    EXPECT_THAT(table_text(comparison, {}, false), HasSubstr("path within 0.4 m: broke in 1 of 30 runs, then in " +
                                                             std::to_string(now) + " of 30, newly with seed 2, 3"));
    EXPECT_THAT(comparison.cannot_tell, ElementsAre(HasSubstr("newly broken with " + std::to_string(now - 1) +
                                                              " of 30 seeds, repaired with none")));
  }
  EXPECT_EQ(verdict_of(of(before, Flights{.build = 2, .change = first(30)}.runs())), "regression");
}

TEST(Comparison, ScriptsOfTheSameBytesDoNotMakeFewRunsOfAnotherEnough) {
  Runs before = Flights{.scripts = 1}.runs(), now = before;
  for (const Runs* few : {&before, &now}) EXPECT_EQ(few->runs.size(), 30U);
  const Runs some = Flights{.scripts = 2, .seeds = 3}.runs(),
             other = Flights{.scripts = 2, .seeds = 3, .build = 2}.runs();
  before.runs.insert(before.runs.end(), some.runs.begin() + 3, some.runs.end());
  now.runs.insert(now.runs.end(), other.runs.begin() + 3, other.runs.end());
  EXPECT_EQ(of(before, now).same_bytes, 30U);
  EXPECT_EQ(verdict_of(of(before, now)), "unknown");
}

TEST(Comparison, OnlyTheSameModeIsCompared) {
  const auto flown = [](std::string mode, int scripts) {
    return Flights{.scripts = scripts, .change = [mode](FlownRun& run) { run.mode = mode; }}.runs();
  };
  const auto nothing = compare(flown("sitl", 1), flown("real", 1), {});
  ASSERT_FALSE(nothing.ok());
  EXPECT_THAT(nothing.error().message,
              HasSubstr("script1: flown in sitl in build1.json, in real in build1.json: only"));
  Runs both = flown("sitl", 2), real = flown("real-shim", 1);
  EXPECT_EQ(verdict_of(of(both, both)), "equal");
  Runs now = flown("sitl", 2);
  for (FlownRun& run : now.runs) {
    if (run.script == "script2") run.mode = "real-fabric";
  }
  EXPECT_EQ(of(both, now).scripts, 1U);
  EXPECT_EQ(verdict_of(of(both, now)), "unknown") << "its simulated runs are missing";
  EXPECT_THAT(of(both, now).left_out, Contains(HasSubstr("script2: flown in sitl in")));
  EXPECT_EQ(verdict_of(of(real, real)), "equal");
}

TEST(Comparison, FewSeedsOfManyScriptsAreOrderedTogether) {
  const auto later = [](FlownRun& run) { run.metrics["command_age_median_ms"] += 8; };
  const Flights few{.scripts = 40, .seeds = 1};
  const Comparison comparison = of(few.runs(), Flights{.scripts = 40, .seeds = 1, .build = 2, .change = later}.runs());
  EXPECT_EQ(sent(comparison, Change::worse), std::vector<std::string>{":command_age_median_ms"});
  EXPECT_THAT(table_text(comparison, {}, false), HasSubstr("worse  all scripts"));
  EXPECT_THAT(comparison.left_out, Contains(HasSubstr("40 scripts have fewer seeds")));
  EXPECT_EQ(verdict_of(of(few.runs(), Flights{.scripts = 40, .seeds = 1, .build = 3}.runs())), "equal");
}

TEST(Comparison, TooFewRunsAreNotCalledEqual) {
  const Comparison comparison =
      of(Flights{.scripts = 1, .seeds = 4}.runs(), Flights{.scripts = 1, .seeds = 4, .build = 2}.runs());
  EXPECT_FALSE(comparison.can_tell());
  EXPECT_EQ(verdict_of(comparison), "unknown");
  EXPECT_THAT(table_text(comparison, {}, false), HasSubstr("too few runs to tell anything; fly each script with"));
}

TEST(Comparison, SaysWhatItCouldNotCompare) {
  Runs before = Flights{.scripts = 3, .seeds = 20}.runs(), now = Flights{.scripts = 2, .seeds = 30, .build = 2}.runs();
  for (FlownRun& run : now.runs) {
    if (run.script == "script1") run.source = "another";
    run.metrics["wings"] = 2;
  }
  for (FlownRun& run : before.runs) {
    if (run.script == "script2" && run.seed == 1) run.metrics.erase("path_rms_m");
  }
  const Comparison comparison = of(before, now);
  EXPECT_EQ(comparison.scripts, 1U);
  EXPECT_THAT(comparison.cannot_tell, ElementsAre("build2.json lacks 20 runs that build1.json has"));
  for (const char* wanted :
       {"script1: its text is another one in build2.json (--settings compares them)", "script3: only in build1.json",
        "script2: 10 runs whose seed is in one file alone", "wings: no figure that this program knows",
        "script2: path_rms_m: of 0 seeds only build1.json has it, of 1 only build2.json"})
    EXPECT_THAT(comparison.left_out, Contains(wanted));
  Runs other = Flights{}.runs();
  for (FlownRun& run : other.runs) run.script += "-other";
  const auto nothing = compare(before, other, {});
  ASSERT_FALSE(nothing.ok());
  EXPECT_THAT(nothing.error().message, HasSubstr("have no script that can be compared"));
}

}  // namespace
}  // namespace ledgerline::hil::comparing
