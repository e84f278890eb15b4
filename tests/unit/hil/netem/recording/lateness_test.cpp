#include "hil/netem/recording/lateness.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/random.hpp"
#include "tests/unit/hil/netem/recording/captures.hpp"

namespace ledgerline::hil {
namespace {

using ::testing::HasSubstr;

/// A link whose truth is known: states that were said, and when each came.
struct Truth {
  std::vector<TimeNs> said;
  std::vector<std::optional<TimeNs>> came;
  std::vector<TimeNs> arrivals() const {
    std::vector<TimeNs> all;
    for (const auto& one : came) {
      if (one) all.push_back(*one);
    }
    std::sort(all.begin(), all.end());
    return all;
  }
};

/// Jitter, losses and stalls in which all that is said comes at their end.
Truth link(std::size_t states, double period_s, double jitter_s, double loss, std::uint64_t seed) {
  Truth truth;
  Random random(seed);
  constexpr std::size_t every = 100, stalled = 7;  // of 100 states 7 come at once, together with the next one
  for (std::size_t i = 0; i < states; ++i) {
    const double said_s = 7.3 + static_cast<double>(i) * period_s;
    truth.said.push_back(from_seconds(said_s));
    const std::size_t of_stall = i % every;
    const bool near_stall = of_stall < stalled + 3 || of_stall > every - 3;
    double late_s = std::min(0.05, -jitter_s * std::log(1 - random.uniform()));
    if (of_stall < stalled && i >= every) late_s = (static_cast<double>(stalled - of_stall)) * period_s;
    const bool lost = !near_stall && random.uniform() < loss;
    truth.came.push_back(lost ? std::nullopt : std::optional(from_seconds(said_s + 0.003 + late_s)));
  }
  return truth;
}

void expect_same(const MeasuredLink& day, const Truth& truth) {
  const auto played = LinkRecording::make(day.moments);
  ASSERT_TRUE(played.ok()) << played.error().message;
  ASSERT_EQ(day.came + day.missing, truth.said.size());
  for (std::size_t i = 0; i < truth.said.size(); ++i) {
    const LinkRecording::Delivery delivery = (*played)->at(truth.said[i] - truth.said[0]);
    ASSERT_EQ(delivery.lost, !truth.came[i]) << i;
    if (!delivery.lost) {
      EXPECT_NEAR(to_ms(delivery.delay_ns), to_ms(*truth.came[i] - truth.said[i]) - 3, 1) << i;
    }
  }
}

TEST(StatesDay, FindsJitterLossesAndStalls) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Truth truth = link(600, 0.1, 0.004, 0.05, seed);
    const auto day = recording_of_states(truth.arrivals());
    ASSERT_TRUE(day.ok()) << day.error().message;
    expect_same(*day, truth);
    if (HasFailure()) FAIL() << "seed " << seed;
  }
}

TEST(StatesDay, FollowsADroneWhoseClockIsWrong) {
  for (const double period_s : {0.0998, 0.09999, 0.10003, 0.101}) {
    const Truth truth = link(10'000, period_s, 0.01, 0.02, 3);
    const auto day = recording_of_states(truth.arrivals());
    ASSERT_TRUE(day.ok()) << day.error().message;
    EXPECT_NEAR(day->period_s, period_s, 1e-6);
    expect_same(*day, truth);
    if (HasFailure()) FAIL() << period_s;
  }
}

TEST(StatesDay, APauseIsOneLossAndANewSchedule) {
  std::vector<TimeNs> arrivals;
  for (int i = 0; i < 50; ++i) arrivals.push_back(i * 100 * ms);
  for (int i = 0; i < 50; ++i) arrivals.push_back(20'033 * ms + i * 100 * ms);
  const auto day = recording_of_states(arrivals);
  ASSERT_TRUE(day.ok()) << day.error().message;
  ASSERT_EQ(day->moments.size(), 102U);
  EXPECT_EQ(day->moments[50], (RecordedDelay{4'950 * ms, 0, true}));
  EXPECT_EQ(day->moments[51], (RecordedDelay{19'983 * ms, 0, false}));
  EXPECT_EQ(day->moments[52], (RecordedDelay{20'033 * ms, 0, false}));
  EXPECT_EQ(day->came, 100U);
}

TEST(StatesDay, RefusesWhatIsNoTellosState) {
  const auto why = [](TimeNs period, std::size_t count) {
    std::vector<TimeNs> arrivals;
    for (std::size_t i = 0; i < count; ++i) arrivals.push_back(static_cast<TimeNs>(i) * period);
    const auto day = recording_of_states(arrivals);
    return day ? std::string() : day.error().message;
  };
  EXPECT_THAT(why(100 * ms, 0), HasSubstr("at least two"));
  EXPECT_THAT(why(100 * ms, 1), HasSubstr("at least two"));
  EXPECT_EQ(why(100 * ms, 2), "");
  EXPECT_THAT(why(50 * ms, 100), HasSubstr("a Tello's come every 100 ms"));
  EXPECT_NE(why(0, 1'000), "");
}

TEST(AnswersDay, EachWayHasHalf) {
  const std::vector<RequestTime> asked{{1'000 * ms, 1'030 * ms}, {2'000 * ms, std::nullopt}, {5'000 * ms, 5'010 * ms}};
  const auto day = recording_of_answers(asked);
  ASSERT_TRUE(day.ok()) << day.error().message;
  const std::vector<RecordedDelay> wanted{{0, 15 * ms, false}, {1'000 * ms, 0, true}, {4'000 * ms, 5 * ms, false}};
  EXPECT_EQ(day->moments, wanted);
  EXPECT_EQ(day->missing, 1U);
  EXPECT_FALSE(recording_of_answers(std::span(asked).first(1)));
  EXPECT_FALSE(recording_of_answers({}));
}

}  // namespace
}  // namespace ledgerline::hil
