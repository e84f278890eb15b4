#include "common/fabric/config.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "common/base/file.hpp"
#include "common/fabric/validation/channel_config.hpp"

namespace ledgerline::fabric {
namespace {

class LedgerConfig : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(dir_ + "/msp/signcerts");
    std::filesystem::create_directories(dir_ + "/msp/keystore");
    const auto user =
        crypto::issue(ca_, {.common_name = "User1@org1", .organization = "", .unit = "client", .sans = {}}).value();
    std::ofstream(dir_ + "/ca.pem") << ca_.certificate_pem;
    std::ofstream(dir_ + "/msp/signcerts/cert.pem") << user.certificate_pem;
    std::ofstream(dir_ + "/msp/keystore/priv_sk") << user.key_pem;
    ::chmod((dir_ + "/msp/keystore/priv_sk").c_str(), 0600);
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }

  std::string ledger(const std::string& more = "") const {
    return "[ledger]\nendpoint = \"127.0.0.1:7051\"\ntls_ca = \"" + dir_ +
           "/ca.pem\"\nmsp_id = \"Org1MSP\"\nmsp_dir = \"" + dir_ + "/msp\"\n" + more;
  }
  std::string msp() const { return "[[msp]]\nid = \"Org1MSP\"\nca = \"" + dir_ + "/ca.pem\"\n"; }

  crypto::KeyAndCertificate ca_ = crypto::make_ca("ca.org1", "org1").value();
  std::string dir_ = testing::TempDir() + "ledger-config" + std::to_string(::getpid());
};

TEST_F(LedgerConfig, DefaultsAreTheContractsOwn) {
  auto config = Config::parse(ledger() + msp(), "agent.toml").value();
  const auto client = ledger_config(config).value();
  EXPECT_EQ(client.endpoint, "127.0.0.1:7051");
  EXPECT_EQ(client.where.channel, "teleop");
  EXPECT_EQ(client.where.contract, "ledgerline");
  EXPECT_EQ(client.identity.name.subject, "CN=User1@org1,OU=client");
  const auto registry = msp_registry(config).value();
  EXPECT_TRUE(registry->member(client.identity.serialized, std::time(nullptr)));
  EXPECT_TRUE(config.finish());
}

TEST_F(LedgerConfig, EveryKeyIsKnown) {
  auto config =
      Config::parse(ledger("channel = \"c\"\ncontract = \"x\"\nsigner = \"libcrypto\"\nverifier = \"mbedtls\"\n"
                           "server_name = \"peer0\"\nmax_in_flight = 3\ndeadline_ms = 700\n") +
                        msp(),
                    "agent.toml")
          .value();
  const auto client = ledger_config(config).value();
  ASSERT_TRUE(msp_registry(config));
  EXPECT_TRUE(config.finish());
  EXPECT_EQ(client.where.channel, "c");
  EXPECT_EQ(client.where.contract, "x");
  EXPECT_EQ(client.server_name, "peer0");
  EXPECT_EQ(client.max_in_flight, 3U);
  EXPECT_EQ(client.deadline, std::chrono::milliseconds(700));
}

TEST_F(LedgerConfig, WrongKeysAreReportedWithTheirLine) {
  auto config = Config::parse("[ledger]\nendpoint = \"x\"\nsigner = \"none\"\n", "agent.toml").value();
  EXPECT_FALSE(ledger_config(config));
  EXPECT_FALSE(msp_registry(config));
  const std::string what = config.finish().error().message;
  EXPECT_NE(what.find("agent.toml:3: ledger.signer"), std::string::npos) << what;
  EXPECT_NE(what.find("ledger.msp_id: is missing"), std::string::npos) << what;
}

TEST_F(LedgerConfig, AFailureLeavesNoKeyUnasked) {
  auto config = Config::parse(
                    "[ledger]\nendpoint = \"x\"\ntls_ca = \"y\"\nmsp_id = \"Org1MSP\"\nmsp_dir = \"/nowhere\"\n"
                    "[[msp]]\nid = \"Org1MSP\"\nca = \"/no-ca.pem\"\n[[msp]]\nid = \"Org2MSP\"\nca = \"/no.pem\"\n",
                    "agent.toml")
                    .value();
  EXPECT_FALSE(ledger_config(config));
  EXPECT_FALSE(msp_registry(config));
  EXPECT_TRUE(config.finish());
}

TEST_F(LedgerConfig, FilesThatAreNotThereAreNamed) {
  auto config = Config::parse(
                    "[ledger]\nendpoint = \"x\"\ntls_ca = \"y\"\nmsp_id = \"Org1MSP\"\nmsp_dir = "
                    "\"/nowhere\"\n[[msp]]\nid = \"Org1MSP\"\nca = \"/no-ca.pem\"\n",
                    "agent.toml")
                    .value();
  EXPECT_NE(ledger_config(config).error().message.find("/nowhere/signcerts"), std::string::npos);
  EXPECT_NE(msp_registry(config).error().message.find("/no-ca.pem"), std::string::npos);
}

TEST_F(LedgerConfig, ACertificateIsOfTheOrganisationWhoseAuthorityIssuedIt) {
  const auto other_ca = crypto::make_ca("ca.org2", "org2").value();
  const auto of = [](const crypto::KeyAndCertificate& ca) {
    return crypto::issue(ca, {.common_name = "pilot", .organization = "", .unit = "client", .sans = {}})
        .value()
        .certificate_pem;
  };
  const std::string file = dir_ + "/admin.toml";
  ASSERT_TRUE(write_file(file, ledger()));
  const auto client = load_ledger_config(file).value();
  ASSERT_TRUE(load_msps(file));
  EXPECT_TRUE(load_msps(file)->empty());
  EXPECT_TRUE(check_certificate_of("Org1MSP", of(other_ca), client, {})) << "no authority is known";

  std::filesystem::create_directories(dir_ + "/msp/cacerts");
  ASSERT_TRUE(write_file(dir_ + "/msp/cacerts/ca.pem", ca_.certificate_pem));
  EXPECT_TRUE(check_certificate_of("Org1MSP", of(ca_), client, {}));
  const auto refused = check_certificate_of("Org1MSP", of(other_ca), client, {});
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("is no certificate of Org1MSP: it was issued by CN=ca.org2"),
            std::string::npos)
      << refused.error().message;
  EXPECT_TRUE(check_certificate_of("Org2MSP", of(ca_), client, {})) << "of that one none is known";
  std::filesystem::create_directories(dir_ + "/msp/intermediatecerts");
  ASSERT_TRUE(write_file(dir_ + "/msp/intermediatecerts/ca.pem", other_ca.certificate_pem));
  EXPECT_TRUE(check_certificate_of("Org1MSP", of(other_ca), client, {}));

  ASSERT_TRUE(write_file(file, ledger() + msp()));
  auto msps = load_msps(file).value();
  ASSERT_EQ(msps.size(), 1U);
  EXPECT_EQ(msps[0].msp_id, "Org1MSP");
  msps.push_back({"Org2MSP", other_ca.certificate_pem});
  EXPECT_TRUE(check_certificate_of("Org2MSP", of(other_ca), client, msps));
  EXPECT_FALSE(check_certificate_of("Org2MSP", of(ca_), client, msps));
}

TEST(Timeouts, IsTwiceABlocksWaitWhereBlocksWait) {
  EXPECT_EQ(both_ways_ns(2 * ns_per_s, 10), 4 * ns_per_s);
  EXPECT_EQ(both_ways_ns(2 * ns_per_s, 1), 0);
  EXPECT_EQ(both_ways_ns(3600 * ns_per_s, 500), 55 * ns_per_s) << "whatever a configuration says";
  EXPECT_EQ(both_ways_ns(INT64_MAX, 500), 55 * ns_per_s);
}

TEST(Timeouts, IsOfTheTrustAnchorOrOfThePeer) {
  ClientConfig config;
  EXPECT_EQ(apply_timeouts(config).value(), 0) << "fixed: nobody is asked";
  config.timeouts_of_channel = true;
  config.config_block = "no block";
  EXPECT_NE(apply_timeouts(config).error().message.find("ledger.timeouts"), std::string::npos);
}

TEST_F(LedgerConfig, AnIdentityIsAFolderOrTwoFiles) {
  const std::string files =
      "certificate = \"" + dir_ + "/msp/signcerts/cert.pem\"\nprivate_key = \"" + dir_ + "/msp/keystore/priv_sk\"\n";
  const std::string where = "[ledger]\nendpoint = \"x:1\"\ntls_ca = \"" + dir_ + "/ca.pem\"\nmsp_id = \"Org1MSP\"\n";
  const auto result = [&](const std::string& text) {
    auto config = Config::parse(text, "agent.toml").value();
    const auto client = ledger_config(config);
    EXPECT_TRUE(config.finish());
    return client ? client->identity.name.subject : client.error().message;
  };
  EXPECT_EQ(result(where + files), "CN=User1@org1,OU=client");
  const std::string one_or_the_other = "[ledger] needs msp_dir, or certificate and private_key: one or the other";
  EXPECT_EQ(result(where), one_or_the_other);
  EXPECT_EQ(result(ledger(files)), one_or_the_other);
  EXPECT_EQ(result(where + "certificate = \"c.pem\"\n"), one_or_the_other);
}

TEST_F(LedgerConfig, EveryServerMayHaveATlsPairAndANameOfItsOwn) {
  const auto keys = [](const std::string& of) {
    return "server_name = \"name-" + of + "\"\ntls_certificate = \"" + of + ".crt\"\ntls_key = \"" + of + ".key\"\n";
  };
  std::string text = ledger(keys("own"));
  for (const std::string table : {"peer", "orderer", "endorser"}) {
    text += "[[" + table + "]]\nendpoint = \"x\"\ntls_ca = \"y\"\n" + keys(table);
    if (table == "endorser") text += "msp_id = \"Org2MSP\"\n";
  }
  auto config = Config::parse(text, "agent.toml").value();
  const auto client = ledger_config(config).value();
  EXPECT_TRUE(config.finish());
  const auto expect = [](const std::string& of, const std::string& name, const ClientConfig::TlsPair& pair) {
    EXPECT_EQ(name, "name-" + of);
    EXPECT_EQ(pair.certificate_file, of + ".crt");
    EXPECT_EQ(pair.key_file, of + ".key");
  };
  expect("own", client.server_name, client.tls_pair);
  expect("peer", client.other_peers.at(0).server_name, client.other_peers.at(0).tls_pair);
  expect("orderer", client.orderers.at(0).server_name, client.orderers.at(0).tls_pair);
  expect("endorser", client.endorsers.at(0).server_name, client.endorsers.at(0).tls_pair);
}

TEST_F(LedgerConfig, OfAProgramsWholeFileTheOtherTablesAreSkipped) {
  const std::string file = dir_ + "/agent.toml";
  const std::string whole = ledger() + msp() + "[agent]\nx = 1\n[[drone]]\nname = \"tello1\"\n";
  std::ofstream(file) << whole;
  EXPECT_EQ(load_ledger_config(file).value().endpoint, "127.0.0.1:7051");
  std::ofstream(file) << whole + "[[orderers]]\nendpoint = \"x\"\n";
  const auto misspelt = load_ledger_config(file);
  ASSERT_FALSE(misspelt);
  EXPECT_NE(misspelt.error().message.find("orderers"), std::string::npos) << misspelt.error().message;
}

}  // namespace
}  // namespace ledgerline::fabric
