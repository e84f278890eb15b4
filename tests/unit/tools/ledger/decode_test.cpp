#include "tools/ledger/decode.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "common/msg/ros.hpp"
#include "tests/unit/tools/audit/signed_ledger.hpp"

namespace ledgerline::ledger {
namespace {

using json = nlohmann::ordered_json;
using testing::HasSubstr;
using testing::StartsWith;

json last_transaction(const audit::SignedLedger& chain, const std::string& tx_id) {
  for (const std::string& bytes : chain.chain) {
    const auto block = fabric::decode_block(bytes);
    for (const fabric::Transaction& one : block->transactions)
      if (one.tx_id == tx_id) return transaction_json(block->number, one);
  }
  return {};
}

TEST(ATransaction, IsToldInWordsWithWhatWasCommanded) {
  audit::SignedLedger chain;
  chain.enroll();
  chain.acquire();
  const std::string tx_id = chain.submit(chain.pilot, "command", chain.command_call(4, 1, 9));
  const json decoded = last_transaction(chain, tx_id);
  EXPECT_EQ(decoded["transaction"], tx_id);
  EXPECT_EQ(decoded["function"], "command");
  EXPECT_EQ(decoded["verdict"], "VALID");
  EXPECT_THAT(decoded["creator"].get<std::string>(), StartsWith("Org2MSP CN="));
  EXPECT_GE(decoded["endorsers"].size(), 1U);
  EXPECT_EQ(decoded["arguments"]["plans"][0]["drone"], "tello1");
  EXPECT_EQ(decoded["arguments"]["plans"][0]["sequence"], "4");  // protobuf's JSON has 64 bits as text
  EXPECT_THAT(lines(decoded), HasSubstr("\n  plans:\n    - "));
}

TEST(ACallsArguments, AreItsMessageElsePlainElseCounted) {
  EXPECT_EQ(arguments_json("stop", {"tello1", "cut=true"}), json({"tello1", "cut=true"}));
  EXPECT_EQ(arguments_json("stop", {R"({"drones":["tello1"]})"})["drones"][0], "tello1");
  EXPECT_EQ(arguments_json("of another", {"\x01\x02"})["bytes"], 2);
  EXPECT_EQ(arguments_json("set", {std::string("\xff\xfe", 2)})["bytes"], 2) << "no message of set";
  EXPECT_TRUE(arguments_json("get", {}).empty());
}

TEST(AnAsset, IsDecodedWhereItsTypeIsKnown) {
  Odometry odometry;
  odometry.header = {1'700'000'000 * ns_per_s, "map"};
  odometry.position_m = {1, 2, 3};
  Asset asset;
  asset.set_id("tello1/odom");
  asset.set_msg_type(std::string(odometry_type));
  asset.set_msg_data(to_cdr(odometry));
  EXPECT_EQ(asset_json(asset)["value"]["position_m"], json({1.0, 2.0, 3.0}));
  EXPECT_EQ(asset_json(asset)["value"]["time"], "2023-11-14T22:13:20.000Z");
  asset.set_msg_data("\x01");
  EXPECT_EQ(asset_json(asset)["bytes"], 1) << "damaged";
  asset.set_msg_type("std_msgs/msg/\x1b[31mString");
  EXPECT_THAT(asset_json(asset)["type"].get<std::string>(), testing::Not(HasSubstr("\x1b")));
}

TEST(Lines, IndentWhatIsInsideAndKeepNumbersTogether) {
  EXPECT_EQ(lines({{"a", 1}, {"b", {{"c", {1, 2}}}}, {"d", json::array({{{"e", "f"}}, {{"e", "g"}}})}}),
            "a: 1\nb:\n  c: 1, 2\nd:\n  - e: f\n  - e: g\n");
}

}  // namespace
}  // namespace ledgerline::ledger
