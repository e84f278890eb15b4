#include "common/bridge/core/downlink.hpp"

#include <gmock/gmock.h>

#include <numeric>

#include "common/msg/proto_json.hpp"
#include "tests/unit/common/bridge/world.hpp"

namespace ledgerline::bridge {
namespace {

using namespace testing;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

class DownlinkTest : public ::testing::Test {
 protected:
  DownlinkTest() { make({rule("/*")}); }
  void make(std::vector<Rule> rules) {
    downlink.emplace(DownlinkConfig{.rules = std::move(rules), .self = org1, .writer = writer_of(org1, "")}, *registry);
  }
  static Asset asset(const std::string& id, std::uint64_t sequence, std::uint64_t life = 1) {
    Asset asset;
    asset.set_id(id);
    asset.set_topic("/" + id);
    asset.set_msg_type("p/msg/A");
    asset.set_msg_data(cdr(std::to_string(sequence)));
    asset.mutable_origin()->set_writer(writer_of(org2, ""));
    asset.mutable_origin()->set_life(life);
    asset.mutable_origin()->set_sequence(sequence);
    asset.mutable_origin()->set_stamp_ns(real_now - 5 * ns_per_ms);
    return asset;
  }
  static LedgerOfTests::Tx set(const std::vector<Asset>& assets, const crypto::IdentityName& by = org2,
                               bool stream = false) {
    SetCall call;
    for (const Asset& one : assets) *call.add_assets() = one;
    call.set_stream(stream);
    LedgerOfTests::Tx tx;
    tx.creator = by;
    tx.event_name = "set";
    tx.event_payload = call.SerializeAsString();
    return tx;
  }
  /// "topic=text" of what is published.
  std::vector<std::string> take(const std::vector<LedgerOfTests::Tx>& txs) {
    block = ledger.block(txs);
    out.clear();
    downlink->on_block(real_now, block, out);
    return published();
  }
  std::vector<std::string> published() {
    std::vector<std::string> all;
    for (const auto& one : out) {
      all.push_back(downlink->topics()[one.topic].name + "=" +
                    std::string(reinterpret_cast<const char*>(one.cdr.data()) + 4, one.cdr.size() - 4));
    }
    return all;
  }
  std::uint64_t refused(Refusal why) {
    std::uint64_t count = 0;
    for (const auto& topic : downlink->topics()) count += topic.counters.refusals.at(static_cast<std::size_t>(why));
    return count;
  }
  void TearDown() override {
    for (const auto& topic : downlink->topics()) {
      const DownlinkCounters& c = topic.counters;
      EXPECT_EQ(c.taken, c.published + std::accumulate(c.refusals.begin(), c.refusals.end(), std::uint64_t{0}));
    }
  }

  static constexpr TimeNs real_now = 1'700'000'000 * ns_per_s;
  std::unique_ptr<crypto::MspRegistry> registry = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  LedgerOfTests ledger;
  fabric::Block block;
  std::vector<Downlink::Delivery> out;
  std::optional<Downlink> downlink;
};

TEST_F(DownlinkTest, WhatOthersWroteIsPublishedInOrder) {
  EXPECT_THAT(take({set({asset("Org2MSP/a", 1), asset("Org2MSP/b", 1), asset("Org2MSP/a", 2)})}),
              ElementsAre("/a=1", "/b=1", "/a=2"));
  EXPECT_EQ(out[0].type, "p/msg/A");
  EXPECT_EQ(out[0].source_ns, real_now - 5 * ns_per_ms);
  const auto& counters = downlink->topics()[0].counters;
  EXPECT_EQ(counters.published, 2U);
  EXPECT_EQ(counters.batches, 1U);
  EXPECT_EQ(counters.bytes, 10U);
  EXPECT_NEAR(to_ms(counters.age.quantile(0.5)), 5, 0.1);
}

TEST_F(DownlinkTest, NothingEchoes) {
  make({rule("/a"), rule("/tello1/odom")});
  Asset own = asset("Org1MSP/a", 1);
  own.mutable_origin()->set_writer(writer_of(org1, ""));
  Asset of_agent = asset("tello1/odom", 1);
  of_agent.clear_origin();
  EXPECT_THAT(take({set({own, of_agent}, org1)}), IsEmpty());
  EXPECT_EQ(refused(Refusal::echo), 2U);
  own.mutable_origin()->set_writer(writer_of(org1, "another bridge of this host"));
  EXPECT_THAT(take({set({own}, org1)}), ElementsAre("/a=1"));
}

TEST_F(DownlinkTest, DuplicatesAreDroppedByOriginTopicAndSequence) {
  take({set({asset("Org2MSP/a", 1), asset("Org2MSP/a", 2)})});
  EXPECT_THAT(take({set({asset("Org2MSP/a", 1), asset("Org2MSP/a", 2), asset("Org2MSP/a", 3), asset("Org2MSP/b", 1)})}),
              ElementsAre("/a=3", "/b=1"));
  EXPECT_EQ(refused(Refusal::duplicate), 1U);
  EXPECT_EQ(refused(Refusal::repeated), 1U) << "the newest one again, as batches carry it along";
}

TEST_F(DownlinkTest, GapsInASequenceAreCounted) {
  take({set({asset("Org2MSP/a", 5), asset("Org2MSP/a", 9)})});
  EXPECT_EQ(downlink->topics()[0].counters.missing, 3U);
}

TEST_F(DownlinkTest, ARestartedBridgeCountsFromOneAndItsFormerLifeIsOver) {
  take({set({asset("Org2MSP/a", 5, 1)})});
  EXPECT_THAT(take({set({asset("Org2MSP/a", 1, 2), asset("Org2MSP/a", 6, 1)})}), ElementsAre("/a=1"));
  EXPECT_EQ(refused(Refusal::duplicate), 1U);
}

TEST_F(DownlinkTest, TwoWritersOfOneTopicHaveSequencesOfTheirOwn) {
  Asset other = asset("Org2MSP/a", 1);
  other.mutable_origin()->set_writer(99);
  EXPECT_THAT(take({set({asset("Org2MSP/a", 7), other})}), ElementsAre("/a=7", "/a=1"));
}

TEST_F(DownlinkTest, NobodySpeaksForAnotherWriter) {
  const crypto::IdentityName rival{"Org2MSP", "CN=rival"};
  take({set({asset("Org2MSP/a", 1'000)}, rival)});  // claims to be the bridge of org2's User1
  EXPECT_THAT(take({set({asset("Org2MSP/a", 1)})}), ElementsAre("/a=1"));
}

TEST_F(DownlinkTest, AnIdOfAnOrganisationByAnotherIsNotPublished) {
  EXPECT_THAT(take({set({asset("Org1MSP/a", 1), asset("Org3MSP/a", 1)})}), IsEmpty());
  EXPECT_EQ(refused(Refusal::wrong_writer), 2U);
  const auto bad = downlink->pop_refused();
  ASSERT_TRUE(bad);
  EXPECT_EQ(bad->id, "Org3MSP/a");
  EXPECT_EQ(bad->why, Refusal::wrong_writer);
  take({set({asset("Org2MSP/a", 1)}), set({asset("Org2MSP/a", 1)})});
  EXPECT_FALSE(downlink->pop_refused()) << "what a batch repeats is not bad";
}

TEST_F(DownlinkTest, WithoutAGoodSignatureOfAMemberNothingIsPublished) {
  auto forged = set({asset("Org2MSP/a", 1)});
  forged.spoil.creator_signature = true;
  EXPECT_THAT(take({forged, set({asset("Org9MSP/a", 1)}, {"Org9MSP", "CN=outsider"})}), IsEmpty());
  EXPECT_EQ(refused(Refusal::unverified), 2U);
}

TEST_F(DownlinkTest, InvalidTransactionsAndOtherContractsSayNothing) {
  auto invalid = set({asset("Org2MSP/a", 1)});
  invalid.code = 11;
  auto foreign = set({asset("Org2MSP/a", 1)});
  foreign.contract = "another";
  EXPECT_THAT(take({invalid, foreign}), IsEmpty());
  EXPECT_THAT(downlink->topics(), IsEmpty());
}

TEST_F(DownlinkTest, WhatNoRuleWantsIsNotEvenCounted) {
  make({rule("/a")});
  auto forged = set({asset("Org2MSP/b", 1)});
  forged.spoil.creator_signature = true;
  EXPECT_THAT(take({forged}), IsEmpty());
  EXPECT_THAT(downlink->topics(), IsEmpty());
}

TEST_F(DownlinkTest, FromSaysWhoseTopicsAreTaken) {
  Rule from = rule("/cmd_vel");
  from.from = "Org2MSP";
  make({from});
  const crypto::IdentityName own{"Org1MSP", "CN=another"};
  EXPECT_THAT(take({set({asset("Org2MSP/cmd_vel", 1)}), set({asset("Org1MSP/cmd_vel", 1)}, own)}),
              ElementsAre("/cmd_vel=1"));
}

// As Org3's member wrote them on the ledger, with a bridge on the ground host that carries "/*" or "/tello1/*".
TEST_F(DownlinkTest, TopicsOfPilotsMocapAndDronesAreNeverTakenByAWildcard) {
  make({rule("/tello1/*"), rule("/*")});
  std::vector<Asset> moving;
  for (const char* name :
       {"tello1/cmd_vel", "tello1/takeoff", "tello1/land", "tello1/stop", "tello1/emergency", "vrpn_mocap/tello1/pose",
        "vrpn_mocap/tello1/twist", "tello1/odom", "tello1/pose", "tello1/battery", "tello1/imu", "tello1/link",
        "tello1/failsafe", "tf", "diagnostics", "fleet/a/cmd_vel"}) {
    moving.push_back(asset("Org2MSP/" + std::string(name), 1));
  }
  moving.push_back(asset("tello1/odom", 1));
  EXPECT_THAT(take({set(moving), set({asset("Org2MSP/tello1/note", 1)})}), ElementsAre("/tello1/note=1"));
  EXPECT_EQ(refused(Refusal::unnamed), moving.size());

  Rule named = rule("/tello1/cmd_vel");
  named.from = "Org2MSP";
  make({rule("/*"), named});
  EXPECT_THAT(take({set({asset("Org2MSP/tello1/cmd_vel", 1)})}), ElementsAre("/tello1/cmd_vel=1"))
      << "named without a star, though behind one";
}

TEST_F(DownlinkTest, AnotherIdsTypeDoesNotTakeATopicFromTheOneThatHasIt) {
  take({set({asset("Org2MSP/a", 1)})});
  const crypto::IdentityName outsider{"Org1MSP", "CN=outsider"};
  Asset foreign = asset("Org1MSP/a", 1);
  foreign.set_msg_type("p/msg/B");
  foreign.mutable_origin()->set_writer(99);
  EXPECT_THAT(take({set({foreign}, outsider), set({asset("Org2MSP/a", 2)})}), ElementsAre("/a=2"));
  EXPECT_EQ(refused(Refusal::wrong_type), 1U);
  Asset changed = asset("Org2MSP/a", 3);
  changed.set_msg_type("p/msg/B");
  foreign.mutable_origin()->set_sequence(2);
  EXPECT_THAT(take({set({changed}), set({foreign}, outsider)}), ElementsAre("/a=3", "/a=1"))
      << "the one that has it may change it, and who follows is taken";
}

TEST_F(DownlinkTest, OneOrganisationCannotFillTheIdsOfAll) {
  for (std::size_t i = 0; i < Downlink::max_ids; ++i) take({set({asset("Org2MSP/t" + std::to_string(i), 1)})});
  const crypto::IdentityName another{"Org1MSP", "CN=another"};
  EXPECT_THAT(take({set({asset("Org1MSP/note", 1)}, another), set({asset("tello1/note", 1)}, another)}),
              ElementsAre("/note=1", "/tello1/note=1"));
  EXPECT_EQ(refused(Refusal::too_many), Downlink::max_ids - Downlink::max_ids_of_one);
}

TEST_F(DownlinkTest, TypesThatClashAndMalformedCdrAreRefusedAndCounted) {
  Rule typed = rule("/a");
  typed.type = "p/msg/B";
  make({typed, rule("/*")});
  Asset no_type = asset("Org2MSP/b", 1), short_cdr = asset("Org2MSP/c", 1), alien = asset("Org2MSP/d", 1);
  no_type.set_msg_type("no type");
  short_cdr.set_msg_data(std::string("\0\1\0", 3));
  alien.set_msg_data("{\"a\":1}");
  EXPECT_THAT(take({set({asset("Org2MSP/a", 1), no_type, short_cdr, alien})}), IsEmpty());
  EXPECT_EQ(refused(Refusal::wrong_type), 2U);
  EXPECT_EQ(refused(Refusal::malformed), 2U);
}

TEST_F(DownlinkTest, ATypeThatChangesIsPublishedAsTheNewOne) {
  take({set({asset("Org2MSP/a", 1)})});
  Asset other = asset("Org2MSP/a", 2);
  other.set_msg_type("p/msg/B");
  take({set({other})});
  ASSERT_EQ(out.size(), 1U);
  EXPECT_EQ(out[0].type, "p/msg/B");
  EXPECT_EQ(downlink->topics()[0].type, "p/msg/B");
}

TEST_F(DownlinkTest, AWriterWithoutOriginIsTakenInTheLedgersOrderButForWhatItsBatchRepeats) {
  make({rule("/tello1/odom")});
  Asset odom = asset("tello1/odom", 1);
  odom.clear_origin();
  EXPECT_THAT(take({set({odom}, org2, true), set({odom}, org2, true), set({odom}, org2, false)}),
              ElementsAre("/tello1/odom=1", "/tello1/odom=1"));
  EXPECT_EQ(refused(Refusal::repeated), 1U);
}

TEST_F(DownlinkTest, EventsInJsonAreTakenToo) {
  SetCall call;
  *call.add_assets() = asset("Org2MSP/a", 1);
  auto tx = set({});
  tx.event_payload = to_json(call);
  auto damaged = tx;
  damaged.event_payload = "{\"assets\":";
  EXPECT_THAT(take({damaged, tx}), ElementsAre("/a=1"));
  EXPECT_EQ(downlink->malformed_frames(), 1U);
}

// The contract lets none such through, but an organisation's own peer may endorse them all the same.
TEST_F(DownlinkTest, AnIdThatTheContractRefusesIsNotKeptAndSpoilsNoReport) {
  Rule all = rule("/*");
  all.latched = true;
  make({all});
  const std::string long_id = "Org2MSP/" + std::string(200, 'a');
  for (const std::string& id : {std::string("Org2MSP/\xff"), std::string("Org2MSP/a\nb"), long_id}) {
    EXPECT_THAT(take({set({asset(id, 1)}), set({asset("Org2MSP/a", 1)})}), Each("/a=1"));
    Assets values;
    *values.add_assets() = asset(id, 1);
    downlink->on_values(real_now, values, out);
  }
  EXPECT_EQ(downlink->topics().size(), 1U);
  EXPECT_EQ(downlink->unverified_transactions(), 3U);
  EXPECT_NO_THROW((void)report(*downlink).dump());
}

TEST_F(DownlinkTest, LatchedValuesAreReadByThoseWhoComeLateAndNotTwice) {
  Rule map = rule("/map"), tello = rule("/tello1/*"), all = rule("/*");
  map.latched = tello.latched = all.latched = true;
  map.from = all.from = "Org2MSP";
  tello.from = "tello1";
  make({map, tello, all});
  EXPECT_THAT(downlink->latched(), ElementsAre("Org2MSP/map", "tello1/*", "Org2MSP/*"));
  Assets values;
  *values.add_assets() = asset("Org2MSP/map", 3);
  *values.add_assets() = asset("Org3MSP/map", 3);
  downlink->on_values(real_now, values, out);
  EXPECT_THAT(published(), ElementsAre("/map=3"));
  EXPECT_THAT(take({set({asset("Org2MSP/map", 3), asset("Org2MSP/map", 4)})}), ElementsAre("/map=4"));
  out.clear();
  downlink->on_values(real_now, values, out);
  EXPECT_THAT(out, IsEmpty()) << "a newer one has come in a block";
}

TEST_F(DownlinkTest, WhoMayNotWriteAnOrganisationsIdsLeavesItRoomForThem) {
  const crypto::IdentityName rival{"Org1MSP", "CN=rival"}, outsider{"Org9MSP", "CN=outsider"};
  for (std::size_t i = 0; i < Downlink::max_ids_of_one; ++i) {
    for (const auto& by : {rival, outsider}) take({set({asset("Org2MSP/t" + std::to_string(i), 1)}, by)});
  }
  EXPECT_THAT(take({set({asset("Org2MSP/a", 1), asset("Org2MSP/t1", 1)})}), ElementsAre("/a=1", "/t1=1"));
  EXPECT_EQ(refused(Refusal::wrong_writer), Downlink::max_ids_of_one);
  EXPECT_EQ(refused(Refusal::unverified), Downlink::max_ids_of_one);
}

TEST_F(DownlinkTest, IdsAndWritersAreBounded) {
  const auto id = [](std::size_t i) {
    return "robot" + std::to_string(i / Downlink::max_ids_of_one) + "/t" + std::to_string(i);
  };
  for (std::size_t i = 0; i < Downlink::max_ids; ++i) take({set({asset(id(i), 1)})});
  EXPECT_THAT(take({set({asset("Org2MSP/more", 1), asset("rover/more", 1), asset(id(7), 2)})}),
              ElementsAre("/robot0/t7=2"));
  EXPECT_EQ(refused(Refusal::too_many), 2U);
  EXPECT_EQ(downlink->topics().size(), Downlink::max_ids + 1);
  for (std::size_t i = 0; i < Downlink::max_writers; ++i) {
    Asset other = asset(id(1), 1);
    other.mutable_origin()->set_writer(100 + i);
    take({set({other})});
  }
  EXPECT_EQ(refused(Refusal::too_many), 3U);
}

}  // namespace
}  // namespace ledgerline::bridge
