#include <gmock/gmock.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <atomic>
#include <future>
#include <thread>

#include "common/fabric/client/client.hpp"
#include "orderer/ab.grpc.pb.h"
#include "peer/peer.grpc.pb.h"
#include "tests/unit/chaincode/node/server/served_node.hpp"

/// The client's direct path (ProcessProposal at the peer, Broadcast at an orderer) against the node, which is both.
namespace ledgerline::node {
namespace {

using ::testing::HasSubstr;
using Kind = fabric::Outcome::Kind;

/// A service beside the node, with the TLS of its first peer.
class Beside {
 public:
  Beside(const ServedNode& as, grpc::Service& service) {
    const auto tls =
        std::filesystem::path(as.tls_ca_file()).parent_path().parent_path() / "peers" / "peer0.org1.ledgerline" / "tls";
    grpc::SslServerCredentialsOptions options;
    options.pem_key_cert_pairs.push_back({text_of(tls / "server.key"), text_of(tls / "server.crt")});
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::SslServerCredentials(options), &port_);
    builder.RegisterService(&service);
    server_ = builder.BuildAndStart();
  }
  ~Beside() { server_->Shutdown(std::chrono::system_clock::now()); }
  std::string endpoint() const { return "127.0.0.1:" + std::to_string(port_); }

 private:
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

/// Says that it does not have all blocks yet, as an own endorser that has just started.
class BehindEndorser final : public protos::Endorser::Service {
 public:
  grpc::Status ProcessProposal(grpc::ServerContext*, const protos::SignedProposal*,
                               protos::ProposalResponse*) override {
    ++asked_;
    return {grpc::StatusCode::UNAVAILABLE, "the endorser does not have all blocks yet"};
  }
  int asked() const { return asked_; }

 private:
  std::atomic<int> asked_{0};
};

/// Takes envelopes and says nothing, as an orderer does whose leader has just died.
class SilentOrderer final : public orderer::AtomicBroadcast::Service {
 public:
  explicit SilentOrderer(const ServedNode& as) : beside_(as, *this) {}
  std::string endpoint() const { return beside_.endpoint(); }
  int taken() const { return taken_; }

  grpc::Status Broadcast(grpc::ServerContext*,
                         grpc::ServerReaderWriter<orderer::BroadcastResponse, common::Envelope>* stream) override {
    for (common::Envelope envelope; stream->Read(&envelope);) ++taken_;
    return grpc::Status::OK;
  }

 private:
  std::atomic<int> taken_{0};
  Beside beside_;
};

/// Hands each envelope on to the node, and counts the streams that it came by.
class CountingOrderer final : public orderer::AtomicBroadcast::Service {
 public:
  explicit CountingOrderer(const ServedNode& as, std::chrono::milliseconds late = {})
      : late_(late), node_(orderer::AtomicBroadcast::NewStub(as.connect())), beside_(as, *this) {}
  std::string endpoint() const { return beside_.endpoint(); }
  int streams() const { return streams_; }
  int envelopes() const { return envelopes_; }

  grpc::Status Broadcast(grpc::ServerContext*,
                         grpc::ServerReaderWriter<orderer::BroadcastResponse, common::Envelope>* stream) override {
    ++streams_;
    grpc::ClientContext context;
    const auto onward = node_->Broadcast(&context);
    orderer::BroadcastResponse response;
    for (common::Envelope envelope; stream->Read(&envelope);) {
      ++envelopes_;
      std::this_thread::sleep_for(late_);
      if (!onward->Write(envelope) || !onward->Read(&response) || !stream->Write(response)) break;
    }
    context.TryCancel();
    return grpc::Status::OK;
  }

 private:
  std::atomic<int> streams_{0}, envelopes_{0};
  const std::chrono::milliseconds late_;
  const std::unique_ptr<orderer::AtomicBroadcast::Stub> node_;
  Beside beside_;
};

class DirectTest : public ::testing::Test {
 protected:
  std::unique_ptr<fabric::Client> connect(const std::vector<std::string>& orderers, const std::string& own_peer = "",
                                          const std::vector<std::string>& endorsers = {}) {
    fabric::ClientConfig config;
    config.endpoint = own_peer.empty() ? served.endpoint() : own_peer;
    if (!own_peer.empty()) config.other_peers.push_back({served.endpoint(), served.tls_ca_file()});
    config.tls_ca_file = served.tls_ca_file();
    for (const std::string& one : orderers) config.orderers.push_back({one, served.tls_ca_file()});
    for (const std::string& one : endorsers) config.endorsers.push_back({"Org1MSP", one, served.tls_ca_file()});
    config.identity = served.user(1, "User1");
    auto client = fabric::Client::create(std::move(config));
    EXPECT_TRUE(client.ok()) << client.error().message;
    return std::move(*client);
  }
  /// A state: what one peer of the drone's organisation endorses.
  static fabric::Call note(const std::string& id) {
    return {"set", {R"({"assets":[{"id":")" + id + R"(","msgType":"t"}],"stream":true})"}};
  }

  ServedNode served;
};

TEST_F(DirectTest, ACallCommitsWithOneEndorsement) {
  const auto client = connect({served.endpoint()});
  const auto outcome = client->submit_and_wait(note("tello1/a"));
  ASSERT_EQ(outcome.kind, Kind::committed) << outcome.message;
  const auto block = fabric::decode_block(**served.node().feed().read(outcome.block));
  EXPECT_EQ(block->transactions[0].tx_id, outcome.tx_id);
  EXPECT_EQ(block->transactions[0].endorsements.size(), 1U) << "through the gateway all three peers endorse";
}

TEST_F(DirectTest, ARefusalOfTheContractHasItsWords) {
  const auto outcome = connect({served.endpoint()})->submit_and_wait(note("Org2MSP/a"));
  EXPECT_EQ(outcome.kind, Kind::refused);
  EXPECT_THAT(outcome.message, HasSubstr("chaincode response 500, Org2MSP: not enrolled"));
}

TEST_F(DirectTest, WhatIsTooLargeForTheOrdererIsRefusedWithItsSize) {
  const fabric::Call call{"set", {R"({"id":"tello1/a","msgType":"t","msgData":")" + std::string(100'000, 'A') + "\"}"}};
  const auto client = connect({served.endpoint()});
  const auto outcome = client->submit_and_wait(call);
  EXPECT_EQ(outcome.kind, Kind::refused);
  EXPECT_THAT(outcome.message, HasSubstr("message payload is"));
  EXPECT_EQ(client->submit_and_wait(note("tello1/a")).kind, Kind::committed) << "on a new stream";
}

TEST_F(DirectTest, ManyCallsAtOnceAreOrderedAsTheyWereSubmitted) {
  const auto client = connect({served.endpoint()});
  ASSERT_EQ(client->submit_and_wait(note("tello1/a")).kind, Kind::committed) << "it streams from now on";
  std::vector<std::promise<fabric::Outcome>> outcomes(40);
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    client->submit(note("tello1/a"),
                   [&outcomes, i](fabric::Outcome outcome) { outcomes[i].set_value(std::move(outcome)); });
  }
  std::uint64_t last = 0;
  for (auto& outcome : outcomes) {
    const auto got = outcome.get_future().get();
    ASSERT_EQ(got.kind, Kind::committed) << got.message;
    EXPECT_GT(got.block, last);
    last = got.block;
  }
}

/// Agent and ground have a client for each class of traffic: what is urgent must not wait behind states or commands,
/// and the orderer must not have to hold more streams than that.
TEST_F(DirectTest, EachClassOfTrafficHasOneStreamToTheOrderer) {
  const CountingOrderer orderer(served);
  const auto states = connect({orderer.endpoint()}), urgent = connect({orderer.endpoint()});
  EXPECT_TRUE(states->evaluate({"get", {}}).ok());
  ASSERT_EQ(urgent->submit_and_wait(note("tello1/a")).kind, Kind::committed);
  EXPECT_EQ(orderer.streams(), 1) << "who only asks has none";
  ASSERT_EQ(states->submit_and_wait(note("tello1/a")).kind, Kind::committed);
  EXPECT_EQ(orderer.streams(), 2) << "the other class does not share it";
  constexpr int each = 40;
  std::vector<std::promise<fabric::Outcome>> outcomes(2 * each);
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    (i % 2 == 0 ? states : urgent)->submit(note("tello1/a"), [&outcomes, i](fabric::Outcome outcome) {
      outcomes[i].set_value(std::move(outcome));
    });
  }
  for (auto& outcome : outcomes) EXPECT_EQ(outcome.get_future().get().kind, Kind::committed);
  EXPECT_EQ(orderer.envelopes(), 2 + 2 * each);
  EXPECT_EQ(orderer.streams(), 2) << "however many calls there are at once";
}

TEST_F(DirectTest, WhoOrdersSoonestIsFoundAndTheStreamsStayOpen) {
  const CountingOrderer follower(served, std::chrono::milliseconds(8)), leader(served);
  const auto client = connect({follower.endpoint(), leader.endpoint()});
  std::atomic<bool> there{false};
  const auto stream =
      client->blocks(std::nullopt, {.on_block = [](const auto&, auto) {},
                                    .on_connection = [&](bool connected, const std::string&) { there = connected; }});
  while (!there) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  fabric::Call call = note("tello1/a");
  call.reported_by_block = true;
  int went_to_leader = 0, sent = 0;
  while (went_to_leader < 60 && sent < 2000) {  // on a busy machine it takes more than one round
    const int before = leader.envelopes();
    for (int i = 0; i < 100; ++i, ++sent) {
      const auto outcome = client->submit_and_wait(call);
      ASSERT_EQ(outcome.kind, Kind::committed) << outcome.message;
    }
    went_to_leader = leader.envelopes() - before;
  }
  EXPECT_EQ(follower.envelopes() + leader.envelopes(), sent);
  EXPECT_GE(went_to_leader, 60);
  EXPECT_EQ(follower.streams(), 1);
  EXPECT_EQ(leader.streams(), 1);
}

TEST_F(DirectTest, AnOrdererThatIsGoneIsPassedOver) {
  const auto client = connect({"127.0.0.1:1", served.endpoint()});
  for (int i = 0; i < 3; ++i) EXPECT_EQ(client->submit_and_wait(note("tello1/a")).kind, Kind::committed);
}

TEST_F(DirectTest, AnotherPeerStandsInForOneThatIsGone) {
  const std::string gone = "127.0.0.1:1";
  for (const auto& orderers : {std::vector<std::string>{served.endpoint()}, std::vector<std::string>{}}) {
    const auto client = connect(orderers, gone);
    std::promise<std::uint64_t> seen;
    std::atomic<bool> reported{false};
    const auto stream = client->blocks(0, {.on_block =
                                               [&](const fabric::Block& block, std::string_view) {
                                                 if (!reported.exchange(true)) seen.set_value(block.number);
                                               },
                                           .on_connection = {}});
    EXPECT_EQ(seen.get_future().get(), 0U);
    EXPECT_EQ(client->submit_and_wait(note("tello1/a")).kind, Kind::committed);
    EXPECT_TRUE(client->evaluate({"get", {}}).ok());
  }
}

TEST_F(DirectTest, AnEndorserThatIsBehindRestsAndTheNextOneIsAsked) {
  BehindEndorser behind;
  const Beside beside(served, behind);
  // With the peer behind it in the config, and without: then it is the own peer all the same.
  for (const auto& endorsers : {std::vector{beside.endpoint(), served.endpoint()}, std::vector{beside.endpoint()}}) {
    const int before = behind.asked();
    const auto client = connect({served.endpoint()}, "", endorsers);
    const auto began = std::chrono::steady_clock::now();
    int calls = 0;
    for (; std::chrono::steady_clock::now() - began < std::chrono::milliseconds(600); ++calls) {
      const auto outcome = client->submit_and_wait(note("tello1/a"));
      ASSERT_EQ(outcome.kind, Kind::committed) << outcome.message;
    }
    const int asked = behind.asked() - before;
    EXPECT_GE(asked, 1);
    EXPECT_LE(asked, 5) << "of " << calls << " calls: it rests for 0.2 s each time";
    EXPECT_GT(calls, asked);
  }
}

TEST_F(DirectTest, AnOrdererThatIsSilentIsPassedOver) {
  const SilentOrderer silent(served);
  const auto client = connect({silent.endpoint(), served.endpoint()});
  for (int i = 0; i < 3; ++i) {
    const auto outcome = client->submit_and_wait(note("tello1/a"));
    EXPECT_EQ(outcome.kind, Kind::committed) << outcome.message;
  }
  EXPECT_EQ(silent.taken(), 1) << "what comes after goes to the one that answers";
}

TEST_F(DirectTest, AClientThatEndsInTheMiddleAnswersEveryCall) {
  std::promise<fabric::Outcome> outcome;
  {
    const auto client = connect({"127.0.0.1:1"});
    client->submit(note("tello1/a"), [&](fabric::Outcome got) { outcome.set_value(std::move(got)); });
  }
  EXPECT_EQ(outcome.get_future().get().kind, Kind::unavailable);
}

}  // namespace
}  // namespace ledgerline::node
