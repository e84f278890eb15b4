#include <gmock/gmock.h>

#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// Data that is kept elsewhere, by its hash.
namespace ledgerline::chaincode {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::StartsWith;

class AnchorTest : public ContractTest {
 protected:
  static AnchorCall of(char byte, const std::string& what = "") {
    AnchorCall call;
    call.set_digest(std::string(32, byte));
    call.set_what(what);
    return call;
  }
  Anchors verify(char byte) { return parsed<Anchors>(stub.call(other, "verify", of(byte)).payload); }
};

TEST_F(AnchorTest, WhoAnchoredItAndWhenIsSaidOfThatDigestAlone) {
  ASSERT_EQ(stub.call(other, "anchor", of('\xab', "flight 7, camera 2")).status, 200);
  EXPECT_EQ(stub.event_name, "anchor");
  EXPECT_THAT(stub.writes, SizeIs(1));
  EXPECT_THAT(stub.writes.begin()->first, StartsWith("anchor/abababab"));
  const Anchors found = verify('\xab');
  ASSERT_EQ(found.anchors_size(), 1);
  EXPECT_EQ(found.anchors(0).signer().subject(), "CN=other");
  EXPECT_EQ(found.anchors(0).what(), "flight 7, camera 2");
  EXPECT_EQ(found.anchors(0).timestamp_ns(), stub.transactions - 1);
  EXPECT_EQ(verify('\xac').anchors_size(), 0);
  EXPECT_THAT(stub.event_name, "") << "a question";
}

TEST_F(AnchorTest, NobodyChangesAnAnchorAndNobodyIsKeptOut) {
  ASSERT_EQ(stub.call(other, "anchor", of('x', "mine")).status, 200);
  EXPECT_THAT(stub.call(other, "anchor", of('x', "another")).message, HasSubstr("has anchored this digest already"));
  ASSERT_EQ(stub.call(pilot, "anchor", of('x')).status, 200);
  const Anchors found = verify('x');
  EXPECT_EQ(found.anchors_size(), 2);
  for (const Anchor& one : found.anchors()) EXPECT_EQ(one.what(), one.signer().subject() == "CN=other" ? "mine" : "");
  EXPECT_NE(set(pilot, {asset("anchor/x")}).status, 200);
  EXPECT_NE(enroll(admin1, host, {"anchor"}, ROLE_NONE).status, 200) << "a reserved word";
}

TEST_F(AnchorTest, WhatIsNoDigestIsRefusedByItsPlace) {
  AnchorCall call = of('x');
  call.set_digest("short");
  for (const char* function : {"anchor", "verify"}) {
    EXPECT_EQ(stub.call(other, function, call).message,
              std::string(function) + ": digest has 5 bytes; a SHA-256 has 32");
    EXPECT_THAT(stub.call(other, function, {"abc"}).message, HasSubstr("give an AnchorCall"));
  }
  EXPECT_THAT(stub.call(other, "anchor", of('x', std::string(257, 'w'))).message, HasSubstr("the limit is 256"));
}

}  // namespace
}  // namespace ledgerline::chaincode
