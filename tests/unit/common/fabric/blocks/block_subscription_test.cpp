#include "common/fabric/blocks/block_subscription.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>

#include "tests/unit/common/fabric/client/fake_gateway.hpp"
#include "tests/unit/common/fabric/client/stream_watch.hpp"

/// A program that keeps its place in the chain and reads everything else again at its start.
namespace ledgerline::fabric {
namespace {

using ::testing::HasSubstr;

class BlockSubscriptionTest : public ::testing::Test, protected StreamWatch {
 protected:
  BlockSubscriptionTest() { std::filesystem::create_directories(dir_); }
  ~BlockSubscriptionTest() override {
    end();  // it writes once more
    std::filesystem::remove_all(dir_);
  }

  void grow(FakeGateway& gateway, int blocks, const std::string& function = "set") {
    for (int i = 0; i < blocks; ++i) gateway.add_block(function, "");
  }
  void start(FakeGateway& gateway) {
    numbers_.clear();
    problems_.clear();
    connected_ = false;
    client_ = std::move(Client::create(gateway.client_config())).value();
    auto kept = StoredCheckpoint::read(path_, "teleop");
    ASSERT_TRUE(kept);
    blocks_.emplace(BlockSubscription::Config{.kept = std::move(*kept), .program_stores = program_stores_});
    blocks_->open(*client_, handlers());
  }
  void end() {
    blocks_.reset();
    client_.reset();
  }
  /// One block more, as who follows sees it.
  Numbers next(FakeGateway& gateway) {
    await([&] { return connected_; });
    grow(gateway, 1);
    await([&] { return !numbers_.empty(); });
    return numbers_;
  }
  std::optional<Checkpoint> in_file() const { return *read_checkpoint(path_, "teleop"); }
  static std::string hash_of(const Block& block) {
    return block_header_hash(block.number, block.previous_hash, block.data_hash);
  }

  const std::string dir_ = ::testing::TempDir() + "/block_subscription_" + std::to_string(::getpid());
  std::string path_ = dir_ + "/ground.checkpoint";
  bool program_stores_ = false;
  FakeGateway gateway_;
  std::unique_ptr<Client> client_;
  std::optional<BlockSubscription> blocks_;  ///< ends first
};

TEST_F(BlockSubscriptionTest, TheNewestBlockIsInTheFileAtTheEndAndTheNextStartReadsNoneBefore) {
  grow(gateway_, 3);
  start(gateway_);
  const Numbers first = next(gateway_);
  end();
  ASSERT_TRUE(in_file());
  EXPECT_EQ(in_file()->number, first.back());
  EXPECT_EQ(in_file()->hash, hash_of(gateway_.chain().at(first.back())));
  EXPECT_EQ(in_file()->records, "");

  grow(gateway_, 5);
  start(gateway_);
  EXPECT_EQ(next(gateway_), (Numbers{first.back() + 6}));
  end();
  EXPECT_EQ(in_file()->number, first.back() + 6);
}

TEST_F(BlockSubscriptionTest, WithNothingNewItGoesOnBehindTheCheckpoint) {
  grow(gateway_, 3);
  start(gateway_);
  const Numbers first = next(gateway_);
  end();
  start(gateway_);
  EXPECT_EQ(next(gateway_), (Numbers{first.back() + 1}));
}

TEST_F(BlockSubscriptionTest, AStartThatSeesNoNewBlockRemembersTheNewestAllTheSame) {
  grow(gateway_, 3);
  start(gateway_);
  const Numbers first = next(gateway_);
  end();
  grow(gateway_, 5);
  start(gateway_);
  await([&] { return connected_; });
  end();
  EXPECT_EQ(in_file()->number, first.back() + 5);
  EXPECT_EQ(in_file()->hash, hash_of(gateway_.chain().back()));
}

TEST_F(BlockSubscriptionTest, AnOldChainAndAForkAreRefusedAndTheFileStays) {
  grow(gateway_, 3);
  start(gateway_);
  const std::uint64_t verified = next(gateway_).back();
  end();
  FakeGateway old, fork;
  grow(old, 2);
  grow(fork, 9, "get");
  for (FakeGateway* lie : {&old, &fork}) {
    start(*lie);
    await([&] { return !problems_.empty(); });
    EXPECT_THAT(problems_[0], HasSubstr(lie == &old ? "serves a chain that ends at block" : "serves another block"));
    EXPECT_TRUE(numbers_.empty() && !connected_);
    end();
    EXPECT_EQ(in_file()->number, verified);
  }
}

TEST_F(BlockSubscriptionTest, AProgramThatKeepsByItselfDecidesWhatIsInTheFile) {
  grow(gateway_, 3);
  program_stores_ = true;
  start(gateway_);
  const std::uint64_t first = next(gateway_).back();
  EXPECT_TRUE(blocks_->connection());
  blocks_->store(first - 1, hash_of(gateway_.chain().at(first - 1)), "records");
  end();
  EXPECT_EQ(in_file()->number, first - 1);
  EXPECT_EQ(in_file()->records, "records");
}

TEST_F(BlockSubscriptionTest, WithoutAPathNothingIsKept) {
  path_.clear();
  start(gateway_);
  (void)next(gateway_);
  end();
  EXPECT_TRUE(std::filesystem::is_empty(dir_));
}

}  // namespace
}  // namespace ledgerline::fabric
