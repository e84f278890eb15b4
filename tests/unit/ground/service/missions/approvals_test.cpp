#include "ground/service/missions/approvals.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/access/access.hpp"
#include "common/msg/contract.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground::service {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

const crypto::IdentityName first{"Org2MSP", "CN=first"}, second{"Org2MSP", "CN=second"};

Anchor anchor_of(const crypto::IdentityName& signer, const std::string& what) {
  Anchor anchor;
  *anchor.mutable_signer() = to_message(signer);
  anchor.set_what(what);
  return anchor;
}

TEST(MissionApprovals, AreOfOperatorsAndSupervisors) {
  verification::RolesByOrganisation roles;
  roles.apply({to_message(first), OPERATOR});
  roles.apply({to_message(second), SUPERVISOR});
  roles.apply({to_message(outsider_name), AUDITOR});
  Anchors anchors;
  *anchors.add_anchors() = anchor_of(first, "mission survey may be flown");
  *anchors.add_anchors() = anchor_of(second, "mission survey may be flown");
  *anchors.add_anchors() = anchor_of(outsider_name, "mission survey may be flown");
  *anchors.add_anchors() = anchor_of(host_name, "mission survey may be flown");
  EXPECT_THAT(operators_in(anchors, roles), ElementsAre(first, second));
  roles.apply({to_message(first), ROLE_NONE});
  EXPECT_THAT(operators_in(anchors, roles), ElementsAre(second)) << "a role that was taken";
}

TEST(MissionApprovals, AreAskedForByTheKeysOfThoseWhoMayApprove) {
  verification::RolesByOrganisation roles;
  EXPECT_THAT(approval_questions("digest", roles), IsEmpty()) << "nobody may";
  for (int i = 0; i < 70; ++i) roles.apply({to_message({"Org2MSP", "CN=" + std::to_string(i)}), OPERATOR});
  roles.apply({to_message(first), SUPERVISOR});
  roles.apply({to_message(second), AUDITOR});
  const auto calls = approval_questions("digest", roles);
  ASSERT_EQ(calls.size(), 2U);
  EXPECT_EQ(calls[0].signers_size(), 64) << "as many as a verify answers";
  EXPECT_EQ(calls[1].signers_size(), 7);
  for (const AnchorCall& call : calls) {
    EXPECT_EQ(call.digest(), "digest");
    for (const Identity& one : call.signers()) EXPECT_NE(one.subject(), second.subject);
  }
}

TEST(MissionApprovals, AreReadAgainForABlockThatChangesARole) {
  fabric::Block block;
  for (const char* function : {contract::enroll, contract::revoke}) {
    block.transactions = {event("set", ""), event(function, "")};
    EXPECT_TRUE(changes_roles(block)) << function;
    block.transactions[1].code = 11;
    EXPECT_FALSE(changes_roles(block)) << "it is not valid";
  }
  block.transactions = {event(contract::anchor, ""), event(contract::acquire, "")};
  EXPECT_FALSE(changes_roles(block));
}

TEST(MissionApprovals, AreReadAgainForABlockThatAnchorsTheirDigest) {
  MissionBook book({}, operator_name);
  auto run = mission::MissionRun::make(
      {"survey", {{.drone = "tello1", .start_m = {}, .waypoints = {{{1, 2}, 1.0}, {{1, 3}, 1.0}}}}}, {});
  ASSERT_TRUE(run) << run.error().message;
  const auto id = book.add(std::move(*run));
  ASSERT_TRUE(id) << id.error().message;
  AnchorCall call;
  const ApprovalTerms terms(operator_name, 86'400);
  const auto concerned = [&](const fabric::Block& of) { return anchored_in(of, book, terms, 1'790'000'000); };
  fabric::Block block;
  for (const auto& [approval, withdrawal] : terms.now(book.digest(*id), 1'790'000'000)) {
    for (const crypto::Digest& digest : {approval, withdrawal}) {
      call.set_digest(std::string(digest.begin(), digest.end()));
      block.transactions = {event(contract::anchor, call.SerializeAsString())};
      EXPECT_THAT(concerned(block), ElementsAre(*id));
    }
  }
  block.transactions[0].code = 11;
  EXPECT_THAT(concerned(block), IsEmpty()) << "it is not valid";
  call.set_digest(std::string(32, 'x'));
  block.transactions = {event(contract::anchor, call.SerializeAsString()), event(contract::anchor, "no call"),
                        event("set", "")};
  EXPECT_THAT(concerned(block), IsEmpty());
}

TEST(MissionApprovals, ThatCouldNotBeReadAreAskedForAgainAfterAWhile) {
  Unread unread;
  EXPECT_TRUE(unread.empty());
  unread.add("a", 0);
  unread.add("b", ns_per_s);
  EXPECT_THAT(unread.pop_due(Unread::again_ns - 1), IsEmpty());
  EXPECT_THAT(unread.pop_due(Unread::again_ns), ElementsAre("a"));
  EXPECT_THAT(unread.pop_due(Unread::again_ns), IsEmpty()) << "once";
  EXPECT_THAT(unread.pop_due(Unread::again_ns + ns_per_s), ElementsAre("b"));
  EXPECT_TRUE(unread.empty());
}

TEST(MissionApprovals, WhatWasNotCheckedIsNotStarted) { EXPECT_TRUE(not_checked().forbids); }

}  // namespace
}  // namespace ledgerline::ground::service
