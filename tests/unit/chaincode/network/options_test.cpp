#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <set>

#include "chaincode/network/options.hpp"

namespace ledgerline::network {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

Result<Options> options_of(const std::string& toml) {
  const std::string file = testing::TempDir() + "ledgerline_net_" + std::to_string(::getpid()) + ".toml";
  std::ofstream(file) << toml;
  auto options = read_options(file, {});
  std::filesystem::remove(file);
  return options;
}

const char* const three_hosts = R"(
batch_timeout_ms = 5
[[channel]]
name = "teleop"
[[channel]]
name = "yard"
[[organisation]]
host = "10.0.0.1"
port = 7051
[[organisation]]
host = "10.0.0.2"
port = 7051
[[organisation]]
host = "10.0.0.3"
port = 7051
[[orderer]]
host = "10.0.0.1"
port = 7060
[[orderer]]
host = "10.0.0.2"
port = 7060
[[orderer]]
host = "10.0.0.3"
port = 7060
)";

TEST(FabricOptions, AFileSaysWhereThePartsAre) {
  auto options = options_of(three_hosts);
  ASSERT_TRUE(options.ok()) << options.error().message;
  EXPECT_EQ(options->orderers, 3);
  EXPECT_EQ(options->batch_timeout_ns, 5 * ns_per_ms);
  EXPECT_THAT(options->channels, ElementsAre("teleop", "yard"));
  EXPECT_TRUE(check(*options).ok());
  options->only = {"org2", "orderer2"};
  ASSERT_TRUE(check(*options).ok());
  EXPECT_TRUE(options->runs_organisation(2) && options->runs_orderer(2));
  EXPECT_FALSE(options->runs_organisation(1) || options->runs_orderer(3));
  const ListenAddresses addresses{options->orderer_addresses, options->organisation_addresses, {}};
  for (const ListenAddress& bound : addresses.bound(*options))
    EXPECT_THAT(bound.host, testing::AnyOf("10.0.0.2", "127.0.0.1"));
  EXPECT_EQ(addresses.bound(*options).size(), 6U);
}

TEST(FabricOptions, AddressesOfAllHostsAreInTheChannel) {
  const auto options = options_of(three_hosts);
  ASSERT_TRUE(options.ok()) << options.error().message;
  const std::string yaml = configtx_yaml(*options, {options->orderer_addresses, options->organisation_addresses, {}});
  for (const char* part : {"- 10.0.0.3:7060", "{Host: 10.0.0.2, Port: 7060,", "{Host: 10.0.0.3, Port: 7051}"}) {
    EXPECT_THAT(yaml, HasSubstr(part));
  }
  EXPECT_THAT(yaml, testing::Not(HasSubstr("127.0.0.1")));
}

TEST(FabricOptions, WhatDoesNotFitTogetherIsRefusedByName) {
  const auto why = [](const std::function<void(Options&)>& change) {
    Options options = *options_of(three_hosts);
    change(options);
    const Status status = check(options);
    return status ? std::string("good") : status.error().message;
  };
  EXPECT_EQ(why([](Options&) {}), "good");
  EXPECT_THAT(why([](Options& o) { o.only = {"org4"}; }), HasSubstr("\"org4\""));
  EXPECT_THAT(why([](Options& o) { o.background = {"orderer1"}; }), HasSubstr("\"orderer1\""));
  EXPECT_THAT(why([](Options& o) { o.orderer_addresses.pop_back(); }), HasSubstr("2 of orderers"));
  EXPECT_THAT(why([](Options& o) { o.orderer_addresses[0].port = 7053; }), HasSubstr("overlap"));
  EXPECT_THAT(why([](Options& o) { o.orderer_addresses[0].host = "example"; }), HasSubstr("\"example\""));
  EXPECT_THAT(why([](Options& o) { o.channels = {"teleop", "teleop"}; }), HasSubstr("twice"));
  EXPECT_THAT(why([](Options& o) { o.channels = {"Tele op"}; }), HasSubstr("\"Tele op\""));
  EXPECT_THAT(why([](Options& o) { o.channels = {}; }), HasSubstr("channel"));
  EXPECT_THAT(why([](Options& o) { o.ca = true; }), HasSubstr("one host"));
  EXPECT_THAT(why([](Options& o) {
                o.orderer_addresses.clear();
                o.organisation_addresses.clear();
                o.only = {"org1"};
              }),
              HasSubstr("addresses"));
}

TEST(FabricOptions, HistoryIsOnUnlessAFileTurnsItOff) {
  EXPECT_TRUE(options_of("batch_count = 3\n")->history);
  EXPECT_FALSE(options_of("history = false\n")->history);
}

TEST(FabricOptions, ThePartsThatNobodyWaitsForAreInTheBackgroundAndTheOthersMayHaveShortSlices) {
  Options options;
  EXPECT_EQ(options.organisation_scheduling(3), Scheduling::inherited);
  options.background = {"org3"};
  EXPECT_EQ(options.organisation_scheduling(3), Scheduling::background);
  EXPECT_EQ(options.organisation_scheduling(1), Scheduling::inherited);
  EXPECT_EQ(options.orderer_scheduling(), Scheduling::inherited);
  options.short_slices = true;
  EXPECT_EQ(options.organisation_scheduling(3), Scheduling::background);
  EXPECT_EQ(options.organisation_scheduling(1), Scheduling::short_slices);
  EXPECT_EQ(options.orderer_scheduling(), Scheduling::short_slices);
}

TEST(FabricOptions, KeysThatNobodyKnowsAreRefused) {
  const auto options = options_of("batch_cuont = 3\n");
  ASSERT_FALSE(options.ok());
  EXPECT_THAT(options.error().message, HasSubstr("batch_cuont"));
}

TEST(FabricOptions, APlaceIsHostAndPort) {
  EXPECT_EQ(*parse_listen_address("10.0.0.1:7051"), (ListenAddress{"10.0.0.1", 7051}));
  for (const char* wrong : {"", "10.0.0.1", ":7051", "10.0.0.1:", "10.0.0.1:0", "10.0.0.1:70000", "10.0.0.1:7051x"}) {
    EXPECT_FALSE(parse_listen_address(wrong).ok()) << wrong;
  }
}

TEST(FabricOptions, OnOneHostThePartsLieSideBySide) {
  Options options;
  options.orderers = 3;
  const ListenAddresses addresses = listen_addresses_from(options, 20'000);
  std::set<std::uint16_t> ports;
  for (const ListenAddress& address : addresses.bound(options)) ports.insert(address.port);
  EXPECT_EQ(ports.size(), 18U);
  EXPECT_EQ(*ports.begin(), 20'000);
  EXPECT_EQ(*ports.rbegin(), 20'017);
  EXPECT_TRUE(addresses.authorities.empty());
}

TEST(FabricOptions, AuthoritiesLieBehindTheParts) {
  Options options = *options_of("ca = true\n");
  ASSERT_TRUE(check(options).ok());
  const ListenAddresses addresses = listen_addresses_from(options, 20'000);
  EXPECT_EQ(addresses.authority(0), "127.0.0.1:20012");
  EXPECT_EQ(addresses.authority(3), "127.0.0.1:20015");
  for (const ListenAddress& address : addresses.bound(options)) EXPECT_LT(address.port, 20'012);
}

}  // namespace
}  // namespace ledgerline::network
