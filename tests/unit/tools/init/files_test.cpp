#include "tools/init/core/host.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "common/base/file.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/msg/contract.hpp"
#include "tests/unit/tools/deployment/page.hpp"
#include "tools/configuration/config_file.hpp"

namespace ledgerline::init {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* fabric_deployment = R"(
[ledger]
kind = "fabric"
channel = "air"
[[host]]
name = "raven"
address = "10.0.0.4"
roles = ["drone-host"]
organisation = "Org1MSP"
[[host]]
name = "tower"
address = "10.0.0.2"
roles = ["ledger"]
[[host]]
name = "ground"
address = "10.0.0.1"
roles = ["ground"]
organisation = "Org2MSP"
[[organisation]]
id = "Org1MSP"
host = "tower"
port = 7051
[[organisation]]
id = "Org2MSP"
host = "tower"
port = 7061
[[organisation]]
id = "Org3MSP"
host = "tower"
port = 7071
[[orderer]]
host = "tower"
port = 7081
[[drone]]
name = "first"
host = "raven"
address = "192.168.10.1"
[[drone]]
name = "second"
host = "raven"
address = "192.168.10.2"
)";

HostPlan plan(const std::string& text, const std::string& host) {
  auto config = Config::parse(text, "deployment.toml");
  auto deployment = deployment::read(*config);
  EXPECT_TRUE(deployment) << deployment.error().message;
  auto plan = plan_of(*deployment, host, Directories{});
  EXPECT_TRUE(plan) << plan.error().message;
  return *plan;
}

std::string text_of(const std::vector<File>& files, const std::string& name) {
  for (const File& file : files)
    if (file.name == name) return file.text;
  ADD_FAILURE() << "no file " << name;
  return "";
}

std::vector<File> files(Role role, const std::string& text, const std::string& host) {
  auto files = files_of(role, plan(text, host));
  EXPECT_TRUE(files) << files.error().message;
  return *files;
}

void expect_readable(const std::string& program, const std::string& text) {
  auto config = Config::parse(text, program + ".toml");
  ASSERT_TRUE(config) << config.error().message << "\n" << text;
  const Status read = configuration::check(program, *config);
  EXPECT_TRUE(read) << read.error().message;
}

std::string without_comments(const std::string& text) {
  std::string out, line;
  std::istringstream in(text);
  while (std::getline(in, line))
    if (!line.starts_with("#") && !line.empty()) out += line + "\n";
  return out;
}

TEST(InitFiles, OfEachRoleAreReadByTheProgramsThatTheyAreFor) {
  for (const std::string& text : {std::string(fabric_deployment), *example_deployment()}) {
    const auto drone_host = files(Role::drone_host, text, "raven");
    expect_readable("link", text_of(drone_host, "link.toml"));
    EXPECT_THAT(text_of(drone_host, "link.toml"), HasSubstr("\nmax_m = [3.0, 3.0, 2.5]\n")) << "link wants a fence";
    expect_readable("agent", text_of(drone_host, "agent.toml"));
    const auto ground = files(Role::ground, text, "ground");
    expect_readable("ground", text_of(ground, "ground.toml"));
    expect_readable("control", text_of(ground, "operator.toml"));
    expect_readable("bridge", text_of(files(Role::bridge, text, "ground"), "bridge.toml"));
    expect_readable("control", text_of(files(Role::admin, text, "raven"), "admin.toml"));
  }
  expect_readable("fabric", text_of(files(Role::ledger, fabric_deployment, "tower"), "net.toml"));
  expect_readable("deployment", *example_deployment());
}

TEST(InitFiles, AreReadWithEachDefaultThatTheyShowAsAComment) {
  // "# key = value", but not "# key =", and only in tables that are there.
  for (const auto& [program, file] : {std::pair{"link", "link.toml"}, std::pair{"agent", "agent.toml"}}) {
    std::istringstream in(text_of(files(Role::drone_host, fabric_deployment, "raven"), file));
    std::string text, line;
    bool there = true;
    while (std::getline(in, line)) {
      const bool heading = line.starts_with("[") || line.starts_with("# [[");
      if (heading) there = line.starts_with("[");
      const auto equals = line.find(" = ");
      const bool is_default =
          line.starts_with("# ") && equals != std::string::npos && line.find(' ', 2) == equals;  // one word before it
      text += (there && is_default ? line.substr(2) : line) + "\n";
    }
    expect_readable(program, text);
  }
}

TEST(InitFiles, SayOfTheLedgerWhatTheDeploymentSays) {
  const std::string agent =
      without_comments(text_of(files(Role::drone_host, fabric_deployment, "raven"), "agent.toml"));
  EXPECT_THAT(agent, HasSubstr("[ledger]\nendpoint = \"10.0.0.2:7051\"\ntls_ca = \"/etc/ledgerline/tls/Org1MSP.pem\"\n"
                               "channel = \"air\"\n"));
  EXPECT_THAT(agent, HasSubstr("config_block = \"/etc/ledgerline/air.block\"\nmsp_id = \"Org1MSP\"\n"));
  EXPECT_THAT(agent, HasSubstr("[[orderer]]\nendpoint = \"10.0.0.2:7081\"\n"));
  EXPECT_THAT(agent, HasSubstr("[[endorser]]\nmsp_id = \"Org3MSP\"\nendpoint = \"10.0.0.2:7071\"\n"));
  EXPECT_THAT(agent, Not(HasSubstr("server_name")));
  const std::string ground = without_comments(text_of(files(Role::ground, fabric_deployment, "ground"), "ground.toml"));
  EXPECT_THAT(ground, HasSubstr("[ledger]\nendpoint = \"10.0.0.2:7061\"\n"));
}

// The units of packaging/systemd let a program write to its own StateDirectory alone.
TEST(InitFiles, KeepStateWhereTheServicesMayWrite) {
  const auto state_of = [](const std::string& unit) {
    auto text = read_file(std::string(LEDGERLINE_SOURCE "/packaging/systemd/") + unit + ".service");
    EXPECT_TRUE(text) << text.error().message;
    auto at = text->find("StateDirectory=");
    EXPECT_NE(at, std::string::npos) << unit;
    at += std::string("StateDirectory=").size();
    return "\"/var/lib/" + text->substr(at, text->find('\n', at) - at) + "/";
  };
  const auto drone_host = files(Role::drone_host, fabric_deployment, "raven");
  EXPECT_THAT(text_of(drone_host, "link.toml"), HasSubstr("\nstarts = " + state_of("ledgerline-link")));
  EXPECT_THAT(text_of(drone_host, "agent.toml"), HasSubstr("\ncheckpoint = " + state_of("ledgerline-agent")));
  const auto ground = files(Role::ground, fabric_deployment, "ground");
  EXPECT_THAT(text_of(ground, "ground.toml"), HasSubstr("\ncheckpoint = " + state_of("ledgerline-ground")));
  const auto bridge = files(Role::bridge, fabric_deployment, "ground");
  EXPECT_THAT(text_of(bridge, "bridge.toml"), HasSubstr("\ncheckpoint = " + state_of("ledgerline-bridge")));
}

// A ledger whose host boots later is waited for; a flight that ended early is not flown again.
TEST(InitFiles, AGroundThatCouldNotBeginIsStartedAgain) {
  const auto unit = read_file(LEDGERLINE_SOURCE "/packaging/systemd/ledgerline-ground.service");
  ASSERT_TRUE(unit) << unit.error().message;
  EXPECT_THAT(*unit, HasSubstr("\nRestart=on-abnormal\nRestartForceExitStatus=3\n"));
}

TEST(InitFiles, SayWhatProgramsShowWhereTheLedgerAsksForACertificate) {
  for (const Role role : {Role::drone_host, Role::ground, Role::bridge, Role::admin}) {
    HostPlan with = plan(fabric_deployment, role == Role::drone_host ? "raven" : "ground");
    with.folders.tls_certificate = "/etc/ledgerline/tls/own.pem";
    with.folders.tls_key = "/etc/ledgerline/tls/own.key";
    const std::vector<File> all = *files_of(role, with);
    for (const File& file : all) {
      if (file.name == "link.toml") continue;  // it talks to no ledger
      EXPECT_THAT(without_comments(file.text), HasSubstr("\ntls_certificate = \"/etc/ledgerline/tls/own.pem\"\n"
                                                         "tls_key = \"/etc/ledgerline/tls/own.key\"\n"))
          << file.name;
    }
  }
}

TEST(InitFiles, GiveTheEmbeddedLedgersServiceItsClientsAuthorities) {
  HostPlan tower = plan(*example_deployment(), "tower");
  EXPECT_THAT(text_of(*files_of(Role::ledger, tower), "node.env"), HasSubstr("\nLEDGERLINE_NODE_OPTIONS=\n"));
  tower.client_authorities = {"/a/org1.pem", "/a/org2.pem"};
  EXPECT_THAT(text_of(*files_of(Role::ledger, tower), "node.env"),
              HasSubstr("\nLEDGERLINE_NODE_OPTIONS=--tls-client-ca /a/org1.pem --tls-client-ca /a/org2.pem\n"));
  const auto unit = read_file(LEDGERLINE_SOURCE "/packaging/systemd/ledgerline-node.service");
  EXPECT_THAT(*unit, HasSubstr(" $LEDGERLINE_NODE_OPTIONS\n")) << "not in braces: systemd splits it at blanks";
  tower.client_authorities = {"/a b.pem"};
  EXPECT_FALSE(files_of(Role::ledger, tower));
  HostPlan network = plan(fabric_deployment, "tower");
  network.client_authorities = {"/a/org1.pem"};
  EXPECT_THAT(files_of(Role::ledger, network).error().message, HasSubstr("of the embedded ledger"));
}

TEST(InitFiles, NumberDronesTheSameAtTheirHostsAndAtGround) {
  std::string text = fabric_deployment;
  text +=
      "[[host]]\nname = \"owl\"\naddress = \"10.0.0.5\"\nroles = [\"drone-host\"]\norganisation = \"Org1MSP\"\n"
      "[[drone]]\nname = \"third\"\nhost = \"owl\"\naddress = \"192.168.10.1\"\n";
  EXPECT_THAT(text_of(files(Role::drone_host, text, "owl"), "link.toml"), HasSubstr("name = \"third\""));
  EXPECT_THAT(text_of(files(Role::drone_host, text, "owl"), "link.toml"), HasSubstr("\nnumber = 3\n"));
  EXPECT_THAT(text_of(files(Role::ground, text, "ground"), "ground.toml"), HasSubstr("name = \"third\"\nnumber = 3\n"));
}

HostPlan on_channels(const std::string& host, const std::vector<std::string>& channels) {
  HostPlan out = plan(fabric_deployment, host);
  const Status status = add_channels(out, channels);
  EXPECT_TRUE(status) << status.error().message;
  return out;
}

TEST(InitFiles, OfSeveralChannelsSayWhichDroneIsOnWhich) {
  const HostPlan raven = on_channels("raven", {"yard=second"}), ground_host = on_channels("ground", {"yard=second"});
  const std::string agent = text_of(*files_of(Role::drone_host, raven), "agent.toml");
  expect_readable("agent", agent);
  EXPECT_THAT(without_comments(agent),
              HasSubstr("[[channel]]\nname = \"yard\"\nconfig_block = \"/etc/ledgerline/yard.block\"\n"));
  EXPECT_THAT(without_comments(agent), HasSubstr("name = \"first\"\n[[drone]]"));
  EXPECT_THAT(without_comments(agent), HasSubstr("channel = \"yard\"\n"));
  expect_readable("link", text_of(*files_of(Role::drone_host, raven), "link.toml"));
  const auto ground = *files_of(Role::ground, ground_host);
  expect_readable("ground", text_of(ground, "ground.toml"));
  EXPECT_THAT(without_comments(text_of(ground, "operator.toml")), HasSubstr("\nchannel = \"air\"\n"));
  const std::string of_yard = text_of(ground, "operator-yard.toml");
  expect_readable("control", of_yard);
  EXPECT_THAT(without_comments(of_yard), HasSubstr("\nchannel = \"yard\"\n"));
  EXPECT_THAT(of_yard, HasSubstr("config_block = \"/etc/ledgerline/yard.block\""));
  const std::string network = text_of(*files_of(Role::ledger, on_channels("tower", {"yard=second"})), "net.toml");
  expect_readable("fabric", network);
  EXPECT_THAT(network, HasSubstr("\nname = \"yard\"\n"));
}

// A channel without a drone is refused by agent.
TEST(InitFiles, OfAHostThatFliesOnAFurtherChannelAloneHaveItInLedger) {
  HostPlan raven = on_channels("raven", {"yard=second"});
  std::erase_if(raven.drones, [](const HostDrone& one) { return one.name == "first"; });
  const std::string agent = text_of(*files_of(Role::drone_host, raven), "agent.toml");
  expect_readable("agent", agent);
  EXPECT_THAT(without_comments(agent), HasSubstr("\nchannel = \"yard\"\n"));
  EXPECT_THAT(without_comments(agent), Not(HasSubstr("[[channel]]")));
  EXPECT_THAT(agent, HasSubstr("config_block = \"/etc/ledgerline/yard.block\""));
}

TEST(InitFiles, OfChannelsRefuseWhatDoesNotFit) {
  const auto refused = [](const std::string& text, const std::vector<std::string>& channels) {
    HostPlan of_ground = plan(text, "ground");
    const Status status = add_channels(of_ground, channels);
    return status ? "" : status.error().message;
  };
  EXPECT_THAT(refused(fabric_deployment, {"yard"}), HasSubstr("is NAME=DRONE"));
  EXPECT_THAT(refused(fabric_deployment, {"Yard=second"}), HasSubstr("is NAME=DRONE"));
  EXPECT_THAT(refused(fabric_deployment, {"air=second"}), HasSubstr("already"));
  EXPECT_THAT(refused(fabric_deployment, {"yard=third"}), HasSubstr("no drone \"third\""));
  EXPECT_THAT(refused(fabric_deployment, {"yard=second", "lake=second"}), HasSubstr("is on yard already"));
  EXPECT_THAT(refused(fabric_deployment, {"yard=first,second"}), HasSubstr("no drone is left on air"));
  EXPECT_THAT(refused(*example_deployment(), {"yard=tello1"}), HasSubstr("embedded ledger has one channel"));
}

TEST(InitFiles, WaitForALedgerThatCutsLate) {
  HostPlan slow = plan(fabric_deployment, "raven");
  slow.timeouts = deployment::timeout_with(fabric::both_ways_ns(2 * ns_per_s, 10));
  const std::string agent = text_of(*files_of(Role::drone_host, slow), "agent.toml");
  EXPECT_THAT(agent, HasSubstr("\nmax_age_ms = 4500\n"));
  EXPECT_THAT(agent, HasSubstr("\nledger_silent_after_ms = 5000\n"));
  EXPECT_THAT(agent, HasSubstr("\ndeadline_ms = 5000\n"));
}

TEST(InitFiles, RefuseARoleThatAHostDoesNotHave) {
  const auto of_ground = files_of(Role::drone_host, plan(fabric_deployment, "ground"));
  ASSERT_FALSE(of_ground);
  EXPECT_THAT(of_ground.error().message, HasSubstr("no [[drone]] has host = \"ground\""));
  const auto of_tower = files_of(Role::ground, plan(fabric_deployment, "tower"));
  ASSERT_FALSE(of_tower);
  EXPECT_THAT(of_tower.error().message, HasSubstr("names no organisation"));
}

TEST(InitFiles, NameTheHostsThereAreWhereOneIsNot) {
  auto config = Config::parse(fabric_deployment, "");
  const auto none = plan_of(*deployment::read(*config), "crow", Directories{});
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message, HasSubstr("no [[host]] \"crow\": raven, tower, ground"));
}

constexpr const char* profile = R"({
  "organizations": {"Org1": {"mspid": "Org1MSP", "peers": ["peer0.org1.example.com"]},
                    "Org2": {"mspid": "Org2MSP", "peers": ["peer0.org2.example.com"]}},
  "peers": {"peer0.org1.example.com": {"url": "grpcs://localhost:7051", "tlsCACerts": {"pem": "-----BEGIN\n"},
              "grpcOptions": {"ssl-target-name-override": "peer0.org1.example.com"}},
            "peer0.org2.example.com": {"url": "grpcs://localhost:9051", "tlsCACerts": {"path": "/net/tls2.pem"}}}})";

TEST(InitProfile, GivesThePeerItsNameAndItsAuthority) {
  const auto planned = plan_of_profile(profile, "Org1MSP", "", Directories{});
  ASSERT_TRUE(planned) << planned.error().message;
  EXPECT_EQ(planned->plan.own.endpoint, "localhost:7051");
  EXPECT_EQ(planned->plan.own.server_name, "peer0.org1.example.com");
  EXPECT_EQ(planned->plan.own.tls_ca, "/etc/ledgerline/tls/peer0.org1.example.com.pem");
  ASSERT_EQ(planned->files.size(), 1u);
  EXPECT_EQ(planned->files[0].content, "-----BEGIN\n");
  EXPECT_EQ(planned->plan.peers[1].tls_ca, "/net/tls2.pem");
  EXPECT_THAT(planned->plan.msp_ids, testing::ElementsAre("Org1MSP", "Org2MSP"));
}

TEST(InitProfile, TheExampleIsRead) {
  const auto planned = plan_of_profile(deployment::text_of_page("examples/connection-org1.json"), "Org1MSP", "",
                                       Directories{}, {}, "/etc/profiles");
  ASSERT_TRUE(planned) << planned.error().message;
  EXPECT_EQ(planned->plan.channel, "mychannel");
  EXPECT_EQ(planned->plan.own.tls_ca, "/etc/profiles/tls/org1.pem");
  ASSERT_EQ(planned->plan.orderers.size(), 1U);
  EXPECT_EQ(planned->plan.orderers[0].endpoint, "10.0.0.1:7050");
}

/// Two peers of Org1, of which the second alone is on yard, and one of Org2 on teleop.
constexpr const char* profile_of_two_channels = R"({
  "organizations": {"Org1": {"mspid": "Org1MSP", "peers": ["a.org1", "b.org1"]}, "Org2": {"mspid": "Org2MSP", "peers": ["a.org2"]}},
  "peers": {"a.org1": {"url": "grpcs://a:7051", "tlsCACerts": {"pem": "A"}},
            "b.org1": {"url": "grpcs://b:7051", "tlsCACerts": {"pem": "B"}, "grpcOptions": {"hostnameOverride": "localhost"}},
            "a.org2": {"url": "grpcs://c:7051", "tlsCACerts": {"pem": "C"}}},
  "channels": {"teleop": {"peers": {"a.org1": {}, "a.org2": {}}}, "yard": {"peers": {"b.org1": {}}}, "lake": {"peers": {"a.org2": {}}}}})";

HostPlan of_profile(const std::vector<HostDrone>& flown, const std::vector<std::string>& channels) {
  auto planned = plan_of_profile(profile_of_two_channels, "Org1MSP", "", Directories{}, channels);
  EXPECT_TRUE(planned) << planned.error().message;
  planned->plan.drones = flown;
  planned->plan.all_drones = {{"tello1", "", 1}, {"tello2", "", 2}};
  planned->plan.orderers.clear();
  const Status added = add_channels(planned->plan, channels);
  EXPECT_TRUE(added) << added.error().message;
  return planned->plan;
}

TEST(InitProfile, NamesForEachChannelThePeerThatServesIt) {
  const HostPlan both = of_profile({{"tello1", "10.0.0.9", 1}, {"tello2", "10.0.0.8", 2}}, {"yard=tello2"});
  const std::string agent = text_of(*files_of(Role::drone_host, both), "agent.toml");
  expect_readable("agent", agent);
  EXPECT_THAT(without_comments(agent), HasSubstr("[ledger]\nendpoint = \"a:7051\"\n"));
  EXPECT_THAT(
      without_comments(agent),
      HasSubstr("[[channel]]\nname = \"yard\"\nconfig_block = \"/etc/ledgerline/yard.block\"\nendpoint = \"b:7051\"\n"
                "tls_ca = \"/etc/ledgerline/tls/b.org1.pem\"\nserver_name = \"localhost\"\n"));
  const auto ground = *files_of(Role::ground, both);
  expect_readable("ground", text_of(ground, "ground.toml"));
  expect_readable("control", text_of(ground, "operator-yard.toml"));
  EXPECT_THAT(text_of(ground, "operator.toml"), HasSubstr("endpoint = \"a:7051\""));
  EXPECT_THAT(text_of(ground, "operator-yard.toml"), HasSubstr("endpoint = \"b:7051\""));
  EXPECT_THAT(without_comments(text_of(ground, "ground.toml")), Not(HasSubstr("[[endorser]]"))) << "the gateway";
  for (const auto& [file, own] : {std::pair{"operator.toml", "a"}, std::pair{"operator-yard.toml", "b"}}) {
    const std::string operator_file = without_comments(text_of(ground, file));  // of which receipts are made
    EXPECT_THAT(operator_file,
                HasSubstr(std::string("[[endorser]]\nmsp_id = \"Org1MSP\"\nendpoint = \"") + own + ":7051\"\n"));
    EXPECT_THAT(operator_file, HasSubstr("[[endorser]]\nmsp_id = \"Org2MSP\"\nendpoint = \"c:7051\"\n"));
    EXPECT_THAT(operator_file, Not(HasSubstr("[[orderer]]")));
  }
  const HostPlan yard_alone = of_profile({{"tello2", "10.0.0.8", 2}}, {"yard=tello2"});
  const std::string of_yard = text_of(*files_of(Role::drone_host, yard_alone), "agent.toml");
  expect_readable("agent", of_yard);
  EXPECT_THAT(without_comments(of_yard), HasSubstr("[ledger]\nendpoint = \"b:7051\"\n"));
  EXPECT_THAT(without_comments(of_yard), Not(HasSubstr("[[channel]]")));
}

TEST(InitProfile, TakesThePeerOfLedgerForAChannelOfWhichItSaysNothing) {
  const std::string agent =
      text_of(*files_of(Role::drone_host,
                        of_profile({{"tello1", "10.0.0.9", 1}, {"tello2", "10.0.0.8", 2}}, {"teleop", "pond=tello2"})),
              "agent.toml");
  EXPECT_THAT(without_comments(agent),
              HasSubstr("[[channel]]\nname = \"pond\"\nconfig_block = \"/etc/ledgerline/pond.block\"\n[["));
}

TEST(InitProfile, RefusesAChannelThatNoPeerOfTheOrganisationServes) {
  auto planned = plan_of_profile(profile_of_two_channels, "Org1MSP", "", Directories{}, {"teleop"});
  planned->plan.all_drones = {{"tello1", "", 1}, {"tello2", "", 2}};
  const Status added = add_channels(planned->plan, {"lake=tello2"});
  ASSERT_FALSE(added);
  EXPECT_THAT(added.error().message, HasSubstr("lists no peer of Org1MSP"));
}

/// Of Org1 with one peer, whose `channels` is this JSON; or why there is none.
std::string first_channel(const std::string& channels, const std::vector<std::string>& wanted = {}) {
  const auto planned = plan_of_profile(R"({
    "organizations": {"Org1": {"mspid": "Org1MSP", "peers": ["p"]}, "Org2": {"mspid": "Org2MSP", "peers": ["q"]}},
    "peers": {"p": {"url": "grpcs://p:7051", "tlsCACerts": {"pem": "P"}}, "q": {"url": "grpcs://q:7051", "tlsCACerts": {"pem": "Q"}}},
    "channels": )" + channels + "}",
                                       "Org1MSP", "", Directories{}, wanted);
  return planned ? planned->plan.channel : planned.error().message;
}

TEST(InitProfile, TakesDefaultAsAllChannels) {
  EXPECT_EQ(first_channel(R"({"_default": {"peers": {"p": {}}}})"), "teleop");
  EXPECT_EQ(first_channel(R"({"_default": {"peers": {"p": {}}}})", {"mychannel"}), "mychannel");
  EXPECT_EQ(first_channel(R"({"_default": {}, "mychannel": {}})"), "mychannel");
  std::string of_two = profile_of_two_channels;
  of_two.replace(of_two.find("\"yard\""), 6, "\"_default\"");
  const auto planned = plan_of_profile(of_two, "Org1MSP", "", Directories{}, {"teleop"});
  ASSERT_TRUE(planned) << planned.error().message;
  EXPECT_EQ(planned->plan.own_of("teleop").endpoint, "a:7051");
  EXPECT_EQ(planned->plan.own_of("pond").endpoint, "b:7051");
}

/// As each profile of fabric-samples' test-network: its own organisation alone, and no channels.
Result<ProfilePlan> of_test_network(const fabric::ChannelConfig& block, const std::vector<std::string>& channels = {}) {
  return plan_of_profile(R"({"organizations": {"Org1": {"mspid": "Org1MSP", "peers": ["p"]}},
    "peers": {"p": {"url": "grpcs://p:7051", "tlsCACerts": {"pem": "P"}}}})",
                         "Org1MSP", "", Directories{.config_block = "/net/mychannel.block"}, channels, "", &block);
}

fabric::ChannelConfig mychannel(std::vector<crypto::MspRoot> organisations) {
  fabric::ChannelConfig block;
  block.channel = "mychannel";
  block.organisations = std::move(organisations);
  return block;
}

TEST(InitProfile, ReadsChannelBatchesAndOrganisationsFromAConfigBlock) {
  fabric::ChannelConfig block = mychannel({{"Org2MSP", "B"}, {"Org1MSP", "A"}});
  block.batching = {.timeout_ns = 2 * ns_per_s, .max_messages = 10};
  auto planned = of_test_network(block);
  ASSERT_TRUE(planned) << planned.error().message;
  ASSERT_TRUE(planned->batching);
  EXPECT_EQ(planned->batching->timeout_ns, 2 * ns_per_s);
  EXPECT_EQ(planned->batching->max_messages, 10u);
  planned->plan.drones = planned->plan.all_drones = {{"tello1", "10.0.0.9", 1}};
  const std::string agent = text_of(*files_of(Role::drone_host, planned->plan), "agent.toml");
  expect_readable("agent", agent);
  EXPECT_THAT(without_comments(agent), HasSubstr("\nchannel = \"mychannel\"\n"));
  EXPECT_THAT(without_comments(agent), HasSubstr("\nconfig_block = \"/net/mychannel.block\"\n"));
  EXPECT_THAT(without_comments(agent),
              HasSubstr("[[msp]]\nid = \"Org1MSP\"\nca = \"/etc/ledgerline/authorities/Org1MSP.pem\"\n"
                        "[[msp]]\nid = \"Org2MSP\"\nca = \"/etc/ledgerline/authorities/Org2MSP.pem\"\n"));
  ASSERT_EQ(planned->files.size(), 3u);
  EXPECT_EQ(planned->files[2].path, "/etc/ledgerline/authorities/Org1MSP.pem");
  EXPECT_EQ(planned->files[2].content, "A");
  EXPECT_EQ(of_test_network(block, {"mychannel", "yard=tello2"})->plan.channel, "mychannel");
}

TEST(InitProfile, RefusesAConfigBlockOfAnotherChannelAndOneWithoutTheOrganisation) {
  const fabric::ChannelConfig block = mychannel({{"Org2MSP", "B"}, {"Org3MSP", "C"}});
  EXPECT_EQ(of_test_network(block, {"teleop"}).error().message,
            "--channel teleop: the config block is of channel mychannel");
  EXPECT_EQ(of_test_network(block).error().message,
            "Org1MSP is not on channel mychannel: its config block has Org2MSP, Org3MSP");
}

/// The authority of a profile's one peer: its path, and its content if it became a file.
std::string authority(const std::string& url, const std::string& tls_ca_certs) {
  const auto planned =
      plan_of_profile(R"({"organizations": {"Org1": {"mspid": "Org1MSP", "peers": ["p"]}}, "peers": {"p": {"url": ")" +
                          url + R"(", "tlsCACerts": )" + tls_ca_certs + "}}}",
                      "Org1MSP", "", Directories{}, {}, "/home/ann/net");
  if (!planned) return planned.error().message;
  return planned->plan.own.endpoint + " " + planned->plan.own.tls_ca + " " +
         (planned->files.empty() ? "" : planned->files[0].content);
}

TEST(InitProfile, CountsPathsFromItsFolderAndDecodesBase64) {
  EXPECT_EQ(authority("grpcs://p:7051", R"({"path": "../ca/tls.pem"})"), "p:7051 /home/ann/ca/tls.pem ");
  EXPECT_EQ(authority("grpcs://p:7051/", R"({"path": "/net/tls.pem"})"), "p:7051 /net/tls.pem ");
  const std::string pem = "p:7051 /etc/ledgerline/tls/p.pem -----BEGIN A-----\n";
  EXPECT_EQ(authority("grpcs://p:7051", R"({"pem": "LS0tLS1CRUdJTiBBLS0tLS0K"})"), pem);
  EXPECT_EQ(authority("grpcs://p:7051", R"({"pem": ["LS0tLS1CRUdJ\nTiBBLS0tLS0K\n"]})"), pem);
}

TEST(InitProfile, RefusesYamlByItsName) {
  const auto refused = [](const std::string& text) {
    return plan_of_profile(text, "Org1MSP", "", Directories{}).error().message;
  };
  for (const std::string text : {"organizations:\n  Org1:\n", "---\nname: n\n", "# of test-network\n\nx-type: a\n"})
    EXPECT_THAT(refused(text), HasSubstr("is YAML, and init reads JSON: convert it")) << text;
  for (const std::string text : {"", "{", "# x", "{\"a\": 1", "text"})
    EXPECT_THAT(refused(text), HasSubstr("no JSON object"));
}

TEST(InitProfile, HasTheChannelThatTheProfileNames) {
  EXPECT_EQ(first_channel("{}"), "teleop") << "it names none";
  EXPECT_EQ(first_channel("null"), "teleop");
  EXPECT_EQ(first_channel(R"({"mychannel": {}})"), "mychannel");
  EXPECT_EQ(first_channel(R"({"mychannel": {"peers": {"p": {}, "q": {}}}})"), "mychannel");
  EXPECT_EQ(first_channel(R"({"air": {"peers": {"q": {}}}, "mychannel": {"peers": {"p": {}}}})"), "mychannel")
      << "Org1 is on no other";
  EXPECT_EQ(first_channel(R"({"air": {}, "mychannel": {}})", {"air=tello2"}), "mychannel");
  EXPECT_THAT(first_channel(R"({"air": {"peers": {"q": {}}}})"), HasSubstr("lists no peer of Org1MSP"));
}

TEST(InitProfile, NamesTheChannelsAmongWhichItDoesNotChoose) {
  const std::string several = R"({"air": {}, "mychannel": {}, "teleop": {}})";
  EXPECT_THAT(first_channel(several), HasSubstr("channels air, mychannel, teleop: --channel NAME says"));
  EXPECT_THAT(first_channel(several, {"air=tello2"}), HasSubstr("channels mychannel, teleop:"));
  EXPECT_EQ(first_channel(several, {"air"}), "air");
  EXPECT_EQ(first_channel(several, {"air=tello2", "mychannel"}), "mychannel");
  EXPECT_EQ(first_channel("{}", {"mychannel"}), "mychannel");
  EXPECT_THAT(first_channel(several, {"air", "teleop"}),
              HasSubstr("--channel air and --channel teleop: one is the first"));
  EXPECT_THAT(first_channel(several, {"Air"}), HasSubstr("\"Air\" is no channel's name"));
  EXPECT_THAT(first_channel(R"({"../air": {}})"), HasSubstr("\"../air\" is no channel's name"));
  EXPECT_THAT(first_channel(R"({"air": {"peers": {"q": {}}}})", {"air"}),
              HasSubstr("lists no peer of Org1MSP for channel air"));
}

TEST(InitProfile, PutsTheFirstChannelIntoEachConfig) {
  const auto files = *files_of(Role::ground, of_profile({}, {"yard"}));
  EXPECT_THAT(without_comments(text_of(files, "ground.toml")), HasSubstr("\nchannel = \"yard\"\n"));
  EXPECT_THAT(text_of(files, "operator.toml"), HasSubstr("endpoint = \"b:7051\""));
}

TEST(InitProfile, ADroneHasANameThatRosTakes) {
  const auto drones = drones_of({"tello_1=192.168.10.1", "other"});
  ASSERT_TRUE(drones) << drones.error().message;
  EXPECT_EQ((*drones)[0].name, "tello_1");
  EXPECT_EQ((*drones)[0].address, "192.168.10.1");
  EXPECT_EQ((*drones)[1].number, 2);
  for (const char* name : {"1tello", "tello-1", "tello__1=192.168.10.1", "=192.168.10.1"})
    EXPECT_FALSE(drones_of({name})) << name;
  EXPECT_THAT(drones_of({"tello-1"}).error().message, HasSubstr(contract::drone_name_rule));
}

TEST(InitProfile, RefusesWhatItCannotUse) {
  const auto wrong = [](const std::string& json, const std::string& msp_id) {
    const auto planned = plan_of_profile(json, msp_id, "", Directories{});
    return planned ? "" : planned.error().message;
  };
  EXPECT_THAT(wrong(profile, "Org9MSP"), HasSubstr("no peer of an organisation Org9MSP"));
  EXPECT_THAT(wrong("[1]", "Org1MSP"), HasSubstr("no JSON object"));
  EXPECT_THAT(wrong(R"({"organizations":{"a":{"mspid":"A","peers":["p"]}}})", "A"), HasSubstr("has no peers \"p\""));
  EXPECT_THAT(wrong(R"({"organizations":{"a":{"mspid":"A","peers":["p"]}},"peers":{"p":{"url":"grpc://h:1"}}})", "A"),
              HasSubstr("must be grpcs://HOST:PORT"));
  EXPECT_THAT(wrong(R"({"organizations":{"a":{"mspid":"A","peers":["../p"]}},
                        "peers":{"../p":{"url":"grpcs://h:1","tlsCACerts":{"pem":"x"}}}})",
                    "A"),
              HasSubstr("no name of a server"));
}

TEST(InitCommented, RefusesAValueOfAKeyThatNobodyReads) {
  KeyDescription key;
  key.table = "[a]";
  key.key = "b";
  configuration::ConfigFile file;
  file.add("[a]", "c", "1");
  const auto text = file.commented("x", {key});
  ASSERT_FALSE(text);
  EXPECT_THAT(text.error().message, HasSubstr("no key c in [a]"));
}

TEST(InitCommented, WritesTextsThatTomlReadsBack) {
  for (const std::string text : {"raven", "a \"b\" \\ c", "caf\xc3\xa9", ""}) {
    auto config = Config::parse("key = " + configuration::toml(text), "");
    EXPECT_EQ(config->text("key"), text);
  }
  auto config = Config::parse("key = " + configuration::toml("a\n\t\x7f\x01z"), "");
  ASSERT_TRUE(config) << "what TOML must have escaped, is";
  config->text("key");
  EXPECT_THAT(config->finish().error().message, HasSubstr("without control characters"));
}

}  // namespace
}  // namespace ledgerline::init
