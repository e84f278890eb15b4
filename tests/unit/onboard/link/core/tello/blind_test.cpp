#include <gtest/gtest.h>

#include <cstdio>

#include "tests/unit/campaign.hpp"
#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// A link that does not see its drone, which may be in the air: what it says, for how long, and that the Tello's own
/// rule of 15 s is left to work.
namespace ledgerline::link {
namespace {

constexpr TimeNs tello_lands_after_ns = 15 * ns_per_s;

/// One drone in the air, on the last rc of a link that died; a new link has yet to find it. Agent is dead, too.
struct WithoutState : LinkWorld {
  WithoutState() {
    agent = mocap = false;
    FakeTello& tello = tellos[0];
    tello.connected = true;
    tello.motion = FakeTello::Motion::hovering;
    tello.position = {0, 0, 1};
    tello.rc = {0, 50, 0, 0};
    tello.heard_at_s = 0;
  }
  FakeTello& tello() { return tellos[0]; }
  bool down() { return tello().motion == FakeTello::Motion::ground; }
  long said(std::string_view word) const {
    return std::count_if(sent.begin(), sent.end(), [&](const auto& message) { return message.second == word; });
  }
};

TEST(Blind, TheFirstStepOfALinkSendsCommandAndZero) {
  WithoutState w;
  w.step();
  ASSERT_EQ(w.sent.size(), 2U);
  EXPECT_EQ(w.sent[0].second, "command");
  EXPECT_EQ(w.sent[1].second, "rc 0 0 0 0");
  EXPECT_EQ(w.tello().rc, (std::array<int, 4>{}));
}

TEST(Blind, ALostZeroIsRepeatedWithinATenthOfASecond) {
  WithoutState w;
  w.tello().states = false;
  w.tello().hears = false;
  w.pass(150 * ms);
  w.tello().hears = true;
  w.pass(w.settings_.session.zero_gap_ns);
  EXPECT_EQ(w.tello().rc, (std::array<int, 4>{}));
}

TEST(Blind, FailedHandshakesEndInALanding) {
  for (const bool answers : {true, false}) {
    WithoutState w;
    w.tello().states = false;
    w.tello().answers = answers;  // an ok without state text is blind as well
    w.pass(3'400 * ms);
    EXPECT_EQ(w.said("command"), w.settings_.session.handshakes);
    EXPECT_EQ(w.said("land"), 0);
    EXPECT_EQ(w.core.mode(1), FailsafeMode::none);
    w.pass(200 * ms);
    EXPECT_EQ(w.said("land"), 1);
    EXPECT_EQ(w.core.mode(1), FailsafeMode::land);
    EXPECT_EQ(w.transitions.back().cause, FailsafeCause::state_stale);
    EXPECT_FALSE(w.core.all_on_ground());
    w.pass(5 * ns_per_s);
    EXPECT_TRUE(w.down());
  }
}

TEST(Blind, TheCommandIsBoundedAndTheSilenceAfterItIsLongerThanTheTellosOwn) {
  WithoutState w;
  w.tello().states = w.tello().answers = w.tello().lands = false;  // it hears everything, and obeys no landing
  const SessionSettings& s = w.settings_.session;
  w.pass(3'500 * ms + s.lost_link_land_for_ns + 100 * ms);
  EXPECT_EQ(w.said("land"), s.lost_link_land_for_ns / s.lost_link_repeat_ns);
  w.sent.clear();
  w.pass(s.silence_ns - 500 * ms);
  EXPECT_TRUE(w.sent.empty());
  EXPECT_EQ(w.tello().motion, FakeTello::Motion::sinking) << "it lands by itself";
  EXPECT_GT(s.silence_ns, tello_lands_after_ns);
}

TEST(Blind, EveryFurtherTryBeginsWithZeroAndEndsInLandAndSilence) {
  WithoutState w;
  w.tello().states = w.tello().answers = false;
  const SessionSettings& s = w.settings_.session;
  w.pass(3'500 * ms + s.lost_link_land_for_ns + 100 * ms);
  for (int cycle = 0; cycle < 5; ++cycle) {
    w.sent.clear();
    w.pass(s.lost_link_land_for_ns + s.silence_ns);
    ASSERT_GE(w.sent.size(), 3U);
    EXPECT_EQ(w.sent[0].second, "command");
    EXPECT_EQ(w.sent[1].second, "rc 0 0 0 0");
    EXPECT_EQ(w.sent.back().second, "land");
    EXPECT_EQ(w.said("land"), w.said("command"));
    EXPECT_LE(w.sent.back().first - w.sent[0].first, s.lost_link_land_for_ns);
  }
}

TEST(Blind, ADroneThatIsSwitchedOnLaterIsFoundOnTheGroundAndMayTakeOff) {
  for (int on_s = 1; on_s <= 60; on_s += 4) {
    LinkWorld w;
    w.tellos[0].hears = false;  // it is off
    w.pass(on_s * ns_per_s);
    w.tellos[0].hears = true;
    w.pass(w.settings_.session.silence_ns + ns_per_s);
    ASSERT_EQ(w.core.phase(1), LinkPhase::on_ground) << "switched on after " << on_s << " s";
    EXPECT_EQ(w.core.mode(1), FailsafeMode::none);
    w.plan(PlanAction::takeoff);
    w.pass(6 * ns_per_s);
    EXPECT_EQ(w.core.phase(1), LinkPhase::flying);
  }
}

TEST(Blind, ADroneThatFellSilentWhereItStoodIsSoughtWithoutAnEndAndNeverCommanded) {
  LinkWorld w;
  w.pass(4 * ns_per_s);
  ASSERT_EQ(w.core.phase(1), LinkPhase::on_ground);
  w.tellos[0].hears = w.tellos[0].states = false;
  w.sent.clear();
  w.pass(60 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::disconnected);
  EXPECT_TRUE(w.core.all_on_ground());
  EXPECT_EQ(std::count_if(w.sent.begin(), w.sent.end(), [](const auto& m) { return m.second == "land"; }), 0);
  EXPECT_GE(std::count_if(w.sent.begin(), w.sent.end(), [](const auto& m) { return m.second == "command"; }), 14);
  w.tellos[0].hears = w.tellos[0].states = true;
  w.pass(w.settings_.session.answer_timeout_max_ns + 200 * ms);
  EXPECT_EQ(w.core.phase(1), LinkPhase::on_ground);
}

TEST(Blind, WhatIsSeenOnTheGroundInTheTakeOffOfADeadLinkMayFly) {
  for (const bool answers : {true, false}) {
    WithoutState w;
    w.tello() = {};
    w.tello().connected = true;
    w.tello().hear("takeoff");
    w.tello().answers = answers;
    w.pass(500 * ms);  // it is seen while its motors spin up
    w.tello().states = false;
    w.pass(25 * ns_per_s);
    EXPECT_TRUE(w.down()) << answers;
  }
  WithoutState w;  // and what is seen to rise, though no answer comes
  w.tello() = {};
  w.tello().connected = true;
  w.tello().hear("takeoff");
  w.tello().answers = false;
  w.pass(15 * ns_per_s);
  EXPECT_TRUE(w.down());
}

TEST(Blind, WhatIsFoundInTheAirBehindTheHandshakesComesDownAndIsNotFlownOn) {
  WithoutState w;
  w.tello().states = w.tello().lands = false;
  w.pass(5 * ns_per_s);
  w.tello().states = true;
  w.pass(300 * ms);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landing);
  w.tello().lands = true;
  w.pass(6 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
}

TEST(Blind, WithAnswersLostAloneItIsLandedByWhatIsSeenAndThenLeftAlone) {
  WithoutState w;
  w.tello().answers = false;
  w.pass(6 * ns_per_s + w.settings_.session.stands_after_ns);
  EXPECT_TRUE(w.down());
  EXPECT_TRUE(w.core.all_on_ground());
  w.sent.clear();
  w.pass(30 * ns_per_s);
  EXPECT_EQ(w.said("land"), 0);
}

TEST(Blind, AStopALandingAndACutAreSentAtOnceAndRepeated) {
  for (const auto& [action, word] :
       {std::pair(PlanAction::stop, "land"), {PlanAction::land, "land"}, {PlanAction::cut, "emergency"}}) {
    WithoutState w;
    w.tello().states = w.tello().answers = false;
    w.tello().hears = false;
    w.pass(ns_per_s);
    w.plan(action);
    w.pass(10 * ms);
    EXPECT_EQ(w.said(word), 1);
    w.pass(1'500 * ms);
    EXPECT_EQ(w.said(word), 4);
    w.tello().hears = true;
    w.pass(4 * ns_per_s);
    EXPECT_TRUE(w.down()) << word;
    EXPECT_EQ(w.core.reports()[0].plans.applied, 1U);
  }
}

TEST(Blind, TheSilenceIsBrokenOnceByAStopALandingAndACutEach) {
  WithoutState w;
  const SessionSettings& s = w.settings_.session;
  const auto words = s.lost_link_land_for_ns / s.lost_link_repeat_ns;
  w.tello().states = w.tello().answers = w.tello().lands = false;
  w.pass(3'500 * ms + s.lost_link_land_for_ns + ns_per_s);
  EXPECT_EQ(w.said("land"), words);
  const auto insist = [&](PlanAction action, TimeNs duration) {  // by somebody who does not tire
    for (const TimeNs end = w.now + duration; w.now < end;) {
      w.plan(action);
      w.pass(200 * ms);
    }
  };
  insist(PlanAction::land, 8 * ns_per_s);
  EXPECT_EQ(w.said("land"), 2 * words);
  insist(PlanAction::stop, 8 * ns_per_s);
  EXPECT_EQ(w.said("land"), 3 * words);
  insist(PlanAction::cut, 8 * ns_per_s);
  EXPECT_EQ(w.said("emergency"), words);
  EXPECT_TRUE(w.down());
}

TEST(Blind, ARepeatedRequestDuringAndAfterTheCommandDoesNotBreakTheSilence) {
  for (const PlanAction action : {PlanAction::land, PlanAction::stop}) {
    WithoutState w;
    const SessionSettings& s = w.settings_.session;
    w.tello().states = w.tello().answers = w.tello().lands = false;
    w.pass(3'600 * ms);
    for (int i = 0; i < 90; ++i) {
      w.plan(action);
      w.pass(200 * ms);
    }
    EXPECT_LE(w.said("land"), s.lost_link_land_for_ns / s.lost_link_repeat_ns + 1);
    w.pass(6 * ns_per_s);
    EXPECT_TRUE(w.down()) << "it landed by itself";
  }
}

TEST(Blind, TheLocalStopKeyLandsADroneThatWasHeardForAllOfItsTime) {
  for (const int after_s : {0, 2, 5, 15}) {  // in each stage
    WithoutState w;
    w.tello().states = w.tello().lands = false;
    w.pass(after_s * ns_per_s + 10 * ms);
    const long before = w.said("land");
    w.stop_all = true;
    w.pass(10 * ms);
    EXPECT_EQ(w.said("land"), before + 1) << after_s;
    EXPECT_FALSE(w.core.all_landed_or_commanded()) << after_s;
    w.pass(w.settings_.session.lost_link_land_for_ns - 100 * ms);
    EXPECT_EQ(w.said("land"),
              before + w.settings_.session.lost_link_land_for_ns / w.settings_.session.lost_link_repeat_ns);
    EXPECT_FALSE(w.core.all_landed_or_commanded()) << after_s;
    w.pass(200 * ms);
    EXPECT_TRUE(w.core.all_landed_or_commanded()) << after_s;
    EXPECT_FALSE(w.core.all_on_ground_or_unheard()) << "nobody saw it on the ground";
  }
}

TEST(Blind, TheLocalStopKeyLandsADroneThatWasNeverHeardForThreeSeconds) {
  WithoutState w;
  w.tello().states = w.tello().answers = false;
  w.pass(20 * ms);
  w.stop_all = true;
  w.pass(w.settings_.session.unheard_land_for_ns - 10 * ms);
  EXPECT_FALSE(w.core.all_landed_or_commanded());
  w.pass(20 * ms);
  EXPECT_TRUE(w.core.all_landed_or_commanded());
  EXPECT_FALSE(w.core.all_on_ground());
  EXPECT_TRUE(w.core.all_on_ground_or_unheard());
  EXPECT_EQ(w.said("land"), 7);
  EXPECT_TRUE(w.down() || w.tello().motion == FakeTello::Motion::sinking);
}

TEST(Blind, ALandingThatNobodySeesForThirtySecondsMayStillFly) {
  LinkWorld w;
  w.take_off();
  FakeTello& tello = w.tellos[0];
  tello.lands = tello.states = tello.answers = false;
  w.plan(PlanAction::land);
  w.pass(w.settings_.session.landing_lost_after_ns + 500 * ms);
  ASSERT_EQ(w.core.phase(1), LinkPhase::disconnected);
  EXPECT_FALSE(w.core.all_on_ground());
  w.sent.clear();
  w.pass(w.settings_.session.silence_ns - ns_per_s);
  EXPECT_TRUE(w.sent.empty()) << "`land` was said for long already";
  EXPECT_EQ(tello.motion, FakeTello::Motion::sinking) << "it lands by itself";
}

TEST(Blind, ALinkThatIsStartedAgainAndAgainLandsInItsFirstStep) {
  WithoutState w;
  for (int start = 1; start <= 20; ++start) {
    w.core = LinkCore(w.settings_, 100 + static_cast<std::uint64_t>(start), start);
    w.pass(2 * ms);  // too short for an answer and a state text
    EXPECT_EQ(w.said("land") > 0, start >= w.settings_.session.many_starts) << start;
  }
  EXPECT_EQ(w.tello().motion, FakeTello::Motion::sinking);
}

/// Every course of the channels, of the link's deaths and of the kind of Tello in the first slots of a second; then it
/// stays as it is. Real LinkCore, to the end.
class BlindSearch {
 public:
  enum Channel { fine, no_states, no_answers, nothing_back, nothing };

  void run(int slots) {
    std::vector<int> course(static_cast<std::size_t>(slots));
    const int choices = 10;  // five channels, with or without a death
    int courses = 1;
    for (int i = 0; i < slots; ++i) courses *= choices;
    for (int kind = 0; kind < 4; ++kind) {
      for (int number = 0; number < courses && !::testing::Test::HasFailure(); ++number) {
        for (int i = 0, rest = number; i < slots; ++i, rest /= choices)
          course[static_cast<std::size_t>(i)] = rest % choices;
        fly(kind, course);
        ++flown;
      }
    }
  }
  std::size_t flown = 0;

 private:
  static void fly(int kind, const std::vector<int>& course) {
    WithoutState w;
    FakeTello& tello = w.tello();
    tello.keeps_rc = (kind & 1) != 0;
    tello.command_counts = (kind & 2) != 0;
    std::string sent;
    for (const int slot : course) {
      set(tello, static_cast<Channel>(slot / 2));
      if (slot % 2 == 1) w.core = LinkCore(w.settings_, 43 + w.sent.size());
      sent += " " + std::to_string(slot);
      pass(w, ns_per_s);
    }
    // What was heard last may be of the last slot's end.
    pass(w, 20 * ns_per_s);
    ASSERT_TRUE(w.down()) << "kind " << kind << ", course" << sent;
  }
  static void set(FakeTello& tello, Channel channel) {
    tello.hears = channel != nothing;
    tello.states = channel == fine || channel == no_answers;
    tello.answers = channel == fine || channel == no_states;
  }
  static void pass(WithoutState& w, TimeNs duration) {
    const double from = w.tello().position[0];
    const bool stands = w.tello().rc == std::array<int, 4>{};
    w.pass(duration);
    if (!stands) return;
    ASSERT_NEAR(w.tello().position[0], from, 0.01) << "it moved again";
  }
};

TEST(BlindSearch, TheDroneStopsAndLandsWhicheverLinkIsLostAndWhicheverProcessDies) {
  BlindSearch search;
  search.run(seeds(2, 3));
  std::printf("%zu courses flown\n", search.flown);
  EXPECT_GE(search.flown, 400U);
}

}  // namespace
}  // namespace ledgerline::link
