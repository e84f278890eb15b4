#include <grpcpp/support/status.h>
#include <gtest/gtest.h>

#include <atomic>
#include <condition_variable>
#include <fstream>
#include <future>
#include <mutex>
#include <thread>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "tests/unit/common/fabric/client/door.hpp"
#include "tests/unit/common/fabric/client/fake_gateway.hpp"

namespace ledgerline::fabric {
namespace {

using Kind = Outcome::Kind;

/// Collects outcomes; they come on the client's thread.
class Outcomes {
 public:
  std::function<void(Outcome)> collect() {
    return [this](Outcome outcome) {
      const std::lock_guard lock(mutex_);
      all_.push_back(std::move(outcome));
      changed_.notify_all();
    };
  }
  std::vector<Outcome> await(std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return all_.size() >= count; });
    return all_;
  }
  std::vector<Outcome> now() {
    const std::lock_guard lock(mutex_);
    return all_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Outcome> all_;
};

FakeStatus unavailable() { return {grpc::StatusCode::UNAVAILABLE, "connection lost", ""}; }

std::unique_ptr<Client> client_of(const FakeGateway& gateway) {
  return Client::create(gateway.client_config()).value();
}

TEST(Pipeline, ACallIsEndorsedSubmittedAndCommitted) {
  FakeGateway gateway;
  for (const crypto::Library library : {crypto::Library::mbedtls, crypto::Library::libcrypto}) {
    const auto client = Client::create(gateway.client_config(library)).value();
    const TimeNs before_ns = monotonic_ns();
    const Outcome outcome = client->submit_and_wait({"set", {"payload"}});
    ASSERT_EQ(outcome.kind, Kind::committed) << outcome.message;
    EXPECT_LE(before_ns, outcome.endorsed_ns);
    EXPECT_LE(outcome.endorsed_ns, monotonic_ns());
    EXPECT_TRUE(outcome.ordered_ns == 0 || outcome.endorsed_ns <= outcome.ordered_ns);
    EXPECT_EQ(outcome.code, 0);
    EXPECT_EQ(outcome.answer, "answer to set");
    const Transaction transaction = gateway.chain().at(outcome.block).transactions.at(0);
    EXPECT_EQ(transaction.tx_id, outcome.tx_id);
    EXPECT_EQ(transaction.event_payload, "payload");
  }
}

TEST(Pipeline, EvaluateAsksWithoutWriting) {
  FakeGateway gateway({.endorse = [](const Call& call, int) {
    return call.function == "bad"
               ? FakeStatus{grpc::StatusCode::UNKNOWN, "evaluate call to endorser returned error", "no such id"}
               : FakeStatus{};
  }});
  const auto client = client_of(gateway);
  EXPECT_EQ(client->evaluate({"get", {"a"}}).value(), "answer to get");
  EXPECT_EQ(client->evaluate({"bad", {}}).error().message, "no such id");
  EXPECT_EQ(gateway.submit_calls(), 0);
}

TEST(Pipeline, ARefusalCarriesTheContractsReason) {
  FakeGateway gateway({.endorse = [](const Call&, int) {
    return FakeStatus{grpc::StatusCode::ABORTED, "failed to endorse transaction",
                      "chaincode response 500, tello1: lease held by CN=x"};
  }});
  const Outcome outcome = client_of(gateway)->submit_and_wait({"command", {}});
  EXPECT_EQ(outcome.kind, Kind::refused);
  EXPECT_EQ(outcome.message, "chaincode response 500, tello1: lease held by CN=x");
  EXPECT_EQ(outcome.endorsed_ns, 0);
  EXPECT_EQ(gateway.endorse_calls(), 1);
  EXPECT_EQ(gateway.submit_calls(), 0);
}

TEST(Pipeline, WhatAServerSaysIsOneLineThatATerminalCanShow) {
  const std::string words = "no such id\n12:00:00 error agent: all is lost \x1b[2J";
  const std::string shown = "no such id?12:00:00 error agent: all is lost ?[2J";
  FakeGateway gateway({.endorse = [&](const Call& call, int) {
    const bool plain = call.function == "plain";
    return FakeStatus{grpc::StatusCode::ABORTED, plain ? words : "x", plain ? "" : words};
  }});
  const auto client = client_of(gateway);
  EXPECT_EQ(client->submit_and_wait({"plain", {}}).message, shown);
  EXPECT_EQ(client->submit_and_wait({"detailed", {}}).message, shown);
}

TEST(Pipeline, AnInvalidatedTransactionSaysWhy) {
  FakeGateway gateway({.flag = [](const Call&) { return '\x0b'; }});
  const Outcome outcome = client_of(gateway)->submit_and_wait({"set", {}});
  EXPECT_EQ(outcome.kind, Kind::invalidated);
  EXPECT_EQ(outcome.code, 11);
  EXPECT_EQ(outcome.message, "MVCC_READ_CONFLICT");
  EXPECT_EQ(outcome.block, 1U);
}

TEST(Pipeline, EndorsingIsRepeatedUntilThePeerIsThere) {
  FakeGateway gateway({.endorse = [](const Call&, int attempt) { return attempt < 3 ? unavailable() : FakeStatus{}; }});
  EXPECT_EQ(client_of(gateway)->submit_and_wait({"set", {}}).kind, Kind::committed);
  EXPECT_EQ(gateway.endorse_calls(), 3);
  EXPECT_EQ(gateway.submit_calls(), 1);
}

TEST(Pipeline, RepeatingHasALimit) {
  FakeGateway gateway({.endorse = [](const Call&, int) { return unavailable(); }});
  const auto client = client_of(gateway);
  const Outcome outcome = client->submit_and_wait({"set", {}});
  EXPECT_EQ(outcome.kind, Kind::unavailable);
  EXPECT_NE(outcome.message.find("connection lost"), std::string::npos) << outcome.message;
  EXPECT_EQ(gateway.endorse_calls(), 5);
  const auto evaluated = client->evaluate({"get", {}});
  ASSERT_FALSE(evaluated);
  EXPECT_EQ(evaluated.error().message, "ledger at " + gateway.client_config().endpoint + ": connection lost");
}

TEST(Pipeline, SubmitIsNeverRepeatedAndALostAnswerIsFoundOut) {
  FakeGateway gateway({.after_submit = [](const std::string&) { return unavailable(); }});
  const Outcome outcome = client_of(gateway)->submit_and_wait({"set", {}});
  EXPECT_EQ(outcome.kind, Kind::committed) << outcome.message;
  EXPECT_EQ(gateway.submit_calls(), 1);
  EXPECT_EQ(gateway.chain().size(), 2U);
}

TEST(Pipeline, ASubmitThatTheOrdererRefusesEndsAtOnce) {
  FakeGateway gateway({.before_submit = [](const std::string&) {
    return FakeStatus{grpc::StatusCode::ABORTED, "failed to send transaction to orderer", "status=BAD_REQUEST"};
  }});
  auto config = gateway.client_config();
  config.deadline = std::chrono::hours(1);  // it does not wait for a status that never comes
  const Outcome outcome = Client::create(config).value()->submit_and_wait({"set", {}});
  EXPECT_EQ(outcome.kind, Kind::refused);
  EXPECT_EQ(outcome.message, "status=BAD_REQUEST");
  EXPECT_EQ(gateway.submit_calls(), 1);
}

TEST(Pipeline, AnAnswerThatComesTooLateIsUnavailable) {
  FakeGateway gateway({.before_submit = [](const std::string&) { return unavailable(); }});
  auto config = gateway.client_config();
  config.deadline = std::chrono::milliseconds(300);
  const Outcome outcome = Client::create(config).value()->submit_and_wait({"set", {}});
  EXPECT_EQ(outcome.kind, Kind::unavailable);
  EXPECT_NE(outcome.message.find("submitted, but its status is not known"), std::string::npos) << outcome.message;
  EXPECT_NE(outcome.message.find("connection lost"), std::string::npos) << outcome.message;
}

/// A client with a block stream that is there, and how often its peer was asked for a status.
struct Watched {
  std::atomic<int> asked{0};
  Door blocks, connected;
  FakeGateway gateway;
  std::unique_ptr<Client> client;
  std::unique_ptr<Client::Stream> stream;

  explicit Watched(FakeBehaviour behaviour = {}) : gateway(with_count(std::move(behaviour))) {
    client = client_of(gateway);
    stream = client->blocks(0, {.on_block = {}, .on_connection = [this](bool is, const std::string&) {
                                  if (is) connected.open();
                                }});
    connected.pass();
  }
  FakeBehaviour with_count(FakeBehaviour behaviour) {
    behaviour.status = [this](const std::string&) {
      ++asked;
      return FakeStatus{};
    };
    return behaviour;
  }
};

TEST(Pipeline, ABlockStreamOfTheClientTellsTheEnd) {
  Watched watched({.flag = [](const Call& call) { return call.args[0] == "bad" ? '\x0b' : '\0'; }});
  const Outcome good = watched.client->submit_and_wait({"set", {"good"}, true});
  EXPECT_EQ(good.kind, Kind::committed) << good.message;
  EXPECT_EQ(watched.gateway.chain().at(good.block).transactions.at(0).tx_id, good.tx_id);
  const Outcome bad = watched.client->submit_and_wait({"set", {"bad"}, true});
  EXPECT_EQ(bad.kind, Kind::invalidated);
  EXPECT_EQ(bad.code, 11);
  EXPECT_EQ(watched.asked, 0);
  EXPECT_EQ(watched.client->submit_and_wait({"set", {"good"}}).kind, Kind::committed);
  EXPECT_EQ(watched.asked, 1) << "who reads what he wrote waits for the peer's state";
}

TEST(Pipeline, ThePeerIsAskedWhereTheBlockStreamIsSilent) {
  Door door;
  Watched watched({.deliver = [&door](const common::Block&) -> std::optional<common::Block> {
    door.pass();
    return std::nullopt;
  }});
  EXPECT_EQ(watched.client->submit_and_wait({"set", {"a"}, true}).kind, Kind::committed);
  EXPECT_EQ(watched.asked, 1);
  door.open();
}

TEST(Pipeline, ThePeerIsAskedWhereTheBlockStreamIsLost) {
  Door lost;
  Watched watched({.after_submit =
                       [&lost](const std::string&) {
                         lost.pass();
                         return FakeStatus{};
                       },
                   .deliver = [](const common::Block& block) -> std::optional<common::Block> {
                     // Others' blocks alone: with ours the stream breaks off.
                     if (block.header().number() < 2) return std::nullopt;
                     common::Block wrong = block;
                     wrong.mutable_header()->set_number(77);
                     return wrong;
                   }});
  watched.gateway.add_block("set", "other");
  std::promise<Outcome> outcome;
  watched.client->submit({"set", {"a"}, true}, [&](Outcome got) { outcome.set_value(std::move(got)); });
  watched.gateway.await_status_calls(1);
  lost.open();
  EXPECT_EQ(outcome.get_future().get().kind, Kind::committed);
}

// Certificate and signatures of one transaction are of one pair: the gateway refuses any other.
TEST(Pipeline, ACallThatBeganBeforeARenewalIsSignedAsItBegan) {
  std::shared_ptr<crypto::IdentityInUse> in_use;
  std::optional<crypto::SigningIdentity> next;
  FakeGateway::Behaviour behaviour;
  behaviour.endorse = [&](const Call& call, int) -> FakeStatus {
    if (call.function == "first") in_use->replace(*next);
    return {};
  };
  FakeGateway gateway(behaviour);
  next = gateway.renewed_identity();
  ClientConfig config = gateway.client_config();
  in_use = config.identity.in_use = std::make_shared<crypto::IdentityInUse>(config.identity);
  const std::string old = config.identity.serialized;
  const auto client = Client::create(std::move(config)).value();
  for (const char* function : {"first", "second"}) {
    const Outcome outcome = client->submit_and_wait({function, {"payload"}});
    ASSERT_EQ(outcome.kind, Kind::committed) << function << ": " << outcome.message;
  }
  EXPECT_TRUE(client->evaluate({"get", {}}));
  const auto chain = gateway.chain();
  ASSERT_GE(chain.size(), 2U);
  EXPECT_EQ(chain[chain.size() - 2].transactions.at(0).creator, old);
  EXPECT_EQ(chain.back().transactions.at(0).creator, next->serialized);
}

TEST(Pipeline, TheStatusIsAskedAgainAfterALostConnection) {
  std::atomic<int> asked{0};
  FakeGateway gateway({.status = [&](const std::string&) { return ++asked < 3 ? unavailable() : FakeStatus{}; }});
  EXPECT_EQ(client_of(gateway)->submit_and_wait({"set", {}}).kind, Kind::committed);
  EXPECT_EQ(asked, 3);
  EXPECT_EQ(gateway.submit_calls(), 1);
}

TEST(Pipeline, TransactionsAreOrderedAsTheyWereSubmitted) {
  Door door;
  // The first one is endorsed last, and every Submit but the first overtakes where it can.
  FakeGateway gateway({.endorse = [&](const Call& call, int) {
    if (call.args[0] == "0") door.pass();
    return FakeStatus{};
  }});
  const auto client = client_of(gateway);
  Outcomes outcomes;
  for (int i = 0; i < 20; ++i) client->submit({"set", {std::to_string(i)}}, outcomes.collect());
  gateway.await_endorse_calls(20);
  EXPECT_EQ(gateway.submit_calls(), 0);
  door.open();
  outcomes.await(20);
  const auto chain = gateway.chain();
  ASSERT_EQ(chain.size(), 21U);
  for (int i = 0; i < 20; ++i)
    EXPECT_EQ(chain[static_cast<std::size_t>(i + 1)].transactions[0].event_payload, std::to_string(i));
}

TEST(Pipeline, OneThatFailsDoesNotHoldUpTheOthers) {
  FakeGateway gateway({.endorse = [](const Call& call, int) {
    return call.function == "bad" ? FakeStatus{grpc::StatusCode::ABORTED, "no", ""} : FakeStatus{};
  }});
  const auto client = client_of(gateway);
  Outcomes outcomes;
  for (int i = 0; i < 9; ++i) client->submit({i % 3 == 0 ? "bad" : "set", {}}, outcomes.collect());
  int refused = 0;
  for (const Outcome& outcome : outcomes.await(9)) refused += outcome.kind == Kind::refused ? 1 : 0;
  EXPECT_EQ(refused, 3);
  EXPECT_EQ(gateway.chain().size(), 7U);
}

TEST(Pipeline, TooManyInFlightAreRefusedAtOnceAndTheRestGoesOn) {
  Door door;
  FakeGateway gateway({.endorse = [&](const Call&, int) {
    door.pass();
    return FakeStatus{};
  }});
  auto config = gateway.client_config();
  config.max_in_flight = 2;
  const auto client = Client::create(config).value();
  Outcomes outcomes;
  for (int i = 0; i < 3; ++i) client->submit({"set", {}}, outcomes.collect());
  EXPECT_EQ(outcomes.await(1)[0].kind, Kind::overloaded);
  door.open();
  const auto all = outcomes.await(3);
  EXPECT_EQ(all[1].kind, Kind::committed);
  EXPECT_EQ(all[2].kind, Kind::committed);
  EXPECT_EQ(gateway.chain().size(), 3U);
}

TEST(Pipeline, ATransactionThatTheGatewayForgedIsNotSigned) {
  FakeGateway gateway({.forge = [](common::Envelope& envelope) {
    OpenedTransaction opened = open_transaction(envelope.SerializeAsString()).value();
    protos::ChaincodeProposalPayload forged;
    forged.set_input("land all drones");
    opened.action.set_chaincode_proposal_payload(forged.SerializeAsString());
    envelope.ParseFromString(opened.bytes());
  }});
  const Outcome outcome = client_of(gateway)->submit_and_wait({"set", {}});
  EXPECT_EQ(outcome.kind, Kind::refused);
  EXPECT_NE(outcome.message.find("not the one that was asked for"), std::string::npos);
  EXPECT_EQ(gateway.submit_calls(), 0);
}

TEST(Pipeline, TheSameClientWorksAgainAfterTheLedgerCameBack) {
  FakeGateway gateway;
  const auto client = client_of(gateway);
  EXPECT_EQ(client->submit_and_wait({"set", {}}).kind, Kind::committed);
  gateway.stop();
  EXPECT_EQ(client->submit_and_wait({"set", {}}).kind, Kind::unavailable);
  gateway.start();
  Outcome outcome;
  do {
    outcome = client->submit_and_wait({"set", {}});
  } while (outcome.kind == Kind::unavailable);
  EXPECT_EQ(outcome.kind, Kind::committed) << outcome.message;
}

TEST(Pipeline, DestructionEndsWhatIsInFlightAsUnavailable) {
  // Endorsing, waiting for its turn, waiting for its status, and in back-off: all at once.
  Door door;
  FakeGateway gateway(
      {.endorse =
           [&](const Call& call, int) {
             if (call.function == "slow") door.pass();
             return call.function == "away" ? unavailable() : FakeStatus{};
           },
       .before_submit =
           [](const std::string&) {
             return FakeStatus{grpc::StatusCode::UNAVAILABLE, "lost", ""};  // ends in a status that never comes
           }});
  Outcomes outcomes;
  {
    const auto client = client_of(gateway);
    client->submit({"set", {}}, outcomes.collect());
    gateway.await_status_calls(1);
    client->submit({"slow", {}}, outcomes.collect());
    client->submit({"set", {}}, outcomes.collect());
    client->submit({"away", {}}, outcomes.collect());
    gateway.await_endorse_calls(4);
  }
  const auto all = outcomes.now();
  ASSERT_EQ(all.size(), 4U);
  for (const Outcome& outcome : all) EXPECT_EQ(outcome.kind, Kind::unavailable);
  door.open();
}

TEST(Pipeline, ManyThreadsMaySubmit) {
  FakeGateway gateway;
  const auto client = client_of(gateway);
  Outcomes outcomes;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 10; ++i) client->submit({"set", {}}, outcomes.collect());
    });
  }
  for (auto& thread : threads) thread.join();
  for (const Outcome& outcome : outcomes.await(40)) EXPECT_EQ(outcome.kind, Kind::committed) << outcome.message;
}

TEST(Pipeline, ACallbackMaySubmitTheNext) {
  FakeGateway gateway;
  const auto client = client_of(gateway);
  Outcomes outcomes;
  client->submit({"set", {}}, [&](Outcome) { client->submit({"set", {}}, outcomes.collect()); });
  EXPECT_EQ(outcomes.await(1)[0].kind, Kind::committed);
}

TEST(Pipeline, AServerOfAnotherCaIsNotTalkedTo) {
  FakeGateway gateway, outsider;
  auto config = gateway.client_config();
  config.tls_ca_file = outsider.client_config().tls_ca_file;
  EXPECT_EQ(Client::create(config).value()->submit_and_wait({"set", {}}).kind, Kind::unavailable);
  EXPECT_EQ(gateway.endorse_calls(), 0);
}

TEST(Pipeline, ABadConfigIsAnErrorBeforeAnythingIsSent) {
  FakeGateway gateway;
  const auto error = [&](const std::function<void(ClientConfig&)>& spoil) {
    auto config = gateway.client_config();
    spoil(config);
    auto client = Client::create(config);
    return client ? "created" : client.error().message;
  };
  EXPECT_NE(error([](ClientConfig& c) { c.endpoint = ""; }).find("HOST:PORT"), std::string::npos);
  EXPECT_NE(error([](ClientConfig& c) { c.tls_ca_file = "/nowhere.pem"; }).find("/nowhere.pem"), std::string::npos);
  EXPECT_NE(error([](ClientConfig& c) { c.tls_ca_file = "/dev/null"; }).find("/dev/null"), std::string::npos);
  EXPECT_NE(error([](ClientConfig& c) { c.identity.signer.reset(); }).find("identity"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::fabric
