#include <gmock/gmock.h>

#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// Who hammers against evict, grant, release and clear_stop: ten transactions a block, of which the evictor has one.
namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;

constexpr std::size_t max_blocks = 5;

class ClaimConflicts : public ::testing::Test {
 protected:
  ClaimConflicts() {
    net.config.batch_count = 10;
    net.restart();
    submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"}));
    submit(net.admin1, "enroll", enroll_call(chief.name, {}, SUPERVISOR));
    submit(net.admin1, "grant", grant_call("Org2MSP", {"tello1"}));
    submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
    submit(net.admin2, "enroll", enroll_call(rival.name, {}, OPERATOR));
    submit(net.pilot, "acquire", "tello1");
  }

  /// What is endorsed is ordered; false: it was refused.
  bool order(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    const Reply endorsed = net.core->endorse(net.propose(who, function, arg).signed_proposal, net.now);
    if (endorsed.code != Code::ok) return false;
    EXPECT_EQ(net.core->order(*fabric::sign_envelope(who, endorsed.bytes), net.now).code, Code::ok);
    return true;
  }
  std::vector<int> commit() {
    net.now.monotonic_ns += ns_per_s;
    return net.commit();
  }
  void submit(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    ASSERT_TRUE(order(who, function, arg)) << function;
    ASSERT_THAT(commit(), ElementsAre(protos::VALID)) << function;
  }

  /// Nine that change the lease or its requests: they come before the evictor's one in each block. `acquires`: some are
  /// the holder's own.
  bool acquires = true;
  void hammer() {
    for (int i = 0; i < 9; ++i) {
      LeaseCall lease;
      lease.add_drones("tello1");
      lease.set_priority(static_cast<std::uint32_t>(++hammered));
      AnswerCall answer;
      answer.add_drones("tello1");
      answer.mutable_to()->set_msp_id("Org2MSP");
      answer.mutable_to()->set_subject(rival.name.subject);
      switch (acquires ? i % 3 : 1 + i % 2) {
        case 0:
          lease.mutable_delegate()->set_msp_id("Org2MSP");
          lease.mutable_delegate()->set_subject("CN=station" + std::to_string(hammered % 2));
          order(net.pilot, "acquire", lease.SerializeAsString());
          break;
        case 1:
          order(rival, "request", lease.SerializeAsString());
          break;
        default:
          order(rival, "deny", answer.SerializeAsString());
      }
    }
  }

  /// As ledgerline control does it: what another made invalid is said again, behind a claim. In how many blocks it was
  /// valid; 0: in none of twenty.
  std::size_t blocks_until_valid(const crypto::SigningIdentity& who, const std::string& function,
                                 const std::string& arg, bool claims) {
    bool claimed = false;
    for (std::size_t block = 1; block <= 20;) {
      hammer();
      const bool ordered = order(who, function, arg);
      EXPECT_TRUE(ordered) << function;
      const auto codes = commit();
      if (ordered && codes.back() == protos::VALID) return block;
      ++block;
      if (!claims || std::exchange(claimed, true)) continue;
      hammer();
      EXPECT_TRUE(order(who, "claim", "tello1"));
      EXPECT_EQ(commit().back(), protos::VALID) << "a claim loses to nobody";
      ++block;
    }
    return 0;
  }
  void expect_through(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg) {
    EXPECT_EQ(blocks_until_valid(who, function, arg, false), 0U) << function << ": nobody hammered";
    const std::size_t blocks = blocks_until_valid(who, function, arg, true);
    EXPECT_GE(blocks, 1U) << function;
    EXPECT_LE(blocks, max_blocks) << function;
    submit(rival, "request", "tello1");  // the claim is over with it
  }

  FakeNetwork net;
  int hammered = 0;
  const crypto::SigningIdentity rival = crypto::make_test_identity({"Org2MSP", "CN=rival"});
  const crypto::SigningIdentity chief = crypto::make_test_identity({"Org1MSP", "CN=chief"});
};

TEST_F(ClaimConflicts, AnEvictionIsOnTheLedgerWithinFiveBlocksWhateverItsHolderDoes) {
  EXPECT_EQ(blocks_until_valid(chief, "evict", "tello1", false), 0U) << "nobody hammered";
  const std::size_t blocks = blocks_until_valid(chief, "evict", "tello1", true);
  EXPECT_GE(blocks, 1U);
  EXPECT_LE(blocks, max_blocks);
  submit(rival, "acquire", "tello1");  // the claim is over with it
}

TEST_F(ClaimConflicts, SoIsClearStopByASupervisor) {
  submit(net.pilot, "stop", "tello1");
  expect_through(chief, "clear_stop", "tello1");
}

TEST_F(ClaimConflicts, SoIsTheEndOfAGrantAndTheHolderIsGoneWithIt) {
  GrantCall none;
  none.add_drones("tello1");
  none.mutable_grant()->mutable_to()->set_msp_id("Org2MSP");
  const std::string withdrawn = none.SerializeAsString();
  EXPECT_EQ(blocks_until_valid(net.admin1, "grant", withdrawn, false), 0U) << "nobody hammered";
  const std::size_t blocks = blocks_until_valid(net.admin1, "grant", withdrawn, true);
  EXPECT_GE(blocks, 1U);
  EXPECT_LE(blocks, max_blocks);
  EXPECT_FALSE(order(net.pilot, "acquire", "tello1"));
}

TEST_F(ClaimConflicts, SoIsAReleaseOfAHolderOfAnotherOrganisation) {
  acquires = false;
  EXPECT_EQ(blocks_until_valid(net.pilot, "release", "tello1", false), 0U) << "nobody hammered";
  const std::size_t blocks = blocks_until_valid(net.pilot, "release", "tello1", true);
  EXPECT_GE(blocks, 1U);
  EXPECT_LE(blocks, max_blocks);
  submit(rival, "acquire", "tello1");
  submit(net.pilot, "request", "tello1");  // the claim is over with the lease
}

TEST_F(ClaimConflicts, SoIsAHoldersClearOfItsOwnStopAndItsClaimIsOver) {
  acquires = false;
  submit(net.pilot, "stop", "tello1");
  expect_through(net.pilot, "clear_stop", "tello1");
}

TEST_F(ClaimConflicts, AHolderWhoClaimsAllTheTimeIsEvicted) {
  submit(chief, "claim", "tello1");
  for (int i = 0; i < 9; ++i) EXPECT_TRUE(order(net.pilot, i % 2 == 0 ? "claim" : "unclaim", "tello1"));
  EXPECT_TRUE(order(chief, "evict", "tello1"));
  EXPECT_EQ(commit().back(), protos::VALID);
}

TEST_F(ClaimConflicts, AHoldersClaimDoesNothingElseInItsPlace) {
  submit(net.pilot, "claim", "tello1");
  EXPECT_FALSE(order(net.pilot, "clear_stop", "tello1")) << "it is not stopped";
  EXPECT_FALSE(order(net.pilot, "evict", "tello1"));
  submit(chief, "evict", "tello1");
  EXPECT_FALSE(order(net.pilot, "evict", "tello1"));
}

TEST_F(ClaimConflicts, AHoldersClaimKeepsOffRequestsAndDenialsAloneAndEndsWithItsLease) {
  submit(rival, "request", "tello1");
  submit(net.pilot, "claim", "tello1");
  EXPECT_FALSE(order(rival, "request", "tello1"));
  AnswerCall answer;
  answer.add_drones("tello1");
  answer.mutable_to()->set_msp_id("Org2MSP");
  answer.mutable_to()->set_subject(rival.name.subject);
  EXPECT_FALSE(order(rival, "deny", answer.SerializeAsString()));
  LeaseCall higher;
  higher.add_drones("tello1");
  higher.set_priority(5);
  submit(rival, "acquire", higher.SerializeAsString());  // by its priority, whatever the holder has claimed
  submit(net.pilot, "request", "tello1");
  submit(rival, "release", "tello1");
  submit(net.pilot, "acquire", "tello1");  // of another epoch: its old claim is over
  submit(rival, "request", "tello1");
}

TEST_F(ClaimConflicts, AHolderEndsItsOwnClaimAndNoOther) {
  submit(net.pilot, "claim", "tello1");
  EXPECT_FALSE(order(rival, "request", "tello1"));
  submit(net.pilot, "unclaim", "tello1");
  submit(rival, "request", "tello1");
  submit(chief, "claim", "tello1");
  submit(net.pilot, "unclaim", "tello1");
  EXPECT_FALSE(order(rival, "request", "tello1")) << "the owner's claim stands";
  submit(net.pilot, "claim", "tello1");
  submit(chief, "unclaim", "tello1");
  submit(rival, "request", "tello1");
}

TEST_F(ClaimConflicts, WhileItStandsTheHolderFliesOnAndIsStopped) {
  submit(chief, "claim", "tello1");
  EXPECT_FALSE(order(rival, "request", "tello1"));
  submit(net.pilot, "stop", "tello1");
  submit(net.pilot, "release", "tello1");
  EXPECT_FALSE(order(rival, "acquire", "tello1"));
  submit(chief, "unclaim", "tello1");
  submit(rival, "acquire", "tello1");
}

TEST_F(ClaimConflicts, OnlyTheOwnersOrganisationAndTheHolderMayClaim) {
  for (const auto* who : {&rival, &net.admin2}) EXPECT_FALSE(order(*who, "claim", "tello1"));
  EXPECT_FALSE(order(crypto::make_test_identity({"Org1MSP", "CN=member"}), "claim", "tello1"));
  for (const auto* who : {&chief, &net.admin1, &net.host}) EXPECT_TRUE(order(*who, "claim", "tello1"));
  for (const int code : commit()) EXPECT_EQ(code, protos::VALID);
  EXPECT_FALSE(order(rival, "unclaim", "tello1"));
}

TEST_F(ClaimConflicts, AClaimOverWhichTheHolderLeftIsEndedByTheEvictionThatItWasFor) {
  submit(chief, "claim", "tello1");
  submit(net.pilot, "release", "tello1");
  submit(chief, "evict", "tello1");
  EXPECT_FALSE(order(chief, "evict", "tello1")) << "without a claim there is nothing to evict";
  submit(rival, "acquire", "tello1");
}

}  // namespace
}  // namespace ledgerline::node
