#include "chaincode/lifecycle/lifecycle.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/base/file.hpp"

namespace ledgerline::chaincode_lifecycle {
namespace {

class Package : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(dir_); }
  void TearDown() override { std::filesystem::remove_all(dir_); }
  /// What tar, an independent reader, writes.
  std::string unpacked(const std::string& command) const {
    std::string out;
    FILE* pipe = ::popen(("cd " + dir_ + " && " + command + " 2>&1").c_str(), "r");
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) out.push_back(static_cast<char>(c));
    return ::pclose(pipe) == 0 ? out : "failed: " + out;
  }
  const std::string dir_ = testing::TempDir() + "package" + std::to_string(::getpid());
};

TEST_F(Package, IsWhatTarReads) {
  // Longer than a stored block of deflate, and no multiple of tar's blocks.
  const std::string connection =
      connection_json({.address = "cc.org1.example.com:9999", .root_pem = std::string(70'001, 'x')});
  ASSERT_TRUE(write_file(dir_ + "/p.tgz", make_package("ledgerline_1", connection)));
  EXPECT_EQ(unpacked("gzip -t p.tgz && tar tzf p.tgz"), "metadata.json\ncode.tar.gz\n");
  EXPECT_EQ(nlohmann::json::parse(unpacked("tar xzOf p.tgz metadata.json")),
            (nlohmann::json{{"type", "ccaas"}, {"label", "ledgerline_1"}}));
  EXPECT_EQ(unpacked("tar xzOf p.tgz code.tar.gz | tar xzO connection.json"), connection);
}

TEST_F(Package, HasTheSameIdWhereverItIsMade) {
  const auto make = [](const std::string& address) {
    return package_id("ledgerline_1", make_package("ledgerline_1", connection_json({.address = address})));
  };
  EXPECT_EQ(make("a:1"), make("a:1"));
  EXPECT_NE(make("a:1"), make("a:2"));
  EXPECT_THAT(make("a:1"), testing::MatchesRegex("ledgerline_1:[0-9a-f]{64}"));
}

TEST_F(Package, SaysWhetherThereIsTlsAndWhoShowsACertificate) {
  const auto plain = nlohmann::json::parse(connection_json({.address = "a:1"}));
  EXPECT_EQ(plain["tls_required"], false);
  EXPECT_FALSE(plain.contains("client_key"));
  const auto mutual = nlohmann::json::parse(connection_json({.address = "a:1",
                                                             .root_pem = "root",
                                                             .client_auth = true,
                                                             .client_pem = "certificate",
                                                             .client_key_pem = "key"}));
  EXPECT_EQ(mutual["tls_required"], true);
  EXPECT_EQ(mutual["client_auth_required"], true);
  EXPECT_EQ(mutual["root_cert"], "root");
  EXPECT_EQ(mutual["client_key"], "key");
}

TEST_F(Package, LabelsAreFabrics) {
  for (const char* good : {"ledgerline_1", "a", "A-1.2+x"}) EXPECT_TRUE(is_label(good)) << good;
  for (const char* bad : {"", "_a", "a b", "a/b", "a:b"}) EXPECT_FALSE(is_label(bad)) << bad;
}

}  // namespace
}  // namespace ledgerline::chaincode_lifecycle
