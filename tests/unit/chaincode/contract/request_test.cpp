#include <gmock/gmock.h>

#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// Two operators' dialogue: who asks for a lease, and what its holder answers.
namespace ledgerline::chaincode {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

class RequestTest : public ContractTest {
 protected:
  RequestTest() { stub.call(pilot, "acquire", {"tello1", "tello2", "priority=5"}); }
  Response answer(const crypto::IdentityName& by, const char* function, const crypto::IdentityName& to,
                  const std::vector<std::string>& drones = {"tello1"}) {
    AnswerCall call;
    for (const std::string& drone : drones) call.add_drones(drone);
    call.mutable_to()->set_msp_id(to.msp_id);
    call.mutable_to()->set_subject(to.subject);
    return stub.call(by, function, call);
  }
  Response request(const crypto::IdentityName& by, const std::string& priority = "0") {
    return stub.call(by, "request", {"tello1", "priority=" + priority});
  }
  std::vector<std::string> requests() {
    std::vector<std::string> names;
    const Control record = control("tello1");
    for (const Request& one : record.requests()) names.push_back(one.who().subject());
    return names;
  }
};

TEST_F(RequestTest, OneTransactionMakesTheRequesterTheHolder) {
  ASSERT_EQ(request(rival, "3").status, 200);
  EXPECT_THAT(stub.writes, SizeIs(1)) << "the holder flies on: nothing that its commands read";
  EXPECT_THAT(requests(), ElementsAre("CN=rival"));
  const std::uint64_t epoch = control("tello1").epoch();
  ASSERT_EQ(answer(pilot, "hand_over", rival).status, 200);
  EXPECT_EQ(stub.event_name, "hand_over");
  const Control after = control("tello1");
  EXPECT_EQ(after.holder().subject(), "CN=rival");
  EXPECT_GT(after.epoch(), epoch);
  EXPECT_EQ(after.priority(), 3U) << "as requested, though it is less than the holder had";
  EXPECT_THAT(requests(), IsEmpty());
  EXPECT_EQ(control("tello2").holder().subject(), "CN=pilot");
}

TEST_F(RequestTest, NobodyIsGivenADroneThatItHasNotRequested) {
  EXPECT_THAT(answer(pilot, "hand_over", rival).message, HasSubstr("has not requested it"));
  request(rival);
  EXPECT_THAT(answer(pilot, "hand_over", rival, {"tello1", "tello2"}).message,
              AllOf(StartsWith("tello2: "), HasSubstr("has not requested it")));
  EXPECT_EQ(control("tello1").holder().subject(), "CN=pilot") << "all of them or none";
  EXPECT_THAT(answer(rival, "hand_over", rival).message, HasSubstr("does not hold the lease"));
  EXPECT_THAT(answer(pilot, "hand_over", other).message, HasSubstr("neither operator nor supervisor"));
}

TEST_F(RequestTest, TheHolderDeniesAndTheRequesterWithdraws) {
  for (const auto& who : {pilot, rival}) {
    request(rival);
    EXPECT_THAT(answer(guard, "deny", rival).message, HasSubstr("may not deny it"));
    EXPECT_EQ(answer(who, "deny", rival).status, 200);
    EXPECT_THAT(requests(), IsEmpty());
    EXPECT_THAT(answer(pilot, "deny", rival).message, HasSubstr("has not requested it"));
    EXPECT_NE(answer(pilot, "hand_over", rival).status, 200);
  }
}

TEST_F(RequestTest, ARequestIsWithinTheGrantAndOfADroneThatSomebodyElseHolds) {
  grant(admin1, {"tello1"}, "Org2MSP", "", true, false, 7);
  EXPECT_THAT(request(rival, "8").message, HasSubstr("has granted Org2MSP CN=rival priorities up to 7, not 8"));
  EXPECT_THAT(request(pilot).message, HasSubstr("holds the lease already"));
  EXPECT_THAT(request(other).message, HasSubstr("neither operator nor supervisor"));
  EXPECT_THAT(request(rival, "x").message, StartsWith("request: priority must be a number"));
  stub.call(pilot, "release", {"tello1"});
  EXPECT_THAT(request(rival).message, HasSubstr("nobody holds the lease; acquire it"));
}

TEST_F(RequestTest, WhatIsNoLongerGrantedIsNotHandedOver) {
  enroll({"Org3MSP", "CN=Admin@org3"}, other, {}, OPERATOR);
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  ASSERT_EQ(request(other).status, 200);
  grant(admin1, {"tello1"}, "Org3MSP", "", false);
  EXPECT_THAT(answer(pilot, "hand_over", other).message, HasSubstr("is not granted it any more"));
}

TEST_F(RequestTest, ANewerRequestReplacesTheOlderAndAnAcquireEndsIt) {
  request(rival, "1");
  request(guard, "2");
  request(rival, "3");
  EXPECT_THAT(requests(), ElementsAre("CN=guard", "CN=rival"));
  stub.call(rival, "acquire", {"tello1", "priority=9"});
  EXPECT_THAT(requests(), ElementsAre("CN=guard"));
}

TEST_F(RequestTest, ADroneHasAsManyRequestsAsTheBoundSays) {
  for (std::size_t i = 0; i <= contract::max_drone_requests; ++i) {
    const crypto::IdentityName who{"Org1MSP", "CN=" + std::to_string(i)};
    enroll(admin1, who, {}, OPERATOR);
    const Response response = request(who);
    EXPECT_EQ(response.status == 200, i < contract::max_drone_requests) << response.message;
  }
  EXPECT_EQ(request(rival).status, 200) << "another organisation's have a bound of their own";
}

}  // namespace
}  // namespace ledgerline::chaincode
