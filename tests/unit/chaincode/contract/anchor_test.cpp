#include <gmock/gmock.h>

#include <algorithm>
#include <set>

#include "chaincode/contract/contract_common.hpp"
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

TEST_F(AnchorTest, WhoAnchoredItAndWhenIsGivenForThatDigestOnly) {
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

TEST_F(AnchorTest, ManyMintedIdentitiesDoNotHideAnotherOnesAnchor) {
  ASSERT_EQ(stub.call(pilot, "anchor", of('x', "mine")).status, 200);
  ASSERT_EQ(stub.call(guard, "anchor", of('x', "ours")).status, 200);
  for (int i = 0; i < 300; ++i) {
    for (const char* msp_id : {"Org1MSP", "Org3MSP"})
      ASSERT_EQ(stub.call({msp_id, "CN=sybil" + std::to_string(i)}, "anchor", of('x')).status, 200);
  }
  AnchorCall asked = of('x');
  for (const auto& who : {guard, pilot, host}) {
    asked.add_signers()->set_msp_id(who.msp_id);
    asked.mutable_signers(asked.signers_size() - 1)->set_subject(who.subject);
  }
  const auto own = parsed<Anchors>(stub.call(other, "verify", asked).payload);
  ASSERT_EQ(own.anchors_size(), 2) << "by their own keys";
  EXPECT_EQ(own.anchors(0).what(), "ours");
  EXPECT_EQ(own.anchors(1).what(), "mine");
  EXPECT_THAT(stub.ranges, ::testing::IsEmpty());

  const Anchors all = verify('x');  // 16 of each of the two, and the one of Org2
  EXPECT_EQ(all.anchors_size(), 33);
  EXPECT_TRUE(std::ranges::any_of(all.anchors(), [](const Anchor& one) { return one.what() == "mine"; }));
  EXPECT_THAT(all.more_of(), ::testing::ElementsAre("Org1MSP", "Org3MSP"));
  EXPECT_EQ(all.bookmark(), "");

  asked = of('x');
  asked.set_organisation("Org1MSP");
  std::set<std::string> found;
  for (int page = 0; page < 10; ++page) {
    const auto some = parsed<Anchors>(stub.call(other, "verify", asked).payload);
    for (const Anchor& one : some.anchors()) EXPECT_TRUE(found.insert(one.signer().subject()).second) << "twice";
    asked.set_bookmark(some.bookmark());
    if (some.bookmark().empty()) break;
  }
  EXPECT_THAT(found, SizeIs(301)) << "all of one organisation's, page by page";
}

TEST_F(AnchorTest, PagesOfManyOrganisationsEnd) {
  for (int organisation = 0; organisation < 9; ++organisation) {
    for (int i = 0; i < 20; ++i)
      ASSERT_EQ(stub.call({"Far" + std::to_string(organisation) + "MSP", "CN=" + std::to_string(i)}, "anchor", of('x'))
                    .status,
                200);
  }
  AnchorCall asked = of('x');
  std::set<std::string> organisations;
  int pages = 0;
  do {
    ASSERT_LT(++pages, 10) << "they go in circles";
    const auto some = parsed<Anchors>(stub.call(other, "verify", asked).payload);
    for (const Anchor& one : some.anchors()) organisations.insert(one.signer().msp_id());
    asked.set_bookmark(some.bookmark());
  } while (!asked.bookmark().empty());
  EXPECT_THAT(organisations, SizeIs(9));
}

TEST_F(AnchorTest, AnAnchorOfTheVersionBeforeIsFoundAndStands) {
  ASSERT_EQ(stub.call(pilot, "anchor", of('x', "old")).status, 200);
  auto moved = stub.state.extract(anchor_key(of('x').digest(), pilot));
  moved.key() = anchor_key_before(of('x').digest(), pilot);
  stub.state.insert(std::move(moved));
  EXPECT_THAT(stub.call(pilot, "anchor", of('x', "new")).message, HasSubstr("has anchored this digest already"));
  EXPECT_EQ(verify('x').anchors_size(), 1);
  AnchorCall asked = of('x');
  asked.add_signers()->set_msp_id(pilot.msp_id);
  asked.mutable_signers(0)->set_subject(pilot.subject);
  EXPECT_EQ(parsed<Anchors>(stub.call(other, "verify", asked).payload).anchors_size(), 1);
}

TEST_F(AnchorTest, WhatOnlyVerifyTakesIsRefusedByAnchor) {
  AnchorCall call = of('x');
  call.set_organisation("Org1MSP");
  EXPECT_THAT(stub.call(pilot, "anchor", call).message, HasSubstr("are of verify alone"));
  for (std::size_t i = 0; i <= contract::max_page_anchors; ++i) call.add_signers()->set_msp_id("Org1MSP");
  EXPECT_THAT(stub.call(pilot, "verify", call).message, HasSubstr("65 signers; the limit is 64"));
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
