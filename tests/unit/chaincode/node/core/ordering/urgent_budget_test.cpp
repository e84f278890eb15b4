#include "chaincode/node/core/ordering/budgets.hpp"

#include <gtest/gtest.h>

namespace ledgerline::node {
namespace {

class UrgentBudgetTest : public ::testing::Test {
 protected:
  /// How many of 1,000 more it reserves for one identity of an organisation.
  int reserve_all(const std::string& msp_id, const std::string& who) {
    int taken = 0;
    for (int i = 0; i < 1'000; ++i) taken += reserve(msp_id, who);
    return taken;
  }
  bool reserve(const std::string& msp_id, const std::string& who) {
    return budget.reserve(std::to_string(++ids), {msp_id, who}, now_ns);
  }
  void settle_all(bool valid) {
    for (int id = settled + 1; id <= ids; ++id) budget.settle(std::to_string(id), valid);
    settled = ids;
  }

  CoreConfig config;
  UrgentBudget budget{config};
  TimeNs now_ns = ns_per_s;
  int ids = 0, settled = 0;
};

TEST_F(UrgentBudgetTest, AnIdentityAndItsOrganisationHaveEachTheirBound) {
  EXPECT_EQ(reserve_all("Org3MSP", "one"), 128);
  EXPECT_EQ(reserve_all("Org3MSP", "two"), 128);
  for (int who = 0; who < 10; ++who) reserve_all("Org3MSP", "sybil" + std::to_string(who));
  EXPECT_FALSE(reserve("Org3MSP", "other")) << "512 of the organisation";
  EXPECT_TRUE(reserve("Org1MSP", "pilot"));
}

TEST_F(UrgentBudgetTest, ValidOnesGiveTheirPlaceBackAndOthersDoNot) {
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(reserve_all("Org1MSP", "pilot"), 128);
    settle_all(true);
  }
  reserve_all("Org1MSP", "pilot");
  settle_all(false);
  EXPECT_FALSE(reserve("Org1MSP", "pilot"));
  now_ns += 5 * ns_per_s;
  EXPECT_EQ(reserve_all("Org1MSP", "pilot"), 10) << "two a second are forgiven";
}

TEST_F(UrgentBudgetTest, WhoLosesARaceNowAndThenNeverRunsOut) {
  for (int i = 0; i < 5'000; ++i) {
    now_ns += 500 * ns_per_ms;
    ASSERT_TRUE(reserve("Org1MSP", "pilot"));
    settle_all(false);
  }
}

TEST_F(UrgentBudgetTest, ATransactionHasOnePlaceOnly) {
  EXPECT_TRUE(budget.reserve("tx", {"Org1MSP", "pilot"}, now_ns));
  EXPECT_FALSE(budget.reserve("tx", {"Org1MSP", "pilot"}, now_ns));
  budget.settle("tx", true);
  budget.settle("tx", true);
  budget.settle("another", false);
  EXPECT_EQ(reserve_all("Org1MSP", "pilot"), 128);
}

TEST_F(UrgentBudgetTest, WhatALotOfIdentitiesLeaveBehindIsForgotten) {
  for (int who = 0; who < 20'000; ++who) {
    now_ns += 20 * ns_per_ms;
    budget.reserve(std::to_string(who), {"Org1MSP", std::to_string(who)}, now_ns);
    budget.settle(std::to_string(who), true);
  }
  EXPECT_LE(budget.remembered(), 1'025U);
}

}  // namespace
}  // namespace ledgerline::node
