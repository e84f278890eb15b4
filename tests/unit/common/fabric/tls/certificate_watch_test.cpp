#include "common/fabric/tls/certificate_watch.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <condition_variable>
#include <filesystem>
#include <mutex>

#include "common/base/file.hpp"

namespace ledgerline::fabric {
namespace {

namespace fs = std::filesystem;
using Weight = CertificateWatch::Weight;
using std::chrono::milliseconds;

/// A program's identity and TLS pair in files, a watch of them, and what it has reported.
class Watch : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(dir_ + "/msp/signcerts");
    fs::create_directories(dir_ + "/msp/keystore");
    put(issued(ca_, "raven"));
    put_tls(issued(ca_, "raven-host"));
    ledger_.identity_source = {crypto::Library::libcrypto, "Org1MSP", dir_ + "/msp", {}};
    ledger_.identity = crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", dir_ + "/msp").value();
    ledger_.tls_pair = {dir_ + "/tls.crt", dir_ + "/tls.key"};
    ledger_.orderers = {{"127.0.0.1:1", "", "", {}}, {"127.0.0.1:2", "", "", ledger_.tls_pair}};
  }
  void TearDown() override {
    watch_.reset();
    fs::remove_all(dir_);
  }
  static crypto::KeyAndCertificate issued(const crypto::KeyAndCertificate& ca, const std::string& name,
                                          int days = 100) {
    return crypto::issue(ca, {.common_name = name, .organization = "", .unit = "client", .sans = {}, .days = days})
        .value();
  }
  void put(const crypto::KeyAndCertificate& one) const {
    ASSERT_TRUE(replace_file(dir_ + "/msp/keystore/priv_sk", one.key_pem, 0600));
    ASSERT_TRUE(replace_file(dir_ + "/msp/signcerts/cert.pem", one.certificate_pem));
  }
  void put_tls(const crypto::KeyAndCertificate& one) const {
    ASSERT_TRUE(replace_file(dir_ + "/tls.key", one.key_pem, 0600));
    ASSERT_TRUE(replace_file(dir_ + "/tls.crt", one.certificate_pem));
  }
  void watch() {
    watch_ = CertificateWatch::create(
                 ledger_, crypto::make_msp_registry(crypto::Library::libcrypto, {{"Org1MSP", ca_.certificate_pem}}))
                 .value();
    watch_->start(
        [this](Weight weight, const std::string& words) {
          const std::lock_guard lock(mutex_);
          reported_.emplace_back(weight, words);
          changed_.notify_all();
        },
        milliseconds(10));
  }
  /// Its weight, once something with these words is reported, or that a renewal was taken; without a limit of its own:
  /// ctest has one. On a slow disk a look may fall between two files, and that is reported before.
  Weight await(const std::string& words) {
    std::unique_lock lock(mutex_);
    for (;; ++heard_) {
      changed_.wait(lock, [&] { return heard_ < reported_.size(); });
      const std::string& reported = reported_[heard_].second;
      if (reported.find(words) != std::string::npos || reported.find("has a renewed certificate") != std::string::npos)
        return reported_[heard_++].first;
    }
  }
  std::string serialized() const { return ledger_.identity.in_use->now()->serialized; }

  const std::string dir_ = testing::TempDir() + "watch" + std::to_string(::getpid());
  const crypto::KeyAndCertificate ca_ = crypto::make_ca("ca.org1", "org1").value();
  ClientConfig ledger_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::pair<Weight, std::string>> reported_;
  std::size_t heard_ = 0;
  std::unique_ptr<CertificateWatch> watch_;
};

TEST_F(Watch, ARenewedIdentityIsInUseOnceBothFilesAreThere) {
  watch();
  const std::string old = serialized();
  put(issued(ca_, "raven", 200));
  EXPECT_EQ(await("Org1MSP CN=raven,OU=client has a renewed certificate, for "), Weight::info);
  while (serialized() == old) std::this_thread::yield();  // it is reported just before
  EXPECT_EQ(ledger_.identity.serialized, old) << "clients go by what is in use";
}

TEST_F(Watch, APairThatDoesNotFitIsRefusedAndTheOldOneStays) {
  watch();
  const std::string old = serialized();
  ASSERT_TRUE(replace_file(dir_ + "/msp/signcerts/cert.pem", issued(ca_, "raven").certificate_pem));
  EXPECT_EQ(await("keeps its old certificate, what lies on disk is refused: the key "), Weight::alarm);
  EXPECT_EQ(serialized(), old);
  put(issued(ca_, "raven"));
  EXPECT_EQ(await("has a renewed certificate"), Weight::info) << "a better one is taken later";
}

TEST_F(Watch, AnotherSubjectIsRefused) {
  watch();
  const std::string old = serialized();
  put(issued(ca_, "crow"));
  EXPECT_EQ(await("of another subject, CN=crow,OU=client"), Weight::alarm);
  EXPECT_EQ(serialized(), old);
}

TEST_F(Watch, WhatAnotherAuthorityHasSignedIsRefused) {
  watch();
  const std::string old = serialized();
  put(issued(crypto::make_ca("ca.org1", "org1").value(), "raven"));
  EXPECT_EQ(await("it is no member of Org1MSP"), Weight::alarm);
  EXPECT_EQ(serialized(), old);
}

TEST_F(Watch, ARenewedTlsPairCountsOnceForAllThatUseIt) {
  watch();
  put_tls(issued(ca_, "of-any-name"));
  EXPECT_EQ(await("TLS, " + dir_ + "/tls.crt has a renewed certificate, for "), Weight::info);
  while (ledger_.tls_in_use->renewals() == 0) std::this_thread::yield();
  ASSERT_TRUE(replace_file(dir_ + "/tls.key", issued(ca_, "raven-host").key_pem, 0600));
  EXPECT_EQ(await("the certificate is of another key"), Weight::alarm);
  EXPECT_EQ(ledger_.tls_in_use->renewals(), 1U);
}

TEST_F(Watch, TheEndThatComesFirstIsReported) {
  put_tls(issued(ca_, "raven-host", 20));
  watch();
  EXPECT_NEAR(static_cast<double>(watch_->days_left()), 19.5, 0.5);  // by whether the second of its issue is over
  EXPECT_EQ(await("the certificate of TLS, " + dir_ + "/tls.crt ends in "), Weight::warning);
  put(issued(ca_, "raven", 2));
  EXPECT_EQ(await("has a renewed certificate"), Weight::info);
  EXPECT_EQ(await("the certificate of Org1MSP CN=raven,OU=client ends in "), Weight::alarm);
  EXPECT_LE(watch_->days_left(), 2);
}

}  // namespace
}  // namespace ledgerline::fabric
