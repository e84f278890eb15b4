#include "ground/service/core/guard.hpp"

#include <gtest/gtest.h>

namespace ledgerline::ground::service {
namespace {

class GuardTest : public testing::Test {
 protected:
  const std::string token = std::string(63, 'a') + "b";
  const Guard guard{token, "127.0.0.1", 8800};
  const std::string authorization = "Bearer " + token;
  Head good() const { return {.host = "127.0.0.1:8800", .origin = "", .authorization = authorization}; }
};

TEST_F(GuardTest, HearsWhoKnowsTheTokenFromItsOwnPageOrFromNone) {
  EXPECT_EQ(guard.check(good()).status, 0U);
  Head head = good();
  head.origin = "http://127.0.0.1:8800";
  EXPECT_EQ(guard.check(head).status, 0U);
  head.host = "localhost:8800";
  head.origin = "http://localhost:8800";
  EXPECT_EQ(guard.check(head).status, 0U);
}

TEST_F(GuardTest, RefusesAnotherSitesPageAndANameThatWasBoundToThisAddress) {
  for (const char* origin : {"http://evil.example", "http://127.0.0.1:8801", "https://127.0.0.1:8800", "null",
                             "http://127.0.0.1:8800.evil.example", "http://localhost:8800"}) {
    Head head = good();
    head.origin = origin;
    EXPECT_EQ(guard.check(head).status, 403U) << origin;
    EXPECT_EQ(guard.check_place(head).status, 403U) << origin;
  }
  for (const char* host : {"", "evil.example", "evil.example:8800", "127.0.0.1", "127.0.0.1:8801"}) {
    Head head = good();
    head.host = host;
    EXPECT_EQ(guard.check(head).status, 403U) << host;
  }
}

TEST_F(GuardTest, RefusesWhoDoesNotKnowTheWholeToken) {
  for (const std::string& wrong :
       {std::string(), std::string("Bearer "), "Bearer " + token.substr(1), "Bearer " + token + "0",
        "Bearer " + std::string(64, 'a'), token, "bearer " + token, "Basic " + token}) {
    Head head = good();
    head.authorization = wrong;
    EXPECT_EQ(guard.check(head).status, 401U) << wrong;
    EXPECT_EQ(guard.check_place(head).status, 0U) << "the page's files need none";
  }
}

TEST_F(GuardTest, AStreamNamesTheTokenAmongItsSubprotocolsAndNowhereElse) {
  const std::string list = "ledgerline.v1, token." + token, wrong = "ledgerline.v1, token." + std::string(64, 'a');
  Head head = good();
  head.websocket = true;
  EXPECT_EQ(guard.check(head).status, 401U);
  head.subprotocols = list;
  head.authorization = "";
  EXPECT_EQ(guard.check(head).status, 0U);
  head.subprotocols = wrong;
  EXPECT_EQ(guard.check(head).status, 401U);
  head.subprotocols = ",,, ,";
  EXPECT_EQ(guard.check(head).status, 401U);
}

TEST(BudgetTest, GivesItsRateAndNoMoreThanASecondOfItAtOnce) {
  Budget budget(10);
  TimeNs now = 100 * ns_per_s;
  int taken = 0;
  while (budget.take(now)) ++taken;
  EXPECT_EQ(taken, 10);
  for (int i = 0; i < 1000; ++i) taken += budget.take(now += 10 * ns_per_ms);
  EXPECT_NEAR(taken, 10 + 100, 1);
  EXPECT_FALSE(budget.take(now - ns_per_s)) << "a clock that goes back gives nothing";
}

}  // namespace
}  // namespace ledgerline::ground::service
