#include "common/dds/dds.hpp"

#include <gmock/gmock.h>

#include "common/dds/reach.hpp"

namespace ledgerline::dds {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr const char* all_files =
    "[dds]\nidentity_ca = \"ca.pem\"\ncertificate = \"me.pem\"\nprivate_key = \"me.key\"\ngovernance = \"g.p7s\"\n"
    "permissions = \"p.p7s\"\n";

std::string problem_of(const std::string& toml) {
  auto config = Config::parse(toml, "ground.toml");
  EXPECT_TRUE(config.ok());
  (void)participant_options(*config, "ledgerline_ground");
  const Status status = config->finish();
  return status ? "" : status.error().message;
}

TEST(DdsConfig, WithoutItAProgramIsOnLoopbackAndInsecure) {
  auto config = Config::parse("", "ground.toml");
  const ParticipantOptions options = participant_options(*config, "ledgerline_ground");
  ASSERT_TRUE(config->finish());
  EXPECT_FALSE(options.local_only) << "nothing is said";
  EXPECT_FALSE(options.domain);
  EXPECT_FALSE(options.security);
  EXPECT_EQ(options.node, "ledgerline_ground");
}

TEST(DdsConfig, WhatTheConfigSaysComesOut) {
  auto config = Config::parse(std::string(all_files) + "domain = 7\nlocal_only = false\n", "ground.toml");
  const ParticipantOptions options = participant_options(*config, "ledgerline_ground");
  ASSERT_TRUE(config->finish()) << config->finish().error().message;
  EXPECT_EQ(options.local_only, false);
  EXPECT_EQ(options.domain, 7U);
  ASSERT_TRUE(options.security);
  EXPECT_EQ(options.security->identity_ca, "ca.pem");
  EXPECT_EQ(options.security->certificate, "me.pem");
  EXPECT_EQ(options.security->private_key, "me.key");
  EXPECT_EQ(options.security->governance, "g.p7s");
  EXPECT_EQ(options.security->permissions, "p.p7s");
}

/// A program that took half of them would be insecure without saying so.
TEST(DdsConfig, FilesOfSecurityAreAllThereOrNone) {
  const std::string text = all_files;
  for (const char* key : {"identity_ca", "certificate", "private_key", "governance", "permissions"}) {
    const auto begin = text.find(key), end = text.find('\n', begin) + 1;
    const std::string without = problem_of(text.substr(0, begin) + text.substr(end));
    EXPECT_THAT(without, HasSubstr("ground.toml:2: dds.")) << key;
    EXPECT_THAT(without, HasSubstr(std::string("needs dds.") + key + ", too"));
    EXPECT_THAT(problem_of("[dds]\n" + text.substr(begin, end - begin)),
                HasSubstr(std::string("ground.toml:2: dds.") + key + ": needs dds."));
  }
}

const std::vector<Interface> host{
    {.name = "lo", .up = true, .loopback = true, .multicast = false, .has_address = true},
    {.name = "wlan0", .up = true, .loopback = false, .multicast = true, .has_address = true},
    {.name = "tun0", .up = true, .loopback = false, .multicast = false, .has_address = true},
    {.name = "eth1", .up = false, .loopback = false, .multicast = true, .has_address = true},
    {.name = "eth2", .up = true, .loopback = false, .multicast = true, .has_address = false}};

Reach reach_with(const std::string& dds, const std::string& uri = {}) {
  auto config = Config::parse("[dds]\n" + dds, "ground.toml");
  const ParticipantOptions options = participant_options(*config, "ledgerline_ground");
  EXPECT_TRUE(config->finish()) << dds;
  auto reach = reach_of(options, uri, host);
  EXPECT_TRUE(reach) << reach.error().message;
  return reach ? *reach : Reach{};
}

std::string error_with(const std::string& dds) {
  auto config = Config::parse("[dds]\n" + dds, "ground.toml");
  const auto reach = reach_of(participant_options(*config, "ledgerline_ground"), "", host);
  return reach ? "" : reach.error().message;
}

constexpr const char* discovery_here =
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>119</MaxAutoParticipantIndex>"
    "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";
constexpr const char* loopback_alone =
    "<CycloneDDS><Domain id=\"any\"><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"true\"/>"
    "</Interfaces></General>";

TEST(DdsConfig, BeatsTheEnvironmentAndSaysSo) {
  const std::string lan = "file:///lan.xml";
  const std::string here = std::string(loopback_alone) + discovery_here;
  for (const auto& [dds, uri] :
       {std::pair{"", ""}, {"local_only = true", ""}, {"local_only = true", "file:///lan.xml"}}) {
    EXPECT_EQ(reach_with(dds, uri).cyclone_config, here) << dds;
    EXPECT_TRUE(reach_with(dds, uri).this_host_only) << dds;
  }
  for (const char* dds : {"", "local_only = false"}) {
    EXPECT_EQ(reach_with(dds, lan).cyclone_config, std::nullopt) << "as the environment says";
    EXPECT_FALSE(reach_with(dds, lan).this_host_only);
  }
  for (const char* dds :
       {"", "local_only = true", "local_only = false", "interfaces = [\"lo\"]", "cyclonedds = \"x\""}) {
    EXPECT_THAT(reach_with(dds).warnings, IsEmpty()) << dds;
    EXPECT_THAT(reach_with(dds, lan).warnings, ElementsAre(HasSubstr("CYCLONEDDS_URI"))) << dds;
  }
  EXPECT_THAT(reach_with("local_only = true", lan).warnings, ElementsAre(HasSubstr("stays on this machine")));
  EXPECT_THAT(reach_with("", lan).warnings, ElementsAre(HasSubstr("CYCLONEDDS_URI decides")));
  EXPECT_EQ(reach_with("cyclonedds = \"/etc/cyclone.xml\"", lan).cyclone_config, "file:///etc/cyclone.xml");
  EXPECT_THAT(reach_with("cyclonedds = \"/etc/cyclone.xml\"", lan).warnings,
              ElementsAre(HasSubstr("/etc/cyclone.xml, which decides")));
}

TEST(DdsConfig, NamedInterfacesAndPeersBecomeCyclonesConfiguration) {
  const std::string begin = "<CycloneDDS><Domain id=\"any\">",
                    discovery =
                        "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>119"
                        "</MaxAutoParticipantIndex>",
                    end = "</Discovery></Domain></CycloneDDS>";
  EXPECT_EQ(
      reach_with("interfaces = [\"lo\", \"wlan0\"]\npeers = [\"10.0.0.7\", \"drone.lan:7412\"]").cyclone_config,
      begin +
          "<General><Interfaces><NetworkInterface name=\"lo\" multicast=\"true\"/>"
          "<NetworkInterface name=\"wlan0\"/></Interfaces></General>" +
          discovery +
          "<Peers><Peer address=\"10.0.0.7\"/><Peer address=\"drone.lan:7412\"/><Peer address=\"127.0.0.1\"/></Peers>" +
          end);
  EXPECT_EQ(reach_with("local_only = false\npeers = [\"10.0.0.7\"]").cyclone_config,
            begin + discovery + "<Peers><Peer address=\"10.0.0.7\"/></Peers>" + end)
      << "the interfaces are Cyclone's choice";
  EXPECT_FALSE(reach_with("interfaces = [\"lo\", \"wlan0\"]").this_host_only);
  EXPECT_FALSE(reach_with("interfaces = [\"wlan0\"]").this_host_only);
  EXPECT_FALSE(reach_with("local_only = false\npeers = [\"10.0.0.7\"]").this_host_only);
  EXPECT_TRUE(reach_with("interfaces = [\"lo\"]").this_host_only);
  EXPECT_THAT(reach_with("interfaces = [\"tun0\"]").warnings, ElementsAre(HasSubstr("tun0 cannot multicast")));
  EXPECT_THAT(reach_with("interfaces = [\"wlan0\"]").warnings, IsEmpty());
}

TEST(DdsConfig, NeighboursSinceIronMayAnnounceAnyAddressOfTheHost) {
  const std::string any_address =
      std::string(
          "<CycloneDDS><Domain id=\"any\"><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/>"
          "<NetworkInterface name=\"wlan0\" multicast=\"false\"/><NetworkInterface name=\"tun0\" multicast=\"false\"/>"
          "</Interfaces></General>") +
      discovery_here;
  for (const char* release : {"iron", "jazzy", "kilted", "rolling"}) {
    const Reach reach = reach_with(std::string("ros_release = \"") + release + "\"");
    EXPECT_EQ(reach.cyclone_config, any_address) << release;
    EXPECT_TRUE(reach.this_host_only) << release;
  }
  for (const char* release : {"foxy", "galactic", "humble"})
    EXPECT_EQ(reach_with(std::string("local_only = true\nros_release = \"") + release + "\"").cyclone_config,
              std::string(loopback_alone) + discovery_here);
  EXPECT_EQ(reach_with("ros_release = \"jazzy\"", "file:///lan.xml").cyclone_config, std::nullopt)
      << "the release opens and closes nothing";
}

TEST(DdsConfig, AnInterfaceThatCannotBeUsedIsNamedWithItsCure) {
  EXPECT_EQ(error_with("interfaces = [\"lo\", \"wlan1\"]"),
            "DDS: this host has no network interface 'wlan1'; it has lo, wlan0, tun0, eth1, eth2");
  EXPECT_EQ(error_with("interfaces = [\"eth1\"]"),
            "DDS: the network interface 'eth1' is down; run: ip link set eth1 up");
  EXPECT_EQ(error_with("interfaces = [\"eth2\"]"), "DDS: the network interface 'eth2' has no IPv4 address");
  auto down = host;
  down.front().up = false;
  const auto alone = reach_of(ParticipantOptions{}, "", down);
  ASSERT_FALSE(alone);
  EXPECT_EQ(alone.error().message, "DDS: the network interface 'lo' is down; run: ip link set lo up");
}

TEST(DdsConfig, TheLastDomainHasRoomForThoseWhosePortsArePorts) {
  EXPECT_THAT(*reach_with("local_only = true\ndomain = 231").cyclone_config,
              HasSubstr("<MaxAutoParticipantIndex>119<"));
  EXPECT_THAT(*reach_with("local_only = true\ndomain = 232").cyclone_config, HasSubstr("<MaxAutoParticipantIndex>62<"));
  EXPECT_THAT(why_no_domain(232, "free participant index"), HasSubstr("room for 63 programs"));
}

TEST(DdsConfig, ADomainThatDoesNotStartReportsWhy) {
  const std::string full = why_no_domain(3, "Failed to find a free participant index for domain 3");
  EXPECT_THAT(full, HasSubstr("have taken every participant's ports of this domain (UDP, from 8160; "));
  EXPECT_THAT(full, HasSubstr("room for 120 programs"));
  EXPECT_THAT(why_no_domain(0, "", "CYCLONEDDS_URI file:///two.xml"),
              HasSubstr("look at CYCLONEDDS_URI file:///two.xml: its XML must have one root, <CycloneDDS>"));
  EXPECT_EQ(why_no_domain(0, ""), "DDS domain 0 does not start: Cyclone DDS does not say why");
  EXPECT_EQ(why_no_domain(0, "nix: unknown element"), "DDS domain 0 does not start: nix: unknown element");
}

TEST(DdsConfig, AWrongValueIsNamedWithFileLineKeyAndWhatIsAllowed) {
  EXPECT_THAT(problem_of("[dds]\ndomain = 233\n"),
              HasSubstr("ground.toml:2: dds.domain: must be a whole number from 0 to 232"));
  EXPECT_THAT(problem_of("[dds]\nlocal_only = 1\n"), HasSubstr("ground.toml:2: dds.local_only: must be true or false"));
  EXPECT_THAT(problem_of("[dds]\nlocal_only = true\ncyclonedds = \"lan.xml\"\n"),
              HasSubstr("ground.toml:3: dds.cyclonedds: must not stand beside dds.local_only"));
  EXPECT_THAT(problem_of("[dds]\ninterfaces = [\"lo\"]\nlocal_only = true\n"),
              HasSubstr("ground.toml:2: dds.interfaces: must not stand beside dds.local_only"));
  EXPECT_THAT(problem_of("[dds]\ninterfaces = [\"lo\", \"lo\"]\n"), HasSubstr("dds.interfaces: names 'lo' twice"));
  EXPECT_THAT(problem_of("[dds]\ninterfaces = [\"lo\"]\ncyclonedds = \"lan.xml\"\n"),
              HasSubstr("dds.interfaces: must not stand beside dds.cyclonedds"));
  EXPECT_THAT(problem_of("[dds]\ninterfaces = [\"a\", \"b\", \"c\", \"d\", \"e\"]\n"), HasSubstr("dds.interfaces"));
  for (const char* here : {"", "local_only = true\n"})
    EXPECT_THAT(problem_of(std::string("[dds]\npeers = [\"10.0.0.7\"]\n") + here),
                HasSubstr("ground.toml:2: dds.peers: needs dds.interfaces, or dds.local_only = false"));
  EXPECT_THAT(problem_of("[dds]\ninterfaces = [\"lo\"]\npeers = [\"a b\"]\n"), HasSubstr("'a b' is no address"));
  EXPECT_THAT(problem_of("[dds]\nros_release = \"jazy\"\n"),
              HasSubstr("ground.toml:2: dds.ros_release: must be one of foxy, galactic, humble, iron, jazzy"));
  EXPECT_THAT(problem_of("[dds]\nidentity = \"a\"\n"), HasSubstr("ground.toml:2: dds.identity: unknown key"));
}

}  // namespace
}  // namespace ledgerline::dds
