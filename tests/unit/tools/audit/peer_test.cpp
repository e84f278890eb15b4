#include "tools/audit/source.hpp"

#include <gmock/gmock.h>

#include "common/common.pb.h"
#include "tests/unit/common/fabric/client/fake_gateway.hpp"

namespace ledgerline::audit {
namespace {

using ::testing::HasSubstr;

constexpr std::uint64_t height = 40;  // more than the queue between stream and audit holds

class PeerTest : public ::testing::Test {
 protected:
  void serve(fabric::FakeBehaviour behaviour) {
    gateway_.emplace(std::move(behaviour));
    while (gateway_->chain().size() < height) gateway_->add_block("set", "");
    client_ = std::move(fabric::Client::create(gateway_->client_config())).value();
  }
  Result<Reading> read(std::chrono::milliseconds timeout, std::uint64_t blocks = height) {
    return read_blocks(*client_, blocks, timeout, [this](std::string_view bytes) {
      common::Block block;
      ASSERT_TRUE(block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())));
      numbers_.push_back(block.header().number());
    });
  }

  std::optional<fabric::FakeGateway> gateway_;
  std::unique_ptr<fabric::Client> client_;
  std::vector<std::uint64_t> numbers_;
};

TEST_F(PeerTest, AllBlocksComeInOrderAndThenItEnds) {
  serve({});
  const auto reading = read(std::chrono::seconds(60));
  ASSERT_TRUE(reading) << reading.error().message;
  EXPECT_EQ(reading->problem, "");
  ASSERT_EQ(numbers_.size(), height);
  for (std::size_t i = 0; i < height; ++i) EXPECT_EQ(numbers_[i], i);
}

TEST_F(PeerTest, AnAuditThatEndsEarlierLeavesNobodyWaiting) {
  serve({});
  const auto reading = read(std::chrono::seconds(60), 3);
  ASSERT_TRUE(reading);
  EXPECT_EQ(numbers_.size(), 3U);
}

TEST_F(PeerTest, AChainThatBreaksIsReportedWhereItDoes) {
  serve({.deliver = [](const common::Block& block) -> std::optional<common::Block> {
    if (block.header().number() != 5) return std::nullopt;
    common::Block other = block;
    (*other.mutable_header()->mutable_previous_hash())[0] ^= 1;
    return other;
  }});
  const auto reading = read(std::chrono::seconds(1));
  ASSERT_TRUE(reading) << reading.error().message;
  EXPECT_EQ(reading->blocks, 5U);
  EXPECT_THAT(reading->problem, HasSubstr("block 5"));
}

TEST_F(PeerTest, APeerThatHasLessThanItReportedIsFound) {
  serve({});
  const auto reading = read(std::chrono::seconds(1), height + 1);
  ASSERT_TRUE(reading);
  EXPECT_THAT(reading->problem, HasSubstr("gives no more of them"));
}

TEST_F(PeerTest, APeerThatGivesNothingIsAnError) {
  serve({.refuse_deliver = common::FORBIDDEN});
  const auto reading = read(std::chrono::seconds(1));
  ASSERT_FALSE(reading);
  EXPECT_TRUE(numbers_.empty());
}

}  // namespace
}  // namespace ledgerline::audit
