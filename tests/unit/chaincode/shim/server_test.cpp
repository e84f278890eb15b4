#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

#include "chaincode/shim/shim.hpp"

namespace ledgerline::shim {
namespace {

using ::testing::HasSubstr;

std::string why_not(const Options& options) {
  const auto server = Server::start(options, {});
  return server ? "" : server.error().message;
}

TEST(ShimServer, RefusesAKeyThatOthersMayRead) {
  const std::string key = ::testing::TempDir() + "shim_server_" + std::to_string(::getpid()) + ".key";
  std::ofstream(key) << "a key";
  ::chmod(key.c_str(), 0644);
  EXPECT_THAT(why_not({.chaincode_id = "c:1",
                       .address = "127.0.0.1:0",
                       .key_file = key,
                       .certificate_file = key,
                       .client_ca_file = ""}),
              HasSubstr("chmod 600 " + key));
  ::unlink(key.c_str());
}

TEST(ShimServer, APackageIdIsALabelAndAHashAndMayHaveTheNewlineOfASecret) {
  const std::string id = "ledgerline_1:" + std::string(64, 'a');
  for (const std::string& good : {id, id + "\n"}) {
    const auto taken = package_id_from(good);
    ASSERT_TRUE(taken) << taken.error().message;
    EXPECT_EQ(*taken, id);
  }
  for (const std::string& bad : {std::string(), std::string("ledgerline_1"), std::string("ledgerline_1:HASH"),
                                 ":" + std::string(64, 'a'), "\"" + id + "\"", "'" + id + "'", id + "\n\n", id + "\r\n",
                                 " " + id, id + " ", id + "a", "ledgerline_1:" + std::string(64, 'A')}) {
    const auto refused = package_id_from(bad);
    ASSERT_FALSE(refused) << bad;
    EXPECT_THAT(refused.error().message, HasSubstr("label:64 hex digits"));
    EXPECT_EQ(refused.error().message.find('\n'), std::string::npos);
  }
}

TEST(ShimServer, DoesNotSpeakPlainTextForAnEmptyKey) {
  const std::string key = ::testing::TempDir() + "shim_server_empty_" + std::to_string(::getpid()) + ".key";
  std::ofstream(key) << "";
  ::chmod(key.c_str(), 0600);
  EXPECT_NE(why_not({.chaincode_id = "c:1",
                     .address = "0.0.0.0:0",
                     .key_file = key,
                     .certificate_file = key,
                     .client_ca_file = ""}),
            "");
  ::unlink(key.c_str());
}

TEST(ShimServer, SpeaksPlainTextWithinThisHostAlone) {
  for (const char* address : {"0.0.0.0:0", "[::]:0", "192.0.2.1:0", ":0", "host.example.org:0"}) {
    EXPECT_THAT(
        why_not(
            {.chaincode_id = "c:1", .address = address, .key_file = "", .certificate_file = "", .client_ca_file = ""}),
        HasSubstr("CHAINCODE_TLS_KEY"))
        << address;
  }
  EXPECT_EQ(why_not({.chaincode_id = "c:1",
                     .address = "127.0.0.1:0",
                     .key_file = "",
                     .certificate_file = "",
                     .client_ca_file = ""}),
            "");
}

}  // namespace
}  // namespace ledgerline::shim
