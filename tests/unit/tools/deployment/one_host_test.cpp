#include "tools/deployment/deployment.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/tools/deployment/page.hpp"

namespace ledgerline::deployment {
namespace {

using testing::HasSubstr;

Result<OneHost> of_text(const std::string& toml) {
  auto config = Config::parse(toml, "lab.toml");
  if (!config) return config.error();
  return read_one_host(*config);
}

/// What is wrong with the page's flight on one host once `text` is replaced there.
std::string error_with(const std::string& text, const std::string& other) {
  std::string toml = one_machine_example();
  toml.replace(toml.find(text), text.size(), other);
  const auto host = of_text(toml);
  return host ? "" : host.error().message;
}

const std::string last_organisation = "[[organisation]]\nid = \"Org3MSP\"\nhost = \"ground\"\n";

TEST(OneHost, ThePagesSecondExampleIsAFlightOfTwo) {
  const auto host = of_text(one_machine_example());
  ASSERT_TRUE(host) << host.error().message;
  EXPECT_EQ(host->drones, 2);
  EXPECT_EQ(host->ledger, LedgerKind::embedded);
  EXPECT_EQ(host->orderers, 1);
}

TEST(OneHost, FabricsOrderersAreCounted) {
  std::string toml = one_machine_example();
  toml.replace(toml.find("embedded"), std::string("embedded").size(), "fabric");
  for (int i = 0; i < 3; ++i) toml += "[[orderer]]\nhost = \"ground\"\n";
  const auto host = of_text(toml);
  ASSERT_TRUE(host) << host.error().message;
  EXPECT_EQ(host->orderers, 3);
}

TEST(OneHost, NothingOfTheFileIsPassedOverAndItsPlaceIsReported) {
  const auto page = of_text(fabric_example());
  ASSERT_FALSE(page);
  EXPECT_THAT(page.error().message,
              HasSubstr("lab.toml:11: host.1.name: is \"ground\": a flight on one host has one host"));
  EXPECT_THAT(page.error().message, HasSubstr("host.2.name: is \"tower\""));
  EXPECT_THAT(page.error().message, HasSubstr("host.0.address: is 10.0.0.4"));
  EXPECT_THAT(page.error().message, HasSubstr("organisation.2.port: must not be there"));
  EXPECT_THAT(page.error().message, HasSubstr("orderer.0.port: must not be there"));
  EXPECT_THAT(page.error().message, HasSubstr("drone.1.address: tello2 at 192.168.10.2"));
  EXPECT_THAT(error_with("kind = \"embedded\"", "kind = \"embedded\"\nchannel = \"other\""),
              HasSubstr("lab.toml:3: ledger.channel: is other"));
  EXPECT_THAT(error_with("kind = \"embedded\"", "contract = \"other\""), HasSubstr("ledger.contract: is other"));
  EXPECT_THAT(error_with(last_organisation, ""), HasSubstr("organisation: must be Org1MSP, Org2MSP and Org3MSP"));
  EXPECT_THAT(error_with("tello2", "albatross"), HasSubstr("drone.1.name: albatross at 127.0.0.3"));
}

}  // namespace
}  // namespace ledgerline::deployment
