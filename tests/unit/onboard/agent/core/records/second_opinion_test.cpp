#include "onboard/agent/core/records.hpp"

#include <gtest/gtest.h>

#include "common/access/stops.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace ledgerline::agent {
namespace {

FirstRecords records(std::uint64_t epoch = 5) {
  FirstRecords out;
  out.controls = {testing::control("tello1", epoch), testing::control("tello2", 6)};
  out.roles.apply({to_message(testing::LedgerOfTests::operator_name()), OPERATOR});
  return out;
}

TEST(SecondOpinionTest, WhoAgreesIsNeverAnAlarm) {
  SecondOpinion opinion;
  for (std::uint64_t epoch = 1; epoch < 100; ++epoch) {
    const auto verdict = opinion.compare(records(epoch), records(epoch));
    EXPECT_TRUE(verdict.alarms.empty() && verdict.cleared.empty() && !verdict.again_soon);
  }
  EXPECT_EQ(opinion.alarms(), 0U);
  EXPECT_EQ(opinion.comparisons(), 99U);
  EXPECT_TRUE(SecondOpinion::differences(records(), records()).empty());
}

TEST(SecondOpinionTest, AnotherCommanderIsADifference) {
  FirstRecords theirs = records();
  *theirs.controls[0].mutable_delegate() = to_message({"Org2MSP", "CN=station"});
  const auto different = SecondOpinion::differences(records(), theirs);
  ASSERT_EQ(different.size(), 1U);
  EXPECT_NE(different[0].theirs.find("commanded by Org2MSP CN=station"), std::string::npos);
}

TEST(SecondOpinionTest, ADifferenceOnceIsOnlyAskedAboutSoon) {
  SecondOpinion opinion;
  EXPECT_TRUE(opinion.compare(records(5), records(4)).again_soon);
  const auto agreed = opinion.compare(records(5), records(5));
  EXPECT_TRUE(agreed.alarms.empty() && agreed.cleared.empty() && !agreed.again_soon);
  EXPECT_FALSE(opinion.differs());
}

TEST(SecondOpinionTest, APeerThatFollowsABlockBehindIsNoAlarm) {
  SecondOpinion opinion;
  for (std::uint64_t epoch = 1; epoch < 100; ++epoch) {
    const auto verdict = opinion.compare(records(epoch + 1), records(epoch));
    EXPECT_TRUE(verdict.alarms.empty() && verdict.again_soon);
  }
  EXPECT_EQ(opinion.alarms(), 0U);
}

TEST(SecondOpinionTest, ALastingDifferenceIsOneAlarmUntilThereIsAgreement) {
  SecondOpinion opinion;
  (void)opinion.compare(records(5), records(4));
  const auto verdict = opinion.compare(records(5), records(4));
  ASSERT_EQ(verdict.alarms.size(), 1U);
  EXPECT_EQ(verdict.alarms[0].what, "tello1");
  EXPECT_NE(verdict.alarms[0].ours.find("epoch 5"), std::string::npos);
  EXPECT_NE(verdict.alarms[0].theirs.find("epoch 4"), std::string::npos);
  EXPECT_TRUE(opinion.differs());
  for (std::uint64_t epoch = 6; epoch < 20; ++epoch)
    EXPECT_TRUE(opinion.compare(records(epoch), records(4)).alarms.empty()) << "it is reported once";
  EXPECT_EQ(opinion.compare(records(5), records(5)).cleared, std::vector<std::string>{"tello1"});
  EXPECT_FALSE(opinion.differs());
  (void)opinion.compare(records(5), records(4));
  EXPECT_EQ(opinion.compare(records(5), records(4)).alarms.size(), 1U);
  EXPECT_EQ(opinion.alarms(), 2U);
}

TEST(SecondOpinionTest, AStopARoleOrADroneThatOneSideDoesNotHaveIsADifference) {
  FirstRecords stopped = records(), promoted = records(), fewer = records();
  add_stop(stopped.controls[1], testing::stop_of("tello2"));
  promoted.roles.apply({to_message(testing::LedgerOfTests::operator_name()), SUPERVISOR});
  fewer.controls.pop_back();
  for (const auto& [other, what] :
       {std::pair(stopped, "tello2"), std::pair(promoted, "roles"), std::pair(fewer, "tello2")}) {
    SecondOpinion opinion;
    (void)opinion.compare(records(), other);
    const auto verdict = opinion.compare(records(), other);
    ASSERT_EQ(verdict.alarms.size(), 1U) << what;
    EXPECT_EQ(verdict.alarms[0].what, what);
    const auto now = SecondOpinion::differences(records(), other);
    ASSERT_EQ(now.size(), 1U) << what;
    EXPECT_EQ(now[0].text(), verdict.alarms[0].text());
  }
}

TEST(SecondOpinionTest, OfOrganisationsThatOneSideDoesNotFollowOrHasLeftOutNothingIsCompared) {
  const crypto::IdentityName far{"Org3MSP", "CN=far"};
  FirstRecords followed = records(), left_out = records();
  followed.roles.apply({to_message(far), OPERATOR});
  EXPECT_TRUE(SecondOpinion::differences(records(), followed).empty()) << "granted since, and not read here yet";
  left_out.roles.follow("Org3MSP");
  EXPECT_EQ(SecondOpinion::differences(left_out, followed).size(), 1U) << "followed, and without that role";
  left_out.roles.exclude("Org3MSP");
  EXPECT_TRUE(SecondOpinion::differences(left_out, followed).empty());
  EXPECT_TRUE(SecondOpinion::differences(followed, left_out).empty());
}

TEST(SecondOpinionTest, ARoleThatIsNoneIsAsGoodAsNoRole) {
  FirstRecords other = records();
  other.roles.apply({to_message({"Org3MSP", "CN=host"}), ROLE_NONE});
  SecondOpinion opinion;
  EXPECT_FALSE(opinion.compare(records(), other).again_soon);
}

}  // namespace
}  // namespace ledgerline::agent
