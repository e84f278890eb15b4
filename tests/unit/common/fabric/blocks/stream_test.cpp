#include <grpcpp/support/status.h>
#include <gtest/gtest.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>

#include "tests/unit/common/fabric/client/fake_gateway.hpp"

namespace ledgerline::fabric {
namespace {

/// What a stream said, in order.
template <typename T>
class Log {
 public:
  void add(T entry) {
    const std::lock_guard lock(mutex_);
    entries_.push_back(std::move(entry));
    changed_.notify_all();
  }
  std::vector<T> await(std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return entries_.size() >= count; });
    return entries_;
  }
  void await_that(const std::function<bool(const T&)>& is) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] {
      for (const T& entry : entries_) {
        if (is(entry)) return true;
      }
      return false;
    });
  }
  std::vector<T> now() {
    const std::lock_guard lock(mutex_);
    return entries_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<T> entries_;
};

struct Logs {
  Log<Block> blocks;
  Log<Client::Event> events;
  Log<std::pair<bool, std::string>> connection;
  Client::StreamHandlers handlers() {
    return {[this](const Block& block, std::string_view raw) {
              EXPECT_EQ(decode_block(raw).value().number, block.number);
              blocks.add(block);
            },
            on_connection()};
  }
  std::function<void(bool, const std::string&)> on_connection() {
    return [this](bool there, const std::string& why) { connection.add({there, why}); };
  }
  std::function<void(const Client::Event&)> on_event() {
    return [this](const Client::Event& event) { events.add(event); };
  }
  void await_connection() {
    connection.await_that([](const auto& entry) { return entry.first; });
  }
};

std::unique_ptr<Client> client_of(const FakeGateway& gateway) {
  return Client::create(gateway.client_config()).value();
}

void expect_numbers(const std::vector<Block>& blocks, std::uint64_t first) {
  for (std::size_t i = 0; i < blocks.size(); ++i) EXPECT_EQ(blocks[i].number, first + i);
}

/// True the first time that it is asked about a thing: each place is cut once, so that the stream comes through at
/// last.
class CutOnce {
 public:
  bool operator()(std::uint64_t block, std::size_t transaction) {
    const std::lock_guard lock(mutex_);
    return done_.insert({block, transaction}).second;
  }

 private:
  std::mutex mutex_;
  std::set<std::pair<std::uint64_t, std::size_t>> done_;
};

TEST(BlockStream, GivesAllBlocksFromTheStartAndThenTheNewOnes) {
  FakeGateway gateway;
  for (int i = 0; i < 3; ++i) gateway.add_block("set", std::to_string(i));
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->blocks(0, logs.handlers());
  logs.blocks.await(4);
  const TimeNs before_ns = monotonic_ns();
  gateway.add_block("set", "new");
  const auto blocks = logs.blocks.await(5);
  EXPECT_LE(before_ns, blocks[4].received_ns);
  EXPECT_LE(blocks[4].received_ns, monotonic_ns());
  expect_numbers(blocks, 0);
  EXPECT_EQ(blocks[4].transactions[0].event_payload, "new");
  EXPECT_EQ(logs.connection.now(), (std::vector<std::pair<bool, std::string>>{{true, ""}}));
}

TEST(BlockStream, CutBehindEveryBlockItHasNeitherGapNorDuplicate) {
  CutOnce cut;
  FakeGateway gateway({.cut = std::ref(cut)});
  for (int i = 0; i < 6; ++i) gateway.add_block("set", std::to_string(i));
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->blocks(2, logs.handlers());
  expect_numbers(logs.blocks.await(5), 2);
  gateway.add_block("set", "last");
  expect_numbers(logs.blocks.await(6), 2);
  EXPECT_GE(gateway.deliver_calls(), 5);
}

TEST(BlockStream, ATransactionThatCannotBeTrustedIsLeftOutAloneAndReportedOnce) {
  FakeGateway gateway;
  gateway.add_foreign_event();
  gateway.add_foreign_event();
  for (int i = 0; i < 10; ++i) gateway.add_block("set", std::to_string(i));
  Logs logs;
  Log<std::string> words;
  auto handlers = logs.handlers();
  handlers.on_unverified = [&](const std::string& what) { words.add(what); };
  const auto client = client_of(gateway);
  const auto stream = client->blocks(0, std::move(handlers));
  const auto blocks = logs.blocks.await(13);
  expect_numbers(blocks, 0);
  EXPECT_EQ(logs.connection.now(), (std::vector<std::pair<bool, std::string>>{{true, ""}}));
  for (const std::size_t left_out : {1U, 2U}) {
    EXPECT_EQ(blocks[left_out].transactions[0].code, code_unverified);
    EXPECT_EQ(blocks[left_out].transactions[0].event_name, "");
  }
  for (std::size_t i = 3; i < 13; ++i) EXPECT_EQ(blocks[i].transactions[0].event_payload, std::to_string(i - 3));
  ASSERT_EQ(words.now().size(), 1U);  // the second within a minute is counted only
  EXPECT_EQ(words.now()[0].find("block 1: transaction "), 0U);
  EXPECT_NE(words.now()[0].find("its event names another transaction"), std::string::npos);
}

TEST(BlockStream, FromTheNextNewOneOnLeavesOutWhatIsThere) {
  for (const bool with_cut : {false, true}) {
    // With a cut the connection is lost behind the newest block, before the first new one: none may be missed.
    CutOnce once;
    FakeGateway gateway({.cut = with_cut ? std::function<bool(std::uint64_t, std::size_t)>(std::ref(once)) : nullptr});
    gateway.add_block("set", "old");
    Logs logs;
    const auto client = client_of(gateway);
    const auto stream = client->blocks(std::nullopt, logs.handlers());
    logs.await_connection();
    gateway.add_block("set", "new");
    gateway.add_block("set", "newer");
    const auto blocks = logs.blocks.await(2);
    expect_numbers(blocks, 2);
    EXPECT_EQ(blocks[0].transactions[0].event_payload, "new");
  }
}

TEST(BlockStream, SurvivesARestartOfTheLedger) {
  FakeGateway gateway;
  gateway.add_block("set", "a");
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->blocks(0, logs.handlers());
  logs.blocks.await(2);
  gateway.stop();
  logs.connection.await(2);
  EXPECT_FALSE(logs.connection.now()[1].first);
  gateway.start();
  gateway.add_block("set", "b");
  expect_numbers(logs.blocks.await(3), 0);
  EXPECT_TRUE(logs.connection.await(3).back().first);
}

TEST(BlockStream, MayBeOpenedBeforeTheLedgerIsThere) {
  FakeGateway gateway;
  gateway.stop();
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->blocks(0, logs.handlers());
  logs.connection.await(1);
  EXPECT_FALSE(logs.connection.now()[0].first);
  gateway.start();
  expect_numbers(logs.blocks.await(1), 0);
}

TEST(BlockStream, AForgedBlockIsReportedAndTheRightOneTakenInstead) {
  for (const bool wrong_data : {false, true}) {
    std::atomic<int> lies{2};
    FakeGateway gateway({.deliver = [&](const common::Block& block) -> std::optional<common::Block> {
      if (block.header().number() != 2 || lies-- <= 0) return std::nullopt;
      common::Block forged = block;
      if (wrong_data) {
        forged.mutable_data()->set_data(0, "forged");
      } else {
        forged.mutable_header()->set_previous_hash(std::string(32, 'x'));
      }
      return forged;
    }});
    for (int i = 0; i < 3; ++i) gateway.add_block("set", std::to_string(i));
    Logs logs;
    const auto client = client_of(gateway);
    const auto stream = client->blocks(0, logs.handlers());
    const auto blocks = logs.blocks.await(4);
    expect_numbers(blocks, 0);
    EXPECT_EQ(blocks[2].transactions[0].event_payload, "1");
    logs.connection.await_that([&](const auto& entry) {
      return entry.second == (wrong_data ? "block 2: its data does not match its data hash"
                                         : "block 2 does not follow block 1: it names another previous hash");
    });
  }
}

TEST(BlockStream, AnotherBlockThanTheOneAskedForIsNotTaken) {
  std::atomic<bool> lie{true};
  FakeGateway gateway({.deliver = [&](const common::Block& block) -> std::optional<common::Block> {
    if (!lie.exchange(false)) return std::nullopt;
    common::Block other = block;
    other.mutable_header()->set_number(7);
    return other;
  }});
  gateway.add_block("set", "a");
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->blocks(1, logs.handlers());
  expect_numbers(logs.blocks.await(1), 1);
  logs.connection.await_that([](const auto& entry) { return entry.second == "block 7 came where 1 was due"; });
}

TEST(BlockStream, ARefusalIsReported) {
  FakeGateway gateway({.refuse_deliver = common::FORBIDDEN});
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->blocks(0, logs.handlers());
  logs.connection.await_that([&](const auto& entry) {
    return entry.second.starts_with(gateway.client_config().endpoint + " refused the stream: FORBIDDEN: are msp_id ");
  });
}

TEST(BlockStream, EndsAtAnyMoment) {
  FakeGateway gateway;
  gateway.add_block("set", "a");
  auto client = client_of(gateway);
  for (int i = 0; i < 20; ++i) {
    Logs logs;
    const auto stream = client->blocks(i % 2 == 0 ? std::optional<std::uint64_t>(0) : std::nullopt, logs.handlers());
    if (i % 4 == 0) logs.blocks.await(1);
  }
  Logs logs;
  auto waiting = client->blocks(100, logs.handlers());  // a block that is far off
  auto outliving = client->blocks(0, logs.handlers());
  logs.blocks.await(2);
  client.reset();
  gateway.add_block("set", "b");
  logs.blocks.await(3);
  gateway.stop();
  auto in_backoff = Client::create(gateway.client_config()).value()->blocks(0, logs.handlers());
  logs.connection.await_that([](const auto& entry) { return !entry.first; });
}

class EventStream : public testing::Test {
 protected:
  static void fill(FakeGateway& gateway) {
    gateway.add_block({{"set", {"1"}}, {"set", {"2"}}, {"invalid", {"x"}}, {"command", {"3"}}});
    gateway.add_block({{"invalid", {"x"}}});
    gateway.add_block({{"set", {"4"}}});
    gateway.add_block({{"set", {"5"}}, {"set", {"6"}}});
  }
  static char flag(const Call& call) { return call.function == "invalid" ? '\x0b' : '\0'; }
  static std::string payloads(const std::vector<Client::Event>& events) {
    std::string out;
    for (const auto& event : events) out += event.payload;
    return out;
  }
};

TEST_F(EventStream, GivesTheEventsOfValidTransactionsInOrder) {
  FakeGateway gateway({.flag = flag});
  fill(gateway);
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->events(0, logs.on_event(), logs.on_connection());
  const auto events = logs.events.await(6);
  EXPECT_EQ(payloads(events), "123456");
  EXPECT_EQ(events[2].name, "command");
  EXPECT_EQ(events[2].block, 1U);
  EXPECT_EQ(events[2].tx_id, gateway.chain()[1].transactions[3].tx_id);
}

TEST_F(EventStream, CutBehindEveryEventItHasNeitherGapNorDuplicate) {
  CutOnce cut;
  FakeGateway gateway({.flag = flag, .cut = std::ref(cut)});
  fill(gateway);
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->events(1, logs.on_event(), logs.on_connection());
  EXPECT_EQ(payloads(logs.events.await(6)), "123456");
  gateway.add_block("set", "7");
  EXPECT_EQ(payloads(logs.events.await(7)), "1234567");
  EXPECT_GE(gateway.events_calls(), 6);
}

TEST_F(EventStream, ResumesBehindACheckpoint) {
  FakeGateway gateway({.flag = flag});
  fill(gateway);
  const auto chain = gateway.chain();
  const auto client = client_of(gateway);
  Logs logs, tail;
  const auto stream = client->events(1, logs.on_event(), logs.on_connection(), chain[1].transactions[1].tx_id);
  EXPECT_EQ(payloads(logs.events.await(4)), "3456");
  const auto last = client->events(4, tail.on_event(), tail.on_connection(), chain[4].transactions[1].tx_id);
  tail.await_connection();
  gateway.add_block("set", "7");
  EXPECT_EQ(payloads(tail.events.await(1)), "7");
}

TEST_F(EventStream, FromTheNextNewOneOnNothingIsMissedBetweenConnections) {
  FakeGateway gateway({.flag = flag});
  fill(gateway);
  Logs logs;
  const auto client = client_of(gateway);
  const auto stream = client->events(std::nullopt, logs.on_event(), logs.on_connection());
  logs.await_connection();
  gateway.stop();
  gateway.add_block("set", "7");  // while nobody listens
  gateway.start();
  EXPECT_EQ(payloads(logs.events.await(1)), "7");
}

TEST_F(EventStream, EndsAtAnyMoment) {
  FakeGateway gateway({.flag = flag});
  fill(gateway);
  const auto client = client_of(gateway);
  for (int i = 0; i < 12; ++i) {
    Logs logs;
    const auto stream = client->events(i % 2 == 0 ? std::optional<std::uint64_t>(0) : std::nullopt, logs.on_event(),
                                       logs.on_connection());
    if (i % 4 == 0) logs.events.await(2);
  }
}

}  // namespace
}  // namespace ledgerline::fabric
