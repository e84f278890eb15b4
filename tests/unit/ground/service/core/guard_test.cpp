#include "ground/service/core/guard.hpp"

#include <gtest/gtest.h>

namespace ledgerline::ground::service {
namespace {

class GuardTest : public testing::Test {
 protected:
  const std::string token = std::string(63, 'a') + "b";
  const Guard guard{token, {"127.0.0.1:8800", "localhost:8800"}, false};
  const std::string authorization = "Bearer " + token;
  Guard::Found of_session(std::string_view candidate) const {
    if (candidate == ended) return {.session_ended = true};
    if (candidate == session) return {.session = SignIns::Session{.who = 1, .number = 7}};
    return {};
  }
  Guard::Admission admission_of(const Head& head) const {
    return guard.check(head, [&](std::string_view candidate) { return of_session(candidate); });
  }
  unsigned check(const Head& head) const { return admission_of(head).refused.status; }
  const std::string session = std::string(64, 'c'), ended = std::string(64, 'd');
  Head good() const { return {.host = "127.0.0.1:8800", .origin = "", .authorization = authorization}; }
};

TEST_F(GuardTest, AcceptsTheTokenFromItsOwnPageOrFromNone) {
  EXPECT_EQ(check(good()), 0U);
  Head head = good();
  head.origin = "http://127.0.0.1:8800";
  EXPECT_EQ(check(head), 0U);
  head.host = "localhost:8800";
  head.origin = "http://localhost:8800";
  EXPECT_EQ(check(head), 0U);
  const std::string lower = "bearer " + token;
  head.authorization = lower;
  EXPECT_EQ(check(head), 0U) << "a scheme is read without its case";
}

TEST_F(GuardTest, RefusesAnotherSitesPageAndANameThatWasBoundToThisAddress) {
  for (const char* origin : {"http://evil.example", "http://127.0.0.1:8801", "https://127.0.0.1:8800", "null",
                             "http://127.0.0.1:8800.evil.example", "http://localhost:8800"}) {
    Head head = good();
    head.origin = origin;
    EXPECT_EQ(check(head), 403U) << origin;
    EXPECT_EQ(guard.check_origin(head).status, 403U) << origin;
  }
  for (const char* host : {"", "evil.example", "evil.example:8800", "127.0.0.1", "127.0.0.1:8801"}) {
    Head head = good();
    head.host = host;
    EXPECT_EQ(check(head), 403U) << host;
  }
}

TEST_F(GuardTest, RefusesWhoDoesNotKnowTheWholeToken) {
  for (const std::string& wrong :
       {std::string(), std::string("Bearer "), "Bearer " + token.substr(1), "Bearer " + token + "0",
        "Bearer " + std::string(64, 'a'), token, "Bearer" + token, "Basic " + token}) {
    Head head = good();
    head.authorization = wrong;
    EXPECT_EQ(check(head), 401U) << wrong;
    EXPECT_EQ(guard.check_origin(head).status, 0U) << "the page's files need none";
  }
}

TEST_F(GuardTest, ATokenOfASessionIsItsOperators) {
  const std::string authorization_of_session = "Bearer " + session, list = "ledgerline.v1, token." + session;
  Head head = good();
  EXPECT_FALSE(admission_of(head).session) << "the page's own token is nobody's";
  head.authorization = authorization_of_session;
  ASSERT_TRUE(admission_of(head).session);
  EXPECT_EQ(admission_of(head).session->who, 1U);
  head.origin = "http://evil.example";
  EXPECT_EQ(check(head), 403U);
  EXPECT_FALSE(admission_of(head).session);
  head = {.host = "127.0.0.1:8800", .subprotocols = list, .websocket = true};
  ASSERT_TRUE(admission_of(head).session);
}

TEST_F(GuardTest, ATokenWhoseSessionIsOverIsRefusedAsAnEndedOne) {
  const std::string was = "Bearer " + ended, never = "Bearer " + std::string(64, 'e');
  Head head = good();
  head.authorization = was;
  EXPECT_EQ(check(head), 401U);
  EXPECT_TRUE(admission_of(head).session_ended);
  EXPECT_FALSE(admission_of(head).session);
  head.origin = "http://evil.example";
  EXPECT_EQ(check(head), 403U);
  EXPECT_FALSE(admission_of(head).session_ended) << "another site's page is not heard with it, either";
  head = good();
  head.authorization = never;
  EXPECT_EQ(check(head), 401U);
  EXPECT_FALSE(admission_of(head).session_ended);
}

TEST_F(GuardTest, AStreamNamesTheTokenAmongItsSubprotocolsAndNowhereElse) {
  const std::string list = "ledgerline.v1, token." + token, wrong = "ledgerline.v1, token." + std::string(64, 'a');
  Head head = good();
  head.websocket = true;
  EXPECT_EQ(check(head), 401U);
  head.subprotocols = list;
  head.authorization = "";
  EXPECT_EQ(check(head), 0U);
  head.subprotocols = wrong;
  EXPECT_EQ(check(head), 401U);
  head.subprotocols = ",,, ,";
  EXPECT_EQ(check(head), 401U);
}

TEST(BudgetTest, GivesItsRateAndNoMoreThanASecondOfItAtOnce) {
  Budget budget(10);
  TimeNs now = 100 * ns_per_s;
  int taken = 0;
  while (budget.spend(now)) ++taken;
  EXPECT_EQ(taken, 10);
  for (int i = 0; i < 1000; ++i) taken += budget.spend(now += 10 * ns_per_ms);
  EXPECT_NEAR(taken, 10 + 100, 1);
  EXPECT_FALSE(budget.spend(now - ns_per_s)) << "a clock that goes back gives nothing";
}

}  // namespace
}  // namespace ledgerline::ground::service
