#include "ground/service/missions/approvals.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace ledgerline::ground::service {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const crypto::IdentityName anna{"Org2MSP", "CN=anna"}, bob{"Org2MSP", "CN=bob"}, ground{"Org2MSP", "CN=ground"};
constexpr std::int64_t day_s = 86'400;

TEST(ApprovalTerms, AnApprovalIsOfOneMissionAtOneGroundAndOfNothingElse) {
  const crypto::Digest mission = crypto::sha256("survey");
  std::set<crypto::Digest> all;
  const auto add = [&](const ApprovalTerms& terms, const crypto::Digest& of, std::int64_t now_s) {
    for (const auto& [approval, withdrawal] : terms.now(of, now_s)) {
      all.insert(approval);
      all.insert(withdrawal);
    }
  };
  add({ground, day_s}, mission, 10 * day_s);
  EXPECT_EQ(all.size(), 4U);
  add({ground, day_s}, mission, 10 * day_s);
  EXPECT_EQ(all.size(), 4U) << "the same for the same";
  add({anna, day_s}, mission, 10 * day_s);
  EXPECT_EQ(all.size(), 8U);
  add({{"Org2MSP\nCN=ground", ""}, day_s}, mission, 10 * day_s);
  EXPECT_EQ(all.size(), 12U);
  add({ground, day_s}, crypto::sha256("another"), 10 * day_s);
  EXPECT_EQ(all.size(), 16U);
  EXPECT_FALSE(all.contains(mission)) << "who anchors a mission's text approves nothing";
}

TEST(ApprovalTerms, AnApprovalEndsBetweenHalfOfItsTimeAndTheWholeOfIt) {
  const ApprovalTerms terms(ground, day_s);
  const crypto::Digest mission = crypto::sha256("survey");
  for (std::int64_t given_s = 100 * day_s; given_s < 101 * day_s; given_s += day_s / 24) {
    const crypto::Digest given = terms.now(mission, given_s)[0].approval;
    const auto counts = [&](std::int64_t at_s) {
      const auto now = terms.now(mission, at_s);
      return now[0].approval == given || now[1].approval == given;
    };
    EXPECT_TRUE(counts(given_s + day_s / 2));
    EXPECT_FALSE(counts(given_s + day_s));
    EXPECT_FALSE(counts(given_s - day_s / 2 - 1)) << "nor before it was given";
  }
}

TEST(ApprovalTerms, AWithdrawalEndsWhatWasApprovedBeforeItAndNobodyElses) {
  EXPECT_THAT(standing_approvals(std::vector<PeriodSigners>{{{anna}, {}}, {{anna, bob}, {}}}), ElementsAre(anna, bob));
  EXPECT_THAT(standing_approvals(std::vector<PeriodSigners>{{{}, {anna}}, {{anna, bob}, {}}}), ElementsAre(bob));
  EXPECT_THAT(standing_approvals(std::vector<PeriodSigners>{{{anna}, {anna}}, {}}), IsEmpty());
  EXPECT_THAT(standing_approvals(std::vector<PeriodSigners>{{{anna}, {}}, {{anna}, {anna}}}), ElementsAre(anna))
      << "approved again since";
}

TEST(ApprovalTerms, SaysWhereAndUntilWhenWithinAnAnchorsBound) {
  const ApprovalTerms terms(ground, day_s);
  EXPECT_EQ(terms.approval_words("survey", 1'790'000'000),
            "mission survey may be flown until 2026-09-22T12:00:00Z at Org2MSP CN=ground");
  EXPECT_THAT(terms.withdrawal_words("survey"), HasSubstr("may not be flown any more at Org2MSP CN=ground"));
  const ApprovalTerms maximal({std::string(64, 'M'), std::string(1'024, 'x')}, day_s);
  EXPECT_LE(maximal.approval_words(std::string(64, 'm'), 1'790'000'000).size(), 256U);
}

}  // namespace
}  // namespace ledgerline::ground::service
