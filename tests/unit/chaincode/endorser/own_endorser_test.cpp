#include "chaincode/endorser/shell/service.hpp"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <nlohmann/json.hpp>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "common/base/file.hpp"
#include "common/fabric/blocks/checkpoint.hpp"
#include "common/fabric/client/client.hpp"
#include "tests/unit/chaincode/endorser/first_state/snapshots_of_tests.hpp"
#include "tests/unit/chaincode/node/server/served_node.hpp"

/// An endorser in the client's process, against the embedded node, which is its peer and orderer.
namespace ledgerline::endorser {
namespace {

using ::testing::HasSubstr;
using Kind = fabric::Outcome::Kind;
using node::ServedNode;

fabric::Call state(const std::string& id) {
  return {"set", {R"({"assets":[{"id":")" + id + R"(","msgType":"t"}],"stream":true})"}};
}

/// That nobody had a moment ago.
int free_port() {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof at;
  EXPECT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&at), size), 0);
  EXPECT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size), 0);
  ::close(fd);
  return ntohs(at.sin_port);
}

class FakeEndorser final : public fabric::OwnEndorser {
 public:
  explicit FakeEndorser(Answer answer) : answer_(std::move(answer)) {}
  Answer endorse(const std::string&) override {
    ++asked;
    return answer_;
  }
  fabric::Client::StreamHandlers fed_by(fabric::Client::StreamHandlers handlers) override { return handlers; }
  std::atomic<int> asked{0};

 private:
  const Answer answer_;
};

class WithinTest : public ::testing::Test {
 protected:
  fabric::ClientConfig config() const {
    fabric::ClientConfig config;
    config.endpoint = served.endpoint();
    config.tls_ca_file = served.tls_ca_file();
    config.orderers.push_back({served.endpoint(), served.tls_ca_file()});
    config.config_block = node::text_of(organisation().parent_path().parent_path().parent_path() / "teleop.block");
    config.identity = served.user(1, "User1");
    return config;
  }
  std::filesystem::path organisation() const {
    return std::filesystem::path(served.tls_ca_file()).parent_path().parent_path();
  }
  /// Sends many states through a client with this endorser, with a block stream; what the endorser says it did.
  nlohmann::json send_states(const std::filesystem::path& msp_dir, fabric::BlockSource blocks,
                             const std::string& checkpoint = "", const FirstStateSettings& first_state = {},
                             int states = count) {
    const std::filesystem::path summary = organisation() / "within.json";
    fabric::ClientConfig with = config();
    with.blocks = blocks;
    const Status begun = start_own_endorser({msp_dir, 10, summary, checkpoint, {}, first_state}, with);
    EXPECT_TRUE(begun.ok()) << begun.error().message;
    {
      const auto client = fabric::Client::create(std::move(with)).value();
      std::atomic<int> seen{0};
      const auto stream = client->blocks(std::nullopt, {.on_block = [&](const auto&, auto) { ++seen; },
                                                        .on_connection = [](bool, const std::string&) {}});
      for (int i = 0; i < states; ++i) {
        const auto outcome = client->submit_and_wait(state("tello1/a"));
        EXPECT_EQ(outcome.kind, Kind::committed) << outcome.message;
      }
      EXPECT_GT(seen, states - count / 2) << "the stream's own reader has its blocks, too";
    }
    with = {};
    return nlohmann::json::parse(node::text_of(summary), nullptr, false);
  }

  // A client that was sent on to the peer at the start rests 0.2 s before it asks its endorser again: far more than it
  // sends in that.
  static constexpr int count = 500;
  ServedNode served;
};

TEST_F(WithinTest, CallsAreEndorsedInTheProcessOnTheStreamThatItReadsAnyway) {
  for (const auto blocks : {fabric::BlockSource::peer, fabric::BlockSource::ordered}) {
    const auto counts = send_states(organisation() / "peers/peer0.org1.ledgerline/msp", blocks);
    EXPECT_GT(counts["answered"], count / 2) << counts;
    EXPECT_EQ(counts["differ"], 0) << counts;
    EXPECT_GT(counts["same"], 0) << counts;
    EXPECT_EQ(counts["joined"], true) << counts;
  }
}

TEST_F(WithinTest, WithAnIdentityThatMayNotEndorseItLeavesAllToThePeer) {
  const auto counts = send_states(organisation() / "users/User1@org1.ledgerline/msp", fabric::BlockSource::peer);
  EXPECT_EQ(counts["answered"], 0) << counts;
  EXPECT_GT(counts["sent_to_the_peer"], 0) << counts;
}

TEST_F(WithinTest, AnotherStartGoesOnBehindItsCheckpoint) {
  const auto identity = organisation() / "peers/peer0.org1.ledgerline/msp";
  const std::string file = organisation() / "endorser.checkpoint";
  const auto first = send_states(identity, fabric::BlockSource::peer, file);
  EXPECT_EQ(first["restored"], 0);
  EXPECT_EQ(std::filesystem::status(file).permissions(), std::filesystem::perms(0600));
  const auto second = send_states(identity, fabric::BlockSource::peer, file);
  EXPECT_GE(second["restored"], count) << second;
  EXPECT_GT(second["answered"], count / 2) << second;
  EXPECT_EQ(second["differ"], 0);
  EXPECT_EQ(second["apart"], 0);
  auto checkpoint = *fabric::read_checkpoint(file, "teleop/ledgerline").value();
  checkpoint.records.pop_back();
  ASSERT_TRUE(fabric::write_checkpoint(file, checkpoint).ok());
  fabric::ClientConfig with = config();
  EXPECT_THAT(start_own_endorser({identity, 10, "", file, {}}, with).error().message, HasSubstr("is not whole"));
  ::chmod(file.c_str(), 0640);
  EXPECT_THAT(start_own_endorser({identity, 10, "", file, {}}, with).error().message, HasSubstr("chmod 600"));
}

/// As a peer of Fabric would write it that has what is in this checkpoint.
void write_snapshot(const std::filesystem::path& folder, const std::string& checkpoint, const std::string& hash = "") {
  auto known = read_snapshot(fabric::read_checkpoint(checkpoint, "teleop/ledgerline").value()->records).value();
  if (!hash.empty()) known.end.hash = hash;
  const PeerSnapshotFiles files = snapshot_of(known);
  for (const auto& [name, content] : {std::pair{peer_snapshot_file::description, &files.description},
                                      {peer_snapshot_file::description_hash, &files.description_hash},
                                      {peer_snapshot_file::states, &files.states},
                                      {peer_snapshot_file::states_counts, &files.states_counts},
                                      {peer_snapshot_file::ids, &files.ids},
                                      {peer_snapshot_file::ids_count, &files.ids_count}})
    ASSERT_TRUE(write_file(folder / name, *content).ok());
}

TEST_F(WithinTest, AFirstStartGoesOnBehindAPeersSnapshot) {
  const auto identity = organisation() / "peers/peer0.org1.ledgerline/msp";
  const std::string file = organisation() / "endorser.checkpoint", another = organisation() / "another.checkpoint";
  const std::filesystem::path folder = organisation() / "snapshot", states = folder / peer_snapshot_file::states;
  const auto refused = [&](const FirstStateSettings& first_state, const std::string& checkpoint = "") {
    fabric::ClientConfig with = config();
    const Status begun = start_own_endorser({identity, 10, "", checkpoint, {}, first_state}, with);
    return begun ? "it begins" : begun.error().message;
  };
  (void)send_states(identity, fabric::BlockSource::peer, file);
  write_snapshot(folder, file);
  const auto first = send_states(identity, fabric::BlockSource::peer, another, {folder});
  EXPECT_GE(first["restored"], count) << first;
  EXPECT_GT(first["answered"], count / 2) << first;
  EXPECT_EQ(first["differ"], 0) << first;
  EXPECT_EQ(first["apart"], 0) << first;

  EXPECT_THAT(refused({folder, std::string(64, '0')}), HasSubstr("it is another snapshot"));
  EXPECT_THAT(refused({"", std::string(64, '0')}), HasSubstr("first_state_hash without first_state"));
  ::chmod(states.c_str(), 0664);
  EXPECT_THAT(refused({folder}), HasSubstr("chmod go-w"));
  ::chmod(states.c_str(), 0644);
  std::string content = node::text_of(states);
  content.back() ^= 1;
  ASSERT_TRUE(write_file(states, content).ok());
  EXPECT_THAT(refused({folder}), HasSubstr("public_state.data: its SHA-256 is not"));
  EXPECT_THAT(refused({folder}), HasSubstr("peer snapshot submitrequest")) << "what to do";
  EXPECT_EQ(refused({folder}, another), "it begins") << "behind its own checkpoint, which is newer";
  std::filesystem::remove(states);
  EXPECT_THAT(refused({folder}), HasSubstr("public_state.data: there is no such file"));
  std::filesystem::remove_all(folder);
  EXPECT_THAT(refused({folder}), HasSubstr("there is no such folder"));

  write_snapshot(folder, file, std::string(32, 'x'));
  const auto other = send_states(identity, fabric::BlockSource::peer, "", {folder}, 10);
  EXPECT_EQ(other["answered"], 0) << "of another chain: it never signs";
  EXPECT_EQ(other["restored"], 0) << other;
}

TEST_F(WithinTest, WithBlocksAsTheyAreOrderedItsCheckpointIsOfABlockThatThePeerHasReported) {
  const auto identity = organisation() / "peers/peer0.org1.ledgerline/msp";
  const std::string file = organisation() / "endorser.checkpoint";
  const auto first = send_states(identity, fabric::BlockSource::ordered, file);
  EXPECT_EQ(first["joined"], true);
  const auto second = send_states(identity, fabric::BlockSource::ordered, file);
  EXPECT_GE(second["restored"], count) << second;
  EXPECT_GT(second["answered"], count / 2) << second;
  EXPECT_EQ(second["differ"], 0);
  EXPECT_EQ(second["apart"], 0);
}

TEST_F(WithinTest, ItServesOtherProgramsWhereItIsAskedTo) {
  const std::filesystem::path peer = organisation() / "peers/peer0.org1.ledgerline";
  fabric::ClientConfig with = config();
  const Status nowhere =
      start_own_endorser({peer / "msp", 1, "", "", {"127.0.0.1:0", peer / "tls/none.crt", ""}}, with);
  EXPECT_THAT(nowhere.error().message, HasSubstr("own_endorser.tls_certificate"));
  const ServeSettings no_authority{"127.0.0.1:0", peer / "tls/server.crt", peer / "tls/server.key",
                                   peer / "tls/none.crt"};
  EXPECT_THAT(start_own_endorser({peer / "msp", 1, "", "", no_authority}, with).error().message,
              HasSubstr("own_endorser.tls_client_ca"));
  const std::string at = "127.0.0.1:" + std::to_string(free_port());
  const std::filesystem::path summary = organisation() / "serving.json";
  ASSERT_TRUE(
      start_own_endorser({peer / "msp", 10, summary, "", {at, peer / "tls/server.crt", peer / "tls/server.key"}}, with)
          .ok());
  fabric::ClientConfig other = config();
  other.endorsers = {{"Org1MSP", at, served.tls_ca_file()}, {"Org1MSP", served.endpoint(), served.tls_ca_file()}};
  const auto client = fabric::Client::create(std::move(other)).value();
  for (int i = 0; i < count; ++i) EXPECT_EQ(client->submit_and_wait(state("tello1/a")).kind, Kind::committed);
  with = {};
  EXPECT_GT(nlohmann::json::parse(node::text_of(summary))["answered"], count / 2);
}

TEST_F(WithinTest, NoIdentityIsNoEndorserAndABadOneAnError) {
  fabric::ClientConfig none = config();
  EXPECT_TRUE(start_own_endorser({}, none).ok());
  EXPECT_EQ(none.own_endorser, nullptr);
  EXPECT_THAT(start_own_endorser({organisation() / "nowhere", 1, "", "", {}}, none).error().message,
              HasSubstr("own_endorser.msp_dir"));
  none.orderers.clear();
  EXPECT_THAT(
      start_own_endorser({organisation() / "peers/peer0.org1.ledgerline/msp", 1, "", "", {}}, none).error().message,
      HasSubstr("no [[orderer]]"));
  none.own_endorser = std::make_shared<FakeEndorser>(fabric::OwnEndorser::Answer{.response = std::string()});
  EXPECT_FALSE(fabric::Client::create(none).ok());
}

TEST_F(WithinTest, OneThatCannotAnswerRestsAndThePeerIsAsked) {
  const auto own = std::make_shared<FakeEndorser>(
      fabric::OwnEndorser::Answer{.response = Error{"not all blocks yet"}, .elsewhere = true});
  fabric::ClientConfig with = config();
  with.own_endorser = own;
  const auto client = fabric::Client::create(std::move(with)).value();
  const auto began = std::chrono::steady_clock::now();
  int calls = 0;
  for (; std::chrono::steady_clock::now() - began < std::chrono::milliseconds(600); ++calls) {
    const auto outcome = client->submit_and_wait(state("tello1/a"));
    ASSERT_EQ(outcome.kind, Kind::committed) << outcome.message;
  }
  EXPECT_GE(own->asked, 1);
  EXPECT_LE(own->asked, 5) << "of " << calls << " calls: it rests for 0.2 s each time";
  // Where two organisations are asked it is passed over likewise.
  fabric::Call both = state("tello1/a");
  both.need = fabric::EndorsementNeed{.count = fabric::EndorsementNeed::Count::two};
  EXPECT_EQ(client->submit_and_wait(both).kind, Kind::committed);
}

TEST_F(WithinTest, ItsRefusalIsTheCallsEnd) {
  fabric::ClientConfig with = config();
  with.own_endorser = std::make_shared<FakeEndorser>(fabric::OwnEndorser::Answer{.response = Error{"access denied"}});
  const auto outcome = fabric::Client::create(std::move(with)).value()->submit_and_wait(state("tello1/a"));
  EXPECT_EQ(outcome.kind, Kind::refused);
  EXPECT_EQ(outcome.message, "access denied");
}

TEST_F(WithinTest, AnAnswerThatIsNoResponseIsNotSent) {
  fabric::ClientConfig with = config();
  with.own_endorser =
      std::make_shared<FakeEndorser>(fabric::OwnEndorser::Answer{.response = std::string("\xff nothing")});
  EXPECT_EQ(fabric::Client::create(std::move(with)).value()->submit_and_wait(state("tello1/a")).kind, Kind::refused);
}

}  // namespace
}  // namespace ledgerline::endorser
