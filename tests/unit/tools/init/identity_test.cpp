
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "tools/init/core/host.hpp"

namespace ledgerline::init {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class InitIdentity : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = testing::TempDir() + "init.XXXXXX";
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    dir_ = name;
  }
  void TearDown() override { fs::remove_all(dir_); }

  std::string in(const std::string& name) const { return dir_ / name; }
  std::string written(const std::string& name, const std::string& content) const {
    EXPECT_TRUE(write_file(in(name), content));
    return in(name);
  }
  Directories folders() const { return {.config = dir_.string()}; }
  static crypto::KeyAndCertificate issued(const crypto::CertificateRequest& request) {
    return *crypto::issue(*crypto::make_ca("ca", "org"), request);
  }

  fs::path dir_;
};

TEST_F(InitIdentity, TheKeyIsForItsOwnerAloneAndIsNeverReplaced) {
  ASSERT_TRUE(request_identity(in("msp"), in("raven.csr"), {.common_name = "raven", .organization = "Org1"}));
  struct stat info {};
  ASSERT_EQ(::stat(in("msp/keystore/priv_sk").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
  const std::string key = *read_file(in("msp/keystore/priv_sk"));
  EXPECT_THAT(*read_file(in("raven.csr")), HasSubstr("BEGIN CERTIFICATE REQUEST"));
  const Status again = request_identity(in("msp"), in("other.csr"), {.common_name = "raven"});
  ASSERT_FALSE(again);
  EXPECT_THAT(again.error().message, HasSubstr("has a key already"));
  EXPECT_EQ(*read_file(in("msp/keystore/priv_sk")), key);
}

TEST_F(InitIdentity, AKeyInAFolderThatCannotBeReadIsNotReplacedEither) {
  constexpr uid_t nobody = 65'534;
  ASSERT_TRUE(write_file(in("msp/keystore/priv_sk"), "the only copy", 0600));
  fs::permissions(in("msp/keystore"), fs::perms::owner_write | fs::perms::owner_exec);
  const bool root = ::geteuid() == 0;  // who may read every folder
  for (const std::string& path : {dir_.string(), in("msp"), in("msp/keystore"), in("msp/keystore/priv_sk")})
    ASSERT_TRUE(!root || ::chown(path.c_str(), nobody, nobody) == 0);
  ASSERT_TRUE(!root || ::seteuid(nobody) == 0);
  const Status refused = request_identity(in("msp"), in("raven.csr"), {.common_name = "raven"});
  ASSERT_TRUE(!root || ::seteuid(0) == 0);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("priv_sk is there already"));
  EXPECT_EQ(*read_file(in("msp/keystore/priv_sk")), "the only copy");
}

TEST_F(InitIdentity, ACertificateOfAnotherKeyIsRefusedAndTheOldOneStays) {
  const auto own = issued({.common_name = "raven", .organization = "o", .unit = "client", .sans = {}});
  const auto strange = issued({.common_name = "raven", .organization = "o", .unit = "client", .sans = {}});
  ASSERT_TRUE(write_file(in("msp/keystore/priv_sk"), own.key_pem, 0600));
  const auto taken = install_certificate(folders(), written("raven.pem", own.certificate_pem));
  ASSERT_TRUE(taken) << taken.error().message;
  EXPECT_THAT(*taken, HasSubstr("CN=raven"));
  const auto refused = install_certificate(folders(), written("strange.pem", strange.certificate_pem));
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("of another key"));
  EXPECT_TRUE(crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", in("msp")));
}

// As openssl's `cat ca.pem raven.pem` and some authorities' downloads have it.
TEST_F(InitIdentity, AChainWithItsAuthorityFirstIsPutInOrder) {
  const auto ca = crypto::make_ca("ca", "org").value();
  const auto own =
      crypto::issue(ca, {.common_name = "raven", .organization = "o", .unit = "client", .sans = {}}).value();
  ASSERT_TRUE(write_file(in("msp/keystore/priv_sk"), own.key_pem, 0600));
  const std::string chain = "Issuer: ca\n" + ca.certificate_pem + "Subject: raven\n" + own.certificate_pem;
  const std::string there = written("msp/signcerts/raven.pem", chain);
  EXPECT_FALSE(crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", in("msp")));
  const auto taken = install_certificate(folders(), there);  // in its own place, which is the cure that doctor prints
  ASSERT_TRUE(taken) << taken.error().message;
  EXPECT_THAT(*taken, HasSubstr("CN=raven"));
  EXPECT_EQ(*read_file(in("msp/signcerts/cert.pem")), own.certificate_pem + ca.certificate_pem);
  EXPECT_FALSE(fs::exists(there));
  EXPECT_TRUE(crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", in("msp")));
}

TEST_F(InitIdentity, AnExpiredCertificateIsRefused) {
  const auto own = issued({.common_name = "raven", .organization = "o", .unit = "client", .sans = {}, .days = -1});
  ASSERT_TRUE(write_file(in("msp/keystore/priv_sk"), own.key_pem, 0600));
  const auto taken = install_certificate(folders(), written("raven.pem", own.certificate_pem));
  ASSERT_FALSE(taken);
  EXPECT_THAT(taken.error().message, HasSubstr("has expired"));
}

TEST_F(InitIdentity, ACertificateOfAnAuthorityThatTheHostDoesNotKnowIsRefused) {
  const crypto::CertificateRequest request{.common_name = "raven", .organization = "o", .unit = "client", .sans = {}};
  const auto org1 = crypto::make_ca("ca.org1", "org1").value(), org2 = crypto::make_ca("ca.org2", "org2").value();
  const auto good = crypto::issue(org1, request).value();
  ASSERT_TRUE(write_file(in("msp/keystore/priv_sk"), good.key_pem, 0600));
  written("authorities/Org2MSP.pem", org2.certificate_pem);
  const auto refused = install_certificate(folders(), written("raven.pem", good.certificate_pem));
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("CN=ca.org1"));
  EXPECT_THAT(refused.error().message, HasSubstr("no member of an organisation here"));
  EXPECT_FALSE(fs::exists(in("msp/signcerts/cert.pem")));
  written("authorities/Org1MSP.pem", org1.certificate_pem);
  EXPECT_TRUE(install_certificate(folders(), in("raven.pem")));
  EXPECT_TRUE(check_authority(in("elsewhere"), in("msp"), good.certificate_pem)) << "nobody knows";
  written("agent.toml", "[ledger]\nmsp_id = \"Org2MSP\"\nmsp_dir = \"" + in("msp") + "\"\n");
  const Status foreign = check_authority(dir_.string(), in("msp"), good.certificate_pem);
  ASSERT_FALSE(foreign);
  EXPECT_THAT(foreign.error().message, HasSubstr("no member of Org2MSP"));
}

TEST_F(InitIdentity, ARenewedCertificateReplacesTheOneOfAnotherName) {
  const auto own = issued({.common_name = "raven", .organization = "o", .unit = "client", .sans = {}});
  ASSERT_TRUE(write_file(in("msp/keystore/priv_sk"), own.key_pem, 0600));
  written("msp/signcerts/a.pem", "old");
  ASSERT_TRUE(install_certificate(folders(), written("raven.pem", own.certificate_pem)));
  EXPECT_FALSE(fs::exists(in("msp/signcerts/a.pem")));
}

TEST_F(InitIdentity, WhatIsCollectedForOthersHasNoKey) {
  ASSERT_TRUE(identities::make(in("ledger"), 1));
  written("ledger/teleop.block", "block");
  const Status collected = collect_public(in("ledger"), in("public"));
  ASSERT_TRUE(collected) << collected.error().message;
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(dir_ / "public")) {
    if (!entry.is_regular_file()) continue;
    ++files;
    EXPECT_EQ(read_file(entry.path())->find("PRIVATE KEY"), std::string::npos) << entry.path();
  }
  EXPECT_EQ(files, 9u);
  EXPECT_TRUE(fs::exists(in("public/tls/orderers.pem")));
  EXPECT_TRUE(fs::exists(in("public/orderers-ca.pem"))) << "receipts are checked by it";
}

TEST_F(InitIdentity, NothingIsWrittenWhereAFileIsThere) {
  written("b", "mine");
  const Status refused = write_new({{in("a"), "1"}, {in("b"), "2"}});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr(in("b") + " is there already"));
  EXPECT_FALSE(fs::exists(in("a")));
  EXPECT_TRUE(write_new({{in("b"), "mine"}})) << "it has that content";
}

}  // namespace
}  // namespace ledgerline::init
