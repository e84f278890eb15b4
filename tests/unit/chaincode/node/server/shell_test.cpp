#include <fcntl.h>
#include <gmock/gmock.h>
#include <sched.h>
#include <sys/mount.h>
#include <unistd.h>

#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <latch>
#include <thread>

#include "chaincode/node/server/limit.hpp"
#include "chaincode/node/shell/block_feed.hpp"
#include "chaincode/node/shell/node.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "gateway/gateway.pb.h"
#include "msp/identities.pb.h"
#include "orderer/ab.pb.h"
#include "peer/events.pb.h"

/// The node with its threads and a real directory, without gRPC.
namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

/// Collects answers of those who have the core for the test's thread.
template <typename T>
class Inbox {
 public:
  void put(T item) {
    const std::lock_guard lock(mutex_);
    items_.push_back(std::move(item));
    arrived_.notify_all();
  }
  std::vector<T> wait_for(std::size_t count) {
    std::unique_lock lock(mutex_);
    arrived_.wait(lock, [&] { return items_.size() >= count; });
    return items_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<T> items_;
};

/// A thread that has the core until this ends.
class BusyThread {
 public:
  explicit BusyThread(Node& node)
      : thread_([this, &node] {
          node.post([this](NodeCore&) {
            has_core_.count_down();
            ends_.wait();
          });
        }) {
    has_core_.wait();
  }
  ~BusyThread() {
    ends_.count_down();
    thread_.join();
  }
  BusyThread(const BusyThread&) = delete;
  BusyThread& operator=(const BusyThread&) = delete;

 private:
  std::latch has_core_{1}, ends_{1};
  std::thread thread_;
};

class ShellTest : public ::testing::Test {
 protected:
  ShellTest() : dir_(std::filesystem::temp_directory_path() / ("ledgerline_shell_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(dir_);
    start();
  }
  ~ShellTest() override {
    node.reset();
    std::filesystem::remove_all(dir_);
  }

  void start() {
    node.reset();
    Node::Options options;
    options.dir = dir_;
    options.kept_bytes = kept_bytes;
    options.drones = drones;
    options.core.batch_count = 3;
    options.core.batch_timeout_ns = batch_timeout_ns;
    auto opened = Node::open(options);
    ASSERT_TRUE(opened.ok()) << opened.error().message;
    node = std::move(*opened);
    node->on_answer([this](std::uint64_t, const TxStatus& status) { answers.put(status); });
    user = *crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", user_msp_dir(dir_, 1, "User1"));
  }

  /// From any thread; the transaction's fate comes to `answers`.
  void submit(const std::string& json) {
    const Now now{monotonic_ns(), realtime_ns()};
    const auto proposal = *fabric::make_proposal(user, {}, {"set", {json}}, now.real_ns, crypto::random_bytes(24));
    node->post([this, proposal, now](NodeCore& core) {
      const Reply endorsed = core.endorse(proposal.signed_proposal, now);
      if (endorsed.code != Code::ok) return answers.put({endorsed.detail, 0, -1});
      if (const auto status = core.watch(proposal.tx_id, 1)) return answers.put(*status);
      core.order(*fabric::sign_envelope(user, endorsed.bytes), now);
    });
  }

  std::filesystem::path dir_;
  std::vector<std::string> drones;
  TimeNs batch_timeout_ns = 2 * ns_per_ms;
  std::uint64_t kept_bytes = Node::Options().kept_bytes;
  Inbox<TxStatus> answers;
  std::unique_ptr<Node> node;
  crypto::SigningIdentity user;
};

/// Reads a feed to its end, as streams do: one block, then the next, waiting where there is none.
class Reader final : public BlockFeed::Waiter, public std::enable_shared_from_this<Reader> {
 public:
  explicit Reader(BlockFeed& feed) : feed_(feed) {}
  void wake() override {
    const std::lock_guard lock(mutex_);
    while (!feed_.wait(next_, weak_from_this())) {
      const auto block = feed_.read(next_);
      ASSERT_TRUE(block.ok());
      blocks.put(*fabric::decode_block(**block));
      ++next_;
    }
  }
  Inbox<fabric::Block> blocks;

 private:
  BlockFeed& feed_;
  std::mutex mutex_;
  std::uint64_t next_ = 0;
};

// Who wakes readers may hold a stream, and with it its place, when the service with its limit has ended.
TEST(Limit, APlaceMayOutliveIt) {
  auto limit = std::make_unique<Limit>("service", 1);
  Limit::Slot place = limit->acquire();
  ASSERT_TRUE(place);
  EXPECT_FALSE(limit->acquire());
  place.reset();
  place = limit->acquire();
  ASSERT_TRUE(place);
  limit.reset();
  place.reset();
}

TEST_F(ShellTest, ANewLedgerHasItsConfigAndFirstCalls) {
  EXPECT_EQ(node->feed().height(), 4U);
  submit(R"({"id":"tello16/a","msgType":"t"})");
  EXPECT_EQ(answers.wait_for(1)[0].code, 0);
}

TEST_F(ShellTest, ANewLedgerEnrollsTheDronesThatItIsGivenAlone) {
  node.reset();
  std::filesystem::remove_all(dir_);
  drones = {"raven"};
  start();
  EXPECT_EQ(node->feed().height(), 4U);
  submit(R"({"id":"raven/a","msgType":"t"})");
  EXPECT_EQ(answers.wait_for(1)[0].code, 0);
  submit(R"({"id":"tello1/a","msgType":"t"})");
  EXPECT_NE(answers.wait_for(2)[1].code, 0);
}

TEST_F(ShellTest, CallsFromManyThreadsAllCommitAndReadersSeeEachBlockOnce) {
  const auto reader = std::make_shared<Reader>(node->feed());
  reader->wake();
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([this, t] {
      for (int i = 0; i < 10; ++i) submit(R"({"id":"tello)" + std::to_string(t + 1) + R"(/a","msgType":"t"})");
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const TxStatus& status : answers.wait_for(40)) EXPECT_EQ(status.code, 0) << status.tx_id;
  const std::uint64_t height = node->feed().height();
  fabric::ChainCheck check;
  std::size_t transactions = 0;
  for (const fabric::Block& block : reader->blocks.wait_for(height)) {
    EXPECT_TRUE(check.add(block).ok()) << block.number;
    transactions += block.transactions.size();
  }
  EXPECT_EQ(check.height(), height);
  EXPECT_EQ(transactions, 44U);
}

TEST_F(ShellTest, WhoBringsATaskDoesItAndEverythingThatFollows) {
  batch_timeout_ns = 60 * ns_per_s;
  start();
  const auto reader = std::make_shared<Reader>(node->feed());
  reader->wake();
  const std::uint64_t height = node->feed().height();
  for (int i = 0; i < 3; ++i) submit(R"({"id":"tello1/a","msgType":"t"})");  // as many as fill a block
  EXPECT_EQ(node->feed().height(), height + 1);
  EXPECT_THAT(reader->blocks.wait_for(0), SizeIs(height + 1));
}

TEST_F(ShellTest, WhatComesWhileOthersHaveTheCoreIsDoneByThem) {
  Inbox<std::thread::id> done;
  {
    const BusyThread busy(*node);
    node->post([&](NodeCore&) { done.put(std::this_thread::get_id()); });
    EXPECT_THAT(done.wait_for(0), SizeIs(0));
  }
  EXPECT_NE(done.wait_for(1)[0], std::this_thread::get_id());
}

TEST_F(ShellTest, WhatWasAnsweredIsThereAfterARestart) {
  submit(R"({"id":"tello1/a","msgType":"t"})");
  const TxStatus status = answers.wait_for(1)[0];
  start();
  Inbox<std::optional<TxStatus>> found;
  node->post([&](NodeCore& core) { found.put(core.find(status.tx_id)); });
  ASSERT_TRUE(found.wait_for(1)[0]);
  EXPECT_EQ(found.wait_for(1)[0]->block, status.block);
}

TEST_F(ShellTest, AFullDiskConfirmsNothingUntilThereIsRoom) {
  node.reset();
  std::filesystem::remove_all(dir_);
  std::filesystem::create_directories(dir_);
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("none", dir_.c_str(), "tmpfs", 0, "size=4m") != 0)
    GTEST_SKIP() << "no file system of its own without root";
  kept_bytes = 0;
  start();
  submit(R"({"id":"tello1/a","msgType":"t"})");
  ASSERT_EQ(answers.wait_for(1)[0].code, 0);
  const std::string filler = dir_ / "filler";
  const int fd = ::open(filler.c_str(), O_WRONLY | O_CREAT, 0600);
  const std::string page(4'096, 'x');
  while (::write(fd, page.data(), page.size()) > 0) {
  }
  ::close(fd);
  const std::uint64_t height = node->feed().height();
  for (int i = 0; i < 8; ++i) submit(R"({"id":"tello1/a","msgType":"t"})");  // more than a page has left
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_LE(node->feed().height(), height + 1);
  EXPECT_LT(answers.wait_for(1).size(), 9U);
  ::unlink(filler.c_str());
  for (const TxStatus& status : answers.wait_for(9)) EXPECT_EQ(status.code, 0) << status.tx_id;
  start();
  EXPECT_GT(node->feed().height(), height) << "all of it is there after a restart";
  node.reset();
  ::umount2(dir_.c_str(), MNT_DETACH);
}

TEST_F(ShellTest, ADiskThatIsNearlyFullTakesWhatIsUrgentAlone) {
  node.reset();
  kept_bytes = UINT64_MAX;
  std::filesystem::remove_all(dir_);
  std::filesystem::create_directories(dir_);
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("none", dir_.c_str(), "tmpfs", 0, "size=4m") != 0)
    GTEST_SKIP() << "no file system of its own without root";
  start();
  std::ofstream(dir_ / "filler") << std::string(3'950'000, 'x');
  std::this_thread::sleep_for(std::chrono::milliseconds(1'100));
  node->post([](NodeCore&) {});
  const auto order = [&](const std::string& function, const std::string& argument) {
    const auto asker = *crypto::load_identity(crypto::Library::libcrypto, "Org2MSP", user_msp_dir(dir_, 2, "User1"));
    Inbox<Reply> replies;
    node->post([&](NodeCore& core) {
      const Now now{monotonic_ns(), realtime_ns()};
      const auto proposal =
          *fabric::make_proposal(asker, {}, {function, {argument}}, now.real_ns, crypto::random_bytes(24));
      const Reply endorsed = core.endorse(proposal.signed_proposal, now);
      EXPECT_EQ(endorsed.code, Code::ok) << endorsed.detail;
      replies.put(core.order(*fabric::sign_envelope(asker, endorsed.bytes), now));
    });
    return replies.wait_for(1)[0];
  };
  EXPECT_THAT(order("set", R"({"id":"Org2MSP/a","msgType":"t"})").detail, HasSubstr("the disk is nearly full"));
  EXPECT_EQ(order("acquire", "tello1").code, Code::ok);
  node.reset();
  ::umount2(dir_.c_str(), MNT_DETACH);
}

TEST_F(ShellTest, NoNewAuthoritiesAreMadeOverAnOldChain) {
  node.reset();
  std::filesystem::rename(dir_ / "crypto", dir_ / "elsewhere");
  Node::Options options;
  options.dir = dir_;
  const auto opened = Node::open(options);
  ASSERT_FALSE(opened.ok());
  EXPECT_THAT(opened.error().message, HasSubstr("crypto is missing"));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "crypto"));
}

// Zero length after a power cut, or a copy that went wrong: a new chain would have other owners and forget every stop.
TEST_F(ShellTest, AnEmptyBlockFileBesideItsAnchorIsDamageAndNoNewLedger) {
  node.reset();
  std::filesystem::resize_file(dir_ / "ledger" / "blocks", 0);
  Node::Options options;
  options.dir = dir_.string();
  const auto opened = Node::open(std::move(options));
  ASSERT_FALSE(opened);
  EXPECT_THAT(opened.error().message, HasSubstr("ledger/blocks has no block, though"));
}

TEST_F(ShellTest, TheQueueToTheCoreIsBounded) {
  std::size_t taken = 0;
  {
    const BusyThread busy(*node);
    while (taken < 100'000 && node->post([](NodeCore&) {})) ++taken;
  }
  EXPECT_LT(taken, 10'000U);
  EXPECT_GT(taken, 1'000U);
}

TEST_F(ShellTest, WhoOnlyAsksComesLaterWhateverServiceBringsIt) {
  const auto user = *crypto::load_identity(crypto::Library::libcrypto, "Org3MSP", user_msp_dir(dir_, 3, "User1"));
  const auto place = [&](const fabric::ChannelAndContract& where, const std::string& function) {
    const auto proposal =
        *fabric::make_proposal(user, where, {function, {"tello1"}}, realtime_ns(), crypto::random_bytes(24));
    return node->priority_of(proposal.signed_proposal);
  };
  for (const char* function : {"get", "history", "verify"}) {
    EXPECT_EQ(place({}, function).turn, Turn::later) << function;
  }
  EXPECT_EQ(place({"teleop", "qscc"}, "GetBlockByNumber").turn, Turn::later);
  for (const char* function : {"set", "command", "stop", "acquire", "anchor"}) {
    EXPECT_EQ(place({}, function).turn, Turn::first) << function;
  }
  EXPECT_EQ(place({}, "stop").requester.msp_id, "Org3MSP");
  EXPECT_EQ(place({}, "stop").requester.identity, user.serialized);
  EXPECT_EQ(node->priority_of("garbage").turn, Turn::later);
  msp::SerializedIdentity made_up;
  made_up.set_mspid("Org9MSP");
  EXPECT_EQ(node->requester_of(made_up.SerializeAsString()).msp_id, "")
      << "made-up organisations have one line together";
}

TEST_F(ShellTest, QuestionsOfOneIdentityKeepNoOtherWaiting) {
  Inbox<std::string> done;
  const auto ask = [&](const std::string& msp_id, const std::string& who) {
    node->post([&done, who](NodeCore&) { done.put(who); }, Turn::later, {msp_id, who});
  };
  {
    const BusyThread busy(*node);
    for (int i = 0; i < 100; ++i) ask("Org3MSP", "sybil" + std::to_string(i % 50));
    ask("Org1MSP", "pilot");
    node->post([&done](NodeCore&) { done.put("stop"); });
  }
  const auto order = done.wait_for(102);
  EXPECT_EQ(order[0], "stop");
  EXPECT_LE(std::ranges::find(order, "pilot") - order.begin(), 2);
}

TEST_F(ShellTest, ServicesShowABlockInTheirOwnWay) {
  submit(R"({"id":"tello1/a","msgType":"t"})");
  const TxStatus status = answers.wait_for(1)[0];
  const auto block = *node->feed().read(status.block);

  protos::DeliverResponse filtered;
  ASSERT_TRUE(fill_filtered(*block, filtered).ok());
  const auto& transaction = filtered.filtered_block().filtered_transactions(0);
  EXPECT_EQ(transaction.txid(), status.tx_id);
  const auto& event = transaction.transaction_actions().chaincode_actions(0).chaincode_event();
  EXPECT_EQ(event.event_name(), "set");
  EXPECT_EQ(event.payload(), "");

  orderer::DeliverResponse ordered;
  ASSERT_TRUE(fill_orderer(*block, ordered).ok());
  EXPECT_EQ(ordered.block().metadata().metadata(common::TRANSACTIONS_FILTER), "");

  gateway::ChaincodeEventsResponse events;
  ASSERT_TRUE(fill_events(*block, "ledgerline", "", events).ok());
  ASSERT_THAT(events.events(), SizeIs(1));
  EXPECT_THAT(events.events(0).payload(), HasSubstr("tello1/a"));
  for (const auto& [contract, after] :
       {std::pair<std::string, std::string>{"ledgerline", status.tx_id}, {"other", ""}}) {
    gateway::ChaincodeEventsResponse none;
    ASSERT_TRUE(fill_events(*block, contract, after, none).ok());
    EXPECT_THAT(none.events(), SizeIs(0));
  }
}

}  // namespace
}  // namespace ledgerline::node
