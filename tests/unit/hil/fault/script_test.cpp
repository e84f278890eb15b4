#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "hil/fault/random_script.hpp"
#include "hil/fault/script.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

TEST(FaultScript, SaysFileLineKeyAndWhatIsAllowed) {
  const std::string error = error_of(
      "title = \"t\"\nmust = [\"flies well\"]\n[flight]\nlaps = 0\nwings = 2\n[[fault]]\nwhat = \"drone tello1 to "
      "sideways\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"noon\"\n[[fault]]\nwhat = \"ledger stall\"\nfor = "
      "\"long\"\n");
  for (const char* wanted :
       {"x.toml:2: must: \"flies well\" is no rule (`ledgerline fault list rules`)\n",
        "x.toml:4: flight.laps: must be a whole number from 1", "x.toml:5: flight.wings: unknown key",
        "x.toml:7: fault.0.what:", "x.toml:10: fault.1.at: \"noon\": must be a time", "x.toml:13: fault.2.for:"})
    EXPECT_NE(error.find(wanted), std::string::npos) << wanted << "\nis not in\n" << error;
}

TEST(FaultScript, EachKeyOfAFaultIsCheckedByItself) {
  const std::string error = error_of(
      "title = \"t\"\n[[fault]]\nwhat = \"drone tello1 to sideways\"\nat = \"noon\"\nfor = \"long\"\n[[fault]]\nwhat = "
      "\"drone tello2 to stall\"\nat = \"lap 7\"\nfor = \"0s\"\n");
  for (const char* wanted :
       {"x.toml:3: fault.0.what: ", "x.toml:4: fault.0.at: ", "x.toml:5: fault.0.for: ", "x.toml:7: fault.1.what: ",
        "x.toml:8: fault.1.at: must be a lap that is flown: there is 1", "x.toml:9: fault.1.for: "})
    EXPECT_NE(error.find(wanted), std::string::npos) << wanted << "\nis not in\n" << error;
  EXPECT_NE(error_of("title = \"t\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"61s\"\n").find("a time is at most 60s"),
            std::string::npos);
  const std::string second = "[[fault]]\nwhat = \"ledger stall\"\nat = \"lap 2\"\n";
  EXPECT_EQ(error_of("title = \"t\"\n[flight]\nlaps = 2\n" + second), "");
  EXPECT_EQ(error_of("title = \"t\"\n[[task]]\ndrone = \"tello1\"\nlaps = 2\n" + second), "");
}

TEST(FaultScript, ARuleThatIsNearlyOneIsAskedFor) {
  EXPECT_EQ(parse_rule("holds withn 5 s").error().message,
            "\"holds withn 5 s\" is no rule: did you mean \"holds within 2 s\"? (`ledgerline fault list rules`)");
}

TEST(FaultScript, WhatIsNotImplementedIsRefusedNeverIgnored) {
  for (const char* what : {"peer kill",
                           "orderer kill",
                           "chaincode kill",
                           "cpu burn",
                           "memory 1GB",
                           "disk full",
                           "roudi kill",
                           "ledger agent loss 5%",
                           "ledger both from corrupt 1%",
                           "ledger agent partition",
                           "drone tello1 sideways",
                           "drone tello1 to",
                           "drone tello2 to stall",
                           "drone tello1 plans corrupt 5%",
                           "drone tello1 plans truncate 5%",
                           "drone tello1 plans delay 10ms, rate 1MB/s",
                           "ledger agent lies",
                           "ledger agent lies twice",
                           "operator errs badly",
                           "outsider errs boot",
                           "supervisor dance tello1",
                           "sensor tello1 speed stuck",
                           "sensor tello1 h wild",
                           "mocap tello1",
                           "agent pause",
                           "wind 1 2",
                           "clock jump soon",
                           "operator dance tello1",
                           "drone tello1 to loss off",
                           "drone tello1 to delay 10ms, loss off",
                           "drone tello1 to clear",
                           "mocap tello1 clear",
                           "mocap tello1 every 0s",
                           "sensor tello1 all every 0s",
                           "drone tello1 battery 200%",
                           "drone tello1 flow",
                           "drone tello1 light 50%",
                           "drone tello1 baro drift fast",
                           "pads",
                           "pads gone now"}) {
    const std::string error = error_of(std::string("title = \"t\"\n[[fault]]\nwhat = \"") + what + "\"\n");
    EXPECT_NE(error.find("x.toml:3: fault.0.what:"), std::string::npos) << what << ": " << error;
  }
  EXPECT_TRUE(error_of("title = \"t\"\n[[fault]]\nwhat = \"drone tello2 to stall\"\n").ends_with("only tello1"));
  EXPECT_NE(error_of("title = \"t\"\n[[fault]]\nwhat = \"ground end\"\n").find("kill"), std::string::npos);
  EXPECT_EQ(
      error_of("title = \"t\"\n[flight]\nkeeps_rc = false\ncommand_counts = false\n[[fault]]\nwhat = \"link end\"\n"),
      "");
  EXPECT_EQ(error_of("title = \"t\"\n[flight]\ntello = \"drawn\"\n"), "");
  EXPECT_NE(error_of("title = \"t\"\n[flight]\ntello = \"real\"\n").find("x.toml:3: flight.tello"), std::string::npos);
  EXPECT_NE(error_of("title = \"t\"\n[flight]\nwifi = \"no-such.csv\"\n").find("x.toml:3: flight.wifi"),
            std::string::npos);
  EXPECT_NE(error_of("title = \"t\"\n[flight]\npads = \"9:0:0\"\n")
                .find("x.toml:3: flight.pads: \"9:0:0\" is no mission pad"),
            std::string::npos);
  EXPECT_NE(error_of("title = \"t\"\n[[fault]]\nwhat = \"clock jump 1s\"\nfor = \"1s\"\n").find("leave `for` out"),
            std::string::npos);
  EXPECT_NE(error_of("title = \"t\"\nmust = [\"lands within 3 s\"]\n").find("there is none"), std::string::npos);
}

TEST(FaultScript, WhatCountsFromAnEndNeedsFaultsThatEnd) {
  for (const char* rule : {"resumes within 2 s", "recovers and finishes the lap"}) {
    const auto error = [&](const char* fault) {
      return error_of(std::string("title = \"t\"\nmust = [\"") + rule + "\"]\n[[fault]]\nwhat = " + fault + "\n");
    };
    EXPECT_EQ(error("\"ledger stall\"\nfor = \"2s\""), "");
    EXPECT_EQ(error("\"ledger restart\""), "");
    const std::string refused = error("\"ledger stall\"");
    for (const std::string& wanted :
         {"x.toml:2: must: \"" + std::string(rule), std::string("\"ledger stall\" never ends")})
      EXPECT_NE(refused.find(wanted), std::string::npos) << refused;
  }
}

TEST(FaultScript, APlansFaultIsCheckedByWhatItDoesNotByItsWords) {
  const std::string file = testing::TempDir() + "generated-rate.txt";
  std::ofstream(file) << "0.01\n0.02\n";
  const auto fault = parse_fault("drone tello1 plans delay recorded " + file, "path", "");
  EXPECT_TRUE(fault.ok()) << fault.error().message;
  std::filesystem::remove(file);
}

TEST(FaultScript, DemandsAHeightUnlessItSaysItsOwn) {
  const Script silent = scripted("title = \"t\"\n");
  ASSERT_EQ(silent.must.size(), 1U);
  EXPECT_EQ(silent.must[0].text, "height below 1.6 m");
  EXPECT_TRUE(silent.must[0].always);
  EXPECT_EQ(text_of(silent).find("height"), std::string::npos) << "nobody said it";
  const Script own = scripted("title = \"t\"\nmust = [\"height below 2 m\"]\n");
  ASSERT_EQ(own.must.size(), 1U);
  EXPECT_EQ(own.must[0].text, "height below 2 m");
}

TEST(FaultScript, IsReadAgainAsItWasWritten) {
  constexpr std::uint64_t drawn_scripts = slow ? 50 : 500;
  std::set<std::string> texts;
  for (std::uint64_t number = 1; number <= drawn_scripts; ++number) {
    const Script drawn = draw_script(number);
    const std::string text = text_of(drawn);
    const auto again = parse_script(text, drawn.name + ".toml");
    ASSERT_TRUE(again.ok()) << again.error().message << "\n" << text;
    EXPECT_EQ(text_of(*again), text);
    texts.insert(text);
  }
  EXPECT_EQ(texts.size(), drawn_scripts);
  for (const std::string& file : library()) {
    const auto script = load_script(file);
    ASSERT_TRUE(script.ok()) << script.error().message;
    const auto again = parse_script(text_of(*script), file);
    ASSERT_TRUE(again.ok()) << again.error().message;
    EXPECT_EQ(text_of(*again), text_of(*script));
  }
}

}  // namespace
}  // namespace ledgerline::hil
