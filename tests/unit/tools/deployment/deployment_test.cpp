#include "tools/deployment/deployment.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/tools/deployment/page.hpp"

namespace ledgerline::deployment {
namespace {

using testing::HasSubstr;

Result<Deployment> read_text(const std::string& toml) {
  auto config = Config::parse(toml, "lab.toml");
  if (!config) return config.error();
  return read(*config);
}

std::string error_of(const std::string& toml) {
  const auto deployment = read_text(toml);
  return deployment ? "" : deployment.error().message;
}

const std::string host =
    "[[host]]\nname = \"ground\"\naddress = \"127.0.0.1\"\nroles = [\"drone-host\", \"ground\", \"ledger\"]\n";
const std::string organisation = "[[organisation]]\nid = \"Org1MSP\"\nhost = \"ground\"\n";
const std::string drone = "[[drone]]\nname = \"tello1\"\nhost = \"ground\"\naddress = \"127.0.0.2\"\n";

TEST(Deployment, ThePagesExampleIsRead) {
  const auto deployment = read_text(fabric_example());
  ASSERT_TRUE(deployment) << deployment.error().message;
  EXPECT_EQ(deployment->ledger, LedgerKind::fabric);
  EXPECT_EQ(deployment->channel, "teleop");
  ASSERT_EQ(deployment->hosts.size(), 3U);
  EXPECT_EQ(deployment->hosts[0].address, "10.0.0.4");
  EXPECT_TRUE(deployment->hosts[1].has(Role::ground));
  EXPECT_FALSE(deployment->hosts[1].has(Role::drone_host));
  ASSERT_EQ(deployment->organisations.size(), 3U);
  EXPECT_EQ(deployment->organisations[2].peer.host, "tower");
  EXPECT_EQ(deployment->organisations[2].peer.port, 7061);
  EXPECT_EQ(deployment->orderers.size(), 1U);
  ASSERT_EQ(deployment->drones.size(), 2U);
  EXPECT_EQ(deployment->drones[1].name, "tello2");
  EXPECT_EQ(deployment->host("raven"), &deployment->hosts[0]);
  EXPECT_EQ(deployment->host("dove"), nullptr);
}

TEST(Deployment, TheSmallestIsOneHostOneOrganisationOneDrone) {
  EXPECT_EQ(error_of(host + organisation + drone), "");
  EXPECT_EQ(error_of("ledger.kind = \"none\"\n" + host + drone), "");
}

TEST(Deployment, WhatIsWrongIsReportedWithFileLineAndKey) {
  const std::pair<std::string, const char*> cases[] = {
      {"[ledger]\nkind = \"paper\"\n" + host + organisation + drone,
       "lab.toml:2: ledger.kind: is \"paper\", must be one of"},
      {host + "speed = 3\n" + organisation + drone, "lab.toml:5: host.0.speed: unknown key"},
      {host + organisation + "[[drone]]\nname = \"tello1\"\nhost = \"dove\"\naddress = \"127.0.0.2\"\n",
       "lab.toml:10: drone.0.host: is \"dove\", must be the name of a [[host]]"},
      {"[[host]]\nname = \"ground\"\naddress = \"127.0.0.1\"\nroles = [\"ground\", \"ledger\"]\n" + organisation +
           drone,
       "drone.0.host: is \"ground\", whose roles have no \"drone-host\""},
      {"[[host]]\nname = \"ground\"\naddress = \"ground.lab\"\nroles = [\"ground\"]\n" + drone,
       "lab.toml:3: host.0.address: is \"ground.lab\", must be an IPv4 address"},
      {"[[host]]\nname = \"ground\"\naddress = \"127.0.0.1\"\nroles = [\"cook\"]\n" + drone,
       "lab.toml:4: host.0.roles: has \"cook\", must be of drone-host, ground, ledger"},
      {"[[host]]\nname = \"ground\"\naddress = \"127.0.0.1\"\n" + drone, "host.0.roles: must name at least one"},
      {host + host + organisation + drone, "lab.toml:6: host.1.name: must be a name that no other has"},
      {host + "organisation = \"Org7MSP\"\n" + organisation + drone,
       "lab.toml:5: host.0.organisation: is \"Org7MSP\", must be the id of an [[organisation]]"},
      {host + drone, "organisation: must be there"},
      {"ledger.kind = \"none\"\n" + host + organisation + drone, "organisation: must not be there"},
      {"ledger.kind = \"fabric\"\n" + host + organisation + drone, "orderer: must be 1 or 3 tables, and there are 0"},
      {host + organisation + "[[orderer]]\nhost = \"ground\"\n" + drone,
       "orderer: goes with ledger.kind = \"fabric\" alone"},
      {host + organisation + "[[organisation]]\nid = \"Org2MSP\"\nhost = \"ground\"\nport = 9\n" + drone,
       "organisation.1.host: must be the first one's"},
      {host + organisation, "drone: must be 1 to 16 tables"},
      {host + organisation + drone + "[[drone]]\nname = \"tello2\"\nhost = \"ground\"\naddress = \"127.0.0.2\"\n",
       "drone.1.address: must be an address that no other drone of its host has"},
      {host + organisation + "[[drone]]\nname = \"tello-1\"\nhost = \"ground\"\naddress = \"127.0.0.2\"\n",
       "drone.0.name: must be a letter, then letters, digits and single underscores"},
      {"[[host]]\nname = \"ground\"\naddress = \"127.0.0.1\"\nroles = [\"drone-host\", \"ledger\"]\n" + organisation +
           drone,
       "host: must have one with the role \"ground\""},
  };
  for (const auto& [toml, wanted] : cases) EXPECT_THAT(error_of(toml), HasSubstr(wanted)) << toml;
}

}  // namespace
}  // namespace ledgerline::deployment
