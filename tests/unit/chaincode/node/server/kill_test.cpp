#include <gtest/gtest.h>
#include <unistd.h>

#include <condition_variable>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "common/base/random.hpp"
#include "common/fabric/client/client.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/child.hpp"

/// The real node is killed under load, again and again: what it confirmed is in its chain ever after.
namespace ledgerline {
namespace {

std::string program;  // the path of ledgerline-node

class KillTest : public ::testing::Test {
 protected:
  KillTest() : dir_(std::filesystem::temp_directory_path() / ("ledgerline_kill_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(dir_);
  }
  ~KillTest() override { std::filesystem::remove_all(dir_); }

  void start() {
    const std::string count = std::to_string(1 + random_.next() % 8);
    ASSERT_TRUE(node_.start(
        {program, "--dir", dir_, "--listen", "127.0.0.1:0", "--batch-count", count, "--batch-timeout", "2"}))
        << "the node does not start again";
    fabric::ClientConfig config;
    config.endpoint = nlohmann::json::parse(node_.ready_line())["endpoint"];
    const std::string organisation = dir_.string() + "/crypto/peerOrganizations/org1.ledgerline";
    config.tls_ca_file = organisation + "/tlsca/tlsca.org1.ledgerline-cert.pem";
    auto user =
        crypto::load_identity(crypto::Library::libcrypto, "Org1MSP", organisation + "/users/User1@org1.ledgerline/msp");
    ASSERT_TRUE(user.ok()) << user.error().message;
    config.identity = std::move(*user);
    auto client = fabric::Client::create(std::move(config));
    ASSERT_TRUE(client.ok()) << client.error().message;
    client_ = std::move(*client);
  }

  fabric::Call call() {
    return {"set", {R"({"id":"tello1/note)" + std::to_string(++calls_ % 5) + R"(","msgType":"t"})"}};
  }

  /// Keeps 16 calls in flight until the node is gone.
  void load(std::chrono::milliseconds duration) {
    const auto end = std::chrono::steady_clock::now() + duration;
    while (std::chrono::steady_clock::now() < end) {
      {
        std::unique_lock lock(mutex_);
        if (in_flight_ >= 16) ended_.wait_for(lock, std::chrono::milliseconds(5));
        if (in_flight_ >= 16) continue;
        ++in_flight_;
      }
      client_->submit(call(), [this](const fabric::Outcome& outcome) {
        const std::lock_guard lock(mutex_);
        --in_flight_;
        if (outcome.kind == fabric::Outcome::Kind::committed) confirmed_[outcome.tx_id] = outcome.block;
        ended_.notify_one();
      });
    }
  }

  /// Every confirmed transaction stands where it was confirmed; the client checks the chain of hashes.
  void check(std::uint64_t from) {
    const fabric::Outcome last = client_->submit_and_wait(call());
    ASSERT_EQ(last.kind, fabric::Outcome::Kind::committed) << last.message;
    std::map<std::string, std::uint64_t> found;
    std::uint64_t height = from;
    std::string problem;
    {
      std::mutex mutex;
      std::condition_variable grown;
      fabric::Client::StreamHandlers handlers;
      handlers.on_block = [&](const fabric::Block& block, std::string_view) {
        const std::lock_guard lock(mutex);
        for (const fabric::Transaction& tx : block.transactions) {
          if (tx.code == 0) found[tx.tx_id] = block.number;
        }
        height = block.number + 1;
        grown.notify_one();
      };
      handlers.on_connection = [&](bool connected, const std::string& why) {
        const std::lock_guard lock(mutex);
        if (!connected) problem = why;
      };
      const auto stream = client_->blocks(from, std::move(handlers));
      std::unique_lock lock(mutex);
      ASSERT_TRUE(grown.wait_for(lock, std::chrono::seconds(60), [&] { return height > last.block; })) << problem;
      lock.unlock();
    }
    const std::lock_guard lock(mutex_);
    for (const auto& [tx_id, block] : confirmed_) {
      if (block < from) continue;
      ASSERT_TRUE(found.contains(tx_id)) << "confirmed in block " << block << ", now gone";
      ASSERT_EQ(found[tx_id], block);
    }
    checked_ = last.block + 1;
  }

  std::filesystem::path dir_;
  Child node_;
  std::unique_ptr<fabric::Client> client_;
  Random random_{11};
  std::atomic<int> calls_ = 0;
  std::mutex mutex_;
  std::condition_variable ended_;
  int in_flight_ = 0;
  std::map<std::string, std::uint64_t> confirmed_;
  std::uint64_t checked_ = 0;
};

TEST_F(KillTest, WhatWasConfirmedIsInTheChainAfterEveryKill) {
  const int kills = seeds(20, 200);
  for (int i = 0; i < kills; ++i) {
    ASSERT_NO_FATAL_FAILURE(start()) << "kill " << i;
    ASSERT_NO_FATAL_FAILURE(check(checked_)) << "kill " << i;
    std::thread load_thread([&] { load(std::chrono::milliseconds(300)); });
    std::this_thread::sleep_for(std::chrono::milliseconds(20 + random_.next() % 250));
    node_.end(SIGKILL);
    load_thread.join();
    client_.reset();
  }
  ASSERT_NO_FATAL_FAILURE(start());
  ASSERT_NO_FATAL_FAILURE(check(0));  // once more, all of it
  EXPECT_GT(confirmed_.size(), static_cast<std::size_t>(kills)) << "there was no load";
  RecordProperty("confirmed", static_cast<int>(confirmed_.size()));
  std::printf("%d kills, %zu transactions confirmed, %llu blocks\n", kills, confirmed_.size(),
              static_cast<unsigned long long>(checked_));
}

}  // namespace
}  // namespace ledgerline

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc != 2) return std::fprintf(stderr, "usage: %s LEDGERLINE-NODE\n", argv[0]), 2;
  ledgerline::program = argv[1];
  return RUN_ALL_TESTS();
}
