#include "hil/netem/impairment.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace ledgerline::hil {
namespace {

using testing::HasSubstr;

struct Moments {
  double mean_s = 0, deviation_s = 0, least_s = 1e9, max_s = 0;
};

Moments moments(const std::string& text, int draws = 20'000) {
  const auto distribution = parse_distribution(text);
  EXPECT_TRUE(distribution) << text;
  if (!distribution) return {};
  Draws random(7);
  Moments m;
  double squares = 0;
  for (int i = 0; i < draws; ++i) {
    const double s = to_seconds(random.next(*distribution));
    m.mean_s += s / draws;
    squares += s * s / draws;
    m.least_s = std::min(m.least_s, s);
    m.max_s = std::max(m.max_s, s);
  }
  m.deviation_s = std::sqrt(squares - m.mean_s * m.mean_s);
  return m;
}

TEST(Distribution, DrawsAsItsNameSays) {
  EXPECT_EQ(moments("200ms").least_s, 0.2);
  EXPECT_EQ(moments("constant 250us").max_s, 0.00025);

  const Moments uniform = moments("uniform 10ms 50ms");
  EXPECT_NEAR(uniform.mean_s, 0.03, 3e-4);
  EXPECT_NEAR(uniform.deviation_s, 0.04 / std::sqrt(12), 3e-4);
  EXPECT_GE(uniform.least_s, 0.01);
  EXPECT_LE(uniform.max_s, 0.05);

  const Moments normal = moments("normal 50ms 10ms");
  EXPECT_NEAR(normal.mean_s, 0.05, 3e-4);
  EXPECT_NEAR(normal.deviation_s, 0.01, 3e-4);

  for (const char* text : {"gamma 0.46s 0.2s", "gamma 20ms 40ms"}) {  // a shape above 1, and one below
    const Moments gamma = moments(text);
    const double mean = text[6] == '0' ? 0.46 : 0.02, deviation = text[6] == '0' ? 0.2 : 0.04;
    EXPECT_NEAR(gamma.mean_s, mean, 0.03 * mean) << text;
    EXPECT_NEAR(gamma.deviation_s, deviation, 0.05 * deviation) << text;
  }
}

TEST(Distribution, NeverDrawsLessThanZeroOrMoreThanTheMaximumDelay) {
  const Moments normal = moments("normal 5ms 50ms");
  EXPECT_EQ(normal.least_s, 0);
  EXPECT_EQ(moments("normal 59s 20s").max_s, to_seconds(max_delay));
  EXPECT_LE(moments("gamma 1us 60s").max_s, to_seconds(max_delay));
  EXPECT_NEAR(moments("gamma 60s 1us").mean_s, 60, 1e-3);
}

TEST(Distribution, PlaysARecordingInItsOrderAndAround) {
  const auto read = [](const std::string& path) -> Result<Distribution::Recording> {
    if (path != "wifi.txt") return Error{"cannot read " + path};
    return parse_recording(path, "# seconds\n0.001\n 0.002 \r\n\n0.003");
  };
  const auto recorded = parse_distribution("recorded wifi.txt", read);
  ASSERT_TRUE(recorded);
  EXPECT_EQ(text_of(*recorded), "recorded wifi.txt");
  Draws draws(3);
  TimeNs last = draws.next(*recorded);
  for (int i = 0; i < 10; ++i) {
    const TimeNs next = draws.next(*recorded);
    EXPECT_EQ(next, last % (3 * ns_per_ms) + ns_per_ms);
    last = next;
  }
  EXPECT_THAT(parse_distribution("recorded other.txt", read).error().message, HasSubstr("cannot read other.txt"));
}

TEST(Distribution, ReadsARecordingOnceWhateverBecomesOfTheFile) {
  std::string content = "0.001";
  const ReadRecording read =
      reading_once<Distribution::Recording>([&](const std::string& path) -> Result<Distribution::Recording> {
        if (content.empty()) return Error{path + " is gone"};
        return parse_recording(path, content);
      });
  const ReadRecording copy = read;
  ASSERT_TRUE(parse_distribution("recorded f", read));
  content = "0.001\n0.002";
  EXPECT_EQ(parse_distribution("recorded f", copy)->values->size(), 1U);
  EXPECT_EQ(parse_distribution("recorded g", read)->values->size(), 2U);
  content.clear();
  EXPECT_EQ(parse_distribution("recorded f", read)->values->size(), 1U);
  EXPECT_FALSE(parse_distribution("recorded h", read));
}

TEST(Distribution, NamesFileAndLineOfARecordingThatIsNone) {
  const auto error_of = [](const std::string& content) {
    const auto parsed = parse_recording("f", content);
    return parsed ? "no error" : parsed.error().message;
  };
  EXPECT_THAT(error_of("0.1\nabc\n"), HasSubstr("f:2: \"abc\" is no number of seconds from 0 to 60"));
  EXPECT_THAT(error_of("0.1\n-1\n"), HasSubstr("f:2:"));
  EXPECT_THAT(error_of("61\n"), HasSubstr("f:1:"));
  EXPECT_THAT(error_of("# nothing\n"), HasSubstr("f: no values"));
}

TEST(Impairment, IsReadAndWrittenAsTheSameText) {
  for (const char* text : {
           "delay 200ms",
           "delay uniform 10ms 50ms",
           "jitter gamma 460ms 200ms",
           "loss 5%",
           "loss bursts 1% 20%",
           "loss bursts 1% 20% 80%",
           "loss bursts 1% 20% 80% 0.1%",
           "duplicate 5% 20ms",
           "reorder 5% normal 30ms 5ms",
           "corrupt 0.25%",
           "truncate 1%",
           "rate 20kB/s queue 8kB",
           "rate 500B/s queue 2kB",
           "delay 1s, jitter 250us, loss 5%, duplicate 1% 0s, stall, partition",
       }) {
    Impairment impairment;
    const auto applied = apply_effects(text, impairment);
    EXPECT_TRUE(applied) << text << ": " << applied.error().message;
    EXPECT_EQ(text_of(impairment), text);
    EXPECT_TRUE(impairment.any()) << text;
    Impairment again;
    EXPECT_TRUE(apply_effects(text_of(impairment), again)) << text;
    EXPECT_EQ(text_of(again), text);
  }
  EXPECT_EQ(text_of(Impairment{}), "clear");
}

TEST(Impairment, TakesAnEffectInThePlaceOfTheOneBefore) {
  Impairment impairment;
  ASSERT_TRUE(apply_effects("delay 0.2s, loss 5%, rate 1MB/s", impairment));
  ASSERT_TRUE(apply_effect("delay 300ms", impairment));
  ASSERT_TRUE(apply_effect("loss off", impairment));
  EXPECT_EQ(text_of(impairment), "delay 300ms, rate 1000kB/s queue 250kB");
  ASSERT_TRUE(apply_effect("clear", impairment));
  EXPECT_FALSE(impairment.any());
  ASSERT_TRUE(
      apply_effects("stall, partition, corrupt 1%, truncate 1%, jitter 1ms, duplicate 1%, reorder 1% 1ms", impairment));
  ASSERT_TRUE(
      apply_effects("stall off, partition off, corrupt off, truncate off, jitter off, duplicate off, reorder "
                    "off, rate off, delay off",
                    impairment));
  EXPECT_FALSE(impairment.any());
}

TEST(Impairment, RefusesWhatItDoesNotKnowAndChangesNothingThen) {
  const std::pair<const char*, const char*> cases[] = {
      {"", "an effect is missing"},
      {"lag 20ms", "allowed are delay, jitter"},
      {"delay", "a time is missing"},
      {"delay 200", "\"200\" is no time from 0s to 60s"},
      {"delay -1s", "\"-1s\" is no time"},
      {"delay 61s", "\"61s\" is no time"},
      {"delay nans", "is no time"},
      {"delay uniform 50ms 10ms", "the least is more than the most"},
      {"delay uniform 50ms", "uniform LEAST MOST"},
      {"delay 20ms 30ms", "a distribution is"},
      {"jitter gamma 0s 1s", "more than nothing"},
      {"loss", "allowed is loss SHARE"},
      {"loss 5", "no share from 0% to 100%"},
      {"loss 101%", "no share"},
      {"loss bursts 1%", "loss bursts ENTER LEAVE"},
      {"loss bursts 1% 2% 3% 4% 5%", "loss bursts ENTER LEAVE"},
      {"duplicate", "duplicate SHARE [DISTRIBUTION]"},
      {"reorder 5%", "reorder SHARE DISTRIBUTION"},
      {"corrupt 1% 2%", "corrupt SHARE"},
      {"rate 20", "is not from 1B/s"},
      {"rate 20kB", "is not from 1B/s"},
      {"rate 0B/s", "is not from 1B/s"},
      {"rate 2000MB/s", "is not from 1B/s"},
      {"rate 20kB/s queue", "rate BYTES/s [queue BYTES]"},
      {"rate 20kB/s queue 65MB", "is not from 1B"},
      {"stall 5s", "allowed are"},
      {"delay 1ms, nonsense", "nonsense"},
      {"delay 1ms,", "an effect is missing"},
      {"\x01\xff", "?"},
  };
  for (const auto& [text, why] : cases) {
    Impairment impairment;
    ASSERT_TRUE(apply_effect("delay 7ms", impairment));
    const auto applied = apply_effects(text, impairment);
    ASSERT_FALSE(applied) << text;
    EXPECT_THAT(applied.error().message, HasSubstr(why)) << text;
    EXPECT_EQ(text_of(impairment), "delay 7ms") << text;
  }
}

TEST(Impairment, OfAStreamIsOnlyWhatTcpLetsThrough) {
  Impairment impairment;
  ASSERT_TRUE(apply_effects("delay 1ms, jitter 2ms, rate 1MB/s, stall, partition", impairment));
  EXPECT_TRUE(check_for_stream(impairment));
  for (const char* effect : {"loss 1%", "duplicate 1%", "reorder 1% 1ms", "corrupt 1%", "truncate 1%"}) {
    Impairment with = impairment;
    ASSERT_TRUE(apply_effect(effect, with));
    const auto possible = check_for_stream(with);
    ASSERT_FALSE(possible) << effect;
    EXPECT_THAT(possible.error().message, HasSubstr(std::string(effect).substr(0, std::string(effect).find(' '))));
  }
}

}  // namespace
}  // namespace ledgerline::hil
