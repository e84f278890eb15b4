#include "tools/checks/shell/probes.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "common/base/file.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::checks {
namespace {

TEST(DoctorChannels, AskAnotherPeerAloneAndWithItsOwnTlsPair) {
  fabric::ClientConfig client;
  client.tls_pair = {"own.pem", "own.key"};
  client.orderers = {{"orderer:7050", "missing.pem"}};
  client.endorsers = {{"Org2MSP", "peer:9051", "missing.pem"}};
  client.blocks = fabric::BlockSource::ordered;
  const ServerKeys plain{"Org2MSP", "peer:9051", "ca.pem", "", "", ""};
  EXPECT_EQ(client_at(plain, client).tls_pair.certificate_file, "own.pem");
  ServerKeys wanting = plain;
  wanting.tls_certificate = "its.pem";
  wanting.tls_key = "its.key";
  const fabric::ClientConfig there = client_at(wanting, client);
  EXPECT_EQ(there.tls_pair.certificate_file, "its.pem");
  EXPECT_EQ(there.tls_pair.key_file, "its.key");
  EXPECT_EQ(there.endpoint, "peer:9051");
  // Else what is wrong with another server's files would be reported as this one's.
  EXPECT_TRUE(there.orderers.empty() && there.endorsers.empty());
  EXPECT_EQ(there.blocks, fabric::BlockSource::peer);
}

TEST(DoctorConfigs, TheEmbeddedLedgersCountsForItsRole) {
  const std::string dir = testing::TempDir() + "configs" + std::to_string(::getpid());
  ASSERT_TRUE(write_file(dir + "/other.toml", ""));
  const Configs none = read_configs(dir, "ledger");
  ASSERT_EQ(none.findings.size(), 1U);
  EXPECT_EQ(none.findings[0].problem, Problem::config_missing);
  EXPECT_EQ(none.findings[0].what, dir + "/node.env");
  ASSERT_TRUE(write_file(dir + "/node.env", "# Where\nLEDGERLINE_LISTEN=10.0.0.2:7051\nLEDGERLINE_NODE_OPTIONS=\n"));
  const Configs there = read_configs(dir, "ledger");
  EXPECT_FALSE(anything_broken(there.findings)) << words(there.findings);
  ASSERT_TRUE(there.node);
  EXPECT_EQ(there.node->listen, "10.0.0.2:7051");
  std::filesystem::remove_all(dir);
}

}  // namespace
}  // namespace ledgerline::checks
