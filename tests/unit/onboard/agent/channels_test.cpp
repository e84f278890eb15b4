#include "onboard/agent/shell/settings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "common/msg/contract.hpp"
#include "onboard/agent/shell/report.hpp"

namespace ledgerline::agent {
namespace {

using testing::ElementsAre;

std::vector<DroneNumber> numbers(const Settings& settings) {
  std::vector<DroneNumber> all;
  for (const DroneName& drone : settings.core.drones) all.push_back(drone.number);
  return all;
}

TEST(AgentChannels, EachHasItsDronesAndFilesOfItsOwn) {
  auto config = Config::parse(
      "[ledger]\ncontract = \"c\"\n[[channel]]\nname = \"yard\"\n[output]\ncheckpoint = \"kept\"\n[[drone]]\nname = "
      "\"a\"\n[[drone]]\nname = \"b\"\nchannel = \"yard\"\n[[drone]]\nname = \"c\"\nnumber = 7\n",
      "agent.toml");
  ASSERT_TRUE(config);
  const fabric::Channels channels = fabric::read_channels(*config);
  const Settings process = read_settings(*config, "Org1MSP", {"teleop", "c"});
  ASSERT_TRUE(config->finish()) << config->finish().error().message;
  const auto each = settings_of_channels(process, channels);
  ASSERT_EQ(each.size(), 2U);
  EXPECT_THAT(numbers(each[0]), ElementsAre(1, 7));
  EXPECT_THAT(numbers(each[1]), ElementsAre(2));
  EXPECT_EQ(each[0].core.check.where.channel, "teleop");
  EXPECT_EQ(each[1].core.check.where.channel, "yard");
  EXPECT_EQ(each[1].core.check.where.contract, "c");
  EXPECT_EQ(each[0].checkpoint, "kept");
  EXPECT_EQ(each[1].checkpoint, "kept-yard");
  EXPECT_NE(each[0].core.seed, each[1].core.seed);
}

TEST(AgentChannels, OneIsTheProcessItself) {
  auto config = Config::parse("[[drone]]\nname = \"a\"\n[output]\ncheckpoint = \"kept\"\n", "agent.toml");
  ASSERT_TRUE(config);
  const fabric::Channels channels = fabric::read_channels(*config);
  const Settings process = read_settings(*config, "Org1MSP", {"teleop", "ledgerline"});
  const auto each = settings_of_channels(process, channels);
  ASSERT_EQ(each.size(), 1U);
  EXPECT_THAT(numbers(each[0]), ElementsAre(1));
  EXPECT_EQ(each[0].checkpoint, "kept");
  EXPECT_EQ(each[0].core.seed, process.core.seed);
}

TEST(AgentSettings, ADroneHasANameThatRosTakes) {
  for (const char* name : {"1tello", "tello-1", "tello__1"}) {
    auto config = Config::parse("[[drone]]\nname = \"" + std::string(name) + "\"\n", "agent.toml");
    ASSERT_TRUE(config);
    (void)read_settings(*config, "Org1MSP", {"teleop", "ledgerline"});
    const auto status = config->finish();
    ASSERT_FALSE(status) << name;
    EXPECT_THAT(status.error().message, testing::HasSubstr(contract::drone_name_rule));
  }
}

TEST(AgentChannels, TheSummaryOfSeveralHasEach) {
  const auto all = nlohmann::json::parse(summary_of_all({R"({"channel":"teleop"})", R"({"channel":"yard"})"}));
  EXPECT_EQ(all["channels"][1]["channel"], "yard");
}

}  // namespace
}  // namespace ledgerline::agent
