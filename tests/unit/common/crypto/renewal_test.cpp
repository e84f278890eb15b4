#include "common/crypto/identities/renewal.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <ctime>
#include <filesystem>

#include "common/base/file.hpp"

namespace ledgerline::crypto {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t end_s = 1'800'000'000;

class RenewalOfACertificate : public testing::Test {
 protected:
  KeyAndCertificate issued(const std::string& name, int days) const {
    return issue(ca_, {.common_name = name, .organization = "", .unit = "client", .sans = {}, .days = days}).value();
  }
  static Result<Renewal::Pair> pair_of(const std::string& key_pem, const std::string& certificate_pem) {
    return Renewal::Pair{parse_certificate(certificate_pem).value(), key_pem, certificate_pem};
  }
  static Result<Renewal::Pair> pair_of(const KeyAndCertificate& one) {
    return pair_of(one.key_pem, one.certificate_pem);
  }
  std::string refusal(const Result<Renewal::Pair>& found, std::int64_t at_s) {
    const Status checked = renewal_.check(found, at_s);
    return checked ? "taken" : checked.error().message;
  }

  const KeyAndCertificate ca_ = make_ca("ca.org1", "org1").value();
  const KeyAndCertificate old_ = issued("raven", 2);
  const std::int64_t now_s_ = std::time(nullptr) + 60;  // days begin at the issue
  Renewal renewal_{"raven", "CN=raven,OU=client", parse_certificate(old_.certificate_pem).value().not_after_s};
};

TEST_F(RenewalOfACertificate, OneOfTheSameSubjectIsTakenAndItsEndCounts) {
  EXPECT_EQ(renewal_.days_left(now_s_), 1);
  EXPECT_EQ(refusal(pair_of(issued("raven", 100)), now_s_), "taken");
  EXPECT_EQ(renewal_.days_left(now_s_), 99);
}

TEST_F(RenewalOfACertificate, APairThatDoesNotBelongTogetherIsRefused) {
  EXPECT_EQ(refusal(pair_of(old_.key_pem, issued("raven", 100).certificate_pem), now_s_),
            "the certificate is of another key");
  EXPECT_EQ(renewal_.days_left(now_s_), 1) << "the old one goes on";
}

TEST_F(RenewalOfACertificate, OneOfAnotherSubjectIsRefused) {
  EXPECT_NE(refusal(pair_of(issued("crow", 100)), now_s_).find("of another subject, CN=crow,OU=client"),
            std::string::npos);
  Renewal any("TLS", "", end_s);
  EXPECT_TRUE(any.check(pair_of(issued("crow", 100)), now_s_));
}

TEST_F(RenewalOfACertificate, OneThatHasEndedOrNotBegunIsRefused) {
  EXPECT_EQ(refusal(pair_of(issued("raven", 2)), now_s_ + 3 * day_s), "it has ended already");
  EXPECT_NE(refusal(pair_of(issued("raven", 2)), now_s_ - 10 * day_s).find("not valid yet"), std::string::npos);
}

TEST_F(RenewalOfACertificate, TheOneInUseStaysTakenAtItsEndWhereOtherFilesChange) {
  const Renewal::Pair own = pair_of(issued("raven", 2)).value();
  renewal_.begin(own);
  EXPECT_EQ(refusal(own, now_s_ + 3 * day_s), "taken");
  EXPECT_EQ(refusal(pair_of(issued("raven", 2)), now_s_ + 3 * day_s), "it has ended already");
}

TEST_F(RenewalOfACertificate, OneThatIsNotValidYetIsDueOnceWhenItBecomesSo) {
  const auto next = pair_of(issued("raven", 100));
  const std::int64_t begins_s = next->certificate.not_before_s;
  EXPECT_FALSE(renewal_.pop_recheck(begins_s));
  EXPECT_NE(refusal(next, begins_s - 60).find("not valid yet, for another 60 s"), std::string::npos);
  EXPECT_FALSE(renewal_.pop_recheck(begins_s - 1));
  EXPECT_TRUE(renewal_.pop_recheck(begins_s));
  EXPECT_FALSE(renewal_.pop_recheck(begins_s)) << "once";
  EXPECT_EQ(refusal(next, begins_s), "taken");
}

TEST_F(RenewalOfACertificate, WhatIsRefusedForAnotherReasonIsNotDueAgain) {
  const auto next = pair_of(issued("raven", 100));
  (void)refusal(next, next->certificate.not_before_s - 60);
  (void)refusal(pair_of(issued("crow", 100)), now_s_);
  EXPECT_FALSE(renewal_.pop_recheck(now_s_ + day_s));
}

TEST_F(RenewalOfACertificate, WhatCannotBeReadIsRefusedInItsWords) {
  EXPECT_EQ(refusal(Error{"cannot open cert.pem"}, now_s_), "cannot open cert.pem");
}

TEST(EndOfACertificate, IsCountedInWholeDays) {
  EXPECT_EQ(days_left(end_s, end_s - day_s), 1);
  EXPECT_EQ(days_left(end_s, end_s - day_s + 1), 0);
  EXPECT_EQ(days_left(end_s, end_s), 0);
  EXPECT_EQ(days_left(end_s, end_s + 1), -1);
  EXPECT_EQ(days_left(end_s, end_s + day_s + 1), -2);
  EXPECT_EQ(ends(end_s, end_s - 30 * day_s), Ends::later);
  EXPECT_EQ(ends(end_s, end_s - 30 * day_s + 1), Ends::soon);
  EXPECT_EQ(ends(end_s, end_s - 3 * day_s), Ends::soon);
  EXPECT_EQ(ends(end_s, end_s - 3 * day_s + 1), Ends::urgent);
  EXPECT_EQ(ends(end_s, end_s + 1), Ends::over);
}

TEST(EndOfACertificate, IsReportedOnceADayFromAMonthBefore) {
  Renewal renewal("raven", "CN=raven", end_s);
  EXPECT_FALSE(renewal.pop_end_notice(end_s - 31 * day_s));
  const auto first = renewal.pop_end_notice(end_s - 30 * day_s + 1);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->words, "the certificate of raven ends in 29 days");
  EXPECT_EQ(first->weight, Renewal::Weight::warning);
  EXPECT_FALSE(renewal.pop_end_notice(end_s - 30 * day_s + 2)) << "the same day";
  EXPECT_TRUE(renewal.pop_end_notice(end_s - 29 * day_s + 1));
}

TEST(EndOfACertificate, WeighsMoreInTheLastThreeDaysAndBehindIt) {
  Renewal renewal("raven", "CN=raven", end_s);
  EXPECT_EQ(renewal.pop_end_notice(end_s - 3 * day_s)->weight, Renewal::Weight::warning);
  const auto near = renewal.pop_end_notice(end_s - 2 * day_s + 1);
  EXPECT_EQ(near->weight, Renewal::Weight::alarm);
  EXPECT_EQ(near->words, "the certificate of raven ends in 47 hours");
  const auto last = renewal.pop_end_notice(end_s - 5 * 3'600);
  EXPECT_EQ(last->weight, Renewal::Weight::alarm);
  EXPECT_EQ(last->words, "the certificate of raven ends in 5 hours");
  const auto over = renewal.pop_end_notice(end_s + 1);
  EXPECT_EQ(over->weight, Renewal::Weight::alarm);
  EXPECT_EQ(over->words, "the certificate of raven has ended");
}

// As a renewal with a new key leaves a folder for a moment, or for good when it is cut off.
TEST_F(RenewalOfACertificate, OfSeveralKeysInAFolderTheOneThatFitsCounts) {
  const std::string dir = testing::TempDir() + "renewal" + std::to_string(::getpid());
  fs::create_directories(dir + "/signcerts");
  fs::create_directories(dir + "/keystore");
  const KeyAndCertificate next = issued("raven", 100);
  ASSERT_TRUE(write_file(dir + "/keystore/a_sk", old_.key_pem, 0600));
  ASSERT_TRUE(write_file(dir + "/keystore/b_sk", next.key_pem, 0600));
  for (const KeyAndCertificate& one : {old_, next}) {
    ASSERT_TRUE(write_file(dir + "/signcerts/cert.pem", one.certificate_pem));
    const auto loaded = load_identity(Library::libcrypto, "Org1MSP", dir);
    ASSERT_TRUE(loaded) << loaded.error().message;
    EXPECT_EQ(read_serialized(loaded->serialized).value().certificate.not_after_s,
              parse_certificate(one.certificate_pem).value().not_after_s);
  }
  ASSERT_TRUE(write_file(dir + "/signcerts/cert.pem", issued("raven", 3).certificate_pem));
  EXPECT_NE(load_identity(Library::libcrypto, "Org1MSP", dir).error().message.find("does not belong"),
            std::string::npos);
  fs::remove_all(dir);
}

}  // namespace
}  // namespace ledgerline::crypto
