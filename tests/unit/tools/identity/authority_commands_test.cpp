#include <gtest/gtest.h>

#include <algorithm>

#include "tools/identity/core/authority_commands.hpp"

namespace ledgerline::identity {
namespace {

const Authority authority{"/bin/fabric-ca-client", "https://ca.org1:7054", "ca-tls.pem"};

bool has(const Command& command, const std::string& word) {
  return std::ranges::find(command.words, word) != command.words.end();
}

bool has_variable(const Command& command, const std::string& variable) {
  return std::ranges::find(command.environment, variable) != command.environment.end();
}

TEST(IdentityAsking, ASecretIsInNoWordsOfTheProcess) {
  const auto command = enroll(authority, "/tmp/home", "raven@org1", "p/w:1", {.subject_parts = "O=org1"}).value();
  for (const std::string& word : command.words) EXPECT_EQ(word.find("p/w"), std::string::npos) << word;
  EXPECT_TRUE(has_variable(command, "FABRIC_CA_CLIENT_URL=https://raven%40org1:p%2Fw%3A1@ca.org1:7054"));
  EXPECT_TRUE(has_variable(command, "FABRIC_CA_CLIENT_HOME=/tmp/home"));
  EXPECT_TRUE(has(command, "raven@org1")) << "the host in it, not this machine's name";
  EXPECT_TRUE(has(command, "O=org1"));
}

TEST(IdentityAsking, ARenewalMakesANewKeyUnlessItMustNot) {
  const auto command =
      renew(authority, "/tmp/home", "raven", {.hosts = "raven.local,10.0.0.2", .profile = "tls"}, false).value();
  EXPECT_TRUE(has(command, "reenroll") && has(command, "raven.local,10.0.0.2") && has(command, "tls"));
  EXPECT_FALSE(has(command, "--csr.keyrequest.reusekey"));
  EXPECT_TRUE(has(renew(authority, "/tmp/home", "raven", {}, true).value(), "--csr.keyrequest.reusekey"));
}

TEST(IdentityAsking, AnAuthorityWithoutTlsIsNotAsked) {
  Authority plain = authority;
  plain.url = "http://ca.org1:7054";
  EXPECT_FALSE(enroll(plain, "/tmp/home", "raven", "secret", {}));
}

TEST(IdentityAsking, RevokedIsANameOrOneCertificate) {
  const auto commands = revoke(authority, "/tmp/home", {.name = "raven"}).value();
  ASSERT_EQ(commands.size(), 2U);
  EXPECT_TRUE(has(commands[0], "--revoke.name") && has(commands[1], "gencrl"));
  EXPECT_TRUE(has(revoke(authority, "", {.serial = "0a", .authority_key = "0b"}).value()[0], "--revoke.serial"));
  EXPECT_FALSE(revoke(authority, "", {}));
  EXPECT_FALSE(revoke(authority, "", {.name = "raven", .serial = "0a", .authority_key = "0b"}));
}

TEST(IdentityAsking, WhatTheAuthoritySetsIsNotAskedForAgain) {
  EXPECT_EQ(subject_parts("CN=raven,OU=client,O=org1.ledgerline,C=DE").value(), "O=org1.ledgerline,C=DE");
  EXPECT_EQ(subject_parts("CN=raven").value(), "");
  EXPECT_FALSE(subject_parts("CN=raven,O=Drones\\, Inc"));
}

}  // namespace
}  // namespace ledgerline::identity
