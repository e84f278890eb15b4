#include "hil/fault/own_code.hpp"
#include "hil/fault/real/sdk_flight.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

Script own_scenario(const std::string& name) {
  auto script = load_script(std::string(SCENARIOS) + "/own/" + name + ".toml", true);
  EXPECT_TRUE(script) << script.error().message;
  return *script;
}

TEST(OwnCode, ACommandIsTakenApartAsAShellDoes) {
  EXPECT_THAT(*words_of_command("python3  my.py --side 2"), ElementsAre("python3", "my.py", "--side", "2"));
  EXPECT_THAT(*words_of_command(R"(a 'b c' "d \" e" f\ g '')"), ElementsAre("a", "b c", "d \" e", "f g", ""));
  EXPECT_THAT(words_of_command("a 'b").error().message, HasSubstr("the quote ' has no end"));
  EXPECT_FALSE(words_of_command("  "));
}

TEST(OwnCode, AProgramIsFoundAsAShellFindsIt) {
  EXPECT_TRUE(program_at("sh"));
  EXPECT_EQ(*program_at("/bin/sh"), "/bin/sh");
  EXPECT_THAT(program_at("no_such_program").error().message, HasSubstr("no program no_such_program in PATH"));
  const std::string text = testing::TempDir() + "/no_program";
  std::ofstream(text) << "no program\n";
  EXPECT_THAT(program_at(text).error().message, HasSubstr("no program that can be run"));
  Script script = own_scenario("sdk-client-errors");
  EXPECT_THAT(put_into(script, {.controller = {}, .program = {"no_such_program"}}).error().message,
              HasSubstr("in PATH"));
}

TEST(OwnCode, WhoFliesMustBeThere) {
  const Script by_sdk = own_scenario("sdk-client-errors"), by_topics = own_scenario("ros2-gap");
  for (const Script& script : {by_sdk, by_topics}) {
    EXPECT_THAT(check_sitl(script).error().message, HasSubstr("give --program COMMAND")) << script.name;
    EXPECT_THAT(run_script(script, 1).error().message, HasSubstr("in real time")) << script.name;
    EXPECT_FALSE(check_real(script, {})) << script.name;
  }
  EXPECT_TRUE(check_real(by_topics, {}, {.controller = {}, .program = {"true"}}));
}

TEST(OwnCode, WhatDoesNotGoTogetherIsRefused) {
  Script plain = scripted("title = \"t\"\n");
  EXPECT_THAT(put_into(plain, {.controller = {}, .program = {"true"}}).error().message, HasSubstr("here ground flies"));
  EXPECT_THAT(put_into(plain, {.controller = "/nowhere.so", .program = {}}).error().message, HasSubstr("no file"));
  Script manual = scripted("title = \"t\"\n[flight]\nkind = \"manual\"\n[[pilot]]\ndo = \"takeoff\"\n");
  EXPECT_THAT(put_into(manual, {.controller = EXAMPLE_CONTROLLER, .program = {}}).error().message,
              HasSubstr("has none"));
  EXPECT_THAT(put_into(manual, {.controller = {}, .program = {"true"}}).error().message, HasSubstr("[[pilot]]"));
}

TEST(OwnCode, WhatAnSdkFlightCannotHaveIsRefusedByName) {
  const auto refusal = [](const std::string& text) {
    auto script = parse_script("title = \"t\"\n" + text, "x.toml", true);
    if (!script) return "NO SCRIPT: " + script.error().message;
    const Status checked = check_sdk(*script);
    return checked ? std::string() : checked.error().message;
  };
  const std::string flight = "[flight]\nkind = \"sdk\"\n";
  for (const char* fault :
       {"drone tello1 to delay 200ms", "sensor tello1 h stuck", "cpu 0 burn", "drone * both loss 5%"})
    EXPECT_EQ(refusal(flight + "[[fault]]\nwhat = \"" + fault + "\"\n"), "") << fault;
  const std::pair<const char*, const char*> faults[] = {
      {"ledger both stall", "no ledger in a flight by the SDK"},
      {"agent stop", "there is no link, agent"},
      {"link kill", "\"link kill\": "},
      {"disk full", "there is no link, agent"},
      {"drone tello1 reboot", "inside of the simulation"},
      {"operator stop tello1", "there is no link, agent"},
      {"peer 1 kill", "a part of Fabric"},
      {"mocap tello1 frozen", "inside of the simulation"},
  };
  for (const auto& [fault, why] : faults)
    EXPECT_THAT(refusal(flight + "[[fault]]\nwhat = \"" + fault + "\"\n"), HasSubstr(why)) << fault;
  for (const char* rule : {"hold is seen", "no command older than 1 s applied", "pose within 1 m"})
    EXPECT_THAT(refusal(std::string("must = [\"") + rule + "\"]\n" + flight), HasSubstr("link says that")) << rule;
  EXPECT_THAT(refusal(flight + "rate_hz = 50\npredict = false\npose = \"tello\"\n"),
              testing::AllOf(HasSubstr("flight.rate_hz"), HasSubstr("flight.predict"), HasSubstr("flight.pose")));
  EXPECT_THAT(refusal(flight + "[[fault]]\nwhat = \"cpu 0 burn\"\nat = \"landing\"\n"), HasSubstr("link says when"));
}

TEST(OwnCode, APlantedPluginIsCaughtAndRepairedItPasses) {
  const auto broken = [](const char* controller, std::uint64_t seed) {
    Script script = own_scenario("plugin-slow-ledger");
    const Status put = put_into(script, {.controller = controller, .program = {}});
    EXPECT_TRUE(put) << put.error().message;
    const auto run = run_script(script, seed);
    EXPECT_TRUE(run) << run.error().message;
    return broken_text(*run);
  };
  for (std::uint64_t seed = 1; seed <= static_cast<std::uint64_t>(seeds(4, 30)); ++seed) {
    EXPECT_EQ(broken(EXAMPLE_CONTROLLER, seed), "") << seed;
    EXPECT_NE(broken(PLANTED_CONTROLLER, seed), "") << seed;
  }
}

TEST(OwnCode, APluginsFlightHasTheSameBytesAgain) {
  Script script = own_scenario("plugin-slow-ledger");
  ASSERT_TRUE(put_into(script, {.controller = EXAMPLE_CONTROLLER, .program = {}}));
  const auto once = run_script(script, 2), again = run_script(script, 2);
  ASSERT_TRUE(once && again);
  EXPECT_EQ(once->digest, again->digest);
}

}  // namespace
}  // namespace ledgerline::hil
