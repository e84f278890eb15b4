#include "tools/status/core/status.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ledgerline::status {
namespace {

TEST(StatusTest, ProcessesAreReadAsProcTellsThem) {
  const std::string cmdline("/usr/bin/ledgerline-agent\0--config\0agent.toml\0", 46);
  EXPECT_EQ(words_of(cmdline), (std::vector<std::string>{"/usr/bin/ledgerline-agent", "--config", "agent.toml"}));
  EXPECT_EQ(value_of("--config", words_of(cmdline)), "agent.toml");
  EXPECT_EQ(value_of("--config", {"ledgerline-link", "--config=/etc/link.toml"}), "/etc/link.toml");
  EXPECT_EQ(value_of("--config", {"ledgerline-link", "--config"}), "");
  EXPECT_EQ(value_of("--dir", {"ledgerline-node", "--dir", "/var/ledger"}), "/var/ledger");
  EXPECT_EQ(unit_of("0::/system.slice/ledgerline-agent.service\n"), "ledgerline-agent.service");
  EXPECT_EQ(unit_of("0::/user.slice/user-0.slice/session-1.scope\n"), "");
  EXPECT_TRUE(executable_of("/usr/bin/ledgerline-link (deleted)").deleted);
  EXPECT_EQ(executable_of("/usr/bin/ledgerline-link (deleted)").file, "/usr/bin/ledgerline-link");
}

TEST(StatusTest, AStartIsFoundBehindANameWithBlanksAndBrackets) {
  std::string stat = "812 (ledger) line) S";
  for (int field = 4; field <= 30; ++field) stat += field == 22 ? " 12345" : " 7";
  ASSERT_TRUE(start_of(stat, 100));
  EXPECT_DOUBLE_EQ(*start_of(stat, 100), 123.45);
  EXPECT_FALSE(start_of("812 (link", 100));
  EXPECT_FALSE(start_of("812 (link) S 1 2", 100));
  EXPECT_FALSE(start_of("", 100));
}

TEST(StatusTest, AgesAreShownInTheUnitThatFits) {
  EXPECT_EQ(words_of_age(340 * ns_per_ms), "340 ms");
  EXPECT_EQ(words_of_age(-20 * ns_per_ms), "-20 ms");
  EXPECT_EQ(words_of_age(from_seconds(12.5)), "12.5 s");
  EXPECT_EQ(words_of_age(240 * ns_per_s), "4 min");
  EXPECT_EQ(words_of_age(3 * 3'600 * ns_per_s), "3 h");
  EXPECT_EQ(words_of_age(200'000 * ns_per_s), "2 d");
}

Status one_of_all() {
  Ledger ledger{.config = "/etc/ledgerline/agent.toml", .channel = "flight", .peers = {}};
  ledger.peers.push_back({.endpoint = "peer:7051", .msp_id = "Org1MSP", .height = 17});
  ledger.newest_block_age_ns = 250 * ns_per_ms;
  ledger.drones.push_back({.name = "tello1",
                           .state_age_ns = 40 * ns_per_ms,
                           .phase = "flying",
                           .owner = "Org1MSP CN=host",
                           .holder = "Org2MSP CN=alice"});
  ledger.drones.push_back({.name = "tello2", .why = "tello2 is not enrolled\x1b[2J"});
  return {.programs = {{.name = "ledgerline-agent",
                        .pid = 12,
                        .user = "ledgerline",
                        .unit = "ledgerline-agent.service",
                        .config = "/etc/ledgerline/agent.toml",
                        .age_ns = 90 * ns_per_s,
                        .replaced = true}},
          .not_running = {},
          .ledgers = {ledger}};
}

TEST(StatusTest, TablesSayWhoRunsAndHowOldWhatIs) {
  const std::string text = words(one_of_all());
  for (const char* part : {"ledgerline-agent *", "90.0 s", "replaced", "channel flight, newest block 250 ms old", "17",
                           "40 ms", "flying", "Org2MSP CN=alice", "tello2 is not enrolled"})
    EXPECT_NE(text.find(part), std::string::npos) << part << " in\n" << text;
  EXPECT_EQ(text.find('\x1b'), std::string::npos) << "what a peer says does not move a terminal's cursor";
  EXPECT_NE(words({}).find("No program"), std::string::npos);
}

TEST(StatusTest, AServiceThatDoesNotRunHasARowAndCounts) {
  Status status = one_of_all();
  EXPECT_TRUE(all_well(status));
  status.not_running.push_back({"link", "/etc/ledgerline/link.toml"});
  EXPECT_FALSE(all_well(status));
  EXPECT_NE(words(status).find("not running (/etc/ledgerline/link.toml)"), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(to_json(status))["not_running"][0]["program"], "ledgerline-link");
}

TEST(StatusTest, AServiceRunsByItsOwnConfig) {
  const std::vector<Program> programs{{.name = "ledgerline-agent", .config = "/etc/ledgerline/agent.toml"},
                                      {.name = "ledgerline-link", .config = "./link.toml"}};
  EXPECT_TRUE(is_running(programs, "agent", "/etc/ledgerline/agent.toml"));
  EXPECT_FALSE(is_running(programs, "agent", "/home/agent.toml"));
  EXPECT_FALSE(is_running(programs, "ground", "/etc/ledgerline/agent.toml"));
  EXPECT_TRUE(is_running(programs, "link", "/etc/ledgerline/link.toml")) << "its folder is hidden";
  EXPECT_TRUE(is_service("bridge"));
  EXPECT_FALSE(is_service("control")) << "a person's commands";
}

TEST(StatusTest, AServiceThatStandsStillDoesNotRun) {
  EXPECT_TRUE(is_halted("Name:\tledgerline-agent\nUmask:\t0022\nState:\tT (stopped)\nUid:\t0\n"));
  EXPECT_TRUE(is_halted("Name:\tx\nState:\tt (tracing stop)\n"));
  EXPECT_FALSE(is_halted("Name:\tx\nState:\tS (sleeping)\n"));
  EXPECT_FALSE(is_halted("Name:\tx\nState:\t"));
  Status status = one_of_all();
  status.programs[0].halted = true;
  EXPECT_FALSE(is_running(status.programs, "agent", "/etc/ledgerline/agent.toml"));
  EXPECT_NE(words(status).find("ledgerline-agent (stands still) *"), std::string::npos);
}

TEST(StatusTest, AnEndorserThatAnswersIsReportedAndIsNoPeerThatDoesNot) {
  Status status = one_of_all();
  status.ledgers[0].peers.push_back({.endpoint = "beside:7151", .msp_id = "Org1MSP", .endorser = true});
  EXPECT_TRUE(all_well(status));
  EXPECT_NE(words(status).find("keeps no blocks"), std::string::npos);
  const auto peers = nlohmann::json::parse(to_json(status))["ledgers"][0]["peers"];
  EXPECT_TRUE(peers[1]["endorser"].get<bool>() && peers[1]["height"].is_null() && peers[1]["why"].is_null());
  EXPECT_FALSE(peers[0]["endorser"].get<bool>());
}

TEST(StatusTest, APeerThatDoesNotAnswerIsReportedAndCounts) {
  Status status = one_of_all();
  EXPECT_TRUE(all_well(status));
  status.ledgers[0].peers.push_back({.endpoint = "far:7051", .msp_id = "Org2MSP", .why = "not reached"});
  EXPECT_FALSE(all_well(status));
  EXPECT_NE(words(status).find("not reached"), std::string::npos);
  const auto json = nlohmann::json::parse(to_json(status));
  EXPECT_EQ(json["ledgers"][0]["peers"][1]["why"], "not reached");
  EXPECT_TRUE(json["ledgers"][0]["peers"][1]["height"].is_null());
  EXPECT_EQ(json["ledgers"][0]["drones"][0]["state_age_s"], 0.04);
  EXPECT_EQ(json["ledgers"][0]["drones"][0]["phase"], "flying");
  EXPECT_TRUE(json["ledgers"][0]["drones"][0]["stopped_by"].is_null());
  EXPECT_EQ(json["programs"][0]["unit"], "ledgerline-agent.service");
  EXPECT_EQ(json["programs"][0]["replaced"], true);
}

}  // namespace
}  // namespace ledgerline::status
