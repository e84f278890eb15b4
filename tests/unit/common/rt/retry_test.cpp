#include "common/rt/retry.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace ledgerline {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Le;

/// A world whose time goes on while somebody sleeps.
struct Slept {
  TimeNs now_ns = 0;
  std::vector<TimeNs> pauses;
  std::vector<std::string> reported;

  TryWorld world() {
    return {.now = [this] { return now_ns; },
            .sleep =
                [this](TimeNs pause_ns) {
                  pauses.push_back(pause_ns);
                  now_ns += pause_ns;
                },
            .warn = [this](const std::string& what) { reported.push_back(what); },
            .seed = 1};
  }
};

const auto never = [] { return false; };
const auto never_done = []() -> Status { return Error{"nobody answers"}; };

TEST(KeepTrying, TheFirstSuccessIsTheEnd) {
  Slept slept;
  int attempts = 0;
  const auto third = [&]() -> Status { return ++attempts < 3 ? Status(Error{"not yet"}) : done; };
  EXPECT_TRUE(retry("RouDi answers", {}, never, third, slept.world()));
  EXPECT_EQ(attempts, 3);
  EXPECT_EQ(slept.pauses.size(), 2U);
  EXPECT_TRUE(slept.reported.empty()) << "over before anybody wonders";
}

TEST(KeepTrying, GivesUpWhenTheTimeIsOverWithTheLastError) {
  Slept slept;
  const Status status = retry("RouDi answers", {.within_ns = 2 * ns_per_s}, never, never_done, slept.world());
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "gave up after 2 s waiting until RouDi answers: nobody answers");
  EXPECT_GT(slept.now_ns, 2 * ns_per_s);
  EXPECT_LE(slept.now_ns, 2'200 * ns_per_ms) << "by one pause at most";
}

TEST(KeepTrying, PausesGrowToTheirMaximum) {
  Slept slept;
  const TryLimits limits{.within_ns = ns_per_s, .first_pause_ns = 10 * ns_per_ms, .max_pause_ns = 40 * ns_per_ms};
  ASSERT_FALSE(retry("it is there", limits, never, never_done, slept.world()));
  EXPECT_LE(slept.pauses.front(), 10 * ns_per_ms);
  EXPECT_GE(slept.pauses.back(), 20 * ns_per_ms) << "half of the maximum, by jitter";
  EXPECT_THAT(slept.pauses, Each(Le(40 * ns_per_ms)));
}

TEST(KeepTrying, TheWaitIsReportedNowAndThen) {
  Slept slept;
  const TryLimits limits{.within_ns = 5 * ns_per_s};
  ASSERT_FALSE(retry("RouDi answers", limits, never, never_done, slept.world()));
  const std::string words = "waiting until RouDi answers: nobody answers";
  EXPECT_THAT(slept.reported, ElementsAre(words, words)) << "after 0.5 s and after 3.5 s";
}

TEST(KeepTrying, WhoIsAskedToEndDoesNotWait) {
  Slept slept;
  const Status status = retry(
      "RouDi answers", {}, [] { return true; }, never_done, slept.world());
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "asked to end before RouDi answers");
  EXPECT_TRUE(slept.pauses.empty());
}

TEST(KeepTrying, TheRealWorldSleeps) {
  const TimeNs begin_ns = monotonic_ns();
  const TryLimits limits{.within_ns = 30 * ns_per_ms};
  EXPECT_THAT(retry("it is there", limits, never, never_done).error().message, HasSubstr("nobody answers"));
  EXPECT_GE(monotonic_ns() - begin_ns, 30 * ns_per_ms);
}

}  // namespace
}  // namespace ledgerline
