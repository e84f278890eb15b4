#include "tools/deployment/one_desk.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/tools/deployment/page.hpp"

namespace ledgerline::deployment {
namespace {

using testing::HasSubstr;

Deployment example(int number) {
  auto config = Config::parse(example_of_the_page(number), "lab.toml");
  return read(*config, "lab.toml").value();
}

std::string error_of(const Deployment& deployment) {
  const auto desk = on_one_desk(deployment);
  return desk ? "" : desk.error().what;
}

TEST(OneDesk, ThePagesSecondExampleIsAFlightOfTwo) {
  const auto desk = on_one_desk(example(1));
  ASSERT_TRUE(desk) << desk.error().what;
  EXPECT_EQ(desk->drones, 2);
  EXPECT_EQ(desk->ledger, LedgerKind::embedded);
  EXPECT_EQ(desk->orderers, 1);
}

TEST(OneDesk, FabricsOrderersAreCounted) {
  Deployment deployment = example(1);
  deployment.ledger = LedgerKind::fabric;
  deployment.orderers.assign(3, {"desk", 0});
  const auto desk = on_one_desk(deployment);
  ASSERT_TRUE(desk) << desk.error().what;
  EXPECT_EQ(desk->orderers, 3);
}

TEST(OneDesk, NothingOfTheFileIsPassedOver) {
  EXPECT_THAT(error_of(example(0)), HasSubstr("lab.toml: 3 hosts: a flight on one desk has one"));
  Deployment other = example(1);
  other.hosts[0].address = "10.0.0.1";
  EXPECT_THAT(error_of(other), HasSubstr("host desk has address 10.0.0.1"));
  other = example(1);
  other.channel = "other";
  EXPECT_THAT(error_of(other), HasSubstr("channel other"));
  other = example(1);
  other.organisations.pop_back();
  EXPECT_THAT(error_of(other), HasSubstr("Org1MSP, Org2MSP and Org3MSP"));
  other = example(1);
  other.organisations[0].peer.port = 7051;
  EXPECT_THAT(error_of(other), HasSubstr("leave out `port`"));
  other = example(1);
  other.drones[1].name = "albatross";
  EXPECT_THAT(error_of(other), HasSubstr("drone albatross at 127.0.0.3"));
  other = example(1);
  other.drones[0].address = "192.168.10.1";
  EXPECT_THAT(error_of(other), HasSubstr("tello1 at 127.0.0.2"));
}

}  // namespace
}  // namespace ledgerline::deployment
