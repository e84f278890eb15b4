#include "onboard/link/core/tello/session.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace ledgerline::link {
namespace {

constexpr TimeNs tick = 10 * ns_per_ms;

/// A session on a clock of its own, with a drone of which each test decides what it says.
class Session : public ::testing::Test {
 protected:
  /// Lets time pass; state text comes at 10 Hz while `height_m` is set.
  void pass(TimeNs duration) {
    const TimeNs end = now + duration;
    for (; now < end; now += tick) {
      if (talks && now % (100 * ns_per_ms) == 0) session.on_state(now, state_text());
      for (CommandText text; session.next_send(now, text);) sent.emplace_back(text.view());
    }
  }
  std::string state_text() const {
    const int h = static_cast<int>(height_m * 10) * 10;
    return "tof:" + std::to_string(static_cast<int>(height_m * 100) + 10) + ";h:" + std::to_string(h) + ";bat:80;" +
           more_text;
  }
  /// What is trusted of the battery after one more text.
  float battery_reported(int percent) {
    EXPECT_TRUE(session.on_state(now += 100 * ns_per_ms, "tof:10;h:0;bat:" + std::to_string(percent) + ";"));
    return session.state().battery;
  }
  void answer(const char* text) { session.on_answer(now, text); }
  long count(const std::string& command) const { return std::count(sent.begin(), sent.end(), command); }

  void connect() {
    talks = true;
    pass(tick);
    answer("ok");
    pass(200 * ns_per_ms);
    ASSERT_EQ(session.phase(), LinkPhase::on_ground);
  }
  void fly() {
    connect();
    ASSERT_TRUE(session.request_takeoff(now));
    pass(ns_per_s);
    height_m = 1;
    pass(ns_per_s);
    answer("ok");
    pass(tick);
    ASSERT_EQ(session.phase(), LinkPhase::flying);
  }

  SessionSettings settings;
  TelloSession session{settings};
  TimeNs now = ns_per_s;
  bool talks = false;
  float height_m = 0;
  std::string more_text;
  std::vector<std::string> sent;
};

TEST_F(Session, ABatteryIsLowWhenTwoOfTheNewestFourTextsSaySo) {
  EXPECT_FLOAT_EQ(battery_reported(90), 0.9F) << "the first one is trusted";
  EXPECT_FLOAT_EQ(battery_reported(0), 0.9F) << "an odd one";
  for (int i = 0; i < 3; ++i) EXPECT_FLOAT_EQ(battery_reported(89), 0.89F);
  EXPECT_FLOAT_EQ(battery_reported(5), 0.89F);
  EXPECT_FLOAT_EQ(battery_reported(4), 0.05F);
  for (int i = 0; i < 2; ++i) EXPECT_FLOAT_EQ(battery_reported(90), 0.05F);
  EXPECT_FLOAT_EQ(battery_reported(90), 0.9F) << "of four one is left";
}

TEST_F(Session, ALowBatteryIsReportedWithinFourTextsThoughAnotherDronesTextsComeInTurn) {
  for (const bool own_first : {true, false}) {
    for (int i = 0; i < 4; ++i) battery_reported(100);
    const TimeNs since = now;
    TimeNs low_at = 0;
    for (int i = 0; i < 100; ++i) {
      const bool low = battery_reported((i % 2 == 0) == own_first ? 5 : 100) <= FailsafeSettings().battery_critical;
      if (low && low_at == 0) low_at = now;
      EXPECT_EQ(low, low_at != 0) << "and stays so: " << i;
    }
    ASSERT_NE(low_at, 0);
    EXPECT_LE(low_at - since, 400 * ns_per_ms);
  }
}

TEST_F(Session, TheHandshakeWithWhatStandsOnTheGroundIsRepeatedWithGrowingPausesWhileAnswersAreLost) {
  talks = true;
  pass(settings.answer_timeout_ns / 2);
  EXPECT_EQ(count("command"), 1);
  pass(60 * ns_per_s);
  EXPECT_GE(count("command"), 10);
  EXPECT_LE(count("command"), 20);  // 0.5, 1, 2, then every 4 s
  EXPECT_EQ(count("land"), 0);
  EXPECT_EQ(session.phase(), LinkPhase::disconnected);
  connect();
}

TEST_F(Session, ADroneIsAskedToLookForPadsUntilItsStateSaysThatItDoesAndNotForEver) {
  session = TelloSession(settings, {}, true);
  connect();
  pass(ns_per_s);
  EXPECT_EQ(count("mon"), 1);
  more_text = "mid:-1;";
  pass(10 * ns_per_s);
  EXPECT_EQ(count("mon"), 1);
  more_text.clear();
  pass(60 * ns_per_s);
  EXPECT_EQ(count("mon"), 6);
}

TEST_F(Session, AnOkWithoutStateTextIsNotAConnection) {
  pass(tick);
  answer("ok");
  pass(5 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::disconnected);
  EXPECT_GE(count("command"), 2);
}

TEST_F(Session, StateTextWithoutAnOkIsNotAConnection) {
  talks = true;
  pass(5 * ns_per_s);
  answer("revoked");
  answer("error");
  pass(ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::disconnected);
}

TEST_F(Session, ADroneThatIsFoundInTheAirIsFlying) {
  height_m = 1.2F;
  talks = true;
  pass(tick);
  answer("ok");
  pass(200 * ns_per_ms);
  EXPECT_EQ(session.phase(), LinkPhase::flying);
}

TEST_F(Session, ADroneThatIsFoundAHandAboveTheGroundIsFlying) {
  height_m = 0.12F;  // too low for `h` to tell
  talks = true;
  pass(tick);
  answer("ok");
  pass(200 * ns_per_ms);
  EXPECT_EQ(session.phase(), LinkPhase::flying);
}

TEST_F(Session, TakeOffNeedsAConnection) { EXPECT_FALSE(session.request_takeoff(now)); }

TEST_F(Session, ALateOkOfAnEarlierCommandIsNoTakeOff) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  pass(100 * ns_per_ms);
  answer("ok");  // a doubled answer to `command`: the drone is still seen on the ground
  EXPECT_EQ(session.phase(), LinkPhase::taking_off);
  EXPECT_EQ(session.answers_unasked(), 1U);
  height_m = 1;
  pass(3 * ns_per_s);
  answer("ok");
  EXPECT_EQ(session.phase(), LinkPhase::flying);
  EXPECT_EQ(count("takeoff"), 1);
}

TEST_F(Session, ALostAnswerToTakeOffIsMadeUpForByWhatIsSeen) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  height_m = 1;
  pass(settings.takeoff_timeout_ns + ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::flying);
  EXPECT_EQ(count("takeoff"), 1);  // never flown twice
}

TEST_F(Session, ALostTakeOffLeavesItOnTheGround) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  pass(settings.takeoff_timeout_ns + ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::on_ground);
  EXPECT_TRUE(session.request_takeoff(now));
}

TEST_F(Session, ARefusedTakeOffIsNotTriedAgainAtOnce) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  pass(tick);
  answer("error Motor stop");
  EXPECT_EQ(session.phase(), LinkPhase::on_ground);
  EXPECT_FALSE(session.request_takeoff(now));
  pass(settings.refused_pause_ns);
  EXPECT_TRUE(session.request_takeoff(now));
}

TEST_F(Session, ARefusedTakeOffKeepsTheDronesOwnWordsUntilOneIsAccepted) {
  connect();
  EXPECT_EQ(session.takeoff_refusal().at_ns, 0);
  ASSERT_TRUE(session.request_takeoff(now));
  pass(tick);
  answer("error No valid imu\r\n");
  EXPECT_EQ(session.takeoff_refusal().text.view(), "error No valid imu");
  EXPECT_EQ(session.takeoff_refusal().at_ns, now);
  pass(settings.refused_pause_ns);
  ASSERT_TRUE(session.request_takeoff(now));
  height_m = 1;
  pass(200 * ns_per_ms);
  answer("ok");
  ASSERT_EQ(session.phase(), LinkPhase::flying);
  EXPECT_EQ(session.takeoff_refusal().at_ns, 0);
}

TEST_F(Session, TextsThatAreNotUnderstoodAreQuotedOnceAMinute) {
  const auto send = [&](std::string_view text) { (void)session.on_state(now += 100 * ns_per_ms, text); };
  for (int i = 0; i < 9; ++i) send("bat: 87;h: 0;tof: 10;\r\n");
  EXPECT_EQ(session.unreadable_text().at_ns, 0) << "a few torn ones are nothing";
  send("bat: 87;h: 0;tof: 10;\r\n");
  EXPECT_EQ(session.unreadable_text().text.view(), "bat: 87;h: 0;tof: 10;");
  const TimeNs first_ns = session.unreadable_text().at_ns;
  EXPECT_EQ(first_ns, now);
  for (int i = 0; i < 599; ++i) send(std::string(1'000, 'x'));
  EXPECT_EQ(session.unreadable_text().at_ns, first_ns);
  send(std::string(1'000, 'x'));
  EXPECT_EQ(session.unreadable_text().text.view(), std::string(120, 'x'));
  EXPECT_GT(session.unreadable_text().at_ns, first_ns);
}

TEST_F(Session, ALandingAskedForBeforeItLiftsOffIsNotOverWhileItMayStillRise) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  pass(100 * ns_per_ms);
  session.request_land(now);
  pass(2 * ns_per_s);  // spins up; `land` is ignored meanwhile
  EXPECT_EQ(session.phase(), LinkPhase::landing);
  height_m = 1;
  pass(200 * ns_per_ms);
  answer("ok");  // the take-off's
  pass(3 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::landing);
  EXPECT_GE(count("land"), 4);
  height_m = 0;
  pass(2 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::landed);
}

TEST_F(Session, ALandingAskedForBeforeATakeOffThatNeverCameEnds) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  session.request_land(now);
  pass(settings.takeoff_timeout_ns + 2 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::landed);
}

TEST_F(Session, WhatIsSeenAloftIsInFlightWhateverWasAnswered) {
  connect();
  ASSERT_TRUE(session.request_takeoff(now));
  pass(tick);
  answer("error");  // of an earlier command
  ASSERT_EQ(session.phase(), LinkPhase::on_ground);
  height_m = 0.8F;
  pass(ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::flying);
}

TEST_F(Session, WhatCameDownByItselfIsLandedAndNotFlownOn) {
  fly();
  height_m = 0;
  pass(2 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::flying);
  pass(3 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::landed);
  EXPECT_GE(count("land"), 1);
}

TEST_F(Session, LandIsRepeatedUntilTheDroneIsDown) {
  fly();
  session.request_land(now);
  pass(3 * ns_per_s + tick);
  EXPECT_GE(count("land"), 3);
  EXPECT_EQ(session.phase(), LinkPhase::landing);
  answer("error");  // a refusal does not end it
  pass(3 * ns_per_s);
  EXPECT_GE(count("land"), 5);
  height_m = 0;
  pass(2 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::landed);  // seen, though no ok came
}

TEST_F(Session, LandIsNotRepeatedWhileTheDroneComesDown) {
  fly();
  session.request_land(now);
  for (int i = 0; i < 20; ++i) {
    height_m -= 0.05F;
    pass(200 * ns_per_ms);
  }
  EXPECT_LE(count("land"), 2);
}

TEST_F(Session, AnOkToLandWhileItIsSeenInTheAirIsAnotherCommandsOk) {
  fly();
  session.request_land(now);
  pass(200 * ns_per_ms);
  answer("ok");
  EXPECT_EQ(session.phase(), LinkPhase::landing);
  height_m = 0;
  pass(200 * ns_per_ms);
  answer("ok");
  EXPECT_EQ(session.phase(), LinkPhase::landed);
}

TEST_F(Session, WithoutAnySightAnOkToLandIsTrusted) {
  fly();
  talks = false;
  pass(2 * ns_per_s);
  session.request_land(now);
  pass(100 * ns_per_ms);
  answer("ok");
  EXPECT_EQ(session.phase(), LinkPhase::landed);
}

TEST_F(Session, ADroneThatFallsSilentOnTheGroundIsReconnected) {
  connect();
  talks = false;
  pass(settings.lost_after_ns + ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::disconnected);
  const long before = count("command");
  pass(ns_per_s);
  EXPECT_GE(count("command"), before);
  talks = true;
  pass(100 * ns_per_ms);
  answer("ok");
  pass(200 * ns_per_ms);
  EXPECT_EQ(session.phase(), LinkPhase::on_ground);
}

TEST_F(Session, ADroneThatFallsSilentInTheAirStaysFlyingSoThatItCanBeLanded) {
  fly();
  talks = false;
  pass(20 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::flying);
}

TEST_F(Session, AStateTextOfAnotherMomentOrAnotherDroneIsNone) {
  more_text = "time:20;";
  fly();
  const auto taken = [&](int motor_s) {
    more_text = "time:" + std::to_string(motor_s) + ";";
    return session.on_state(now += 100 * ns_per_ms, state_text());
  };
  EXPECT_TRUE(taken(20));
  EXPECT_TRUE(taken(21));
  EXPECT_FALSE(taken(20)) << "an old one, again";
  EXPECT_FALSE(taken(40)) << "another drone's";
  EXPECT_TRUE(taken(21));
  now += 10 * ns_per_s;
  EXPECT_TRUE(taken(31)) << "after a silence";
  for (int i = 0; i < 50; ++i) EXPECT_FALSE(taken(i % 2 == 0 ? 5 : 28)) << "these follow nothing";
  for (int i = 0; i < 9; ++i) EXPECT_FALSE(taken(3));
  EXPECT_TRUE(taken(3)) << "ten that follow each other: what was trusted before was another's";
  EXPECT_TRUE(taken(4));
  session.grow_older(60 * ns_per_s);
  EXPECT_TRUE(taken(64)) << "the host slept, and the drone did not";
  more_text = "";
  EXPECT_TRUE(session.on_state(now += 100 * ns_per_ms, state_text())) << "a text that is cut short before it";
  EXPECT_FALSE(taken(5));
}

TEST_F(Session, CutSendsEmergencyUntilItIsDown) {
  fly();
  session.request_cut(now);
  pass(ns_per_s + tick);
  EXPECT_GE(count("emergency"), 10) << "a link may lose three of five";
  EXPECT_LE(count("emergency"), 12);
  pass(10 * ns_per_s);
  EXPECT_LE(count("emergency"), 34) << "whom it does not bring down, it does not flood";
  EXPECT_EQ(count("land"), 0);
  height_m = 0;
  pass(2 * ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::landed);
}

TEST_F(Session, CutOutranksALandingInProgress) {
  fly();
  session.request_land(now);
  pass(100 * ns_per_ms);
  session.request_cut(now);
  pass(tick);
  EXPECT_EQ(sent.back(), "emergency");
}

TEST_F(Session, UnaskedAndUnreadableAnswersChangeNothing) {
  connect();
  for (const char* text : {"ok", "error", "\xff\xff", "", "unknown command: x"}) answer(text);
  pass(ns_per_s);
  EXPECT_EQ(session.phase(), LinkPhase::on_ground);
  EXPECT_EQ(session.answers_unasked(), 5U);
}

}  // namespace
}  // namespace ledgerline::link
