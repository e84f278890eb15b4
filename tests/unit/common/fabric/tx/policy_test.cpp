#include "common/fabric/tx/policy.hpp"

#include <gtest/gtest.h>

#include "common/policies.pb.h"
#include "msp/msp_principal.pb.h"

namespace ledgerline::fabric {
namespace {

const PolicySigner peer1{"Org1MSP", true}, peer2{"Org2MSP", true}, client1{"Org1MSP", false};

TEST(Policy, APeerOfTheOrganisationAndNobodyElse) {
  const std::string policy = peer_policy("Org1MSP");
  EXPECT_TRUE(satisfies(policy, {peer1}));
  EXPECT_TRUE(satisfies(policy, {peer2, peer1}));
  EXPECT_FALSE(satisfies(policy, {peer2}));
  EXPECT_FALSE(satisfies(policy, {client1}));
  EXPECT_FALSE(satisfies(policy, {}));
}

common::SignaturePolicyEnvelope two_of(const std::vector<std::string>& msp_ids) {
  common::SignaturePolicyEnvelope policy;
  policy.mutable_rule()->mutable_n_out_of()->set_n(2);
  for (const std::string& msp_id : msp_ids) {
    common::SignaturePolicyEnvelope one;
    one.ParseFromString(peer_policy(msp_id));
    policy.mutable_rule()->mutable_n_out_of()->add_rules()->set_signed_by(policy.identities_size());
    *policy.add_identities() = one.identities(0);
  }
  return policy;
}

TEST(Policy, EachEndorserCountsOnce) {
  const std::string same = two_of({"Org1MSP", "Org1MSP"}).SerializeAsString();
  EXPECT_FALSE(satisfies(same, {peer1}));
  EXPECT_TRUE(satisfies(same, {peer1, peer1}));
  EXPECT_TRUE(satisfies(two_of({"Org1MSP", "Org2MSP"}).SerializeAsString(), {peer2, peer1}));
}

TEST(Policy, WhatCannotBeReadIsSatisfiedByNobody) {
  EXPECT_FALSE(satisfies("\xff\xff", {peer1}));
  EXPECT_FALSE(satisfies("", {peer1}));
  auto wrong = two_of({"Org1MSP", "Org2MSP"});
  wrong.mutable_rule()->mutable_n_out_of()->mutable_rules(1)->set_signed_by(7);
  EXPECT_FALSE(satisfies(wrong.SerializeAsString(), {peer1, peer2}));
  auto deep = two_of({"Org1MSP", "Org2MSP"});
  for (int i = 0; i < 40; ++i) {
    common::SignaturePolicy outer;
    outer.mutable_n_out_of()->set_n(1);
    *outer.mutable_n_out_of()->add_rules() = deep.rule();
    *deep.mutable_rule() = outer;
  }
  EXPECT_FALSE(satisfies(deep.SerializeAsString(), {peer1, peer2})) << "rules within rules have an end";
}

}  // namespace
}  // namespace ledgerline::fabric
