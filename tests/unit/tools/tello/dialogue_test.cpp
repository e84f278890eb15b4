#include "tools/tello/core/dialogue.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ledgerline::tello {
namespace {

/// One Tello on a clock of its own, of which each test decides what it says.
class AskingATello : public ::testing::Test {
 protected:
  /// Lets time pass until something is asked.
  std::string asked() {
    for (const TimeNs end = now + 10 * ns_per_s; now < end; now += 10 * ns_per_ms) {
      if (std::string text = dialogue.pop_due(now); !text.empty()) return text;
    }
    return "";
  }
  TimeNs now = ns_per_s;
  Dialogue dialogue{questions_of_info()};
};

TEST_F(AskingATello, EachQuestionIsAskedOnceWhereItIsAnswered) {
  const std::vector<std::pair<std::string, std::string>> talk{
      {"command", "ok"},  {"sn?", "0TQDG00EDPMV39\r\n"}, {"battery?", "87\r\n"},          {"hardware?", "TELLO\r\n"},
      {"sdk?", "20\r\n"}, {"version?", "v01.04.91.01"},  {"wifiversion?", "wifiv1.0.0.0"}};
  for (const auto& [question, answer] : talk) {
    EXPECT_EQ(asked(), question);
    dialogue.on_answer(answer);
  }
  EXPECT_TRUE(dialogue.over());
  EXPECT_EQ(asked(), "");
  const auto shown = nlohmann::json::parse(json({{0xC0A80A01, dialogue}}));
  EXPECT_EQ(
      shown.dump(),
      R"({"drones":[{"address":"192.168.10.1","battery":87,"hardware":"TELLO","sdk":"20","serial":"0TQDG00EDPMV39",)"
      R"("version":"v01.04.91.01","wifi_version":"wifiv1.0.0.0"}]})");
}

TEST_F(AskingATello, ADroneThatDoesNotAnswerTheFirstCommandIsGivenUpAfterThreeTries) {
  EXPECT_EQ(asked(), "command");
  EXPECT_EQ(asked(), "command");
  EXPECT_EQ(asked(), "command");
  EXPECT_EQ(asked(), "");
  EXPECT_TRUE(dialogue.over());
  EXPECT_FALSE(dialogue.present());
}

TEST_F(AskingATello, ALostAnswerIsAskedForAgainAndAQuestionThatNobodyKnowsIsNot) {
  EXPECT_EQ(asked(), "command");
  dialogue.on_answer("ok");
  EXPECT_EQ(asked(), "sn?");
  const TimeNs first = now;
  EXPECT_EQ(asked(), "sn?");
  EXPECT_EQ(now - first, Timeouts{}.answer_ns);
  dialogue.on_answer("unknown command: sn?");
  EXPECT_EQ(asked(), "battery?");
  dialogue.on_answer("87");
  EXPECT_TRUE(dialogue.present());
  EXPECT_EQ(dialogue.answer("sn?"), "");
  EXPECT_NE(words({{1, dialogue}}).find("does not say"), std::string::npos);
  EXPECT_NE(words({{1, dialogue}}).find("87 %"), std::string::npos);
}

TEST_F(AskingATello, ALateOrDoubledAnswerIsNotTakenForTheNextQuestions) {
  EXPECT_EQ(asked(), "command");
  dialogue.on_answer("ok");
  dialogue.on_answer("ok");
  EXPECT_EQ(asked(), "sn?");
  dialogue.on_answer("ok");
  dialogue.on_answer("0TQDG00EDPMV39");
  EXPECT_EQ(asked(), "battery?");
  dialogue.on_answer("0TQDG00EDPMV39");
  dialogue.on_answer("87");
  EXPECT_EQ(asked(), "hardware?");
  dialogue.on_answer("87");
  dialogue.on_answer("0TQDG00EDPMV39");
  dialogue.on_answer("ok");
  EXPECT_EQ(dialogue.answer("hardware?"), "");
  dialogue.on_answer("TELLO");
  EXPECT_EQ(dialogue.answer("sn?"), "0TQDG00EDPMV39");
  EXPECT_EQ(dialogue.answer("battery?"), "87");
  EXPECT_EQ(dialogue.answer("hardware?"), "TELLO");
}

TEST_F(AskingATello, HostileAnswersAreNeitherShownNorCounted) {
  EXPECT_EQ(asked(), "command");
  for (const std::string& text : {std::string(), std::string(1, '\0'), std::string("ok\x1b[2J"), std::string(1024, 'o'),
                                  std::string("revoked"), std::string("\xff\xfe")})
    dialogue.on_answer(text);
  EXPECT_FALSE(dialogue.present());
  dialogue.on_answer("ok");
  int times = 0;
  for (; !asked().empty(); ++times) {
    for (const std::string& text :
         {std::string("\x1b]0;title\x07"), std::string(1000, 'A'), std::string("-5"), std::string("101"),
          std::string("999999999999999999999"), std::string("87;rm"), std::string("a b"), std::string("\xc3\x28"),
          std::string("A\0B", 3), std::string("<script>\n")})
      dialogue.on_answer(text);
  }
  EXPECT_LE(times, 3 * 6);
  const std::string shown = words({{1, dialogue}}) + json({{1, dialogue}});
  for (const char c : shown) EXPECT_TRUE(c == '\n' || (c >= ' ' && c <= '~'));
  EXPECT_EQ(dialogue.answer("battery?"), "");
  EXPECT_EQ(dialogue.answer("sn?"), "");
  EXPECT_LT(shown.size(), 600U);
  EXPECT_TRUE(nlohmann::json::accept(json({{1, dialogue}})));
}

TEST_F(AskingATello, ACommandThatIsObeyedIsAnsweredOkWhateverItsPasswordEndsIn) {
  dialogue = Dialogue({"ap lab password?"});
  EXPECT_EQ(asked(), "command");
  dialogue.on_answer("ok");
  EXPECT_EQ(asked(), "ap lab password?");
  dialogue.on_answer("OK,drone will reboot in 3s");
  EXPECT_TRUE(dialogue.over());
  EXPECT_FALSE(dialogue.questions().back().answer.empty());

  dialogue = Dialogue({"ap lab password?"});
  EXPECT_EQ(asked(), "command");
  dialogue.on_answer("ok");
  EXPECT_EQ(asked(), "ap lab password?");
  dialogue.on_answer("unknown command: ap");
  EXPECT_TRUE(dialogue.questions().back().refused);
}

TEST_F(AskingATello, BeforeItWasAskedNothingCounts) {
  dialogue.on_answer("ok");
  EXPECT_FALSE(dialogue.present());
  EXPECT_EQ(asked(), "command");
}

}  // namespace
}  // namespace ledgerline::tello
