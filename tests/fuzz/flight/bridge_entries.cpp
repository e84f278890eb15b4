// The bridge: events of outsiders, values of `get`, its config, and the status that `ledgerline topics` reads.
#include <algorithm>

#include "common/bridge/core/downlink.hpp"
#include "common/msg/proto_json.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"
#include "tools/topics/show.hpp"

namespace ledgerline::fuzz::bridge_part {
namespace {

using agent::testing::LedgerOfTests;
using namespace ledgerline::bridge;

const crypto::IdentityName writer{"Org2MSP", "CN=User1@org2.ledgerline"};
constexpr TimeNs real_now = 1'700'000'000 * ns_per_s;

void add(google::protobuf::RepeatedPtrField<Asset>& assets, const std::string& id, std::uint64_t sequence) {
  Asset& asset = *assets.Add();
  asset.set_id(id);
  asset.set_topic("/" + id);
  asset.set_msg_type("std_msgs/msg/String");
  asset.set_msg_data(std::string("\0\1\0\0\5\0\0\0text\0", 13));
  asset.mutable_origin()->set_writer(7);
  asset.mutable_origin()->set_life(8);
  asset.mutable_origin()->set_sequence(sequence);
  asset.mutable_origin()->set_stamp_ns(real_now);
}

SetCall good_call() {
  SetCall call;
  add(*call.mutable_assets(), "Org2MSP/typed", 1);
  add(*call.mutable_assets(), "Org2MSP/any", 1);
  // What a newer version may have.
  call.assets(1).GetReflection()->MutableUnknownFields(call.mutable_assets(1))->AddLengthDelimited(99, "tomorrow's");
  return call;
}

DownlinkConfig config() {
  Rule typed, all;
  typed.name = "/typed";
  typed.type = "std_msgs/msg/String";
  all.name = "/*";
  all.from = "Org2MSP";
  typed.from = "Org2MSP";
  typed.from_ledger = all.from_ledger = all.latched = true;
  return {.rules = {typed, all}, .self = {"Org1MSP", "CN=self"}, .writer = 1};
}

bool in_bounds(const std::vector<Downlink::Delivery>& deliveries) {
  return std::all_of(deliveries.begin(), deliveries.end(), [](const Downlink::Delivery& one) {
    return is_ros_type(one.type) && one.cdr.size() >= 4 && one.cdr[0] == 0;
  });
}

class EventEntry final : public Entry {
 public:
  explicit EventEntry(bool json) : json_(json) {}
  std::vector<std::string> seeds() override {
    const SetCall call = good_call();
    if (!json_) return {call.SerializeAsString()};
    SetCall known = call;
    known.mutable_assets(1)->DiscardUnknownFields();
    return {to_json(known)};
  }
  Outcome feed(std::string_view bytes) override {
    Downlink downlink(config(), *registry_);
    LedgerOfTests ledger;
    std::vector<Downlink::Delivery> out;
    const fabric::Block block = ledger.block({event(std::string(bytes))});
    downlink.on_block(real_now, block, out);
    if (!in_bounds(out)) return refused("");
    if (!out.empty()) return accepted();
    // It did nothing: so a good one of another life is taken after it.
    SetCall good;
    add(*good.mutable_assets(), "Org2MSP/after", 1);
    const fabric::Block next = ledger.block({event(good.SerializeAsString())});
    downlink.on_block(real_now, next, out);
    return out.size() == 1 ? dropped() : refused("");
  }

 private:
  static LedgerOfTests::Tx event(std::string payload) {
    LedgerOfTests::Tx tx;
    tx.creator = writer;
    tx.event_name = "set";
    tx.event_payload = std::move(payload);
    return tx;
  }
  bool json_;
  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
};

class ValuesEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    Assets values;
    add(*values.mutable_assets(), "Org2MSP/any", 1);
    return {values.SerializeAsString()};
  }
  Outcome feed(std::string_view bytes) override {
    Assets values;
    if (const Status status = parse_message(bytes, values); !status) return refused(status.error().message);
    Downlink downlink(config(), *registry_);
    std::vector<Downlink::Delivery> out;
    downlink.on_values(real_now, values, out);
    if (!in_bounds(out)) return refused("");
    return out.empty() ? dropped() : accepted();
  }

 private:
  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
};

const Registration set({"bridge.set", Kind::protobuf, [] { return std::make_unique<EventEntry>(false); }, 0.1});
const Registration set_json({"bridge.set_json", Kind::json, [] { return std::make_unique<EventEntry>(true); }, 0.1});
const Registration values({"bridge.values", Kind::protobuf, [] { return std::make_unique<ValuesEntry>(); }, 0.1});
const Registration config_file(
    {"bridge.config", Kind::toml, [] {
       return std::make_unique<Function>(
           std::vector<std::string>{
               "[bridge]\nname = \"arm\"\nmin_gap_ms = 5\n[[enrolled]]\nname = "
               "\"robot7\"\n[[topic]]\nname = \"/robot7/*\"\nfrom = \"robot7\"\nstream = true\npriority = 9\n"},
           [](std::string_view text) {
             auto parsed = Config::parse(text, "bridge.toml");
             if (!parsed) return refused(parsed.error().message);
             (void)read_bridge(*parsed);
             return outcome_of(parsed->finish());
           });
     }});
const Registration status(
    {"bridge.status", Kind::json, [] {
       return std::make_unique<Function>(
           std::vector<std::string>{
               R"({"bridge":"","pid":1,"time_ns":5,"period_ms":100,"channels":[{"channel":"teleop",)"
               R"("connected":true,"malformed_frames":0,"topics":[{"topic":"/a","type":"p/msg/A",)"
               R"("id":"Org1MSP/a","direction":"to_ledger","messages":1,"bytes":2,"batches":1,)"
               R"("age_ms":{"median":1.0,"p99":2.0},"drops":{"rate":3}}]}]})"},
           [](std::string_view text) {
             const auto read = topics::parse_status(text, "status", 5);
             if (!read) return refused(read.error().message);
             return topics::table(*read, *read).empty() ? refused("") : accepted();
           });
     }});

}  // namespace
}  // namespace ledgerline::fuzz::bridge_part
