#include "common/fabric/tx/envelope.hpp"

#include <gtest/gtest.h>

#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

namespace ledgerline::fabric {
namespace {

std::string some_transaction() {
  return make_transaction(crypto::make_test_identity({"Org1MSP", "CN=User1@org1"}),
                          crypto::make_test_identity({"Org1MSP", "CN=peer0.org1"}), {"set", {"value"}},
                          std::string(24, 'n'));
}

TEST(OpenedTransaction, SealedAgainItHasTheSameBytes) {
  const std::string bytes = some_transaction();
  auto opened = open_transaction(bytes);
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(opened->result.response().payload(), "answer to set");
  EXPECT_EQ(opened->action.action().endorsements_size(), 1);
  EXPECT_EQ(opened->bytes(), bytes);
}

TEST(OpenedTransaction, WhatWasChangedInItIsInItsBytes) {
  auto opened = open_transaction(some_transaction());
  ASSERT_TRUE(opened);
  opened->result.mutable_response()->set_payload("another answer");
  opened->seal_result();
  const std::string endorsed = opened->action.action().proposal_response_payload();
  EXPECT_NE(endorsed.find("another answer"), std::string::npos) << "before the other layers, to be endorsed";
  const auto again = open_transaction(opened->bytes());
  ASSERT_TRUE(again);
  EXPECT_EQ(again->result.response().payload(), "another answer");
  EXPECT_EQ(again->action.action().proposal_response_payload(), endorsed);
}

TEST(OpenedTransaction, WhatIsNoneIsAnError) {
  EXPECT_FALSE(open_transaction("no envelope"));
  EXPECT_FALSE(open_transaction("")) << "no action";
  auto opened = open_transaction(some_transaction());
  ASSERT_TRUE(opened);
  *opened->transaction.add_actions() = opened->transaction.actions(0);
  EXPECT_FALSE(open_transaction(opened->bytes())) << "two actions";
}

}  // namespace
}  // namespace ledgerline::fabric
