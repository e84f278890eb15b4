#include <gtest/gtest.h>

#include "common/fabric/validation/key_state.hpp"
#include "peer/transaction.pb.h"

/// What a validator remembers of keys is bounded, and a client that writes many keys evicts only its own.
namespace ledgerline::fabric {
namespace {

constexpr std::size_t room = 100;

class KeyMemory : public ::testing::Test {
 protected:
  /// A transaction that counts, of a member of that organisation.
  void write(const std::string& msp_id, const std::vector<std::string>& keys) {
    TransactionVerdict verdict;
    verdict.code = protos::VALID;
    verdict.creator_msp = msp_id;
    NamespaceSet part{.name = "ledgerline", .collection = {}, .set = {}};
    for (const std::string& key : keys) {
      part.set.add_writes()->set_key(key);
      part.set.mutable_writes()->rbegin()->set_value("value");
    }
    verdict.sets.parts.push_back(std::move(part));
    state_.apply(++block_, {verdict});
  }
  /// One that has read all keys from `start` to `end`, which are these.
  void read_range(const std::string& msp_id, const std::string& start, const std::string& end,
                  const std::vector<std::string>& keys) {
    TransactionVerdict verdict;
    verdict.code = protos::VALID;
    verdict.creator_msp = msp_id;
    NamespaceSet part{.name = "ledgerline", .collection = {}, .set = {}};
    auto& range = *part.set.add_range_queries_info();
    range.set_start_key(start);
    range.set_end_key(end);
    range.set_itr_exhausted(true);
    range.mutable_raw_reads();
    for (const std::string& key : keys) {
      auto& read = *range.mutable_raw_reads()->add_kv_reads();
      read.set_key(key);
      read.mutable_version()->set_block_num(1);
    }
    verdict.sets.parts.push_back(std::move(part));
    state_.apply(++block_, {verdict});
  }
  void flood(const std::string& msp_id, const std::string& kind = "asset", int keys = 1'000) {
    for (int i = 0; i < keys; ++i) write(msp_id, {kind + "/" + msp_id + "/" + std::to_string(i)});
  }
  bool knows(const std::string& key) const { return state_.known({"ledgerline", "", key}).version; }

  KeyState state_{KeyState::Part{.contract = "ledgerline", .max_keys = room, .max_ranges = 4}};
  std::uint64_t block_ = 0;
};

TEST_F(KeyMemory, AFloodPushesOutOnlyItsOwnKeys) {
  const std::vector<std::string> ours{"control/tello1", "lease/Org1MSP/x/1", "command/Org1MSP/x", "grant/tello1"};
  for (const std::string& key : ours) write("Org2MSP", {key});
  flood("Org3MSP");
  EXPECT_EQ(state_.keys(), room);
  for (const std::string& key : ours) EXPECT_TRUE(knows(key)) << key;
  write("Org2MSP", {"lease/Org1MSP/x/2"});
  EXPECT_TRUE(knows("lease/Org1MSP/x/2")) << "and what is new is followed";
  EXPECT_FALSE(knows("asset/Org3MSP/0"));
  EXPECT_TRUE(knows("asset/Org3MSP/999"));
}

TEST_F(KeyMemory, AMembersFloodSparesHisOwnOrganisationsOtherKinds) {
  write("Org2MSP", {"lease/Org1MSP/x/1"});
  flood("Org2MSP");
  EXPECT_TRUE(knows("lease/Org1MSP/x/1"));
  for (int i = 0; i < 500; ++i) flood("Org2MSP", "made-up" + std::to_string(i), 3);
  EXPECT_TRUE(knows("lease/Org1MSP/x/1")) << "kinds that nobody has heard of are one";
  EXPECT_EQ(state_.keys(), room);
}

TEST_F(KeyMemory, WhatIsUsedStays) {
  for (int i = 0; i < 1'000; ++i) {
    write("Org2MSP", {"lease/Org1MSP/x/" + std::to_string(i)});
    write("Org2MSP", {"lease/Org1MSP/flown/1"});
  }
  EXPECT_TRUE(knows("lease/Org1MSP/flown/1"));
  EXPECT_TRUE(knows("lease/Org1MSP/x/999"));
  EXPECT_FALSE(knows("lease/Org1MSP/x/1"));
}

TEST_F(KeyMemory, ARangeThatHasLostAKeyIsNotKnown) {
  read_range("Org2MSP", "asset/Org3MSP/", "asset/Org3MSP0", {"asset/Org3MSP/a"});
  read_range("Org2MSP", "stop/tello1/", "stop/tello10", {});
  EXPECT_TRUE(knows("asset/Org3MSP/b")) << "it is not there";
  for (int i = 0; i < 200; ++i) write("Org2MSP", {"asset/Org2MSP/" + std::to_string(i)});
  EXPECT_FALSE(knows("asset/Org3MSP/a")) << "of Org2's transactions, and the oldest of that kind";
  EXPECT_FALSE(state_.knows_range("ledgerline", "asset/Org3MSP/", "asset/Org3MSP0"));
  EXPECT_FALSE(knows("asset/Org3MSP/b")) << "nor what was not in it";
  EXPECT_TRUE(state_.knows_range("ledgerline", "stop/tello1/", "stop/tello10"));
}

TEST_F(KeyMemory, ARangeThatIsLargerThanTheMemoryIsNotTaken) {
  std::vector<std::string> keys;
  for (int i = 0; i < 200; ++i) keys.push_back("asset/" + std::to_string(1'000 + i));
  read_range("Org2MSP", "asset/", "asset0", keys);
  EXPECT_FALSE(state_.knows_range("ledgerline", "asset/", "asset0"));
}

TEST_F(KeyMemory, RangesAreBoundedInTheSameWay) {
  read_range("Org2MSP", "stop/tello1/", "stop/tello10", {});
  for (int i = 0; i < 50; ++i) {
    const std::string drone = "stop/far" + std::to_string(i);
    read_range("Org3MSP", drone + "/", drone + "0", {});
  }
  EXPECT_TRUE(state_.knows_range("ledgerline", "stop/tello1/", "stop/tello10"));
  EXPECT_TRUE(state_.knows_range("ledgerline", "stop/far49/", "stop/far490"));
  EXPECT_FALSE(state_.knows_range("ledgerline", "stop/far1/", "stop/far10"));
}

TEST(KeyUse, TheOldestOfTheLargestKindOfTheLargestWriterGoes) {
  KeyUse use;
  const auto key = [](const std::string& text) { return KeyName{"ledgerline", "", text}; };
  use.add(key("role/a"), "Org1MSP");
  auto first = use.add(key("asset/a"), "Org3MSP");
  const auto second = use.add(key("asset/b"), "Org3MSP");
  use.add(key("lease/a"), "Org3MSP");
  EXPECT_EQ(use.oldest_of_largest().key, "asset/a");
  use.touch(first);
  EXPECT_EQ(use.oldest_of_largest().key, "asset/b");
  use.remove(first);
  use.remove(second);
  EXPECT_NE(use.oldest_of_largest().key, "asset/a");
}

}  // namespace
}  // namespace ledgerline::fabric
