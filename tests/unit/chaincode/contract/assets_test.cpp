#include <gmock/gmock.h>

#include "common/base/check.hpp"
#include "common/msg/contract.hpp"
#include "tests/unit/chaincode/contract/fake_stub.hpp"

namespace ledgerline::chaincode {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::StartsWith;
using AssetsTest = ContractTest;

TEST_F(AssetsTest, WhatIsSetIsWhatGetSays) {
  EXPECT_EQ(set(host, {asset("tello1/note", "one")}).status, 200);
  EXPECT_EQ(value_of("tello1/note"), "one");
  EXPECT_EQ(set(host, {asset("tello1/note", "two")}).status, 200);
  EXPECT_EQ(value_of("tello1/note"), "two");
}

TEST_F(AssetsTest, TheEventHoldsWhatWasWrittenWithItsTopic) {
  set(host, {asset("tello1/a", "1"), asset("tello1/a", "2")});
  EXPECT_EQ(stub.event_name, "set");
  const auto event = parsed<SetCall>(stub.event_payload);
  EXPECT_THAT(event.assets(), SizeIs(2));
  EXPECT_EQ(event.assets(0).topic(), "/tello1/a");
  EXPECT_EQ(value_of("tello1/a"), "2") << "of two samples the last one counts";
}

TEST_F(AssetsTest, AStreamsEventNamesItAlone) {
  EXPECT_EQ(set(host, {asset("tello1/odom", "1")}, true).status, 200);
  EXPECT_EQ(stub.event_name, "set");
  EXPECT_EQ(stub.event_payload, "") << "the call has it";
  EXPECT_EQ(value_of("tello1/odom"), "1");
}

TEST_F(AssetsTest, OnlyTheIdentityThatADroneIsEnrolledToWritesUnderItsName) {
  EXPECT_THAT(set(pilot, {asset("tello1/note")}).message, StartsWith("tello1: enrolled to Org1MSP CN=host"));
  EXPECT_THAT(set(guard, {asset("tello1/note")}).message, StartsWith("tello1: "));
  EXPECT_THAT(set(host, {asset("tello9/note")}).message, StartsWith("tello9: not enrolled"));
}

TEST_F(AssetsTest, AnyMemberWritesUnderItsOwnOrganisation) {
  EXPECT_EQ(set(rival, {asset("Org2MSP/notes", "by rival")}).status, 200);
  EXPECT_EQ(set(pilot, {asset("Org2MSP/notes", "by pilot")}).status, 200);
  EXPECT_NE(set(host, {asset("Org2MSP/notes")}).status, 200);
  EXPECT_EQ(value_of("Org2MSP/notes"), "by pilot");
}

TEST_F(AssetsTest, AnAssetKeepsItsOriginInTheEventAndInGet) {
  Asset one = asset("Org2MSP/chatter");
  one.mutable_origin()->set_writer(1);
  one.mutable_origin()->set_life(2);
  one.mutable_origin()->set_sequence(3);
  one.mutable_origin()->set_stamp_ns(-4);
  one.GetReflection()->MutableUnknownFields(&one)->AddVarint(99, 5);
  EXPECT_EQ(set(pilot, {one}).status, 200);
  QueryCall query;
  query.set_id("Org2MSP/chatter");
  const auto got = parsed<Assets>(stub.call(other, "get", query).payload).assets(0);
  set(pilot, {one});
  for (const Asset& read : {parsed<SetCall>(stub.event_payload).assets(0), got}) {
    EXPECT_EQ(read.origin().sequence(), 3U);
    EXPECT_EQ(read.origin().stamp_ns(), -4);
    EXPECT_EQ(read.GetReflection()->GetUnknownFields(read).field_count(), 1) << "what a newer version has";
  }
}

TEST_F(AssetsTest, ATopicThatItsWriterMayNotWriteHasNoEvent) {
  for (const auto& [who, id] : {std::pair(pilot, "tello1/cmd_vel"), std::pair(pilot, "Org1MSP/chatter"),
                                std::pair(host, "Org2MSP/chatter"), std::pair(guard, "tello1/odom")}) {
    for (const bool stream : {false, true}) {
      EXPECT_NE(set(who, {asset(id)}, stream).status, 200) << id;
      EXPECT_EQ(stub.event_name, "") << id;
    }
  }
}

TEST_F(AssetsTest, TheTopicMustAgreeWithTheId) {
  Asset wrong = asset("tello1/note");
  wrong.set_topic("/tello2/note");
  EXPECT_THAT(set(host, {wrong}).message, HasSubstr("it must be /tello1/note"));
  wrong.set_topic("/tello1/note");
  EXPECT_EQ(set(host, {wrong}).status, 200);
}

TEST_F(AssetsTest, IdsAndTypesAreChecked) {
  for (const char* id : {"", "tello1//x", "/tello1/x", "tello1/x/", "tello1/ä", "tello1/a b"}) {
    EXPECT_NE(set(host, {asset(id)}).status, 200) << id;
  }
  EXPECT_THAT(set(host, {asset("tello1/" + std::string(contract::max_id_chars, 'x'))}).message,
              HasSubstr("the limit is 128"));
  Asset nameless = asset("tello1/x");
  nameless.clear_msg_type();
  EXPECT_THAT(set(host, {nameless}).message, StartsWith("tello1/x: msg_type"));
}

TEST_F(AssetsTest, EveryLimitIsNamedWhenItIsPassed) {
  EXPECT_THAT(set(host, {asset("tello1/x", std::string(contract::max_call_bytes, 'x'))}).message,
              HasSubstr("the limit is 1000000"));
  EXPECT_THAT(set(host, std::vector<Asset>(contract::max_call_assets + 1, asset("tello1/x"))).message,
              HasSubstr("1001 assets; the limit is 1000"));
  EXPECT_THAT(set(host, {asset("tello1/x", std::string(contract::max_batch_bytes, 'x'))}, true).message,
              HasSubstr("the limit is 32000"));
  std::vector<Asset> many;
  for (std::size_t i = 0; i <= contract::max_drone_streams; ++i) many.push_back(asset("tello1/s" + std::to_string(i)));
  EXPECT_THAT(set(host, many, true).message, StartsWith("tello1: 65 ids would stream; the limit is 64"));
}

TEST_F(AssetsTest, NothingIsWrittenWhenOneAssetIsRefused) {
  set(host, {asset("tello1/good"), asset("tello9/bad")});
  EXPECT_EQ(value_of("tello1/good"), "tello1/good: not found");
}

TEST_F(AssetsTest, AStreamingBatchReadsNoKeyThatItWrites) {
  set(host, {asset("tello1/odom"), asset("tello2/odom")}, true);
  EXPECT_THAT(stub.writes, SizeIs(2)) << "the frame, and the host's record once";
  set(host, {asset("tello1/odom", "new"), asset("tello2/odom")}, true);
  EXPECT_THAT(stub.reads, ElementsAre(StartsWith("host/"))) << "one read, however many drones";
  ASSERT_THAT(stub.writes, SizeIs(1));
  EXPECT_THAT(stub.writes.begin()->first, StartsWith("frame/"));
  EXPECT_EQ(value_of("tello1/odom"), "new");
}

TEST_F(AssetsTest, GetIsAtMostThreeReads) {
  set(host, {asset("tello1/odom", "x")}, true);
  EXPECT_EQ(value_of("tello1/odom"), "x");
  EXPECT_THAT(stub.reads, SizeIs(3));
  set(host, {asset("tello1/note", "y")});
  EXPECT_EQ(value_of("tello1/note"), "y");
  EXPECT_THAT(stub.reads, SizeIs(3));
}

TEST_F(AssetsTest, AnIdThatTheNewestBatchLeavesOutIsFoundInHistory) {
  set(host, {asset("tello1/odom", "old"), asset("tello2/odom")}, true);
  set(host, {asset("tello2/odom")}, true);
  EXPECT_EQ(value_of("tello1/odom"), "old");
}

TEST_F(AssetsTest, WithoutHistoryAListHasWhatTheNewestBatchHasAndTheOneIdSaysWhy) {
  set(host, {asset("tello1/battery"), asset("tello1/odom")}, true);
  set(host, {asset("tello1/odom", "newest")}, true);
  stub.has_history = false;
  const auto listed = parsed<Assets>(stub.call(other, "get", {R"({"id":"tello1/*"})"}).payload);
  ASSERT_THAT(listed.assets(), SizeIs(1));
  EXPECT_EQ(listed.assets(0).msg_data(), "newest");
  EXPECT_THAT(value_of("tello1/battery"), HasSubstr("history database not enabled"));
}

TEST_F(AssetsTest, OnlyIdsUnderEnrolledNamesMayStream) {
  EXPECT_THAT(set(pilot, {asset("Org2MSP/x")}, true).message, HasSubstr("only ids under an enrolled name"));
}

TEST_F(AssetsTest, AStreamingIdIsNotSetByAnotherWay) {
  set(host, {asset("tello1/odom")}, true);
  EXPECT_THAT(set(host, {asset("tello1/odom")}).message, StartsWith("tello1/odom: it streams"));
}

TEST_F(AssetsTest, OneAssetInJsonHasASingleForm) {
  const std::string json = R"({"id":"tello1/note","msgType":"a/msg/B","msgData":"AAEAAA=="})";
  EXPECT_EQ(stub.call(host, "set", {json}).status, 200);
  EXPECT_EQ(stub.event_payload.front(), '{');
  EXPECT_EQ(parsed<SetCall>(stub.event_payload).assets(0).id(), "tello1/note");
  EXPECT_EQ(stub.call(other, "get", {"tello1/note"}).payload,
            R"({"id":"tello1/note","topic":"/tello1/note","msgType":"a/msg/B","msgData":"AAEAAA=="})");
  EXPECT_EQ(parsed<Assets>(stub.call(other, "get", {R"({"id":"tello1/*"})"}).payload).assets_size(), 1);
}

TEST_F(AssetsTest, ManyAssetsInJsonAndUnknownFieldsAreReported) {
  EXPECT_EQ(stub.call(host, "set", {R"({"assets":[{"id":"tello1/a","msgType":"t"},{"id":"tello1/b","msgType":"t"}]})"})
                .status,
            200);
  EXPECT_THAT(stub.call(host, "set", {R"({"id":"tello1/a","msgtype":"t"})"}).message, HasSubstr("in JSON"));
  EXPECT_THAT(stub.call(host, "set", {"{"}).message, HasSubstr("in JSON"));
  EXPECT_THAT(stub.call(host, "set", {"\xff\xff"}).message, HasSubstr("in protobuf"));
}

TEST_F(AssetsTest, DeletingLeavesATombstoneAndHistory) {
  set(host, {asset("tello1/note", "kept")});
  EXPECT_EQ(stub.call(host, "delete", {"tello1/note"}).status, 200);
  EXPECT_EQ(stub.event_name, "delete");
  EXPECT_EQ(parsed<DeleteCall>(stub.event_payload).id(), "tello1/note");
  EXPECT_EQ(value_of("tello1/note"), "tello1/note: not found");
  const auto versions = parsed<Versions>(stub.call(other, "history", {"tello1/note"}).payload);
  ASSERT_THAT(versions.versions(), SizeIs(2));
  EXPECT_TRUE(versions.versions(0).deleted());
  EXPECT_EQ(versions.versions(1).asset().msg_data(), "kept");
  EXPECT_EQ(versions.versions(1).signer().subject(), "CN=host");
}

TEST_F(AssetsTest, WhatNeverWasCannotBeDeleted) {
  EXPECT_EQ(stub.call(host, "delete", {"tello1/note"}).message, "tello1/note: not found");
  set(host, {asset("tello1/note")});
  stub.call(host, "delete", {"tello1/note"});
  EXPECT_EQ(stub.call(host, "delete", {"tello1/note"}).message, "tello1/note: not found");
  EXPECT_THAT(stub.call(pilot, "delete", {"tello1/note"}).message, StartsWith("tello1: enrolled to"));
}

TEST_F(AssetsTest, ADeletedStreamIsGoneUntilItStreamsAgain) {
  set(host, {asset("tello1/odom", "one")}, true);
  EXPECT_EQ(stub.call(host, "delete", {"tello1/odom"}).status, 200);
  EXPECT_EQ(value_of("tello1/odom"), "tello1/odom: not found");
  set(host, {asset("tello1/odom", "two")}, true);
  EXPECT_EQ(value_of("tello1/odom"), "two");
  const auto versions = parsed<Versions>(stub.call(other, "history", {"tello1/odom"}).payload);
  ASSERT_THAT(versions.versions(), SizeIs(3));
  EXPECT_EQ(versions.versions(0).asset().msg_data(), "two");
  EXPECT_TRUE(versions.versions(1).deleted());
  EXPECT_EQ(versions.versions(2).asset().msg_data(), "one");
}

TEST_F(AssetsTest, RecordsOfTheContractCannotBeSetOrDeleted) {
  for (const char* id : {"control/tello1", "role/x", "command/x"}) {
    EXPECT_NE(set(host, {asset(id)}).status, 200) << id;
    EXPECT_NE(stub.call(host, "delete", {id}).status, 200) << id;
  }
}

TEST_F(AssetsTest, PrefixAndAllListStreamedAndStoredInOrder) {
  set(host, {asset("tello1/odom"), asset("tello2/odom")}, true);
  set(host, {asset("tello1/a"), asset("tello1/z"), asset("tello2/note")});
  set(pilot, {asset("Org2MSP/notes")});
  const auto ids = [&](const std::vector<std::string>& args) {
    std::vector<std::string> found;
    const auto listed = parsed<Assets>(stub.call(other, "get", args).payload);
    for (const Asset& one : listed.assets()) found.push_back(one.id());
    return found;
  };
  EXPECT_THAT(ids({"tello1/*"}), ElementsAre("tello1/a", "tello1/odom", "tello1/z"));
  EXPECT_THAT(ids({}),
              ElementsAre("Org2MSP/notes", "tello1/a", "tello1/odom", "tello1/z", "tello2/note", "tello2/odom"));
  EXPECT_THAT(ids({"control/*"}), ElementsAre("control/tello1", "control/tello2"));
}

TEST_F(AssetsTest, LongListsComeInPagesThatTogetherAreWhole) {
  std::vector<std::string> expected;
  for (int i = 0; i < 40; ++i) {
    const std::string id = "tello1/n" + std::to_string(100 + i);
    set(host, {asset(id, std::string(100'000, 'x'))});
    expected.push_back(id);
  }
  set(host, {asset("tello1/n120a", "streamed")}, true);
  expected.insert(expected.begin() + 21, "tello1/n120a");
  std::vector<std::string> found;
  QueryCall query;
  query.set_id("tello1/*");
  int pages = 0;
  do {
    const Response response = stub.call(other, "get", query);
    ASSERT_LE(response.payload.size(), contract::max_page_bytes + 1000);
    const auto page = parsed<Assets>(response.payload);
    for (const Asset& one : page.assets()) found.push_back(one.id());
    query.set_bookmark(page.bookmark());
    ++pages;
  } while (!query.bookmark().empty());
  EXPECT_EQ(found, expected);
  EXPECT_EQ(pages, 5);
}

TEST_F(AssetsTest, AListingLooksAtABoundedNumberOfKeysAndGoesOnInTheNextPage) {
  std::vector<std::string> expected;
  for (int call = 0; call < 21; ++call) {
    std::vector<Asset> assets;
    for (int i = 0; i < 1'000; ++i)
      assets.push_back(asset("Org3MSP/" + std::to_string(100'000 + call * 1'000 + i), ""));
    ASSERT_EQ(set(other, assets).status, 200);
    if (call % 7 != 3) {  // what is left of the others is tombstones
      for (const Asset& one : assets) expected.push_back(one.id());
      continue;
    }
    for (const Asset& one : assets) ASSERT_EQ(stub.call(other, "delete", {one.id()}).status, 200);
  }
  for (const char* id : {"Org3MSP/*", "*"}) {
    std::vector<std::string> found;
    QueryCall query;
    query.set_id(id);
    do {
      const Response response = stub.call(other, "get", query);
      ASSERT_EQ(response.status, 200);
      EXPECT_LE(stub.ranges.size(), contract::max_page_keys / 16 + 4);
      const auto page = parsed<Assets>(response.payload);
      for (const Asset& one : page.assets()) found.push_back(one.id());
      ASSERT_TRUE(page.bookmark().empty() || page.bookmark() > query.bookmark());
      query.set_bookmark(page.bookmark());
    } while (!query.bookmark().empty());
    EXPECT_EQ(found, expected) << id;
  }
}

TEST_F(AssetsTest, AListingOfRecordsCountsWhatBelongsToThem) {
  std::vector<std::string> drones, found;
  for (int i = 0; i < 200; ++i) drones.push_back("fleet" + std::to_string(1'000 + i));
  ASSERT_EQ(enroll(admin1, host, drones, ROLE_NONE).status, 200);
  QueryCall query;
  query.set_id("control/*");
  do {
    const auto page = parsed<Assets>(stub.call(other, "get", query).payload);
    EXPECT_LE(stub.reads.size() + stub.ranges.size(), contract::max_page_keys + 16 * 4);
    for (const Asset& one : page.assets()) found.push_back(one.id());
    query.set_bookmark(page.bookmark());
  } while (!query.bookmark().empty());
  EXPECT_EQ(found.size(), 202U);
}

TEST_F(AssetsTest, AListingLooksAtABoundedNumberOfOldBatchesAndGoesOnInTheNextPage) {
  std::vector<std::string> expected;
  for (int i = 1; i <= 5; ++i) {  // ids that streamed once, long ago
    expected.push_back("tello1/once" + std::to_string(i));
    set(host, {asset(expected.back())}, true);
  }
  for (std::size_t i = 5; i < contract::max_page_versions; ++i) set(host, {asset("tello1/odom")}, true);
  set(host, {asset("tello1/zebra")});
  expected.insert(expected.begin(), "tello1/odom");
  expected.push_back("tello1/zebra");
  std::vector<std::string> found;
  QueryCall query;
  query.set_id("tello1/*");
  int pages = 0;
  do {
    stub.looked = 0;
    const auto page = parsed<Assets>(stub.call(other, "get", query).payload);
    for (const Asset& one : page.assets()) found.push_back(one.id());
    query.set_bookmark(page.bookmark());
    EXPECT_LE(stub.looked, contract::max_page_versions);
    ASSERT_LT(++pages, 20);
  } while (!query.bookmark().empty());
  EXPECT_EQ(found, expected);
  EXPECT_GE(pages, 5);
}

TEST_F(AssetsTest, ManyIdsInOneOldBatchCostAsMuchAsOne) {
  std::vector<Asset> once;
  for (int i = 10; i < 60; ++i) once.push_back(asset("tello1/once" + std::to_string(i)));
  set(host, once, true);
  set(host, {asset("tello1/odom")}, true);
  stub.looked = 0;
  QueryCall query;
  query.set_id("tello1/*");
  const auto page = parsed<Assets>(stub.call(other, "get", query).payload);
  EXPECT_EQ(page.assets_size(), 51);
  EXPECT_EQ(page.bookmark(), "");
  EXPECT_EQ(stub.looked, 3U) << "with the empty one that enroll made";
}

TEST_F(AssetsTest, HistoryPagesHaveNoGapAndNoDuplicateWhileNewVersionsArrive) {
  std::vector<std::string> expected;
  for (int i = 0; i < 300; ++i) {
    set(host, {asset("tello1/odom", std::to_string(i)), asset("tello2/odom")}, true);
    expected.insert(expected.begin(), std::to_string(i));
  }
  std::vector<std::string> found;
  QueryCall query;
  query.set_id("tello1/odom");
  int pages = 0;
  do {
    const Response response = stub.call(other, "history", query);
    ASSERT_EQ(response.status, 200) << response.message << " " << query.bookmark();
    const auto page = parsed<Versions>(response.payload);
    for (const Version& version : page.versions()) found.push_back(version.asset().msg_data());
    query.set_bookmark(page.bookmark());
    set(host, {asset("tello1/odom", "newer"), asset("tello2/odom")}, true);
    ASSERT_LT(++pages, 10);
  } while (!query.bookmark().empty());
  ASSERT_EQ(found.size(), expected.size());
  EXPECT_EQ(found, expected);
  EXPECT_GE(pages, 2);
}

TEST_F(AssetsTest, ADamagedBookmarkIsAnError) {
  set(host, {asset("tello1/note")});
  for (const char* bookmark : {"x", "1", "1:nothing", ":tx1", "99999999999999999999:tx"}) {
    EXPECT_NE(stub.call(other, "history", {"tello1/note", std::string("bookmark=") + bookmark}).status, 200)
        << bookmark;
  }
}

TEST_F(AssetsTest, HistoryOfNothingIsNotFound) {
  EXPECT_EQ(stub.call(other, "history", {"tello1/none"}).message, "tello1/none: not found");
}

TEST_F(AssetsTest, HistorySurvivesANewOwner) {
  set(host, {asset("tello1/odom", "by host")}, true);
  ASSERT_EQ(enroll(admin1, guard, {"tello1"}, ROLE_NONE).status, 200);
  EXPECT_EQ(value_of("tello1/odom"), "by host");
  EXPECT_NE(set(host, {asset("tello1/odom")}, true).status, 200);
  EXPECT_EQ(set(guard, {asset("tello1/odom", "by guard")}, true).status, 200);
  const auto versions = parsed<Versions>(stub.call(other, "history", {"tello1/odom"}).payload);
  ASSERT_THAT(versions.versions(), SizeIs(2));
  EXPECT_EQ(versions.versions(0).asset().msg_data(), "by guard");
  EXPECT_EQ(versions.versions(1).asset().msg_data(), "by host");
}

TEST_F(AssetsTest, ARefusalIsOneReadableLineWhateverTheCallHolds) {
  EXPECT_EQ(stub.call(host, "f\xff\n\x1b[2J", {"x"}).message.find("unknown function f???[2J; known"), 0U);
  EXPECT_LE(stub.call(host, std::string(500'000, 'f'), {"x"}).message.size(), 1'000U);
  Asset wrong = asset("tello1/odom");
  wrong.set_topic("/x\n" + std::string(500'000, 'y'));
  const std::string why = set(host, {wrong}).message;
  EXPECT_EQ(why.find("tello1/odom: the topic is /x?yyy"), 0U);
  EXPECT_LE(why.size(), 1'000U);
  EXPECT_THAT(stub.call(host, "set", {"{\"id\":\xff\n}"}).message, StartsWith("not a SetCall in JSON: "));
}

TEST_F(AssetsTest, AnUnknownFunctionIsNamed) {
  EXPECT_THAT(stub.call(host, "transfer", {"x"}).message, StartsWith("unknown function transfer; known are"));
  EXPECT_THAT(stub.call(host, "resume", {"tello1"}).message,
              StartsWith("unknown function resume, which is clear_stop now; known are"));
  EXPECT_THAT(stub.call(host, "fold", {"tello1"}).message,
              StartsWith("unknown function fold, which is apply_stops now"));
}

struct StubWithAFault : FakeStub {
  Result<std::optional<std::string>> get_state(const std::string& key) override {
    LEDGERLINE_CHECK(key.empty(), "a check that fails", key);
    return std::optional<std::string>();
  }
};

TEST(ContractChecks, OneThatFailsIsTheAnswerOfItsCallAlone) {
  StubWithAFault broken;
  const Response answer = broken.call(broken.caller(), "get", {"tello1/note"});
  EXPECT_EQ(answer.status, 500);
  EXPECT_THAT(answer.message, AllOf(HasSubstr("a check of the contract failed"), HasSubstr("a check that fails")));
}

}  // namespace
}  // namespace ledgerline::chaincode
