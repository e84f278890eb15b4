#include <gmock/gmock.h>

#include "tests/unit/common/fabric/client/fake_gateway.hpp"
#include "tests/unit/common/fabric/client/stream_watch.hpp"
#include "tests/unit/common/fabric/validation/signed_chain.hpp"

/// A program that starts again, at a peer that serves what it likes.
namespace ledgerline::fabric {
namespace {

using ::testing::HasSubstr;

class BehindCheckpoint : public ::testing::Test, protected StreamWatch, protected SignedChain {
 protected:
  void grow(int blocks) {
    for (int i = 0; i < blocks; ++i) add("transaction " + std::to_string(chain_.size()), &orderer_);
  }
  /// The checkpoint at the chain's end.
  Checkpoint here() const {
    const auto& header = chain_.back().header();
    return {"teleop", header.number(), block_header_hash(header.number(), header.previous_hash(), header.data_hash()),
            "records"};
  }
  void serve(std::size_t blocks) {
    gateway_.emplace(FakeBehaviour{.deliver = [this](const common::Block& block) -> std::optional<common::Block> {
      return chain_.at(block.header().number());
    }});
    for (std::size_t i = 1; i < blocks; ++i) gateway_->add_block("set", "");
  }
  void follow(const Checkpoint& last, std::uint64_t max_absence) {
    ClientConfig config = gateway_->client_config();
    config.config_block = chain_[0].SerializeAsString();
    client_ = std::move(Client::create(std::move(config))).value();
    Client::StreamHandlers handlers = this->handlers();
    handlers.on_continued = [this](const Continuation& on) {
      say([&] {
        EXPECT_TRUE(numbers_.empty()) << "before the first block";
        continued_.push_back(on);
      });
    };
    stream_ = client_->blocks_behind({last, max_absence}, std::move(handlers));
  }
  Numbers await_blocks(std::size_t count) {
    await([&] { return numbers_.size() >= count; });
    return numbers_;
  }
  std::string await_problem() {
    await([&] { return !problems_.empty(); });
    EXPECT_TRUE(numbers_.empty() && continued_.empty() && !connected_) << "nothing comes of what is refused";
    return problems_[0];
  }

  std::vector<Continuation> continued_;
  std::optional<FakeGateway> gateway_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<Client::Stream> stream_;  ///< ends first
};

TEST_F(BehindCheckpoint, AfterAShortAbsenceNoBlockIsMissed) {
  grow(3);
  const Checkpoint last = here();
  grow(4);
  serve(chain_.size());
  follow(last, 4);
  EXPECT_EQ(await_blocks(4), (Numbers{4, 5, 6, 7}));
  EXPECT_FALSE(continued_.at(0).gap);
  EXPECT_EQ(continued_.at(0).newest, 7U);
}

TEST_F(BehindCheckpoint, AfterALongAbsenceTheNextNewBlockIsTheFirst) {
  grow(3);
  const Checkpoint last = here();
  grow(50);
  serve(chain_.size() - 1);
  follow(last, 10);
  await([&] { return connected_; });
  gateway_->add_block("set", "");
  EXPECT_EQ(await_blocks(1), (Numbers{53}));
  EXPECT_TRUE(continued_.at(0).gap);
  EXPECT_EQ(continued_.at(0).verified, 3U);
  EXPECT_EQ(continued_.at(0).newest, 52U);
}

TEST_F(BehindCheckpoint, AfterALongAbsenceTheNewestBlockMustBeTheOrderers) {
  grow(3);
  const Checkpoint last = here();
  grow(49);
  add("somebody else's", &other_);
  serve(chain_.size());
  follow(last, 10);
  EXPECT_THAT(await_problem(), HasSubstr("block 53: its orderers' signatures do not satisfy"));
}

TEST_F(BehindCheckpoint, AConfigurationWithinTheAbsenceIsFollowed) {
  grow(3);
  const Checkpoint last = here();
  const std::uint64_t number = chain_.size();
  add(config_of(second_), &orderer_, number);
  for (int i = 0; i < 30; ++i) add("transaction", &other_, number);
  serve(chain_.size() - 1);
  follow(last, 10);
  await([&] { return connected_; });
  gateway_->add_block("set", "");
  EXPECT_EQ(await_blocks(1), (Numbers{chain_.size() - 1}));
}

TEST_F(BehindCheckpoint, AnOldChainIsRefusedUntilThePeerHasCaughtUp) {
  grow(6);
  const Checkpoint last = here();
  grow(1);
  serve(5);
  follow(last, 10);
  EXPECT_THAT(await_problem(), HasSubstr("ends at block 4; we have verified block 6"));
  for (int i = 0; i < 3; ++i) gateway_->add_block("set", "");
  EXPECT_EQ(await_blocks(1), (Numbers{7}));
}

TEST_F(BehindCheckpoint, AForkThatTheOrderersSignedIsRefused) {
  for (const std::uint64_t max_absence : {0U, 100U}) {
    grow(3);
    const Checkpoint last = here();
    chain_.pop_back();
    add("another", &orderer_);
    grow(4);
    serve(chain_.size());
    follow(last, max_absence);
    EXPECT_THAT(await_problem(), HasSubstr("serves another block " + std::to_string(last.number)));
    stream_.reset();
    client_.reset();
    gateway_.reset();
    problems_.clear();
  }
}

TEST_F(BehindCheckpoint, AForkIsNotTakenThoughTheCheckpointsOwnBlockIsShown) {
  grow(3);
  const Checkpoint last = here();
  const common::Block shown = chain_.back();
  chain_.pop_back();
  add("another", &orderer_);
  grow(2);
  chain_[last.number] = shown;
  serve(chain_.size());
  follow(last, 100);
  await([&] { return !problems_.empty(); });
  EXPECT_EQ(problems_[0], "block 4 does not follow block 3: it names another previous hash");
  EXPECT_TRUE(numbers_.empty());
}

}  // namespace
}  // namespace ledgerline::fabric
