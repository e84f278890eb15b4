#include "chaincode/shim/session.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <future>
#include <thread>

#include "common/common.pb.h"
#include "ledger/queryresult/kv_query_result.pb.h"
#include "peer/chaincode.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/unit/chaincode/shim/messages.hpp"

/// A peer's stream as the chaincode sees it.
namespace ledgerline::shim {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;
using Message = protos::ChaincodeMessage;

/// Answers as a peer does, at once or on request.
class FakePeer {
 public:
  explicit FakePeer(Invoke invoke, int threads = 4) : workers_(std::make_unique<Workers>("contract", threads)) {
    session = std::make_shared<Session>(
        "ledgerline_1:hash", std::move(invoke), [this](const Message& message) { return take(message); }, *workers_);
    session->begin();
    tell(Message::REGISTERED);
    tell(Message::READY);
  }
  ~FakePeer() {
    session->end();
    workers_.reset();
  }

  void tell(Message::Type type, const std::string& payload = {}, const std::string& tx = {}) {
    EXPECT_TRUE(session->on_message(message(type, payload, tx)).ok());
  }
  void transaction(const std::string& tx, const std::vector<std::string>& args) {
    protos::ChaincodeInput input;
    for (const std::string& arg : args) input.add_args(arg);
    common::SignatureHeader signature_header;
    signature_header.set_creator("the creator");
    common::Header header;
    header.set_signature_header(signature_header.SerializeAsString());
    protos::Proposal proposal;
    proposal.set_header(header.SerializeAsString());
    Message call = message(Message::TRANSACTION, input.SerializeAsString(), tx);
    call.mutable_proposal()->set_proposal_bytes(proposal.SerializeAsString());
    EXPECT_TRUE(session->on_message(call).ok());
  }

  /// The last message of a transaction.
  Message end_of(const std::string& tx) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return ends.contains(tx); });
    return ends[tx];
  }
  /// Until the chaincode has asked for so many values.
  void wait_for_questions(std::ptrdiff_t count) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return std::count(asked.begin(), asked.end(), Message::GET_STATE) >= count; });
  }
  std::map<std::string, std::string> state;
  std::vector<std::pair<std::string, std::string>> range;  ///< what a query gives, two a page
  std::int64_t claimed_s = 0;                              ///< when a history's values were written
  std::set<std::string> held;                              ///< transactions whose questions are not answered
  std::vector<Message::Type> asked;
  std::mutex mutex;
  std::condition_variable changed;
  std::map<std::string, Message> ends;
  std::shared_ptr<Session> session;
  std::function<void()> on_end;  ///< as a transaction's end comes, before the chaincode goes on

 private:
  bool take(const Message& question) {
    const std::lock_guard lock(mutex);
    asked.push_back(question.type());
    changed.notify_all();
    switch (question.type()) {
      case Message::COMPLETED:
      case Message::ERROR:
        ends[question.txid()] = question;
        if (on_end) on_end();
        return true;
      case Message::GET_STATE: {
        protos::GetState request;
        EXPECT_TRUE(request.ParseFromString(question.payload()));
        return answer(question, Message::RESPONSE, state[request.key()]);
      }
      case Message::PUT_STATE: {
        protos::PutState request;
        EXPECT_TRUE(request.ParseFromString(question.payload()));
        if (request.key() == "forbidden") return answer(question, Message::ERROR, "no such luck");
        state[request.key()] = request.value();
        return answer(question, Message::RESPONSE, "");
      }
      case Message::GET_STATE_BY_RANGE:
      case Message::GET_HISTORY_FOR_KEY:
        given_ = 0;
        history_ = question.type() == Message::GET_HISTORY_FOR_KEY;
        return answer(question, Message::RESPONSE, page());
      case Message::QUERY_STATE_NEXT:
        return answer(question, Message::RESPONSE, page());
      case Message::QUERY_STATE_CLOSE:
        return answer(question, Message::RESPONSE, "");
      default:
        return true;
    }
  }

  bool answer(const Message& question, Message::Type type, const std::string& payload) {
    if (held.contains(question.txid())) return true;
    return session->on_message(message(type, payload, question.txid())).ok();
  }

  std::string page() {
    protos::QueryResponse response;
    response.set_id("query");
    for (int i = 0; i < 2 && given_ < range.size(); ++i, ++given_) {
      std::string bytes;
      if (history_) {
        queryresult::KeyModification entry;
        entry.set_tx_id(range[given_].first);
        entry.set_value(range[given_].second);
        entry.mutable_timestamp()->set_seconds(claimed_s);
        bytes = entry.SerializeAsString();
      } else {
        queryresult::KV entry;
        entry.set_key(range[given_].first);
        entry.set_value(range[given_].second);
        bytes = entry.SerializeAsString();
      }
      response.add_results()->set_resultbytes(bytes);
    }
    response.set_has_more(given_ < range.size());
    return response.SerializeAsString();
  }

  std::size_t given_ = 0;
  bool history_ = false;
  std::unique_ptr<Workers> workers_;
};

Response ok(const std::string& payload) { return {200, "", payload}; }

TEST(ShimSession, RegistersUnderItsPackageId) {
  FakePeer peer([](Stub&) { return ok(""); });
  EXPECT_THAT(peer.asked, ElementsAre(Message::REGISTER));
  EXPECT_TRUE(peer.session->ready());
}

TEST(ShimSession, ATransactionReadsWritesAndEmitsItsEvent) {
  FakePeer peer([](Stub& stub) {
    const auto before = stub.get_state("key");
    EXPECT_TRUE(before.ok() && !*before) << "an empty value is none";
    EXPECT_TRUE(stub.put_state("key", "value").ok());
    stub.set_event("first", "a");
    stub.set_event("set", stub.args()[1]);
    EXPECT_EQ(stub.creator(), "the creator");
    EXPECT_EQ(stub.channel(), "teleop");
    return ok(stub.tx_id());
  });
  peer.transaction("tx1", {"set", "payload"});
  const Message end = peer.end_of("tx1");
  EXPECT_EQ(response_in(end).payload(), "tx1");
  EXPECT_EQ(end.chaincode_event().event_name(), "set");
  EXPECT_EQ(end.chaincode_event().payload(), "payload");
  EXPECT_EQ(peer.state["key"], "value");
}

TEST(ShimSession, ARefusalIsAResponseAndHasNoEvent) {
  FakePeer peer([](Stub&) { return Response{500, "tello1: not yours", ""}; });
  peer.transaction("tx1", {"set"});
  const Message end = peer.end_of("tx1");
  EXPECT_EQ(response_in(end).message(), "tello1: not yours");
  EXPECT_FALSE(end.has_chaincode_event());
}

TEST(ShimSession, TransactionsDoNotWaitForEachOther) {
  FakePeer peer([](Stub& stub) {
    const auto value = stub.get_state("key");
    return ok(value->value_or("none"));
  });
  peer.state["key"] = "value";
  peer.held = {"slow"};
  peer.transaction("slow", {"get"});
  peer.transaction("fast", {"get"});
  EXPECT_EQ(response_in(peer.end_of("fast")).payload(), "value");
  peer.wait_for_questions(2);
  peer.tell(Message::RESPONSE, "late", "slow");
  EXPECT_EQ(response_in(peer.end_of("slow")).payload(), "late");
}

TEST(ShimSession, AnErrorOfThePeerReachesTheChaincode) {
  FakePeer peer([](Stub& stub) {
    const Status status = stub.put_state("forbidden", "x");
    return Response{500, status ? "written" : status.error().message, ""};
  });
  peer.transaction("tx1", {"set"});
  EXPECT_EQ(response_in(peer.end_of("tx1")).message(), "no such luck");
}

TEST(ShimSession, TheEndOfTheStreamReleasesWhoWaits) {
  std::promise<std::string> said;
  FakePeer peer([&](Stub& stub) {
    const auto value = stub.get_state("key");
    said.set_value(value ? "a value" : value.error().message);
    return ok("");
  });
  peer.held = {"tx1"};
  peer.transaction("tx1", {"get"});
  peer.wait_for_questions(1);
  peer.session->end();
  EXPECT_EQ(said.get_future().get(), "the peer is gone");
  EXPECT_FALSE(peer.session->ready());
}

TEST(ShimSession, ARangeIsReadPageByPageAndClosedAtTheLimit) {
  std::size_t limit = 3;
  FakePeer peer([&](Stub& stub) {
    std::string keys;
    const auto found = stub.get_range("a", "z", limit);
    for (const KeyValue& entry : *found) keys += entry.key + "=" + entry.value + " ";
    return ok(keys);
  });
  peer.range = {{"a", "1"}, {"b", "2"}, {"c", "3"}, {"d", "4"}, {"e", "5"}};
  peer.transaction("tx1", {"get"});
  EXPECT_EQ(response_in(peer.end_of("tx1")).payload(), "a=1 b=2 c=3 ");
  EXPECT_THAT(peer.asked, ElementsAre(Message::REGISTER, Message::GET_STATE_BY_RANGE, Message::QUERY_STATE_NEXT,
                                      Message::QUERY_STATE_CLOSE, Message::COMPLETED));
  limit = 10;
  peer.asked.clear();
  peer.transaction("tx2", {"get"});
  EXPECT_EQ(response_in(peer.end_of("tx2")).payload(), "a=1 b=2 c=3 d=4 e=5 ");
  EXPECT_THAT(peer.asked, ElementsAre(Message::GET_STATE_BY_RANGE, Message::QUERY_STATE_NEXT, Message::QUERY_STATE_NEXT,
                                      Message::COMPLETED))
      << "the peer has closed it";
}

TEST(ShimSession, HistoryLeavesOutTheNewestAsAsked) {
  FakePeer peer([](Stub& stub) {
    std::string ids;
    const auto found = stub.get_history("key", 1, 2);
    for (const KeyModification& entry : *found) ids += entry.tx_id + " ";
    return ok(ids);
  });
  peer.range = {{"t5", "e"}, {"t4", "d"}, {"t3", "c"}, {"t2", "b"}};
  peer.transaction("tx1", {"history"});
  EXPECT_EQ(response_in(peer.end_of("tx1")).payload(), "t4 t3 ");
}

TEST(ShimSession, ATimeThatNobodyCanMeanIsNoneInAHistory) {
  FakePeer peer([](Stub& stub) { return ok(std::to_string(stub.get_history("key", 0, 1)->front().timestamp_ns)); });
  peer.range = {{"t1", "a"}};
  peer.claimed_s = INT64_MAX;
  peer.transaction("tx1", {"history"});
  EXPECT_EQ(response_in(peer.end_of("tx1")).payload(), "0");
  peer.claimed_s = 1'800'000'000;
  peer.transaction("tx2", {"history"});
  EXPECT_EQ(response_in(peer.end_of("tx2")).payload(), "1800000000000000000");
}

TEST(ShimSession, MoreThanCanWaitAreRefusedAtOnce) {
  std::promise<void> go;
  const std::shared_future<void> gone = go.get_future().share();
  FakePeer peer(
      [&](Stub&) {
        gone.wait();
        return ok("");
      },
      1);
  for (int i = 0; i < 1'002; ++i) peer.transaction("tx" + std::to_string(i), {"get"});
  const Message refused = peer.end_of("tx1001");
  EXPECT_EQ(refused.type(), Message::ERROR);
  EXPECT_THAT(refused.payload(), HasSubstr("too many transactions"));
  go.set_value();
  response_in(peer.end_of("tx999"));
}

TEST(ShimSession, WhatDoesNotParseIsAnErrorOfThatTransactionAlone) {
  FakePeer peer([](Stub&) { return ok(""); });
  peer.tell(Message::TRANSACTION, "\xff\xff", "bad");
  EXPECT_EQ(peer.end_of("bad").type(), Message::ERROR);
  peer.transaction("good", {"get"});
  response_in(peer.end_of("good"));
}

TEST(ShimSession, AMessageThatHasNoPlaceEndsTheStream) {
  FakePeer peer([](Stub&) { return ok(""); });
  EXPECT_FALSE(peer.session->on_message(message(Message::PUT_STATE, "", "tx")).ok());
  peer.tell(Message::KEEPALIVE);
  peer.tell(Message::RESPONSE, "of a transaction that has ended", "nobody");
}

TEST(ShimSession, ATransactionOfTheSameIdMayFollowAtOnce) {
  std::atomic<int> begun{0};
  int ended = 0;
  std::promise<void> second_began;
  FakePeer peer([&](Stub& stub) {
    if (++begun == 2) {
      second_began.set_value();
      // While the first one is cleared away.
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    const auto value = stub.get_state("key");
    return Response{value ? 200 : 500, {}, {}};
  });
  peer.on_end = [&] {
    if (++ended > 1) return;
    peer.transaction("tx", {"read"});
    second_began.get_future().wait();
  };
  peer.transaction("tx", {"read"});
  std::unique_lock lock(peer.mutex);
  EXPECT_TRUE(peer.changed.wait_for(lock, std::chrono::seconds(30), [&] { return ended == 2; }))
      << "the second one never got its answer";
}

}  // namespace
}  // namespace ledgerline::shim
