#include <atomic>
#include <condition_variable>
#include <mutex>

#include "common/fabric/blocks/block_intake.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/common/fabric/blocks/growing_channel.hpp"
#include "tests/unit/common/fabric/client/door.hpp"
#include "tests/unit/common/fabric/client/fake_gateway.hpp"

/// A client that takes blocks as they are ordered, at a peer and an orderer that are late, silent or lie.
namespace ledgerline::fabric {
namespace {

class OrderedStream : public GrowingChannel {
 protected:
  OrderedStream() {
    for (int i = 0; i < 3; ++i) more();
  }
  /// A state, each made ten seconds behind the one before.
  std::string state() {
    Draft made = draft();
    write(made, "draft/free/1");
    made.channel_header.mutable_timestamp()->set_seconds(start_s_ + 10 * static_cast<std::int64_t>(nonces_));
    return made.seal();
  }
  /// A block with one.
  void more() {
    const std::string envelope = state();
    const std::lock_guard lock(mutex_);
    add({envelope});
  }
  common::Block of_peer(std::uint64_t number) {
    const std::lock_guard lock(mutex_);
    return chain_.at(number);
  }
  common::Block block(std::uint64_t number) {
    common::Block block = of_peer(number);
    block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, "");
    return block;
  }
  using Bend = std::function<std::optional<common::Block>(std::uint64_t number)>;
  void serve(Bend peer = {}, Bend orderer = {}) {
    gateway_.emplace(
        FakeBehaviour{.deliver = [this, peer](const common::Block& block) -> std::optional<common::Block> {
                        const std::uint64_t number = block.header().number();
                        if (auto other = peer ? peer(number) : std::nullopt) return other;
                        return of_peer(number);
                      },
                      .ordered = [this, orderer](const common::Block& block) -> std::optional<common::Block> {
                        const std::uint64_t number = block.header().number();
                        if (auto other = orderer ? orderer(number) : std::nullopt) return other;
                        return this->block(number);
                      }});
    for (std::size_t i = 1; i < chain_.size(); ++i) gateway_->add_block("set", "");
    ClientConfig config = gateway_->client_config();
    config.config_block = chain_[0].SerializeAsString();
    config.contract_rules.is_of_hot_path = [](const std::string& key) { return key.starts_with("draft/free/"); };
    config.where.channel = "teleop";
    config.orderers.push_back({config.endpoint, config.tls_ca_file});
    config.blocks = BlockSource::ordered;
    client_ = std::move(Client::create(std::move(config))).value();
  }
  void follow(std::uint64_t start) {
    Client::StreamHandlers handlers;
    handlers.on_block = [this](const Block& block, std::string_view) { keep(numbers_, block.number); };
    handlers.on_contradiction = [this](const std::string& what) { keep(contradictions_, what); };
    handlers.on_refused = [this](const Block& block) { keep(refused_, block.number); };
    handlers.on_connection = [this](bool connected, const std::string& why) {
      if (!connected) keep(lost_, why);
    };
    handlers.on_orderers = [this](bool connected, const std::string& why) {
      if (!connected) keep(orderers_, why);
    };
    handlers.on_confirmed = [this](const Client::StreamHandlers::Confirmed& confirmed) {
      EXPECT_LE(confirmed.ordered_ns, confirmed.confirmed_ns);
      EXPECT_EQ(confirmed.hash, header_hash(block(confirmed.number).header()));
      keep(confirmed_, confirmed.number);
    };
    stream_ = client_->blocks(start, std::move(handlers));
  }
  template <typename T>
  void keep(std::vector<T>& where, T what) {
    const std::lock_guard lock(mutex_);
    where.push_back(std::move(what));
    changed_.notify_all();
  }
  template <typename T>
  std::vector<T> await(const std::vector<T>& where, std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return where.size() >= count; });
    return where;
  }
  using Numbers = std::vector<std::uint64_t>;

  const std::int64_t start_s_ = realtime_ns() / ns_per_s;
  std::mutex mutex_;
  std::condition_variable changed_;
  Numbers numbers_, confirmed_, refused_;
  std::vector<std::string> contradictions_, orderers_, lost_;
  std::atomic<int> held_{0};
  Door door_, asked_;  ///< outlive the threads that wait at them
  std::optional<FakeGateway> gateway_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<Client::Stream> stream_;  ///< ends first
};

TEST_F(OrderedStream, BlocksComeBeforeThePeerDeliversThemAndAreConfirmed) {
  serve([&](std::uint64_t number) -> std::optional<common::Block> {
    if (number == 3) door_.pass();
    return std::nullopt;
  });
  follow(1);
  EXPECT_EQ(await(numbers_, 4), (Numbers{1, 2, 3, 4}));
  door_.open();
  EXPECT_EQ(await(confirmed_, 2), (Numbers{3, 4}));
  EXPECT_TRUE(await(contradictions_, 0).empty());
}

TEST_F(OrderedStream, AnOrdererThatForgesIsAnAlarmAndThePeerGoesOn) {
  serve(
      [&](std::uint64_t number) -> std::optional<common::Block> {
        if (number == 3) door_.pass();
        return std::nullopt;
      },
      [&](std::uint64_t number) -> std::optional<common::Block> {
        if (number != 3) return std::nullopt;
        common::Block forged = block(3);
        forged.mutable_metadata()->set_metadata(common::SIGNATURES, "");
        return forged;
      });
  follow(1);
  EXPECT_EQ(await(contradictions_, 1)[0], "block 3: no orderer has signed it");
  EXPECT_EQ(await(numbers_, 2), (Numbers{1, 2})) << "nothing of it came";
  EXPECT_EQ(await(refused_, 1)[0], 3U) << "but for who acts on a signature alone";
  door_.open();
  EXPECT_EQ(await(numbers_, 4), (Numbers{1, 2, 3, 4}));
}

// A stop that comes behind must be seen all the same.
TEST_F(OrderedStream, BehindAContradictionBothStreamsAreReadOnAndNothingIsTakenFromThem) {
  serve([&](std::uint64_t number) -> std::optional<common::Block> {
    if (number != 3) return std::nullopt;
    door_.pass();
    common::Block other = of_peer(3);
    other.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER,
                                           std::string(1, char(protos::MVCC_READ_CONFLICT)));
    return other;
  });
  follow(1);
  EXPECT_EQ(await(numbers_, 4), (Numbers{1, 2, 3, 4}));  // as they were ordered
  door_.open();
  EXPECT_NE(await(contradictions_, 1)[0].find("the peer does not flag transaction 0 valid"), std::string::npos);
  more();
  gateway_->add_block("set", "");
  const std::uint64_t last = chain_.size() - 1;
  std::unique_lock lock(mutex_);
  const auto reported = [&] { return std::count(refused_.begin(), refused_.end(), last); };
  changed_.wait(lock, [&] { return reported() >= 2; });  // by the peer, and by an orderer
  EXPECT_EQ(numbers_, (Numbers{1, 2, 3, 4}));
}

TEST_F(OrderedStream, AForkThatTheOrderersBlockShowsEndsThePeersConnection) {
  const common::Block other = fork(3, state());
  serve(
      [&](std::uint64_t number) -> std::optional<common::Block> {
        if (number == 3) asked_.pass();  // else the orderers' stream may begin behind it
        return std::nullopt;
      },
      [&](std::uint64_t number) -> std::optional<common::Block> {
        if (number != 3) return std::nullopt;
        asked_.open();
        door_.pass();  // the peer's is here before
        return other;
      });
  follow(1);
  EXPECT_EQ(await(numbers_, 4), (Numbers{1, 2, 3, 4}));
  door_.open();
  const std::string what = "block 3 of the peer is not the one that was ordered";
  EXPECT_EQ(await(contradictions_, 1)[0], what);
  more();
  gateway_->add_block("set", "");
  EXPECT_EQ(await(lost_, 1)[0], what);
  EXPECT_EQ(await(numbers_, 4).size(), 4U) << "for good";
}

TEST_F(OrderedStream, AnOrdererThatWithholdsIsLeftAndThePeerGoesOn) {
  serve({}, [&](std::uint64_t number) -> std::optional<common::Block> {
    if (number >= 8 && held_++ == 0) door_.pass();
    return std::nullopt;
  });
  follow(1);
  std::size_t count = await(numbers_, 4).size();
  while (await(orderers_, 0).empty() && count < 200) {
    more();
    gateway_->add_block("set", "");
    await(numbers_, ++count);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_EQ(await(orderers_, 1)[0].find("it withholds block "), 0u);
  EXPECT_TRUE(await(contradictions_, 0).empty()) << "what stays away contradicts nothing";
  door_.open();
}

TEST_F(OrderedStream, WithoutAPeerNothingComesBeyondTheBound) {
  for (std::size_t i = 0; i < 2 * BlockIntake::max_unconfirmed; ++i) more();
  serve([&](std::uint64_t number) -> std::optional<common::Block> {
    if (number == 3) door_.pass();
    return std::nullopt;
  });
  follow(1);
  EXPECT_EQ(await(numbers_, 2 + BlockIntake::max_unconfirmed).size(), 2 + BlockIntake::max_unconfirmed);
  door_.open();
  EXPECT_EQ(await(numbers_, chain_.size() - 1).back(), chain_.size() - 1);
}

TEST_F(OrderedStream, EndsAtAnyMoment) {
  serve();
  for (int i = 0; i < 20; ++i) {
    follow(1);
    if (i % 2 == 0) await(numbers_, 1);
    stream_.reset();
    const std::lock_guard lock(mutex_);
    numbers_.clear();
  }
}

TEST_F(OrderedStream, WithoutOrdererOrTrustAnchorItIsNotBegun) {
  serve();
  ClientConfig config = gateway_->client_config();
  config.blocks = BlockSource::ordered;
  EXPECT_FALSE(Client::create(config));
  config.orderers.push_back({config.endpoint, config.tls_ca_file});
  EXPECT_FALSE(Client::create(config));
}

}  // namespace
}  // namespace ledgerline::fabric
