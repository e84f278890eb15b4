#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.hpp"
#include "tools/identity/shell/identity_source.hpp"

namespace ledgerline::identity {
namespace {

namespace fs = std::filesystem;

class APlaceOfAnIdentity : public testing::Test {
 protected:
  void TearDown() override { fs::remove_all(dir_); }
  crypto::Renewal::Pair pair() const {
    const auto made =
        crypto::issue(ca_, {.common_name = "raven", .organization = "", .unit = "client", .sans = {}}).value();
    return {crypto::parse_certificate(made.certificate_pem).value(), made.key_pem, made.certificate_pem};
  }
  static unsigned mode(const fs::path& file) {
    struct stat info {};
    return ::stat(file.c_str(), &info) == 0 ? info.st_mode & 0777U : 0;
  }

  const crypto::KeyAndCertificate ca_ = crypto::make_ca("ca.org1", "org1").value();
  const std::string dir_ = testing::TempDir() + "identity_source" + std::to_string(::getpid());
};

TEST_F(APlaceOfAnIdentity, APairInAFolderIsWholeAtEachMomentOfItsRenewal) {
  const crypto::IdentitySource source{.msp_dir = dir_ + "/msp"};
  EXPECT_TRUE(is_free(source));
  const auto first = pair(), second = pair();
  ASSERT_TRUE(put(source, first));
  EXPECT_FALSE(is_free(source));
  EXPECT_EQ(crypto::read_pair(source.files_now().value())->certificate_pem, first.certificate_pem);
  // Cut off before the certificate: the new key is there, and the old pair counts.
  ASSERT_TRUE(write_file(source.msp_dir + "/keystore/0_sk", second.key_pem, 0600));
  EXPECT_EQ(crypto::read_pair(source.files_now().value())->key_pem, first.key_pem);
  ASSERT_TRUE(put(source, second));
  const auto files = source.files_now().value();
  EXPECT_EQ(crypto::read_pair(files)->key_pem, second.key_pem);
  EXPECT_EQ(mode(files.private_key), 0600U);
  EXPECT_EQ(mode(source.msp_dir + "/keystore"), 0700U);
}

TEST_F(APlaceOfAnIdentity, ACertificateKeepsTheNameThatItHas) {
  const crypto::IdentitySource source{.msp_dir = dir_ + "/msp"};
  const auto first = pair(), second = pair();
  fs::create_directories(source.msp_dir + "/signcerts");
  fs::create_directories(source.msp_dir + "/keystore");
  ASSERT_TRUE(write_file(source.msp_dir + "/signcerts/User1-cert.pem", first.certificate_pem));
  ASSERT_TRUE(write_file(source.msp_dir + "/keystore/priv-key.pem", first.key_pem, 0600));
  ASSERT_TRUE(put(source, second));
  EXPECT_EQ(source.files_now()->certificate, source.msp_dir + "/signcerts/User1-cert.pem");
  EXPECT_TRUE(crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", source.msp_dir));
  EXPECT_FALSE(fs::exists(source.msp_dir + "/keystore/priv-key.pem"));
}

TEST_F(APlaceOfAnIdentity, WhatIsLentIsNobodyElsesAndGoes) {
  std::string folder;
  {
    const auto home = Home::make(dir_ + "/msp");
    ASSERT_TRUE(home) << home.error().message;
    folder = home->text();
    ASSERT_TRUE(home->put_pair(pair()));
    EXPECT_EQ(mode(folder), 0700U);
    EXPECT_TRUE(crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", home->msp()));
  }
  EXPECT_FALSE(fs::exists(folder));
}

}  // namespace
}  // namespace ledgerline::identity
