#include <atomic>
#include <condition_variable>
#include <mutex>

#include "tests/unit/common/fabric/client/fake_gateway.hpp"
#include "tests/unit/common/fabric/validation/signed_chain.hpp"

/// A client that knows whose orderers make its channel's blocks, at a peer that serves what it likes.
namespace ledgerline::fabric {
namespace {

class ValidatedStream : public ::testing::Test, protected SignedChain {
 protected:
  /// Serves the chain, or what `lie` makes of its blocks.
  void serve(std::function<std::optional<common::Block>(std::uint64_t)> lie = {}) {
    gateway_.emplace(FakeBehaviour{.deliver = [this, lie](const common::Block& block) -> std::optional<common::Block> {
      const std::uint64_t number = block.header().number();
      if (auto other = lie ? lie(number) : std::nullopt) return other;
      return chain_.at(number);
    }});
    for (std::size_t i = 1; i < chain_.size(); ++i) gateway_->add_block("set", "");
    ClientConfig config = gateway_->client_config();
    config.config_block = chain_[0].SerializeAsString();
    config.where.channel = "teleop";
    client_ = std::move(Client::create(std::move(config))).value();
  }
  void follow(std::uint64_t start) {
    Client::StreamHandlers handlers;
    handlers.on_block = [this](const Block& block, std::string_view) {
      const std::lock_guard lock(mutex_);
      numbers_.push_back(block.number);
      changed_.notify_all();
    };
    handlers.on_connection = [this](bool connected, const std::string& why) {
      const std::lock_guard lock(mutex_);
      if (!connected) problems_.push_back(why);
      changed_.notify_all();
    };
    stream_ = client_->blocks(start, std::move(handlers));
  }
  std::vector<std::uint64_t> await_blocks(std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return numbers_.size() >= count; });
    return numbers_;
  }
  std::string await_problem() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !problems_.empty(); });
    EXPECT_TRUE(numbers_.empty()) << "nothing comes before it is validated";
    return problems_[0];
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::uint64_t> numbers_;
  std::vector<std::string> problems_;
  std::optional<FakeGateway> gateway_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<Client::Stream> stream_;  ///< ends first
};

TEST_F(ValidatedStream, WhatTheOrderersSignedComes) {
  for (int i = 0; i < 3; ++i) add("transaction", &orderer_);
  serve();
  follow(0);
  EXPECT_EQ(await_blocks(4), (std::vector<std::uint64_t>{0, 1, 2, 3}));
}

TEST_F(ValidatedStream, WhatNobodySignedEndsTheStreamUntilTheRightBlockComes) {
  for (int i = 0; i < 3; ++i) add("transaction", &orderer_);
  common::Block unsigned_one = chain_[1];
  unsigned_one.mutable_metadata()->set_metadata(common::SIGNATURES, "");
  std::atomic<int> lies{2};
  serve([&](std::uint64_t number) -> std::optional<common::Block> {
    if (number != 1 || lies-- <= 0) return std::nullopt;
    return unsigned_one;
  });
  follow(1);
  EXPECT_EQ(await_problem(), "block 1: no orderer has signed it");
  EXPECT_EQ(await_blocks(3), (std::vector<std::uint64_t>{1, 2, 3}));
}

TEST_F(ValidatedStream, ConfigurationsFromBeforeItsStartAreFetched) {
  add("transaction", &orderer_);
  add(config_of(second_), &orderer_, 2);
  for (int i = 0; i < 3; ++i) add("transaction", &other_, 2);
  serve();
  follow(4);
  EXPECT_EQ(await_blocks(2), (std::vector<std::uint64_t>{4, 5}));
}

TEST_F(ValidatedStream, WhoHidesAConfigurationServesNothing) {
  add("transaction", &orderer_);
  add(config_of(second_), &orderer_, 2);
  for (int i = 0; i < 3; ++i) add("transaction", &other_, 2);
  const common::Block other = chain_[1];
  serve([&](std::uint64_t number) -> std::optional<common::Block> {
    return number == 2 ? std::optional(other) : std::nullopt;
  });
  follow(4);
  EXPECT_NE(await_problem().find("the peer does not give block 2"), std::string::npos);
}

TEST_F(ValidatedStream, AnAnchorThatIsNoneIsAnErrorOfTheClient) {
  serve();
  ClientConfig config = gateway_->client_config();
  config.config_block = "nothing";
  EXPECT_NE(Client::create(config).error().message.find("ledger.config_block: "), std::string::npos);
  config.config_block = chain_[0].SerializeAsString();
  config.where.channel = "another";
  EXPECT_NE(Client::create(std::move(config)).error().message.find("is of channel teleop"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::fabric
