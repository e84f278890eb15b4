#include "chaincode/node/core/types.hpp"

#include <gmock/gmock.h>

namespace ledgerline::node {
namespace {

const MemberCheck& members() {
  static const MemberCheck check(crypto::make_test_registry({"Org1MSP"}), "teleop");
  return check;
}

TEST(MemberCheckTest, AMembersSignatureGivesTheMember) {
  const auto host = crypto::make_test_identity({"Org1MSP", "CN=host"});
  const auto member = members().check(host.serialized, "message", *host.signer->sign("message"), {});
  ASSERT_TRUE(member.ok());
  EXPECT_EQ((*member)->name.subject, "CN=host");
}

TEST(MemberCheckTest, AnOutsiderAndAWrongSignatureAreDeniedInFabricsWords) {
  const auto outsider = crypto::make_test_identity({"Org9MSP", "CN=x"});
  EXPECT_THAT(members().check(outsider.serialized, "message", *outsider.signer->sign("message"), {}).error().message,
              ::testing::StartsWith("access denied: channel [teleop] creator org unknown: "));
  const auto host = crypto::make_test_identity({"Org1MSP", "CN=host"});
  EXPECT_EQ(members().check(host.serialized, "message", *host.signer->sign("another"), {}).error().message,
            "access denied: channel [teleop] creator org [Org1MSP]: the signature is invalid");
}

}  // namespace
}  // namespace ledgerline::node
