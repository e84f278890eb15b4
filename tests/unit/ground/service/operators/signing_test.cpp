#include "ground/service/operators/calls.hpp"

#include <gtest/gtest.h>

#include "common/base/enum_count.hpp"

namespace ledgerline::ground::service {
namespace {

using Kind = OperatorCall::Kind;

TEST(OperatorSigning, OfOneWhoHasLeftOnlyThatHeGivesBackIsSigned) {
  for (int i = 0; i < static_cast<int>(enum_count<Kind>); ++i) {
    const Kind kind{i};
    EXPECT_TRUE(check_key({.unlocked = true}, kind)) << i;
    EXPECT_EQ(check_key({.unlocked = true, .left = true}, kind).ok(), kind == Kind::release) << i;
    EXPECT_FALSE(check_key({}, kind)) << "his key is locked: " << i;
    EXPECT_FALSE(check_key({.left = true}, kind)) << i;
  }
}

TEST(OperatorSigning, GroundClearsItsOwnStopForWhoIsRefusedForThatDroneAlone) {
  using Outcome = fabric::Outcome;
  const auto refused = [](const char* words) {
    return Outcome::failed(Outcome::Kind::refused, std::string("chaincode response 500, ") + words);
  };
  EXPECT_TRUE(
      may_clear_ground_stop(refused("tello1: stopped by Org2MSP CN=ground; only they, each its own"), "tello1"));
  EXPECT_FALSE(may_clear_ground_stop(refused("clear_stop: Org2MSP CN=alice is revoked"), "tello1"));
  EXPECT_FALSE(may_clear_ground_stop(refused("tello2: not stopped"), "tello1"));
  EXPECT_FALSE(may_clear_ground_stop(Outcome::failed(Outcome::Kind::unavailable, "nobody answers"), "tello1"));
  Outcome committed;
  committed.kind = Outcome::Kind::committed;
  EXPECT_FALSE(may_clear_ground_stop(committed, "tello1")) << "nothing is left";
}

TEST(OperatorSigning, ACallsOutcomeIsReportedInTheContractsWords) {
  const OperatorCall call{.kind = Kind::acquire, .drone = 0};
  fabric::Outcome outcome;
  outcome.kind = fabric::Outcome::Kind::committed;
  EXPECT_EQ(update_of("alice", call, outcome).words, "alice: take control");
  EXPECT_EQ(update_of("alice", call, outcome).level, Level::info);
  outcome = fabric::Outcome::failed(fabric::Outcome::Kind::unavailable, "nobody answers");
  EXPECT_EQ(update_of("alice", call, outcome).words, "alice: take control: refused: nobody answers");
  EXPECT_EQ(update_of("alice", call, outcome).level, Level::warning);
  outcome.refusal = fabric::ContractRefusal{};
  outcome.refusal->words = "its lease is held by bob";
  EXPECT_EQ(update_of("alice", call, outcome).words, "alice: take control: refused: its lease is held by bob");
  EXPECT_EQ(update_of("alice", call, std::string("the session is over")).words,
            "alice: take control: not signed: the session is over");
}

}  // namespace
}  // namespace ledgerline::ground::service
