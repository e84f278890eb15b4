#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ground/service/core/api.hpp"

namespace ledgerline::ground::service {
namespace {

using testing::HasSubstr;

const char* const launchers_list =
    R"({"faults":[{"name":"silent-tello1","drone":"tello1","label":"Drone silent","words":"It says nothing.","on":true},)"
    R"({"name":"ledger-stalled","drone":"","label":"Ledger stalled","words":"Nobody reaches it.","on":false}]})";

TEST(FaultList, IsReadAsTheLauncherTellsItAndReportedInTheSameWords) {
  const auto list = faults_from(launchers_list);
  ASSERT_TRUE(list) << list.error().message;
  ASSERT_EQ(list->size(), 2U);
  EXPECT_EQ((*list)[0].name, "silent-tello1");
  EXPECT_TRUE((*list)[0].on);
  EXPECT_EQ((*list)[1].drone, "");
  EXPECT_EQ(faults_from(faults_text({.switches = *list}))->size(), 2U);
  EXPECT_THAT(faults_message({.switches = {}, .why = "gone"}), HasSubstr(R"("faults":[],"op":"faults","why":"gone")"));
}

TEST(FaultList, WhatIsNoneIsRefusedWithTheReason) {
  const auto wrong = [](const std::string& text) { return faults_from(text).error().message; };
  const auto with = [](const std::string& what, const std::string& by) {
    std::string text = launchers_list;
    return text.replace(text.find(what), what.size(), by);
  };
  EXPECT_THAT(wrong("[]"), HasSubstr("must be a JSON object"));
  EXPECT_THAT(wrong("{}"), HasSubstr("no list"));
  EXPECT_THAT(wrong(with("\"on\":false", "\"on\":0")), HasSubstr("fault 2: on is neither"));
  EXPECT_THAT(wrong(with("silent-tello1", "silent tello1")), HasSubstr("fault 1: name is no word"));
  EXPECT_THAT(wrong(with("silent-tello1", "off\\nclear")), HasSubstr("fault 1: name is no word"));
  EXPECT_THAT(wrong(with("ledger-stalled", "silent-tello1")), HasSubstr("two faults silent-tello1"));
  EXPECT_THAT(wrong(with("It says", std::string(400, 'x'))), HasSubstr("words is no text"));
  EXPECT_THAT(wrong(with("\"drone\":\"\"", "\"more\":\"\"")), HasSubstr("unknown key"));
  std::string many;
  for (std::size_t i = 0; i <= max_fault_switches; ++i) {
    many += (many.empty() ? "" : ",") +
            (R"({"name":"f)" + std::to_string(i) + R"(","drone":"","label":"","words":"","on":false})");
  }
  EXPECT_THAT(wrong("{\"faults\":[" + many + "]}"), HasSubstr("at most 64"));
}

class FaultsApi : public testing::Test {
 protected:
  ApiAnswer ask(std::string_view method, std::string_view body = "", std::optional<std::size_t> who = {},
                bool over = false) const {
    ApiContext known{names, "[]", "{}", events, operators};
    if (there) known.faults = &list;
    return answer({.method = method, .target = "/api/v1/faults", .body = body, .who = who, .session_ended = over},
                  known);
  }
  FaultList list{.switches = *faults_from(launchers_list)};
  bool there = true;
  std::vector<Operator> operators;

 private:
  const std::vector<std::string> names{"tello1"};
  const std::deque<Event> events{};
};

TEST_F(FaultsApi, TellsThemAndAsksForOneThatIsSwitched) {
  EXPECT_EQ(ask("GET").body, faults_text(list));
  const ApiAnswer on = ask("POST", R"({"name":"ledger-stalled","on":true})");
  ASSERT_TRUE(on.fault);
  EXPECT_EQ(command_of(*on.fault), "on ledger-stalled");
  EXPECT_EQ(words_of(*on.fault, list.switches[1]), "Ledger stalled: switched on");
  EXPECT_EQ(command_of(*ask("POST", R"({"name":"silent-tello1","on":false})").fault), "off silent-tello1");
}

TEST_F(FaultsApi, WhereThereAreNoneOrNobodyAnswersSaysSo) {
  list.why = "not reached";
  EXPECT_EQ(ask("GET").status, 503U);
  EXPECT_EQ(ask("POST", R"({"name":"ledger-stalled","on":true})").status, 503U);
  there = false;
  EXPECT_EQ(ask("GET").status, 404U);
  EXPECT_THAT(ask("GET").body, HasSubstr("[service] faults is not set"));
}

TEST_F(FaultsApi, WhatItDoesNotUnderstandSwitchesNothing) {
  for (const char* body : {"", "{}", R"({"name":"ledger-stalled"})", R"({"name":"ledger-stalled","on":1})",
                           R"({"name":7,"on":true})", R"({"name":"ledger-stalled","on":true,"for_s":3})", "[]"}) {
    const ApiAnswer made = ask("POST", body);
    EXPECT_EQ(made.status, 400U) << body;
    EXPECT_FALSE(made.fault) << body;
  }
  EXPECT_EQ(ask("POST", R"({"name":"silent-tello9","on":true})").status, 404U);
  EXPECT_EQ(ask("DELETE").status, 405U);
}

TEST_F(FaultsApi, WithOperatorsOneWhoIsSignedInSwitchesOnAndAnybodyOff) {
  operators = {{"alice", {"Org2MSP", "CN=alice"}}};
  const char* const on = R"({"name":"silent-tello1","on":true})";
  EXPECT_EQ(ask("POST", on).status, 403U);
  EXPECT_FALSE(ask("POST", on).fault);
  EXPECT_EQ(words_of(*ask("POST", on, 0).fault, list.switches[0]), "Drone silent: switched on by alice");
  EXPECT_TRUE(ask("POST", R"({"name":"silent-tello1","on":false})").fault);
  EXPECT_EQ(ask("POST", on, {}, true).status, 401U) << "a session that is over";
  EXPECT_FALSE(ask("POST", on, {}, true).fault);
}

}  // namespace
}  // namespace ledgerline::ground::service
