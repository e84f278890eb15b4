#include "onboard/link/core/tello/serial_check.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "onboard/link/core/tello/session.hpp"

namespace ledgerline::link {
namespace {

/// A session with a configured serial, with a drone on the ground that sends its state text and says `ok` to `command`.
class SerialOfTheSession : public ::testing::Test {
 protected:
  static constexpr TimeNs tick = 10 * ns_per_ms;

  void pass(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end; now += tick) {
      if (now % (100 * ns_per_ms) == 0) session.on_state(now, "tof:10;h:0;bat:80;");
      for (CommandText text; session.next_send(now, text);) {
        sent.emplace_back(text.view());
        if (text.view() == "command") session.on_answer(now, "ok");
        if (text.view() == "sn?" && !answer.empty()) session.on_answer(now, answer);
      }
    }
  }
  long asked() const { return std::count(sent.begin(), sent.end(), "sn?"); }
  bool takes_off() { return session.request_takeoff(now); }

  TelloSession session{SessionSettings{}, "0TQDG00EDPMV39"};
  TimeNs now = ns_per_s;
  std::string answer;
  std::vector<std::string> sent;
};

TEST_F(SerialOfTheSession, TheDroneThatIsMeantTakesOff) {
  answer = "0TQDG00EDPMV39\r\n";
  pass(ns_per_s);
  EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::same);
  EXPECT_EQ(asked(), 1);
  EXPECT_TRUE(takes_off());
}

TEST_F(SerialOfTheSession, AnotherDroneDoesNotAndIsNamed) {
  answer = "0TQDG00EDPMV40\r\n";
  pass(10 * ns_per_s);
  EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::other);
  EXPECT_EQ(session.serial().answered().view(), "0TQDG00EDPMV40");
  EXPECT_FALSE(takes_off());
  EXPECT_EQ(session.phase(), LinkPhase::on_ground);
}

TEST_F(SerialOfTheSession, ADroneThatDoesNotAnswerIsAskedAgainAndWaits) {
  pass(10 * ns_per_s);
  EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::open);
  EXPECT_FALSE(takes_off());
  EXPECT_GE(asked(), 10);
  EXPECT_LE(asked(), 25);
  answer = "0TQDG00EDPMV39";
  pass(ns_per_s);
  EXPECT_TRUE(takes_off());
}

TEST_F(SerialOfTheSession, AFirmwareThatKnowsNoSuchQuestionIsNotCheckedAndTakesOff) {
  for (const char* refusal : {"unknown command: sn?", "error"}) {
    session = TelloSession({}, "0TQDG00EDPMV39");
    answer = refusal;
    pass(5 * ns_per_s);
    EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::unreported) << refusal;
    EXPECT_TRUE(takes_off()) << refusal;
  }
}

TEST_F(SerialOfTheSession, OneRefusalMayBeALateAnswerToSomethingElse) {
  answer = "error";
  pass(5 * tick);
  EXPECT_EQ(asked(), 1);
  EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::open);
  EXPECT_FALSE(takes_off());
  answer = "0TQDG00EDPMV40";
  pass(ns_per_s);
  EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::other);
}

TEST_F(SerialOfTheSession, WhatIsNoSerialDecidesNothing) {
  for (const char* text : {"ok", "OK\r\n", "87", "", "0TQDG00 EDPMV39", "0TQDG00EDPMV39;", "\xff\xfe\xfd\xfc\xfb",
                           "0TQDG00EDPMV390TQDG00EDPMV39"}) {
    answer = text;
    pass(ns_per_s);
    EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::open) << text;
  }
}

TEST_F(SerialOfTheSession, ADroneThatReconnectsIsAskedAgain) {
  answer = "0TQDG00EDPMV39";
  pass(ns_per_s);
  now += 10 * ns_per_s;  // a change of batteries
  answer.clear();
  CommandText text;
  (void)session.next_send(now, text);
  ASSERT_EQ(session.phase(), LinkPhase::disconnected);
  pass(2 * ns_per_s);
  ASSERT_EQ(session.phase(), LinkPhase::on_ground);
  EXPECT_FALSE(takes_off());
  answer = "0TQDG00EDPMV40";
  pass(ns_per_s);
  EXPECT_EQ(session.serial().verdict(), SerialCheck::Verdict::other);
}

TEST_F(SerialOfTheSession, NothingIsAskedInTheAirOrWhereNoSerialIsWanted) {
  answer = "0TQDG00EDPMV39";
  pass(ns_per_s);
  ASSERT_TRUE(takes_off());
  const long before = asked();
  pass(5 * ns_per_s);
  EXPECT_EQ(asked(), before);

  session = TelloSession(SessionSettings{});
  sent.clear();
  pass(10 * ns_per_s);
  EXPECT_EQ(asked(), 0);
  EXPECT_TRUE(takes_off());
}

}  // namespace
}  // namespace ledgerline::link
