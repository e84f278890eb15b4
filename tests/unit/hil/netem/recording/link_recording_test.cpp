#include "hil/netem/recording/link_recording.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "hil/netem/emulated_link.hpp"
#include "tests/unit/hil/netem/recording/captures.hpp"

namespace ledgerline::hil {
namespace {

using ::testing::HasSubstr;

std::shared_ptr<const LinkRecording> day(const std::string& table) {
  auto parsed = parse_link_recording("day.csv", table);
  EXPECT_TRUE(parsed.ok()) << (parsed ? "" : parsed.error().message);
  return parsed ? *parsed : nullptr;
}

ReadLinkRecording recordings_of(const std::string& table) {
  return [table](const std::string& path) { return parse_link_recording(path, table); };
}

TEST(LinkRecording, GoesEvenlyFromOneDelayToTheNextAndRoundAtItsEnd) {
  const std::shared_ptr<const LinkRecording> recorded = day("0,0.010\n0.1,0.030\n0.2,0.020\n");
  EXPECT_EQ(recorded->length_ns(), 300 * ms);
  EXPECT_FALSE(recorded->has_losses());
  for (const auto& [at, delay] :
       {std::pair(0, 10), {50, 20}, {100, 30}, {150, 25}, {200, 20}, {299, 20}, {300, 10}, {650, 20}})
    EXPECT_EQ(recorded->at(at * ms).delay_ns, delay * ms) << at;
}

TEST(LinkRecording, IsLostFromALostMomentUntilTheNextOne) {
  const std::shared_ptr<const LinkRecording> recorded = day("0.0,0.010\n0.1,lost\n0.2,0.020\n0.3,0.020\n");
  EXPECT_TRUE(recorded->has_losses());
  EXPECT_EQ(recorded->at(99 * ms).delay_ns, 10 * ms) << "before a loss the last delay holds";
  for (const auto& [at, lost] : {std::pair(99, false), {100, true}, {199, true}, {200, false}, {500, true}})
    EXPECT_EQ(recorded->at(at * ms).lost, lost) << at;
}

TEST(LinkRecording, ReadsTheTableThatItWrites) {
  const std::string table = "seconds,delay_s\n0.000000,0.001500\n0.100000,lost\n3600.000000,60.000000\n";
  EXPECT_EQ(table_of(day(table)->moments()), table);
  EXPECT_EQ(day(" 0 , 0.5 \r\n\n# a remark\n1,lost\n")->moments().size(), 2U);
}

TEST(LinkRecording, ACrowdedOneSleepsAndLosesAndIsTheSameEachTime) {
  const std::shared_ptr<const LinkRecording> crowded = crowded_link();
  const auto& moments = crowded->moments();
  const auto share = [&](auto&& is_so) {
    return static_cast<double>(std::ranges::count_if(moments, is_so)) / static_cast<double>(moments.size());
  };
  EXPECT_EQ(crowded->length_ns(), 120 * ns_per_s);
  EXPECT_NEAR(share([](const RecordedDelay& moment) { return moment.lost; }), 0.03, 0.02);
  EXPECT_NEAR(share([](const RecordedDelay& moment) { return moment.delay_ns > 7 * ns_per_ms; }), 0.14, 0.08);
  EXPECT_EQ(moments, crowded_link()->moments());
}

TEST(LinkRecording, RefusesATableWithFileAndLine) {
  const std::pair<const char*, const char*> wrong[] = {
      {"", "day.csv: a day has at least two moments"},
      {"0,0.1\n", "at least two moments"},
      {"0,0.1\n1\n", "day.csv:2: \"1\" must be SECONDS,DELAY_S"},
      {"0,0.1\n1,\n", "must be SECONDS,DELAY_S"},
      {"0,0.1\n1,-0.1\n", "must be SECONDS,DELAY_S"},
      {"0,0.1\n1,61\n", "a delay up to 60 s"},
      {"0,0.1\n1,nan\n", "must be SECONDS,DELAY_S"},
      {"0,0.1\n1e9,0.1\n", "must be SECONDS,DELAY_S"},
      {"-1,0.1\n1,0.1\n", "day.csv:1"},
      {"0,0.1\n0,0.1\n", "is not later than the line before"},
      {"0,0.1\n1,0.1,2\n", "must be SECONDS,DELAY_S"},
      {"0,0.1\nseconds,delay_s\n", "day.csv:2"},
  };
  for (const auto& [table, why] : wrong) {
    const auto parsed = parse_link_recording("day.csv", table);
    ASSERT_FALSE(parsed.ok()) << table;
    EXPECT_THAT(parsed.error().message, HasSubstr(why)) << table;
  }
}

TEST(LinkRecording, RefusesMomentsThatCannotBe) {
  EXPECT_FALSE(LinkRecording::make({{0, 0}}));
  EXPECT_FALSE(LinkRecording::make({{0, 0}, {0, 0}}));
  EXPECT_FALSE(LinkRecording::make({{0, 0}, {1, -1}}));
  EXPECT_FALSE(LinkRecording::make({{0, 0}, {1, max_delay + 1}}));
  EXPECT_FALSE(LinkRecording::make({{-1, 0}, {1, 0}}));
  EXPECT_FALSE(LinkRecording::make(std::vector<RecordedDelay>(LinkRecording::max_moments + 1)));
}

TEST(RecordedDayEffect, IsReadAndWrittenAsText) {
  const ReadLinkRecording read = recordings_of("0,0.1\n60,lost\n");
  for (const char* text :
       {"recorded-day day.csv", "recorded-day day.csv at 90s", "delay 10ms, recorded-day day.csv at 1.5s"}) {
    Impairment impairment;
    const auto applied = apply_effects(text, impairment, read_recording, read);
    ASSERT_TRUE(applied.ok()) << applied.error().message;
    EXPECT_EQ(text_of(impairment), text);
    EXPECT_TRUE(impairment.any());
  }
  Impairment impairment;
  ASSERT_TRUE(apply_effect("recorded-day f at 1min", impairment, read_recording, read));
  EXPECT_EQ(impairment.recorded_link->offset_ns, 60 * ns_per_s);
  ASSERT_TRUE(apply_effect("recorded-day f at 250ms", impairment, read_recording, read));
  EXPECT_EQ(impairment.recorded_link->offset_ns, 250 * ms);
  ASSERT_TRUE(apply_effect("recorded-day off", impairment));
  EXPECT_FALSE(impairment.any());
}

TEST(RecordedDayEffect, RefusesWhatItCannotPlay) {
  const ReadLinkRecording read = recordings_of("0,0.1\n60,lost\n");
  const std::pair<const char*, const char*> wrong[] = {
      {"recorded-day", "allowed is recorded-day FILE [at OFFSET]"},
      {"recorded-day f at", "allowed is recorded-day FILE [at OFFSET]"},
      {"recorded-day f from 5s", "allowed is recorded-day FILE [at OFFSET]"},
      {"recorded-day f at 5", "within the day, which is 120 s long"},
      {"recorded-day f at 2min", "within the day"},
      {"recorded-day f at -1s", "within the day"},
      {"recorded-day f at nans", "within the day"},
  };
  for (const auto& [text, why] : wrong) {
    Impairment impairment;
    const auto applied = apply_effect(text, impairment, read_recording, read);
    ASSERT_FALSE(applied.ok()) << text;
    EXPECT_THAT(applied.error().message, HasSubstr(why)) << text;
    EXPECT_FALSE(impairment.any());
  }
  Impairment impairment;
  EXPECT_THAT(apply_effect("recorded-day /no/such/day", impairment).error().message, HasSubstr("/no/such/day"));
}

TEST(RecordedDayEffect, OfAStreamWhereNothingIsLostInIt) {
  Impairment impairment;
  ASSERT_TRUE(apply_effect("recorded-day f", impairment, read_recording, recordings_of("0,0.1\n1,0.2\n")));
  EXPECT_TRUE(check_for_stream(impairment));
  EmulatedLink stream(EmulatedLink::Kind::stream, 1);
  ASSERT_TRUE(stream.set(impairment));
  stream.push(0, "abc");
  EXPECT_EQ(stream.next_due(), 100 * ms);
  ASSERT_TRUE(apply_effect("recorded-day f", impairment, read_recording, recordings_of("0,0.1\n1,lost\n")));
  EXPECT_THAT(check_for_stream(impairment).error().message, HasSubstr("a recorded day with losses"));
}

class PlayedDay : public ::testing::Test {
 protected:
  void set(const std::string& effects) {
    Impairment impairment = link.impairment();
    ASSERT_TRUE(apply_effects(effects, impairment, read_recording, read));
    ASSERT_TRUE(link.set(impairment));
  }
  /// When it comes; nothing: it is lost.
  std::optional<TimeNs> sent(TimeNs now) {
    const auto lost = link.counts().lost;
    link.push(now, "x");
    if (link.counts().lost > lost) return std::nullopt;
    const auto due = link.next_due();
    if (due) link.pop(*due);
    return due;
  }
  EmulatedLink link{EmulatedLink::Kind::datagrams, 1};
  const ReadLinkRecording read =
      reading_once<std::shared_ptr<const LinkRecording>>(recordings_of("0,0.010\n0.1,0.030\n0.2,lost\n0.3,0.020\n"));
};

TEST_F(PlayedDay, BeginsWhenTheLinkIsUsedFirst) {
  set("recorded-day f");
  EXPECT_FALSE(link.pop(5'000 * ms));
  EXPECT_EQ(sent(5'050 * ms), 5'070 * ms);
  EXPECT_EQ(sent(5'200 * ms), std::nullopt);
  EXPECT_EQ(sent(5'300 * ms), 5'320 * ms);
  EXPECT_EQ(sent(5'400 * ms), 5'410 * ms) << "round";
}

TEST_F(PlayedDay, BeginsAtItsOffset) {
  set("recorded-day f at 200ms");
  EXPECT_EQ(sent(1'000 * ms), std::nullopt);
  EXPECT_EQ(sent(1'100 * ms), 1'120 * ms);
}

TEST_F(PlayedDay, GoesOnWhileOtherEffectsChange) {
  set("recorded-day f");
  EXPECT_EQ(sent(0), 10 * ms);
  set("delay 5ms");
  EXPECT_EQ(sent(100 * ms), 135 * ms) << "and its delay comes on top";
  set("recorded-day f at 1ms");  // another one
  EXPECT_EQ(sent(199 * ms), 199 * ms + 5 * ms + 10'200 * ns_per_us);
}

TEST_F(PlayedDay, KeepsTheOrder) {
  set("recorded-day f");
  link.push(0, "");
  link.push(99 * ms, "first");
  set("recorded-day f at 300ms");
  link.push(100 * ms, "second");
  link.pop(100 * ms);
  EXPECT_EQ(link.pop(1'000 * ms)->bytes, "first");
  EXPECT_EQ(link.pop(1'000 * ms)->bytes, "second");
}

}  // namespace
}  // namespace ledgerline::hil
