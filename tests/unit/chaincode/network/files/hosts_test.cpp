#include "chaincode/network/options.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"

namespace ledgerline::network {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsSupersetOf;
using testing::UnorderedElementsAreArray;

/// A folder that goes with the test.
class Folder {
 public:
  Folder() { EXPECT_NE(::mkdtemp(name_.data()), nullptr); }
  ~Folder() { fs::remove_all(name_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::string in(const std::string& name) const { return name_ + "/" + name; }
  const std::string& name() const { return name_; }

 private:
  std::string name_ = testing::TempDir() + "ledgerline_hosts_XXXXXX";
};

/// Files below a folder that have a private key in them, whatever their names.
std::vector<std::string> keys_below(const std::string& folder) {
  std::vector<std::string> keys;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file() || read_file(entry.path())->find("PRIVATE KEY") == std::string::npos) continue;
    keys.push_back(fs::relative(entry.path(), folder));
    EXPECT_EQ(entry.status().permissions(), fs::perms::owner_read | fs::perms::owner_write) << keys.back();
  }
  return keys;
}

Options on_three_hosts() {
  Options options;
  options.orderers = 3;
  for (int k = 1; k <= 3; ++k) {
    const std::string host = "10.0.0." + std::to_string(k);
    options.organisation_addresses.push_back({host, 7051});
    options.orderer_addresses.push_back({host, 7061});
  }
  return options;
}

TEST(FabricHosts, AreTheAddressesOfThePlaces) {
  Options options = on_three_hosts();
  options.orderer_addresses[2].host = "10.0.0.4";
  const auto hosts = hosts_of(options);
  ASSERT_EQ(hosts.size(), 4U);
  EXPECT_EQ(hosts[1].host, "10.0.0.2");
  EXPECT_THAT(hosts[1].organisations, ElementsAre(2));
  EXPECT_THAT(hosts[1].orderers, ElementsAre(2));
  EXPECT_THAT(hosts[2].orderers, ElementsAre());
  EXPECT_THAT(hosts[3].organisations, ElementsAre());
  EXPECT_THAT(hosts[3].orderers, ElementsAre(3));
  EXPECT_TRUE(hosts_of({}).empty());
}

TEST(FabricHosts, EachHasThePrivateKeysOfItsOwnPartsAndNoOther) {
  const Folder folder;
  const std::string all = folder.in("authority");
  const Options options = on_three_hosts();
  ASSERT_TRUE(identities::make(all, options.orderers).ok());
  for (const char* file : {"places.json", "teleop.block", "done/block-teleop"})
    ASSERT_TRUE(write_file(all + "/" + file, "x").ok());
  for (const HostParts& host : hosts_of(options)) {
    const int k = host.organisations.at(0);
    const std::string to = folder.in("host-" + host.host), domain = "org" + std::to_string(k) + ".ledgerline";
    ASSERT_TRUE(write_host(all, host, options, to).ok());
    const std::string organisation = "crypto/peerOrganizations/" + domain;
    std::vector<std::string> expected{organisation + "/peers/peer0." + domain + "/msp/keystore/priv_sk",
                                      organisation + "/peers/peer0." + domain + "/tls/server.key",
                                      organisation + "/peers/endorser0." + domain + "/msp/keystore/priv_sk",
                                      organisation + "/peers/endorser0." + domain + "/tls/server.key",
                                      organisation + "/chaincode/tls/server.key"};
    for (const char* user : {"Admin", "User1", "User2"}) {
      expected.push_back(organisation + "/users/" + user + "@" + domain + "/msp/keystore/priv_sk");
      expected.push_back(organisation + "/users/" + user + "@" + domain + "/tls/client.key");
    }
    const std::string orderer = "crypto/ordererOrganizations/ledgerline/orderers/" + identities::orderer_name(k);
    expected.push_back(orderer + "/msp/keystore/priv_sk");
    expected.push_back(orderer + "/tls/server.key");
    EXPECT_THAT(keys_below(to), UnorderedElementsAreArray(expected));
    for (const char* file : {"places.json", "teleop.block", "done/block-teleop"})
      EXPECT_TRUE(fs::exists(to + "/" + file));
    for (int other = 1; other <= 3; ++other) {
      EXPECT_FALSE(fs::is_empty(identities::organisation_dir(to, other) / "msp" / "cacerts"));
      EXPECT_TRUE(fs::exists(identities::peer_dir(to, other) / "tls" / "ca.crt"));
      EXPECT_TRUE(fs::exists(identities::orderer_dir(to, other) / "tls" / "server.crt"));
      EXPECT_EQ(fs::exists(identities::organisation_dir(to, other) / "users"), other == k) << "users stay at home";
    }
  }
  // What belongs to nobody's host stays.
  std::vector<std::string> kept;
  for (const char* organisation : {"ordererOrganizations/ledgerline", "peerOrganizations/org1.ledgerline",
                                   "peerOrganizations/org2.ledgerline", "peerOrganizations/org3.ledgerline"})
    for (const char* authority : {"ca", "tlsca"})
      kept.push_back("crypto/" + std::string(organisation) + "/" + authority + "/priv_sk");
  kept.emplace_back("crypto/ordererOrganizations/ledgerline/users/Admin@ledgerline/msp/keystore/priv_sk");
  EXPECT_THAT(keys_below(all), IsSupersetOf(kept));
}

TEST(FabricHosts, AnExistingFolderIsLeftAndAnUnfinishedOneIsRecreated) {
  const Folder folder;
  const std::string all = folder.in("authority"), to = folder.in("host-10.0.0.1");
  const Options options = on_three_hosts();
  const HostParts host = hosts_of(options)[0];
  ASSERT_TRUE(identities::make(all, options.orderers).ok());
  EXPECT_FALSE(write_host(all, host, options, to).ok()) << "without the first blocks";
  EXPECT_FALSE(fs::exists(to));
  for (const char* file : {"places.json", "teleop.block", "done/block-teleop"})
    ASSERT_TRUE(write_file(all + "/" + file, "x").ok());
  ASSERT_TRUE(write_host(all, host, options, to).ok());
  ASSERT_TRUE(write_file(to + "/places.json", "its own").ok());
  ASSERT_TRUE(write_host(all, host, options, to).ok());
  EXPECT_EQ(*read_file(to + "/places.json"), "its own");
}

TEST(FabricTexts, APackageHasNoKeyAndThePeersBuilderAddsIt) {
  const Folder folder;
  ASSERT_TRUE(identities::make(folder.name(), 1).ok());
  const auto tls = identities::peer_dir(folder.name(), 1) / "tls";
  const std::string ca = *read_file(tls / "ca.crt");
  const std::string packed = connection_json(listen_addresses_from({}, 20'000), 1, ca);
  EXPECT_EQ(packed.find("PRIVATE"), std::string::npos);
  ASSERT_TRUE(write_file(folder.in("build/connection.json"), packed).ok());
  ASSERT_TRUE(write_file(folder.in("release"), builder_script("release"), 0755).ok());
  const std::string command = folder.in("release") + " " + folder.in("build") + " " + folder.in("out");
  EXPECT_NE(std::system(command.c_str()), 0) << "a peer that does not say where its pair is gets no release";
  ASSERT_EQ(std::system(("CORE_PEER_TLS_KEY_FILE=" + (tls / "server.key").string() +
                         " CORE_PEER_TLS_CERT_FILE=" + (tls / "server.crt").string() + " " + command)
                            .c_str()),
            0);
  EXPECT_THAT(keys_below(folder.in("out")), ElementsAre("chaincode/server/connection.json"));
  const auto json = nlohmann::json::parse(*read_file(folder.in("out/chaincode/server/connection.json")));
  EXPECT_EQ(json.at("client_key"), *read_file(tls / "server.key"));
  EXPECT_EQ(json.at("client_cert"), *read_file(tls / "server.crt"));
  EXPECT_EQ(json.at("root_cert"), ca);
  EXPECT_EQ(json.at("client_auth_required"), true);
  EXPECT_EQ(json.at("address"), listen_addresses_from({}, 20'000).chaincode(1));

  // As others write it: on one line; and one that brings a pair of its own.
  const auto released = [&](const std::string& text) {
    EXPECT_TRUE(write_file(folder.in("build/connection.json"), text).ok());
    EXPECT_EQ(std::system(("CORE_PEER_TLS_KEY_FILE=" + (tls / "server.key").string() +
                           " CORE_PEER_TLS_CERT_FILE=" + (tls / "server.crt").string() + " " + command)
                              .c_str()),
              0);
    return nlohmann::json::parse(*read_file(folder.in("out/chaincode/server/connection.json")));
  };
  EXPECT_EQ(released("{\"address\": \"x:1\"}").at("client_key"), *read_file(tls / "server.key"));
  EXPECT_EQ(released("{\"client_key\": \"its own\"}\n").at("client_key"), "its own");
}

TEST(FabricTexts, AnOrderersAdministrationIsForItsOwnHostAlone) {
  const Options options = on_three_hosts();
  const ListenAddresses addresses{options.orderer_addresses, options.organisation_addresses, {}};
  EXPECT_EQ(addresses.orderer_admin(2), "127.0.0.1:7062");
  EXPECT_THAT(orderer_environment(options, addresses, 2),
              testing::Contains("ORDERER_ADMIN_LISTENADDRESS=127.0.0.1:7062"));
}

}  // namespace
}  // namespace ledgerline::network
