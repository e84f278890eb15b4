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
      if (one.tx_id == tx_id) return transaction_json(*block, one);
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

TEST(ATransaction, IsFoundByTheBeginningOfItsIdAndTheNextBlockNamesItsBlocksHash) {
  audit::SignedLedger chain;
  chain.enroll();
  chain.acquire();
  const std::string tx_id = chain.submit(chain.pilot, "command", chain.command_call(4, 1, 9));
  for (std::uint64_t sequence = 5; sequence < 22; ++sequence)  // more than an id's first digit tells apart
    chain.submit(chain.pilot, "command", chain.command_call(sequence, 1, 9));
  const auto search = [&](const std::string& beginning) {
    TransactionSearch found(beginning);
    for (const std::string& bytes : chain.chain) found.add(bytes);
    return found.result();
  };
  const auto found = search(tx_id.substr(0, 16));
  ASSERT_TRUE(found);
  EXPECT_EQ(*found, *search(tx_id));
  const auto next = fabric::decode_block(chain.chain.at((*found)["block"].get<std::size_t>() + 1));
  EXPECT_EQ((*found)["block_hash"], crypto::hex(next->previous_hash));
  EXPECT_THAT(search("no such").error().message, HasSubstr("is not there"));
  std::string problems;
  for (const char digit : std::string("0123456789abcdef"))
    if (const auto one = search(std::string(1, digit)); !one) problems += one.error().message;
  EXPECT_THAT(problems, HasSubstr(" transactions begin with "));
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

TEST(AnAsset, IsDecodedOfAnchorsAndOfTransitionsAndAlarmsToo) {
  AnchorCall call;
  call.set_digest(std::string(32, 'd'));
  call.set_what("approves mission survey");
  Asset asset;
  asset.set_id("anchor/6464");
  asset.set_msg_type("ledgerline.AnchorCall");
  asset.set_msg_data(call.SerializeAsString());
  EXPECT_EQ(asset_json(asset)["value"]["what"], "approves mission survey");
  EXPECT_THAT(asset_json(asset)["value"]["digest"].get<std::string>(), StartsWith("6464"));
  EXPECT_EQ(arguments_json("anchor", {call.SerializeAsString()}), asset_json(asset)["value"]);
  Transition transition;
  transition.phase = LinkPhase::flying;
  transition.mode = FailsafeMode::hold;
  transition.cause = FailsafeCause::ledger_silent;
  transition.number = 3;
  asset.set_id("tello1/failsafe");
  asset.set_msg_type(std::string(transitions_type));
  asset.set_msg_data(transitions_to_cdr({}, "tello1", {transition}));
  EXPECT_EQ(asset_json(asset)["value"][0]["number"], 3);
  EXPECT_EQ(asset_json(asset)["value"][0]["mode"], "hold");
  asset.set_id("tello1/alarm");
  asset.set_msg_data(alarms_to_cdr({}, "tello1", {{"block", true, 2, "bad signature", 7}}));
  EXPECT_EQ(asset_json(asset)["value"][0]["words"], "bad signature");
  asset.set_msg_type("google.protobuf.Any");
  EXPECT_TRUE(asset_json(asset).contains("bytes")) << "none of ours";
}

TEST(History, OfAControlRecordSaysUnderWhichKeysTheRestIs) {
  EXPECT_EQ(history_note("control/tello1"),
            "Records of their own: stops under 'stop/tello1/*' (`ledgerline ledger get` lists them), grants under "
            "grant/tello1, requests under request/tello1.\n");
  EXPECT_EQ(history_note("tello1/odom"), "");
}

TEST(Lines, IndentWhatIsInsideAndKeepNumbersTogether) {
  EXPECT_EQ(lines({{"a", 1}, {"b", {{"c", {1, 2}}}}, {"d", json::array({{{"e", "f"}}, {{"e", "g"}}})}}),
            "a: 1\nb:\n  c: 1, 2\nd:\n  - e: f\n  - e: g\n");
}

}  // namespace
}  // namespace ledgerline::ledger
