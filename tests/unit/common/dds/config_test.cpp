#include "common/dds/settings/config.hpp"

#include <gmock/gmock.h>

#include "common/dds/settings/reach.hpp"

namespace ledgerline::dds {
namespace {

using ::testing::HasSubstr;

constexpr const char* all_files =
    "[dds]\nidentity_ca = \"ca.pem\"\ncertificate = \"me.pem\"\nprivate_key = \"me.key\"\ngovernance = \"g.p7s\"\n"
    "permissions = \"p.p7s\"\n";

std::string problem_of(const std::string& toml) {
  auto config = Config::parse(toml, "ground.toml");
  EXPECT_TRUE(config.ok());
  (void)participant_options(*config, "ledgerline_ground");
  const Status status = config->finish();
  return status ? "" : status.error().what;
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
  ASSERT_TRUE(config->finish()) << config->finish().error().what;
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

std::string warning_of(std::optional<bool> local_only, const std::string& uri, const std::string& file = {}) {
  ParticipantOptions options;
  options.local_only = local_only;
  options.cyclonedds = file;
  return reach_of(options, uri).warning;
}

TEST(DdsConfig, BeatsTheEnvironmentAndSaysSo) {
  const auto reaches = [](std::optional<bool> local_only, const std::string& uri) {
    ParticipantOptions options;
    options.local_only = local_only;
    return reach_of(options, uri).cyclone_config.value_or("as the environment says");
  };
  EXPECT_THAT(reaches(std::nullopt, ""), HasSubstr("127.0.0.1"));
  EXPECT_THAT(reaches(true, ""), HasSubstr("127.0.0.1"));
  EXPECT_THAT(reaches(true, "file:///lan.xml"), HasSubstr("127.0.0.1"));
  EXPECT_EQ(reaches(false, "file:///lan.xml"), "as the environment says");
  EXPECT_EQ(reaches(std::nullopt, "file:///lan.xml"), "as the environment says");
  for (const auto said : {std::optional<bool>{}, std::optional(true), std::optional(false)}) {
    EXPECT_EQ(warning_of(said, ""), "");
    EXPECT_THAT(warning_of(said, "file:///lan.xml"), HasSubstr("CYCLONEDDS_URI"));
  }
  EXPECT_THAT(warning_of(true, "file:///lan.xml"), HasSubstr("stays on this machine"));
  EXPECT_THAT(warning_of(std::nullopt, "file:///lan.xml"), HasSubstr("CYCLONEDDS_URI decides"));

  ParticipantOptions named;
  named.cyclonedds = "/etc/cyclone.xml";
  EXPECT_EQ(reach_of(named, "file:///lan.xml").cyclone_config, "file:///etc/cyclone.xml");
  EXPECT_THAT(warning_of(std::nullopt, "file:///lan.xml", "/etc/cyclone.xml"),
              HasSubstr("/etc/cyclone.xml, which decides"));
  EXPECT_EQ(warning_of(std::nullopt, "", "/etc/cyclone.xml"), "");
}

TEST(DdsConfig, AWrongValueIsNamedWithFileLineKeyAndWhatIsAllowed) {
  EXPECT_THAT(problem_of("[dds]\ndomain = 233\n"),
              HasSubstr("ground.toml:2: dds.domain: must be a whole number from 0 to 232"));
  EXPECT_THAT(problem_of("[dds]\nlocal_only = 1\n"), HasSubstr("ground.toml:2: dds.local_only: must be true or false"));
  EXPECT_THAT(problem_of("[dds]\nlocal_only = true\ncyclonedds = \"lan.xml\"\n"),
              HasSubstr("ground.toml:3: dds.cyclonedds: must not stand beside dds.local_only"));
  EXPECT_THAT(problem_of("[dds]\nidentity = \"a\"\n"), HasSubstr("ground.toml:2: dds.identity: unknown key"));
}

}  // namespace
}  // namespace ledgerline::dds
