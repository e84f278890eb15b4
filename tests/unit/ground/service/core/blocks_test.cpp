#include "ground/service/core/blocks.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ledgerline::ground::service {
namespace {

using nlohmann::json;

fabric::Transaction call(const std::string& function, const std::string& creator, int code = 0) {
  fabric::Transaction tx;
  tx.contract = "ledgerline";
  tx.function = function;
  tx.creator = creator;
  tx.code = code;
  return tx;
}

fabric::Block block_of(std::uint64_t number, std::vector<fabric::Transaction> transactions) {
  fabric::Block block;
  block.number = number;
  block.transactions = std::move(transactions);
  return block;
}

json reported(const BlockSummary& block) { return json::parse(blocks_message({block}, 0))["blocks"][0]; }

TEST(Blocks, CountsWhatABlockHolds) {
  const auto block = block_of(7, {call("set", "host"), call("set", "host"), call("command", "us"),
                                  call("command", "us", 11), call("stop", "client")});
  const json said = reported(summary_of(block, 5 * ns_per_ms, "us", "ledgerline"));
  EXPECT_EQ(said["n"], 7);
  EXPECT_EQ(said["t_ms"], 5);
  EXPECT_EQ(said["txs"], 5);
  EXPECT_EQ(said["ours"], 2);
  EXPECT_EQ(said["invalid"], 1);
  EXPECT_EQ(said["kinds"], json({{"set", 2}, {"command", 2}, {"stop", 1}}));
}

TEST(Blocks, AnUnknownFunctionNameCountsAmongTheOthers) {
  fabric::Transaction elsewhere = call("set", "host"), config;
  elsewhere.contract = "another";
  config.config = true;
  const auto block = block_of(1, {call("<script>", "x"), call("config", "x"), elsewhere, config});
  const json said = reported(summary_of(block, 0, "us", "ledgerline"));
  EXPECT_EQ(said["kinds"], json({{"other", 3}, {"config", 1}}));
}

TEST(Blocks, AnOrderersBlockHasNoFlagsAndIsNotInvalid) {
  fabric::Block block = block_of(1, {call("set", "host", -1)});
  block.received_ns = 3 * ns_per_ms;
  const BlockSummary summary = summary_of(block, 9 * ns_per_ms, "us", "ledgerline");
  EXPECT_EQ(summary.invalid, 0U);
  EXPECT_EQ(summary.at_ns, 3 * ns_per_ms);
}

TEST(Blocks, EveryFunctionThatWritesWhoMayDoWhatIsAKind) {
  for (const std::string_view function : contract::control_functions)
    EXPECT_NE(std::find(block_kinds.begin(), block_kinds.end(), function), block_kinds.end()) << function;
}

TEST(Blocks, AFunctionOfAnOldBlockCountsByItsNameOfToday) {
  const json said = reported(summary_of(block_of(1, {call("fold", "x"), call("resume", "x")}), 0, "us", "ledgerline"));
  EXPECT_EQ(said["kinds"], json({{"apply_stops", 1}, {"clear_stop", 1}}));
}

TEST(Blocks, AMessageHasThoseThatAreNotReported) {
  const std::deque<BlockSummary> blocks{{.number = 4}, {.number = 5}, {.number = 6}};
  const json said = json::parse(blocks_message(blocks, 4));
  EXPECT_EQ(said["op"], "blocks");
  ASSERT_EQ(said["blocks"].size(), 2U);
  EXPECT_EQ(said["blocks"][0]["n"], 5);
}

}  // namespace
}  // namespace ledgerline::ground::service
