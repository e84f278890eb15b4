#include "tools/timing/metrics.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/tools/timing/some_traces.hpp"

namespace ledgerline::timing {
namespace {

using testing::HasSubstr;

bool kept(const std::string& text) { return check(parse_limit(text).value(), some_figures()).kept; }

TEST(Limits, AreKeptUpToTheirBound) {
  EXPECT_TRUE(kept("p99.apply=1ms"));
  EXPECT_TRUE(kept("p99.9.apply=1000us"));
  EXPECT_TRUE(kept("max.two_way=0.012s"));
  EXPECT_FALSE(kept("max.two_way=11.9ms"));
  EXPECT_FALSE(kept("p50.apply=0.999ms"));
  EXPECT_TRUE(kept("cpu.agent+link=14.5%"));
  EXPECT_FALSE(kept("cpu.agent+link=14.4%"));
  EXPECT_TRUE(kept("overruns=1"));
  EXPECT_FALSE(kept("overruns=0"));
  EXPECT_TRUE(kept("headroom=125%"));
  EXPECT_FALSE(kept("headroom=126%"));
}

TEST(Limits, WhatWasNotMeasuredIsNotKept) {
  for (const char* text : {"p99.apply=1s", "overruns=100", "cpu.link=100%", "headroom=0%"}) {
    const Verdict verdict = check(parse_limit(text).value(), make_metrics({}, {}));
    EXPECT_FALSE(verdict.kept) << text;
    EXPECT_FALSE(verdict.measured) << text;
  }
  EXPECT_FALSE(kept("cpu.agent+nobody=100%"));
}

TEST(Limits, AnUnknownNameIsAnErrorThatSaysWhatThereIs) {
  EXPECT_THAT(parse_limit("p99.aply=1ms").error().message,
              testing::AllOf(HasSubstr("\"aply\""), HasSubstr("apply"), HasSubstr("two_way")));
  EXPECT_THAT(parse_limit("p98.apply=1ms").error().message, testing::AllOf(HasSubstr("\"p98\""), HasSubstr("p99.9")));
  EXPECT_THAT(parse_limit("p99.apply").error().message, HasSubstr("p99.apply=1ms"));
  for (const char* text :
       {"", "=", "p99=1ms", "p99.apply=", "p99.apply=1", "p99.apply=-1ms", "p99.apply=nanms", "p99.apply=1 ms",
        "cpu.link=5", "cpu.=5%", "overruns=1ms", "headroom.x=1%", "max.late=5parsec"}) {
    EXPECT_FALSE(parse_limit(text)) << text;
  }
}

}  // namespace
}  // namespace ledgerline::timing
