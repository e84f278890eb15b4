#include "hil/netem/sdk/sdk_faults.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "hil/netem/sdk/calls.hpp"

namespace ledgerline::hil {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr TimeNs ms = ns_per_ms;
constexpr const char* text_a = "pitch:1;roll:2;yaw:3;tof:10;h:100;bat:87;baro:1.00;\r\n";
constexpr const char* text_b = "pitch:4;roll:5;yaw:6;tof:20;h:200;bat:86;baro:2.00;\r\n";

SdkFault fault(const std::string& text, std::size_t item = 0) {
  auto parsed = parse_sdk_fault(text);
  EXPECT_TRUE(parsed.ok()) << (parsed ? "" : parsed.error().message);
  if (!parsed) return {};
  parsed->item = item;
  return *parsed;
}

SdkFaults with(const std::vector<std::string>& texts, std::size_t drones = 1, std::uint64_t seed = 1) {
  SdkFaults faults(seed, drones);
  std::vector<SdkFault> all;
  for (const std::string& text : texts) all.push_back(fault(text, all.size()));
  EXPECT_TRUE(faults.set(0, all).ok());
  return faults;
}

std::vector<std::string> due(SdkFaults& faults, TimeNs now) {
  std::vector<std::string> texts;
  while (auto unit = faults.pop(now)) texts.push_back(unit->bytes);
  return texts;
}

TEST(SdkFaults, WithoutFaultsEverythingComesAtOnceAsItIs) {
  SdkFaults faults(1, 2);
  faults.command(0, 0, "command");
  faults.answer(0, 0, "ok");
  faults.state(0, 1, text_a);
  auto unit = faults.pop(0);
  ASSERT_TRUE(unit);
  EXPECT_EQ(unit->drone, 0U);
  EXPECT_FALSE(unit->is_state);
  EXPECT_EQ(unit->bytes, "ok");
  unit = faults.pop(0);
  ASSERT_TRUE(unit);
  EXPECT_EQ(unit->drone, 1U);
  EXPECT_TRUE(unit->is_state);
  EXPECT_EQ(unit->bytes, text_a);
  EXPECT_FALSE(faults.pop(0));
  EXPECT_FALSE(faults.next_due());
}

TEST(SdkFaults, LateAnswersComeLaterByTheirTimeAndKeepTheirOrder) {
  auto faults = with({"answers late 300ms"});
  faults.command(0, 0, "command");
  faults.answer(0, 0, "ok");
  faults.answer(10 * ms, 0, "87");
  EXPECT_THAT(due(faults, 299 * ms), IsEmpty());
  EXPECT_EQ(faults.next_due(), 300 * ms);
  EXPECT_THAT(due(faults, 300 * ms), ElementsAre("ok"));
  EXPECT_THAT(due(faults, 310 * ms), ElementsAre("87"));
}

TEST(SdkFaults, LateTimesOfTwoFaultsAddUp) {
  auto faults = with({"answers late 300ms", "answers late 200ms"});
  faults.answer(0, 0, "ok");
  EXPECT_EQ(faults.next_due(), 500 * ms);
}

TEST(SdkFaults, WhatShiftedKeepsComesOnceWithTheNextCommandNeitherLateNorTwice) {
  auto faults = with({"answers late 300ms", "answers twice 100ms", "answers shifted to takeoff"});
  faults.command(0, 0, "takeoff");
  faults.answer(10 * ms, 0, "ok");
  EXPECT_EQ(faults.next_due(), std::nullopt);
  faults.command(500 * ms, 0, "battery?");
  EXPECT_THAT(due(faults, 500 * ms), ElementsAre("ok"));
  EXPECT_EQ(faults.next_due(), std::nullopt);
  faults.answer(510 * ms, 0, "87");
  EXPECT_THAT(due(faults, 910 * ms), ElementsAre("87", "87")) << "one that is not kept";
}

TEST(SdkFaults, WhatIsLateComesWhenItWasDueThoughTheFaultHasEnded) {
  auto faults = with({"answers late 300ms"});
  faults.answer(0, 0, "ok");
  ASSERT_TRUE(faults.set(0, {}).ok());
  faults.answer(1 * ms, 0, "error");
  EXPECT_THAT(due(faults, 1 * ms), ElementsAre("error"));
  EXPECT_THAT(due(faults, 300 * ms), ElementsAre("ok"));
}

TEST(SdkFaults, WrongTurnsAnOkAndAValueIntoARefusalAndARefusalIntoAnOk) {
  auto faults = with({"answers wrong"});
  for (const char* said : {"ok", "87", "error Motor stop", "out of range", "unknown command: x"})
    faults.answer(0, 0, said);
  EXPECT_THAT(due(faults, 0), ElementsAre("error", "error", "ok", "ok", "ok"));
}

TEST(SdkFaults, GarbageIsNeitherOkNorARefusal) {
  auto faults = with({"answers garbage"});
  for (int i = 0; i < 200; ++i) faults.answer(0, 0, "ok");
  for (const std::string& text : due(faults, 0)) {
    EXPECT_NE(text, "ok");
    EXPECT_FALSE(is_refusal(text));
  }
}

TEST(SdkFaults, TheNamedCommandsAnswerAloneIsMissing) {
  auto faults = with({"answers missing to takeoff"});
  faults.command(0, 0, "takeoff");
  faults.command(1 * ms, 0, "battery?");
  faults.answer(2 * ms, 0, "87");  // at once: not the take-off's, which was asked for before
  EXPECT_THAT(due(faults, 2 * ms), ElementsAre("87"));
  faults.answer(5'000 * ms, 0, "ok");
  EXPECT_THAT(due(faults, 60'000 * ms), IsEmpty());
  faults.command(6'000 * ms, 0, "land");
  faults.answer(9'000 * ms, 0, "ok");
  EXPECT_THAT(due(faults, 9'000 * ms), ElementsAre("ok"));
}

TEST(SdkFaults, ARefusalIsTheMovesThatStopBrokeOff) {
  auto faults = with({"answers missing to forward"});
  faults.command(0, 0, "forward 100");
  faults.command(1'000 * ms, 0, "stop");
  faults.answer(1'000 * ms, 0, "error");
  faults.answer(1'000 * ms, 0, "ok");
  EXPECT_THAT(due(faults, 1'000 * ms), ElementsAre("ok"));
}

TEST(SdkFaults, RcIsNoCommandWithAnAnswer) {
  auto faults = with({"answers missing to command"});
  faults.command(0, 0, "command");
  faults.command(0, 0, "rc 0 0 0 0");
  faults.answer(0, 0, "ok");
  EXPECT_THAT(due(faults, 0), IsEmpty());
}

TEST(SdkFaults, ACommandThatWasNeverAnsweredIsForgottenAfterAWhile) {
  auto faults = with({"answers missing to land"});
  faults.command(0, 0, "land");  // ignored, as in a take-off
  faults.command(OpenCalls::answer_lost_ns + ms, 0, "forward 100");
  faults.answer(OpenCalls::answer_lost_ns + 2 * ms, 0, "ok");
  EXPECT_THAT(due(faults, OpenCalls::answer_lost_ns + 2 * ms), ElementsAre("ok"));
}

TEST(SdkFaults, OfManyOpenCommandsTheOldestAreForgotten) {
  OpenCalls calls;
  for (std::size_t i = 0; i < OpenCalls::max_open + 2; ++i)
    EXPECT_TRUE(calls.command(0, "word" + std::to_string(i), i));
  EXPECT_FALSE(calls.command(0, "rc 0 0 0 0"));
  EXPECT_FALSE(calls.command(0, " \r\n"));
  for (std::size_t i = 2; i < OpenCalls::max_open + 2; ++i) EXPECT_EQ(calls.match(0, "ok")->tag, i);
  EXPECT_FALSE(calls.match(0, "ok"));
}

TEST(SdkFaults, TwiceComesAgainAfterItsTime) {
  auto faults = with({"answers twice 700ms"});
  faults.answer(0, 0, "ok");
  EXPECT_THAT(due(faults, 0), ElementsAre("ok"));
  EXPECT_THAT(due(faults, 700 * ms), ElementsAre("ok"));
  EXPECT_THAT(due(faults, 60'000 * ms), IsEmpty());
}

TEST(SdkFaults, OtherIsTheTextOfTheAnswerBefore) {
  auto faults = with({"answers other to takeoff"});
  faults.command(0, 0, "battery?");
  faults.answer(0, 0, "87");
  faults.command(1 * ms, 0, "takeoff");
  faults.answer(5'000 * ms, 0, "ok");
  EXPECT_THAT(due(faults, 5'000 * ms), ElementsAre("87", "87"));
}

TEST(SdkFaults, ShiftedAnswersComeWithTheNextCommand) {
  auto faults = with({"answers shifted"});
  faults.command(0, 0, "command");
  faults.answer(0, 0, "ok");
  EXPECT_THAT(due(faults, 0), IsEmpty());
  faults.command(500 * ms, 0, "rc 0 0 0 0");
  EXPECT_THAT(due(faults, 500 * ms), IsEmpty());
  faults.command(1'000 * ms, 0, "battery?");
  EXPECT_THAT(due(faults, 1'000 * ms), ElementsAre("ok"));
  faults.answer(1'001 * ms, 0, "87");
  faults.command(2'000 * ms, 0, "takeoff");
  EXPECT_THAT(due(faults, 2'000 * ms), ElementsAre("87"));
  faults.answer(7'000 * ms, 0, "ok");
  EXPECT_THAT(due(faults, 7'000 * ms), IsEmpty());
  ASSERT_TRUE(faults.set(0, {}).ok());  // what it keeps comes when it ends
  EXPECT_THAT(due(faults, 7'001 * ms), ElementsAre("ok"));
}

TEST(SdkFaults, ATornTextEndsInsideAFieldOrGoesOnWithTheOneBefore) {
  auto faults = with({"states torn"});
  faults.state(0, 0, text_a);
  due(faults, 0);
  int cut = 0, halves = 0;
  for (int i = 0; i < 200; ++i) {
    const std::string text = i % 2 == 0 ? text_b : text_a, before = i % 2 == 0 ? text_a : text_b;
    faults.state(i * ms, 0, text);
    const auto said = due(faults, i * ms);
    ASSERT_EQ(said.size(), 1U);
    if (said[0] == text) continue;  // both end in the same bytes
    if (text.starts_with(said[0])) {
      ++cut;
      EXPECT_LT(said[0].size(), text.size());
      EXPECT_NE(said[0].back(), ';');
      EXPECT_NE(text[said[0].size()], ';');
    } else {
      ++halves;
      EXPECT_EQ(said[0].size(), before.size());
      const auto differs = std::mismatch(said[0].begin(), said[0].end(), text.begin()).first;
      EXPECT_TRUE(before.ends_with(std::string(differs, said[0].end())));
    }
  }
  EXPECT_GT(cut, 50);
  EXPECT_GT(halves, 20);
}

TEST(SdkFaults, AStaleTextIsOneThatTheDroneSentBefore) {
  auto faults = with({"states stale"});
  faults.state(0, 0, "first");
  EXPECT_THAT(due(faults, 0), ElementsAre("first"));  // there is no older one yet
  faults.state(1, 0, "second");
  EXPECT_THAT(due(faults, 1), ElementsAre("first"));
}

TEST(SdkFaults, StatesOfAnotherDroneAreItsNewest) {
  auto faults = with({"states other"}, 2);
  faults.state(0, 0, text_a);
  EXPECT_THAT(due(faults, 0), ElementsAre(text_a));  // the other one has said nothing yet
  faults.state(1, 1, text_b);
  EXPECT_THAT(due(faults, 1), ElementsAre(text_b));
  faults.state(2, 0, text_a);
  EXPECT_THAT(due(faults, 2), ElementsAre(text_b));
}

TEST(SdkFaults, StatesOfAnotherDroneAreRefusedWhereThereIsNone) {
  SdkFaults faults(1, 1);
  const auto set = faults.set(0, {fault("states other")});
  ASSERT_FALSE(set.ok());
  EXPECT_THAT(set.error().message, HasSubstr("no other"));
}

TEST(SdkFaults, AShareStrikesAboutSoOftenAndTheSameOnesForTheSameSeed) {
  const auto struck = [](std::uint64_t seed, const std::vector<std::string>& texts) {
    auto faults = with(texts, 1, seed);
    std::vector<bool> missing;
    for (int i = 0; i < 250; ++i) {
      faults.answer(i, 0, "ok");
      missing.push_back(due(faults, i).empty());
    }
    return missing;
  };
  const auto once = struck(3, {"answers missing 30%"});
  EXPECT_NEAR(static_cast<double>(std::count(once.begin(), once.end(), true)), 75, 25);
  EXPECT_EQ(struck(3, {"answers missing 30%"}), once);
  EXPECT_NE(struck(4, {"answers missing 30%"}), once);
  EXPECT_EQ(struck(3, {"answers missing 30%", "answers garbage 50%"}), once);  // each has random numbers of its own
}

TEST(SdkFaults, AFaultThatGoesOnGoesOnWithItsRandomNumbers) {
  auto steady = with({"answers missing 50%"}), changed = with({"answers missing 50%"});
  std::vector<bool> a, b;
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(changed.set(0, {fault("answers missing 50%", 0), fault("states torn", 1)}).ok());
    steady.answer(i, 0, "ok");
    changed.answer(i, 0, "ok");
    a.push_back(due(steady, i).empty());
    b.push_back(due(changed, i).empty());
  }
  EXPECT_EQ(a, b);
}

TEST(SdkFaults, QueuesAreBoundedAndCountWhatFindsNoRoom) {
  auto faults = with({"answers late 60s"}, 2);
  for (std::size_t i = 0; i < SdkFaults::max_waiting + 3; ++i) faults.answer(0, 0, "ok");
  EXPECT_EQ(faults.counts().no_room, 3U);
  faults.answer(0, 1, "ok");  // the bound is each drone's own
  EXPECT_EQ(faults.counts().no_room, 3U);
  EXPECT_EQ(due(faults, 60 * ns_per_s).size(), SdkFaults::max_waiting + 1);
}

TEST(SdkFaults, WhatIsTooLongForATelloIsLeftAlone) {
  auto faults = with({"answers missing", "states torn"});
  const std::string long_one(SdkFaults::max_bytes + 1, 'x');
  faults.answer(0, 0, long_one);
  faults.state(0, 0, long_one);
  EXPECT_THAT(due(faults, 0), ElementsAre(long_one, long_one));
}

TEST(SdkFaultText, ReadsWhatItWrites) {
  for (const char* text :
       {"answers late 300ms", "answers late 2s 30% to takeoff", "answers wrong to land", "answers garbage 5%",
        "answers missing", "answers twice", "answers twice 700ms 50%", "answers other to battery?", "answers shifted",
        "states torn", "states stale 30%", "states other"}) {
    const auto parsed = parse_sdk_fault(text);
    ASSERT_TRUE(parsed.ok()) << text << ": " << parsed.error().message;
    EXPECT_EQ(text_of(*parsed), text);
  }
  EXPECT_EQ(text_of(fault("answers missing to *")), "answers missing");
}

TEST(SdkFaultText, RefusesWithWhatIsAllowed) {
  const std::pair<const char*, const char*> wrong[] = {
      {"", "must be `answers late TIME"},
      {"answers", "must be `answers late TIME"},
      {"answers lost", "must be `answers late TIME"},
      {"answers torn", "must be `answers late TIME"},
      {"states late 1s", "must be `answers late TIME"},
      {"states torn to land", "must be `answers late TIME"},
      {"states torn 30% to land", "must be `answers late TIME"},
      {"answers late", "TIME of more than nothing"},
      {"answers late 0ms", "TIME of more than nothing"},
      {"answers late 30%", "TIME of more than nothing"},
      {"answers late 300", "is no time"},
      {"answers missing 0%", "more than 0%"},
      {"answers missing 101%", "more than 0%"},
      {"answers missing nan%", "more than 0%"},
      {"answers missing 30", "must be `answers late TIME"},
      {"answers missing to", "must be `answers late TIME"},
      {"answers missing to takeof", "no command of the SDK"},
      {"answers missing to rc", "has no answer"},
      {"answers missing to land now", "must be `answers late TIME"},
  };
  for (const auto& [text, why] : wrong) {
    const auto parsed = parse_sdk_fault(text);
    ASSERT_FALSE(parsed.ok()) << text;
    EXPECT_THAT(parsed.error().message, HasSubstr(why)) << text;
  }
}

TEST(SdkCalls, AWordIsTheFirstWithoutWhatIsAroundIt) {
  EXPECT_EQ(call_word("takeoff"), "takeoff");
  EXPECT_EQ(call_word(" rc 0 0 0 0\r\n"), "rc");
  EXPECT_EQ(call_word(" \r\n"), "");
  EXPECT_EQ(call_word(""), "");
  EXPECT_EQ(how_answered("rc"), Answered::never);
  EXPECT_EQ(how_answered("takeoff"), Answered::at_end);
  EXPECT_EQ(how_answered("battery?"), Answered::at_once);
  EXPECT_FALSE(how_answered("fly"));
}

}  // namespace
}  // namespace ledgerline::hil
