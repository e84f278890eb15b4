#include "tools/tello/core/dialogue.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace ledgerline::tello {
namespace {

constexpr const char* aloft = "tof:110;h:100;bat:80;";
constexpr const char* stands = "tof:10;h:0;bat:80;";

class LandingATello : public ::testing::Test {
 protected:
  void pass(TimeNs duration, const char* state = nullptr) {
    for (const TimeNs end = now + duration; now < end; now += 10 * ns_per_ms) {
      if (state != nullptr && now % (100 * ns_per_ms) == 0) landing.on_state(now, state);
      for (const std::string& word : landing.pop_due(now)) said.push_back(word);
    }
  }
  long count(const std::string& word) const { return std::count(said.begin(), said.end(), word); }

  Landing landing;
  TimeNs now = ns_per_s;
  std::vector<std::string> said;
};

TEST_F(LandingATello, TheFirstWordsAreHandshakeZeroAndLand) {
  pass(10 * ns_per_ms);
  EXPECT_EQ(said, (std::vector<std::string>{"command", "rc 0 0 0 0", "land"}));
}

TEST_F(LandingATello, TheHandshakesOkIsNoLanding) {
  pass(10 * ns_per_ms);
  landing.on_answer("ok");
  pass(5 * ns_per_s);
  EXPECT_FALSE(landing.down());
  EXPECT_EQ(count("command"), 1);
  EXPECT_EQ(count("land"), 6);
  landing.on_answer("ok");
  pass(10 * ns_per_ms);
  EXPECT_TRUE(landing.down());
  said.clear();
  pass(5 * ns_per_s);
  EXPECT_TRUE(said.empty());
}

TEST_F(LandingATello, WithoutAnswersItIsReportedAgainEachSecond) {
  pass(10 * ns_per_s);
  EXPECT_EQ(count("land"), 10);
  EXPECT_EQ(count("command"), 10);
  EXPECT_FALSE(landing.has_answered());
  EXPECT_FALSE(landing.down());
}

TEST_F(LandingATello, AnOkAgainstTheSightIsNoLanding) {
  pass(100 * ns_per_ms, aloft);
  landing.on_answer("ok");
  landing.on_answer("ok");
  landing.on_answer("ok");
  pass(3 * ns_per_s, aloft);
  EXPECT_FALSE(landing.down());
  pass(ns_per_s, stands);
  EXPECT_TRUE(landing.down());
}

TEST_F(LandingATello, SeenOnTheGroundForASecondItIsDownWithoutAnAnswer) {
  pass(ns_per_s, aloft);
  pass(900 * ns_per_ms, stands);
  EXPECT_FALSE(landing.down());
  pass(300 * ns_per_ms, stands);
  EXPECT_TRUE(landing.down());
}

TEST_F(LandingATello, WhatIsNoAnswerAndNoStateTextChangesNothing) {
  pass(10 * ns_per_ms);
  for (const std::string& text :
       {std::string("okay"), std::string(), std::string("\xff"), std::string(1024, 'k'), std::string("ok;ok")}) {
    landing.on_answer(text);
    landing.on_state(now, text);
  }
  pass(3 * ns_per_s);
  EXPECT_FALSE(landing.has_answered());
  landing.on_answer("error \x1b[2J Motor stop");
  EXPECT_EQ(landing.refusal().find('\x1b'), std::string::npos);
  landing.on_answer("error" + std::string(1000, 'x'));
  EXPECT_LE(landing.refusal().size(), 60U);
  EXPECT_FALSE(landing.down());
}

}  // namespace
}  // namespace ledgerline::tello
