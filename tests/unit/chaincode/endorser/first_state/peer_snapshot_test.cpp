#include "chaincode/endorser/core/peer_snapshot.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "tests/unit/chaincode/endorser/first_state/followed_channel.hpp"

namespace ledgerline::endorser {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class PeerSnapshotTest : public FollowedChannel {
 protected:
  std::string refused(const PeerSnapshotFiles& files, std::string_view hash = {}) {
    const auto read = read_peer_snapshot(files, {}, hash);
    return read ? "it was read" : read.error().message;
  }
  /// With these records of the contract alone, and the configuration.
  std::string refused_with(const std::vector<std::string>& records) {
    PeerSnapshotFiles files = snapshot_of(known());
    put_states(files, {namespaces_of(known()).front(), {"ledgerline", records}});
    seal(files, known().end);
    return refused(files);
  }
};

TEST_F(PeerSnapshotTest, SaysWhatTheChainHasMade) {
  const Snapshot all = known();
  const auto said = read_peer_snapshot(snapshot_of(all), {}, {});
  ASSERT_TRUE(said.ok()) << said.error().message;
  EXPECT_EQ(said->end.height, channel.blocks.size());
  EXPECT_EQ(said->end.hash, all.end.hash);
  EXPECT_EQ(said->config_block, 0U);
  int policies = 0;
  for (const auto& [mine, peers] :
       {std::pair{&said->contract, &channel.peer.state()}, {&said->lifecycle, &all.lifecycle}}) {
    ASSERT_EQ(mine->values().size(), peers->values().size());
    for (const auto& [key, value] : peers->values()) {
      const node::State::Value* const read = mine->find(key);
      ASSERT_NE(read, nullptr) << key;
      EXPECT_EQ(read->bytes, value.bytes);
      EXPECT_EQ(read->version, value.version);
      EXPECT_EQ(read->policy, value.policy);
      if (!value.policy.empty()) ++policies;
    }
  }
  EXPECT_GT(policies, 0) << "records have keepers";
  ASSERT_EQ(said->contract.parts().txs.size(), all.contract.parts().txs.size());
  for (const auto& [id, tx] : all.contract.parts().txs) EXPECT_TRUE(said->contract.find_tx(id)) << id;
}

TEST_F(PeerSnapshotTest, AFileThatIsNotTheOneThatWasSealedIsRefused) {
  const PeerSnapshotFiles whole = snapshot_of(known());
  for (const auto& [name, member] : {std::pair{"public_state.data", &PeerSnapshotFiles::states},
                                     {"public_state.metadata", &PeerSnapshotFiles::states_counts},
                                     {"txids.data", &PeerSnapshotFiles::ids},
                                     {"txids.metadata", &PeerSnapshotFiles::ids_count}}) {
    PeerSnapshotFiles files = whole;
    (files.*member).back() ^= 1;
    EXPECT_EQ(refused(files), std::string(name) +
                                  ": its SHA-256 is not the one that "
                                  "_snapshot_signable_metadata.json names: it is damaged, or was changed");
    files = whole;
    (files.*member).pop_back();
    EXPECT_THAT(refused(files), HasSubstr("its SHA-256 is not"));
    (files.*member).clear();
    EXPECT_THAT(refused(files), HasSubstr("its SHA-256 is not"));
  }
  PeerSnapshotFiles files = whole;
  files.description += " ";
  EXPECT_THAT(refused(files), HasSubstr("its SHA-256 is not the snapshot_hash"));
}

TEST_F(PeerSnapshotTest, ASnapshotThatAnotherPeerDoesNotHaveIsRefused) {
  const PeerSnapshotFiles files = snapshot_of(known());
  const std::string hash = crypto::hex(crypto::sha256(files.description));
  EXPECT_EQ(refused(files, hash), "it was read");
  EXPECT_THAT(refused(files, std::string(64, '0')), HasSubstr("not first_state_hash: it is another snapshot"));
}

TEST_F(PeerSnapshotTest, AnotherChannelsOrDatabasesIsRefused) {
  PeerSnapshotFiles files = snapshot_of(known());
  seal(files, known().end, "racing");
  EXPECT_EQ(refused(files), "_snapshot_signable_metadata.json: it is of channel racing, not of teleop");
  seal(files, known().end, "teleop", "CouchDB");
  EXPECT_THAT(refused(files), HasSubstr("state_db_type is CouchDB"));
}

TEST_F(PeerSnapshotTest, ADescriptionThatSaysTooLittleIsRefused) {
  const PeerSnapshotFiles whole = snapshot_of(known());
  for (const char* description :
       {"", "no JSON", "[]", "{}", R"({"snapshot_files_raw_hashes": 3})", R"({"snapshot_files_raw_hashes": {}})"}) {
    PeerSnapshotFiles files = whole;
    files.description = description;
    files.description_hash = R"({"snapshot_hash": ")" + crypto::hex(crypto::sha256(files.description)) + R"("})";
    EXPECT_NE(refused(files), "it was read") << description;
  }
  for (const char* beside : {"", "[]", "{}", R"({"snapshot_hash": 7})"}) {
    PeerSnapshotFiles files = whole;
    files.description_hash = beside;
    EXPECT_NE(refused(files), "it was read") << beside;
  }
  for (const auto& [from, to] :
       {std::pair<std::string, std::string>{"\"last_block_number\": ", "\"last_block_number\": -"},
        {"\"last_block_hash\": \"", "\"last_block_hash\": \"xy"},
        {"\"last_block_number\"", "\"number\""}}) {
    PeerSnapshotFiles files = whole;
    files.description.replace(files.description.find(from), from.size(), to);
    files.description_hash = R"({"snapshot_hash": ")" + crypto::hex(crypto::sha256(files.description)) + R"("})";
    EXPECT_THAT(refused(files), HasSubstr("no last_block_number, or no last_block_hash")) << to;
  }
}

TEST_F(PeerSnapshotTest, AnotherFormatIsRefused) {
  for (const auto member : {&PeerSnapshotFiles::states, &PeerSnapshotFiles::states_counts, &PeerSnapshotFiles::ids,
                            &PeerSnapshotFiles::ids_count}) {
    PeerSnapshotFiles files = snapshot_of(known());
    (files.*member).front() = '\x02';
    seal(files, known().end);
    EXPECT_THAT(refused(files), HasSubstr("its format is 2, where 1 is read"));
  }
}

TEST_F(PeerSnapshotTest, AFileThatEndsTooEarlyOrLateIsRefused) {
  for (const auto member : {&PeerSnapshotFiles::states, &PeerSnapshotFiles::states_counts, &PeerSnapshotFiles::ids,
                            &PeerSnapshotFiles::ids_count}) {
    const PeerSnapshotFiles whole = snapshot_of(known());
    for (std::size_t size = 0; size < (whole.*member).size(); size += 1 + size / 64) {
      PeerSnapshotFiles files = whole;
      (files.*member).resize(size);
      seal(files, known().end);
      ASSERT_NE(refused(files), "it was read") << size;
    }
    PeerSnapshotFiles files = whole;
    (files.*member) += '\0';
    seal(files, known().end);
    EXPECT_THAT(refused(files), HasSubstr("it is not whole"));
  }
}

TEST_F(PeerSnapshotTest, ADamagedRecordIsRefused) {
  const node::Version at{1, 0};
  const std::string good = state_record("a", {"1", at});
  EXPECT_EQ(refused_with({good, state_record("b", {"1", at, "policy"})}), "it was read");
  EXPECT_THAT(refused_with({state_record("b", {"1", at}), good}), HasSubstr("the record of key a is damaged"));
  EXPECT_THAT(refused_with({good, good}), HasSubstr("the record of key a is damaged"));
  EXPECT_THAT(refused_with({state_record("", {"1", at})}), HasSubstr("is damaged"));
  EXPECT_THAT(refused_with({state_record("a", {"", at})}), HasSubstr("is damaged")) << "an empty value is a deletion";
  EXPECT_THAT(refused_with({state_record("a", {"1", {channel.blocks.size(), 0}})}), HasSubstr("is damaged"))
      << "written behind the newest block";
  EXPECT_EQ(refused_with({state_record("a", {"1", {channel.blocks.size() - 1, UINT64_MAX}})}), "it was read");
  const std::string key = "\x0a" + go_text("a"), value = "\x12" + go_text("1");
  for (const std::string& record : {key + value, key + value + "\x22" + go_text("\x01"),
                                    key + value + "\x22" + go_text(std::string("\x01\x01\x00\x00", 4)),
                                    key + value + "\x22" + go_text(std::string("\x09") + std::string(20, '\x01')),
                                    value + key, key + key, key + value + "\x2a" + go_text("1"), key + "\x10\x01",
                                    key + value + "\x1a" + go_text("\xff"), std::string("\xff")})
    EXPECT_THAT(refused_with({go_text(record)}), HasSubstr("is damaged")) << crypto::hex(record);
}

TEST_F(PeerSnapshotTest, NamespacesAndIdsOutOfOrderAndNoConfigurationAreRefused) {
  PeerSnapshotFiles files = snapshot_of(known());
  auto all = namespaces_of(known());
  std::swap(all[2], all[3]);
  put_states(files, all);
  seal(files, known().end);
  EXPECT_EQ(refused(files), "public_state.metadata: it is not whole");
  all = namespaces_of(known());
  all.erase(all.begin());
  put_states(files, all);
  seal(files, known().end);
  EXPECT_EQ(refused(files), "public_state.data: it has no configuration of the channel");
  files = snapshot_of(known());
  const std::string one = go_text(std::string(64, 'f'));
  files.ids += one + one;
  files.ids_count = '\x01' + go_number(known().contract.parts().txs.size() + 3);
  seal(files, known().end);
  EXPECT_EQ(refused(files), "txids.data: it is not whole");
}

TEST_F(PeerSnapshotTest, NumbersThatNoFileCanHoldAreRefusedAtOnce) {
  for (const auto& number : {go_number(UINT64_MAX), std::string(9, '\xff') + "\x02", std::string(12, '\x80')}) {
    PeerSnapshotFiles files = snapshot_of(known());
    files.states_counts = '\x01' + number;
    seal(files, known().end);
    EXPECT_THAT(refused(files), StartsWith("public_state.metadata")) << crypto::hex(number);
    files = snapshot_of(known());
    files.states_counts = '\x01' + go_number(1) + go_text("of nobody") + number;
    seal(files, known().end);
    EXPECT_THAT(refused(files), HasSubstr("it is not whole"));
    files = snapshot_of(known());
    files.ids_count = '\x01' + number;
    seal(files, known().end);
    EXPECT_THAT(refused(files), HasSubstr("it is not whole"));
    files.ids_count = '\x01' + go_number(1);
    files.ids = '\x01' + number;
    seal(files, known().end);
    EXPECT_EQ(refused(files), "txids.data: it is not whole");
  }
}

TEST_F(PeerSnapshotTest, AnyBytesAreReadOrRefused) {
  const PeerSnapshotFiles whole = snapshot_of(known());
  std::mt19937 random(3);
  for (int i = 0; i < 2000; ++i) {
    PeerSnapshotFiles files = whole;
    for (const auto member : {&PeerSnapshotFiles::states, &PeerSnapshotFiles::states_counts, &PeerSnapshotFiles::ids,
                              &PeerSnapshotFiles::ids_count}) {
      if (random() % 2 == 0) (files.*member)[random() % (files.*member).size()] = static_cast<char>(random());
    }
    seal(files, known().end);
    ASSERT_FALSE(refused(files).empty());
  }
}

}  // namespace
}  // namespace ledgerline::endorser
