#include "common/fabric/channels.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace ledgerline::fabric {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

/// Reads the channels alone; the tables of [ledger] are taken as known.
struct Read {
  Channels channels;
  std::string wrong;  ///< empty: nothing
};
Read read(const std::string& text) {
  Config config = Config::parse(text, "agent.toml").value();
  Read read{read_channels(config), ""};
  for (const char* table : {"orderer", "endorser", "peer"})
    for (std::size_t i = 0; i < config.table_count(table); ++i)
      (void)config.text(std::string(table) + "." + std::to_string(i) + ".endpoint");
  for (std::size_t i = 0; i < config.table_count("drone"); ++i)
    (void)config.text("drone." + std::to_string(i) + ".name");
  if (const Status status = config.finish(); !status) read.wrong = status.error().message;
  return read;
}

const std::string two_drones = "[[drone]]\nname = \"a\"\n[[drone]]\nname = \"b\"\nchannel = \"yard\"\n";

ClientConfig ledger() {
  ClientConfig config;
  config.endpoint = "peer1:7051";
  config.tls_ca_file = "ca.pem";
  config.server_name = "peer1.org1";
  config.config_block = "block of teleop";
  config.orderers = {{"o1:1", "oca"}, {"o2:1", "oca"}};
  config.endorsers = {{"Org2MSP", "peer2:7051", "ca2.pem"}};
  return config;
}

TEST(Channels, AFileWithoutTablesHasTheOneOfLedger) {
  const Read one = read("[ledger]\nchannel = \"north\"\ncontract = \"c\"\n[[drone]]\nname = \"a\"\n");
  EXPECT_EQ(one.wrong, "");
  EXPECT_FALSE(one.channels.several());
  EXPECT_THAT(one.channels.of_drone, ElementsAre(0u));
  const auto each = each_channel(ledger(), one.channels).value();
  ASSERT_EQ(each.size(), 1u);
  EXPECT_EQ(each[0].config_block, "block of teleop");
  EXPECT_EQ(each[0].orderers.size(), 2u);
  EXPECT_EQ(each[0].endorsers.size(), 1u);
  EXPECT_EQ(file_of_channel("kept", one.channels, 0), "kept");
}

TEST(Channels, WhatATableDoesNotSayIsAsInLedger) {
  const Read two = read("[ledger]\ncontract = \"c\"\n[[channel]]\nname = \"yard\"\n" + two_drones);
  EXPECT_EQ(two.wrong, "");
  EXPECT_THAT(two.channels.of_drone, ElementsAre(0u, 1u));
  const auto each = each_channel(ledger(), two.channels).value();
  ASSERT_EQ(each.size(), 2u);
  EXPECT_EQ(each[0].where.channel, "teleop");
  EXPECT_EQ(each[1].where.channel, "yard");
  EXPECT_EQ(each[1].where.contract, "c");
  EXPECT_EQ(each[1].endpoint, "peer1:7051");
  EXPECT_EQ(each[1].server_name, "peer1.org1");
  EXPECT_EQ(each[1].orderers.size(), 2u);
  EXPECT_EQ(each[1].config_block, "") << "another channel's trust anchor would refuse each block, or worse";
  EXPECT_EQ(file_of_channel("kept", two.channels, 0), "kept");
  EXPECT_EQ(file_of_channel("kept", two.channels, 1), "kept-yard");
  EXPECT_EQ(file_of_channel("", two.channels, 1), "");
}

TEST(Channels, OneWithAnEndpointOfItsOwnUsesServersThatNameIt) {
  const std::string block = testing::TempDir() + "yard" + std::to_string(::getpid()) + ".block";
  std::ofstream(block) << "block of yard";
  const Read two = read("[[channel]]\nname = \"yard\"\nendpoint = \"peer9:7051\"\nconfig_block = \"" + block +
                        "\"\n[[orderer]]\nendpoint = \"o1:1\"\n[[orderer]]\nendpoint = \"o2:1\"\nchannels = "
                        "[\"yard\"]\n[[endorser]]\nendpoint = \"peer2:7051\"\n" +
                        two_drones);
  EXPECT_EQ(two.wrong, "");
  const auto each = each_channel(ledger(), two.channels).value();
  ASSERT_EQ(each[0].orderers.size(), 1u);
  EXPECT_EQ(each[0].orderers[0].endpoint, "o1:1");
  EXPECT_EQ(each[0].endorsers.size(), 1u);
  EXPECT_EQ(each[1].endpoint, "peer9:7051");
  EXPECT_EQ(each[1].tls_ca_file, "ca.pem");
  EXPECT_EQ(each[1].server_name, "") << "the name in the other peer's certificate";
  ASSERT_EQ(each[1].orderers.size(), 1u);
  EXPECT_EQ(each[1].orderers[0].endpoint, "o2:1");
  EXPECT_TRUE(each[1].endorsers.empty());
  EXPECT_EQ(each[1].config_block, "block of yard");
}

TEST(Channels, WhatCannotBeMeantIsReportedWithItsLocation) {
  const auto wrong = [](const std::string& text) { return read(text).wrong; };
  const std::string yard = "[[channel]]\nname = \"yard\"\n";
  EXPECT_THAT(wrong("[[drone]]\nname = \"a\"\nchannel = \"yard\"\n"), HasSubstr("agent.toml:3: drone.0.channel"));
  EXPECT_THAT(wrong(yard + yard + two_drones), HasSubstr("channel.1.name: must be another name"));
  EXPECT_THAT(wrong("[[channel]]\nname = \"teleop\"\n" + two_drones), HasSubstr("channel.0.name: must be another"));
  EXPECT_THAT(wrong("[[channel]]\nname = \"../yard\"\n" + two_drones), HasSubstr("must be a channel's name"));
  EXPECT_THAT(wrong(yard + "[[drone]]\nname = \"a\"\n"), HasSubstr("must have a [[drone]] with channel = \"yard\""));
  EXPECT_THAT(wrong(yard + "[[drone]]\nname = \"a\"\nchannel = \"yard\"\n"), HasSubstr("none is on teleop"));
  EXPECT_THAT(wrong("[ledger]\nconfig_block = \"t.block\"\n" + yard + two_drones),
              HasSubstr("channel.0.config_block: must be there, since [ledger] has one"));
  EXPECT_THAT(wrong(yard + "tls_ca = \"x\"\n" + two_drones), HasSubstr("channel.0.endpoint: must be there"));
  EXPECT_THAT(wrong(yard + "tls_key = \"x\"\n" + two_drones), HasSubstr("channel.0.tls_key"));
  EXPECT_THAT(wrong(yard + "[[orderer]]\nendpoint = \"o\"\nchannels = [\"moon\"]\n" + two_drones),
              HasSubstr("orderer.0.channels: must be of this file's channels, teleop or yard"));
}

TEST(Channels, ABlockThatCannotBeReadNamesItsChannel) {
  Channels channels = read("[[channel]]\nname = \"yard\"\nconfig_block = \"/nowhere\"\n" + two_drones).channels;
  const auto each = each_channel(ledger(), channels);
  ASSERT_FALSE(each);
  EXPECT_THAT(each.error().message, HasSubstr("config_block of channel yard"));
}

}  // namespace
}  // namespace ledgerline::fabric
