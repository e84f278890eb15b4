
#include <gtest/gtest.h>

#include "common/fabric/calls/outcome.hpp"

namespace ledgerline::fabric {
namespace {

using Kind = Outcome::Kind;

TEST(ContractRefusal, SaysWhatTheContractSaysAndOfWhat) {
  const auto refusal = refusal_in("chaincode response 500, tello3: the lease is held by Org1MSP CN=x");
  ASSERT_TRUE(refusal);
  EXPECT_EQ(refusal->about, "tello3");
  EXPECT_EQ(refusal->words, "tello3: the lease is held by Org1MSP CN=x");
  EXPECT_EQ(refusal_in("chaincode response 500, no drone is named")->about, "");
}

TEST(ContractRefusal, IsTheContractsAlone) {
  for (const char* message : {"", "tello3: not the holder", "the orderer: not ready", "access denied: tello3: no",
                              "chaincode response 404, tello3: no", "chaincode response 500",
                              "chaincode response 500, error in simulation: tello3: timeout expired",
                              "chaincode response 500, unknown function apply_stops; known are set, get"}) {
    EXPECT_FALSE(refusal_in(message)) << message;
  }
}

TEST(ContractRefusal, NamesItsIdAndWhatIsBelowIt) {
  const ContractRefusal drone{"tello3", "tello3: no"}, id{"tello3/odom", "tello3/odom: no"};
  EXPECT_TRUE(names(drone, "tello3"));
  EXPECT_TRUE(names(drone, "tello3/odom"));
  EXPECT_TRUE(names(id, "tello3/odom"));
  for (const char* other : {"tello", "tello30", "tello30/odom", "atello3", "", "x/tello3"})
    EXPECT_FALSE(names(drone, other)) << other;
  EXPECT_FALSE(names(id, "tello3/link"));
  EXPECT_FALSE(names({"", ": no"}, "")) << "of the whole call";
}

TEST(ContractRefusal, AnOutsidersWordsNameNobody) {
  const auto refusal = refusal_in("chaincode response 500, tello1: stopped by Org2MSP CN=a tello2: tello3: b");
  ASSERT_TRUE(refusal);
  EXPECT_TRUE(names(*refusal, "tello1"));
  EXPECT_FALSE(names(*refusal, "tello2"));
  EXPECT_FALSE(names(*refusal, "tello3"));
  const auto nobody = refusal_in("chaincode response 500, CN=x tello2: is not a member");
  EXPECT_FALSE(names(*nobody, "tello2"));
}

TEST(ContractRefusal, AnOutcomeHasItWhereTheContractRefused) {
  const std::string words = "chaincode response 500, tello1: no";
  EXPECT_EQ(Outcome::failed(Kind::refused, words).refusal->about, "tello1");
  EXPECT_EQ(Outcome::failed(Kind::refused, words).message, words);
  EXPECT_FALSE(Outcome::failed(Kind::refused, "the orderer: no").refusal);
  EXPECT_FALSE(Outcome::failed(Kind::unavailable, words).refusal) << "it may still come";
}

}  // namespace
}  // namespace ledgerline::fabric
