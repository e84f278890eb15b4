#include "tools/deployment/own_drones.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "onboard/link/shell/link_config.hpp"
#include "tests/unit/tools/deployment/page.hpp"

namespace ledgerline::deployment {
namespace {

using testing::HasSubstr;

const std::string a_drone = "[[drone]]\nname = \"a\"\naddress = \"192.168.10.1\"\n";  // lines 1 to 3
const std::string from_mocap = "[pose]\nsource = \"mocap\"\n";                        // 4, 5
const std::string a_fence = "[fence]\nmin_m = [-2, -2, 0]\nmax_m = [2, 2, 2]\n";      // 6 to 8

Result<OwnDrones> own_of(const std::string& toml) {
  auto config = Config::parse(toml, "real.toml");
  if (!config) return config.error();
  EXPECT_TRUE(is_of_own_drones(*config));
  return read_own_drones(*config, "real.toml");
}

std::string own_error(const std::string& toml) {
  const auto own = own_of(toml);
  return own ? "" : own.error().message;
}

TEST(OwnDrones, ThePagesExampleIsRead) {
  const auto own = own_of(real_drones_example());
  ASSERT_TRUE(own) << own.error().message;
  ASSERT_EQ(own->drones.size(), 1U);
  EXPECT_EQ(own->drones[0].address, "192.168.10.1");
  EXPECT_EQ(own->drones[0].interface, "");
  EXPECT_EQ(own->pose_source, "mocap");
  EXPECT_THAT(own->mocap_table, HasSubstr("[mocap]\ntopic = \"/vrpn_mocap/{drone}/pose\"\nclock = \"host\"\n"));
  EXPECT_FLOAT_EQ(own->link.playout.max_speed_mps, 0.5F);
  EXPECT_EQ(own->flight.side_m, 1.0);
  EXPECT_EQ(own->flight.laps, 1);
}

TEST(OwnDrones, TheTablesForLinkMeanThereWhatTheyMeanHere) {
  const auto own = own_of(a_drone + from_mocap + a_fence + "[rc]\nfull_scale_mps = 0.8\nsigns = [-1, 1, 1, 1]\n");
  ASSERT_TRUE(own) << own.error().message;
  auto config = Config::parse(own->link_tables + a_drone, "link.toml");
  ASSERT_TRUE(config) << config.error().message;
  const auto link = link::read_settings(*config, "link.toml");
  ASSERT_TRUE(link) << link.error().message;
  EXPECT_EQ(link->link.fence.min_m, own->link.fence.min_m);
  EXPECT_EQ(link->link.fence.max_m, (std::array<double, 3>{2, 2, 2}));
  EXPECT_FLOAT_EQ(link->link.rc.full_scale_mps, 0.8F);
  EXPECT_FLOAT_EQ(link->link.rc.signs[0], -1.0F);
}

class Calibration : public testing::Test {
 protected:
  Calibration() {
    std::ofstream(path_) << "[rc]\nfull_scale_mps = 0.8\nsigns = [-1, 1, 1, 1]\n[pose]\nvelocity_signs = [1, -1, -1]\n"
                            "velocity_frame = \"body\"\n[flight]\nfull_scale_mps = 0.8\nlag_s = 0.31\n";
  }
  ~Calibration() override { std::filesystem::remove(path_); }
  const std::string path_ = testing::TempDir() + "ledgerline_calibration_" + std::to_string(::getpid()) + ".toml";
  const std::string key_ = "calibration = \"" + path_ + "\"\n";
};

TEST_F(Calibration, CountsAsIfItStoodInTheDeployment) {
  const auto own = own_of(key_ + a_drone + "[pose]\nsource = \"tello\"\n" + a_fence);
  ASSERT_TRUE(own) << own.error().message;
  auto config = Config::parse(own->link_tables + a_drone, "link.toml");
  ASSERT_TRUE(config) << config.error().message;
  const auto link = link::read_settings(*config, "link.toml");
  ASSERT_TRUE(link) << link.error().message;
  EXPECT_FLOAT_EQ(link->link.rc.full_scale_mps, 0.8F);
  EXPECT_FLOAT_EQ(link->link.rc.signs[0], -1.0F);
  EXPECT_EQ(own->flight.lag_s, 0.31);
}

TEST(OwnDrones, WhatLinkWouldRefuseAtItsStartIsRefusedHere) {
  EXPECT_THAT(own_error(a_drone + "[pose]\nsource = \"tello\"\n" + a_fence),
              HasSubstr("real.toml: pose.velocity_signs: must"));
  EXPECT_THAT(own_error(a_drone + a_fence + "[pose]\nsource = \"tello\"\nvelocity_signs = [1, 1, 1]\nflow_mps = 5\n"),
              HasSubstr("real.toml:10: pose.flow_mps: must be a number from 0.001 to 1"));
  EXPECT_THAT(own_error(a_drone + "interface = \"much_too_long_for_one\"\n" + from_mocap + a_fence),
              HasSubstr("real.toml: for link: drone a: 'much_too_long_for_one' is no interface's name"));
}

TEST_F(Calibration, IsLookedForBesideTheFileThatNamesIt) {
  const std::filesystem::path deployment = std::filesystem::path(path_).replace_filename("real.toml");
  const std::string key = "calibration = \"" + std::filesystem::path(path_).filename().string() + "\"\n";
  auto config = Config::parse(key + a_drone + "[pose]\nsource = \"tello\"\n" + a_fence, deployment.string());
  ASSERT_TRUE(config);
  const auto own = read_own_drones(*config, deployment.string());
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(own->flight.lag_s, 0.31);
}

TEST_F(Calibration, MakesTheExampleOfOnboardOdometryWhole) {
  const std::string example = text_of_page("examples/deployment-odometry.toml"), named = "\"calibration.toml\"";
  ASSERT_THAT(example, HasSubstr(named));
  const auto own = own_of(std::string(example).replace(example.find(named), named.size(), "\"" + path_ + "\""));
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(own->pose_source, "tello");
  EXPECT_EQ(own->flight.shape, "square");
}

TEST(OwnDrones, TheExampleWithoutAnyPoseIsFlownByHand) {
  const auto own = own_of(text_of_page("examples/deployment-by-hand.toml"));
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(own->pose_source, "none");
  EXPECT_EQ(own->flight.shape, "manual");
}

TEST_F(Calibration, SaysWhatStandsTwiceAndWhatCannotBeRead) {
  EXPECT_THAT(own_error(key_ + a_drone + "[pose]\nsource = \"tello\"\nvelocity_signs = [1, 1, 1]\n" + a_fence),
              HasSubstr("pose.velocity_signs: stands in " + path_ + ", too"));
  EXPECT_THAT(own_error("calibration = \"/nowhere\"\n" + a_drone + from_mocap + a_fence), HasSubstr("calibration: "));
  std::ofstream(path_, std::ios::app) << "[limits]\nspeed_mps = 8\n";
  EXPECT_THAT(own_error(key_ + a_drone + "[pose]\nsource = \"tello\"\n" + a_fence), HasSubstr("limits"));
}

TEST(OwnDrones, WhatIsDangerousHasNoDefault) {
  EXPECT_THAT(own_error(a_drone + from_mocap), HasSubstr("fence.min_m: must be there"));
  EXPECT_THAT(own_error(a_drone + from_mocap), HasSubstr("fence.max_m: must be there"));
  EXPECT_THAT(own_error(a_drone + from_mocap + "[fence]\nmin_m = [0, 0, 0]\n"),
              HasSubstr("fence.max_m: must be there"));
  EXPECT_THAT(own_error(a_drone + a_fence), HasSubstr("pose.source: is missing"));
  EXPECT_THAT(own_error(a_drone + a_fence + "[pose]\nsource = \"telo\"\nvelocity_signs = [1, 1, 1]\n"),
              HasSubstr("pose.source: must be one of mocap, tello, pads, mocap+tello, none"));
  EXPECT_THAT(own_error(from_mocap + a_fence), HasSubstr("drone: must be 1 to 16 tables"));
}

TEST(OwnDrones, WhatIsWrongIsReportedWithFileLineAndKey) {
  const std::string good = a_drone + from_mocap + a_fence;
  EXPECT_EQ(own_error(good), "");
  EXPECT_EQ(own_error(good + "hieght_m = 2\n"), "real.toml:9: fence.hieght_m: unknown key");
  EXPECT_THAT(own_error(good + "[rc]\nfull_scale_mps = 900\n"), HasSubstr("real.toml:10: rc.full_scale_mps: must be"));
  EXPECT_THAT(own_error(good + "[limits]\nsped_mps = 1\n"),
              HasSubstr("real.toml:10: limits.sped_mps: unknown key: did you mean speed_mps?"));
  EXPECT_THAT(own_error(good + "[ledger]\nkind = \"none\"\n"), HasSubstr("real.toml:10: ledger.kind: is \"none\""));
  EXPECT_THAT(own_error(good + "[flight]\nspeed_mps = 1.5\n[limits]\nspeed_mps = 1\n"),
              HasSubstr("flight.speed_mps: must not be above limits.speed_mps"));
  EXPECT_THAT(own_error(good + "[[drone]]\nname = 'b\"c'\naddress = \"10.0.0.1\"\n"),
              HasSubstr("real.toml:10: drone.1.name: must have no quote"));
  EXPECT_THAT(own_error(good + a_drone), HasSubstr("drone.1.name: must be a name that no other has"));
  EXPECT_THAT(own_error(good + a_drone), HasSubstr("drone.1.address: must be an address"));
  EXPECT_THAT(own_error(a_drone + from_mocap + "[fence]\nmin_m = [3, -2, 0]\nmax_m = [2, 2, 2]\n"),
              HasSubstr("real.toml:7: fence.min_m: must be below fence.max_m (x)"));
}

TEST(OwnDrones, ANetworkThatRunsIsTakenFromItsFiles) {
  const std::string path = testing::TempDir() + "own_ledger_" + std::to_string(::getpid()) + ".toml";
  const std::string text = a_drone + from_mocap + a_fence + "[ledger]\nkind = \"existing\"\nagent = \"" + path + "\"\n";
  const std::string both = text + "ground = \"" + path + "\"\n";
  std::ofstream(path) << "[ledger]\nmsp_id = \"Org1MSP\"\ncertificate = \"here.pem\"\nprivate_key = "
                         "\"here.key\"\n[[orderer]]\nendpoint = \"a:1\"\n"
                         "[[msp]]\nid = \"Org1MSP\"\nca = \"ca.pem\"\n";
  const auto own = own_of(both);
  ASSERT_TRUE(own) << own.error().message;
  ASSERT_TRUE(own->network);
  EXPECT_EQ(own->network->agent_files.certificate, "here.pem");
  EXPECT_THAT(own->network->ground, HasSubstr("[[msp]]"));
  EXPECT_THAT(own->network->pilot, HasSubstr("[[orderer]]"));
  EXPECT_THAT(own->network->pilot, testing::Not(HasSubstr("[[msp]]")));
  EXPECT_EQ(own->network->admin, "");
  EXPECT_THAT(own_error(text), HasSubstr("ledger.ground: must be there with ledger.kind = \"existing\""));
  std::ofstream(path, std::ios::app) << "[output]\ntrace = \"x\"\n[[drone]]\nname = \"a\"\n[dds]\nlocal_only = true\n";
  EXPECT_TRUE(own_of(both)) << "a host's whole file will do";
  EXPECT_THAT(own_of(both)->network->agent, testing::Not(HasSubstr("trace")));
  std::ofstream(path, std::ios::app) << "[outptu]\ntrace = \"x\"\nsummary = \"y\"\n";
  for (const char* key : {":17: outptu.trace", ":18: outptu.summary"})
    EXPECT_THAT(own_error(both), HasSubstr("real.toml:11: ledger.agent: " + path + key + ": unknown key\n"));
  std::filesystem::remove(path);
  EXPECT_THAT(own_error(both), HasSubstr(path));
  EXPECT_THAT(own_error(a_drone + from_mocap + a_fence + "[ledger]\nagent = \"x\"\n"),
              HasSubstr("real.toml:10: ledger.agent: goes with ledger.kind = \"existing\""));
}

TEST(OwnDrones, TheExampleOfANetworkThatRunsIsRead) {
  const std::string directory = testing::TempDir() + "own_fabric_" + std::to_string(::getpid()) + "/";
  std::filesystem::create_directories(directory);
  std::string text = text_of_page("examples/own-fabric.toml");
  for (const char* name : {"agent.toml", "ground.toml"}) {
    const std::string usual = std::string("/etc/ledgerline/") + name;
    ASSERT_NE(text.find(usual), std::string::npos);
    text.replace(text.find(usual), usual.size(), directory + name);
    std::ofstream(directory + name) << "[ledger]\nmsp_id = \"Org1MSP\"\ncertificate = \"a\"\nprivate_key = \"b\"\n"
                                       "[[msp]]\nid = \"Org1MSP\"\nca = \"ca.pem\"\n";
  }
  const auto own = own_of(text);
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_TRUE(own->network);
  std::filesystem::remove_all(directory);
}

TEST(OwnDrones, DronesBehindInterfacesOfTheirOwnMayShareAnAddress) {
  const std::string two = a_drone +
                          "interface = \"wlan1\"\nserial = \"0TQDF6GEDB2Z8A\"\n[[drone]]\nname = \"b\"\naddress = "
                          "\"192.168.10.1\"\ninterface = \"wlan2\"\n";
  const auto own = own_of(two + from_mocap + a_fence);
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(own->drones[0].serial, "0TQDF6GEDB2Z8A");
  EXPECT_EQ(own->drones[1].interface, "wlan2");
}

TEST(OwnDrones, AnotherSourceOfPosesGoesToLinkAsItStands) {
  const auto own =
      own_of(a_drone + a_fence + "[pose]\nsource = \"tello\"\nvelocity_signs = [1, -1, -1]\nflow_mps = 0.1\n");
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_THAT(own->link_tables, HasSubstr("[pose]\n"));
  EXPECT_THAT(own->link_tables, HasSubstr("flow_mps = 0.1"));
  EXPECT_THAT(own->mocap_table, HasSubstr("topic = \"\"\n"));
  EXPECT_THAT(own_error(a_drone + a_fence + "[pose]\nsource = \"tello\"\ntopic = \"/p\"\n"),
              HasSubstr("real.toml:9: pose.topic: goes with pose.source = \"mocap\" or \"mocap+tello\""));
}

}  // namespace
}  // namespace ledgerline::deployment
