#include <stdexcept>

#include "tests/fuzz/entry.hpp"
#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// Every function of the contract in every form, on a ledger that has drones, leases, frames and notes.
namespace ledgerline::fuzz::contract_part {
namespace {

using chaincode::FakeStub;
using chaincode::Response;

const crypto::IdentityName admin{"Org1MSP", "CN=Admin@org1"}, host{"Org1MSP", "CN=host"}, chief{"Org1MSP", "CN=chief"},
    pilot{"Org2MSP", "CN=pilot"}, other_admin{"Org2MSP", "CN=Admin@org2"};

struct Call {
  crypto::IdentityName who;  ///< that may do it
  std::string function;
  std::vector<std::string> json, plain;
};

/// Makes messages of JSON texts: the same calls in protobuf.
std::string protobuf_of(const std::string& function, const std::string& json) {
  const auto bytes = [&](auto message) {
    (void)parse_message(json, message);
    return message.SerializeAsString();
  };
  if (function == "set") {
    SetCall set;
    if (!parse_message(json, set)) (void)parse_message(json, *set.add_assets());
    return set.SerializeAsString();
  }
  if (function == "get" || function == "history") return bytes(QueryCall{});
  if (function == "delete") return bytes(DeleteCall{});
  if (function == "anchor" || function == "verify") return bytes(AnchorCall{});
  if (function == "enroll") return bytes(EnrollCall{});
  if (function == "revoke") return bytes(RevokeCall{});
  if (function == "grant") return bytes(GrantCall{});
  if (function == "acquire" || function == "release" || function == "request") return bytes(LeaseCall{});
  if (function == "hand_over" || function == "deny") return bytes(AnswerCall{});
  if (function == "command") return bytes(CommandCall{});
  return bytes(DronesCall{});
}

const std::vector<Call> calls{
    {host,
     "set",
     {R"({"id":"tello1/note","msgType":"std_msgs/msg/String","msgData":"AAEAAA=="})",
      R"({"assets":[{"id":"tello1/odom","topic":"/tello1/odom","msgType":"nav_msgs/msg/Odometry","msgData":"AAEA"},{"id":"tello2/odom","msgType":"a","msgData":"AAEA"}],"stream":true})",
      R"({"assets":[{"id":"Org1MSP/a/b","msgType":"x"},{"id":"Org1MSP/a/c","msgType":"y","msgData":"AA=="}]})"},
     {}},
    {pilot,
     "get",
     {R"({"id":"tello1/note"})", R"({"id":"tello1/odom"})", R"({"id":"tello1/*"})", "{}",
      R"({"id":"control/*","bookmark":"control/tello1"})", R"({"id":"Org1MSP/n/*","bookmark":"Org1MSP/n/3"})"},
     {"tello1/note", "tello1/*", "", "control/tello1", "*\nbookmark=tello1/odom"}},
    {pilot,
     "history",
     {R"({"id":"tello1/note"})", R"({"id":"tello1/odom","bookmark":"0:/0:"})", R"({"id":"control/tello1"})"},
     {"tello1/odom", "tello1/note\nbookmark=0:/0:", "Org1MSP/n/3"}},
    {host, "delete", {R"({"id":"tello1/note"})", R"({"id":"tello1/odom"})"}, {"tello1/note", "Org1MSP/n/3"}},
    {admin,
     "enroll",
     {R"({"identity":{"mspId":"Org1MSP","subject":"CN=host"},"drones":["tello1","tello2"]})",
      R"({"identity":{"mspId":"Org1MSP","subject":"CN=chief"},"role":"SUPERVISOR"})"},
     {}},
    {other_admin, "revoke", {R"({"identity":{"mspId":"Org2MSP","subject":"CN=pilot"}})"}, {}},
    {admin,
     "grant",
     {R"({"drones":["tello1","tello2"],"grant":{"to":{"mspId":"Org3MSP","subject":"CN=far"},"fly":true,"maxPriority":7,"cut":true}})",
      R"({"drones":["tello1"],"grant":{"to":{"mspId":"Org2MSP"}}})"},
     {}},
    {pilot,
     "acquire",
     {R"({"drones":["tello1","tello2"],"priority":5})", R"({"drones":["tello1"]})"},
     {"tello1", "tello1\ntello2\npriority=7"}},
    {pilot, "release", {R"({"drones":["tello1"]})"}, {"tello1", "tello1\ntello2"}},
    {chief, "request", {R"({"drones":["tello1"],"priority":3})"}, {"tello1", "tello1\ntello2\npriority=7"}},
    {pilot, "hand_over", {R"({"drones":["tello1"],"to":{"mspId":"Org1MSP","subject":"CN=chief"}})"}, {}},
    {pilot, "deny", {R"({"drones":["tello1","tello2"],"to":{"mspId":"Org1MSP","subject":"CN=chief"}})"}, {}},
    {chief, "evict", {R"({"drones":["tello1"]})"}, {"tello1", "tello1\ntello2"}},
    {pilot,
     "command",
     {R"({"organisation":"Org1MSP","plans":[{"drone":"tello1","action":"FLY","bootId":"9","stateStampNs":"55","sequence":"3","epoch":"1","setpoints":[{"atNs":"60","vx":0.5,"vy":-0.25},{"atNs":"70","vx":0.5,"yawRate":1}]},{"drone":"tello2","action":"LAND","epoch":"1"}]})",
      R"({"organisation":"Org1MSP","plans":[{"drone":"tello1","action":"TAKEOFF","epoch":"1"}]})"},
     {}},
    {chief,
     "stop",
     {R"({"drones":["tello1"],"cut":true})", R"({"drones":["tello2","tello1"]})"},
     {"tello1", "tello1\ncut=true"}},
    {chief, "clear_stop", {R"({"drones":["tello1"]})"}, {"tello1", "tello1\ntello2"}},
    {pilot, "anchor", {R"({"digest":"qqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqo=","what":"flight 7"})"}, {}},
    {pilot,
     "verify",
     {R"({"digest":"qqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqo="})",
      R"({"digest":"qqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqo=","signers":[{"mspId":"Org2MSP","subject":"CN=pilot"}]})",
      R"({"digest":"qqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqo=","organisation":"Org2MSP","bookmark":"Org2MSP/0"})"},
     {}},
    {host, "apply_stops", {R"({"drones":["tello1"]})"}, {"tello1", "tello1\ntello2"}},
    {chief, "claim", {R"({"drones":["tello1"]})"}, {"tello1", "tello1\ntello2"}},
    {chief, "unclaim", {R"({"drones":["tello1"]})"}, {"tello1", "tello1\ntello2"}},
};

/// Each call finds the same ledger, so that what is valid stays valid.
class ContractEntry final : public Entry {
 public:
  ContractEntry(const Call& call, Kind kind) : call_(call), plain_(kind == Kind::text) {
    if (kind == Kind::text) seeds_ = call.plain;
    if (kind == Kind::json) seeds_ = call.json;
    if (kind == Kind::protobuf) {
      for (const std::string& json : call.json) seeds_.push_back(protobuf_of(call.function, json));
    }
    must(admin, "enroll", R"({"identity":{"mspId":"Org1MSP","subject":"CN=host"},"drones":["tello1","tello2"]})");
    must(admin, "enroll", R"({"identity":{"mspId":"Org1MSP","subject":"CN=chief"},"role":"SUPERVISOR"})");
    must(other_admin, "enroll", R"({"identity":{"mspId":"Org2MSP","subject":"CN=pilot"},"role":"OPERATOR"})");
    must(admin, "grant",
         R"({"drones":["tello1","tello2"],"grant":{"to":{"mspId":"Org2MSP"},"fly":true,"maxPriority":100}})");
    must(host, "set", calls[0].json[0]);
    for (int i = 0; i < 3; ++i) must(host, "set", calls[0].json[1]);
    for (int i = 0; i < 40; ++i)
      must(host, "set", R"({"id":"Org1MSP/n/)" + std::to_string(i % 20) + R"(","msgType":"x","msgData":"AAEA"})");
    if (call.function != "acquire") must(pilot, "acquire", R"({"drones":["tello1","tello2"]})");
    if (call.function == "verify")
      must(pilot, "anchor", R"({"digest":"qqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqqo="})");
    if (call.function == "hand_over" || call.function == "deny")
      must(chief, "request", R"({"drones":["tello1","tello2"],"priority":3})");
    if (call.function == "clear_stop" || call.function == "apply_stops")
      must(chief, "stop", R"({"drones":["tello1","tello2"]})");
    if (call.function == "apply_stops") must(other_admin, "revoke", calls[5].json[0]);
  }
  std::vector<std::string> seeds() override { return seeds_; }

  Outcome feed(std::string_view bytes) override {
    std::vector<std::string> args;
    if (plain_) {  // an argument a line
      for (std::size_t at = 0; at <= bytes.size();) {
        const std::size_t end = std::min(bytes.find('\n', at), bytes.size());
        args.emplace_back(bytes.substr(at, end - at));
        at = end + 1;
      }
    } else {
      args.emplace_back(bytes);
    }
    stub_.who = call_.who;
    stub_.reads.clear();
    stub_.writes.clear();
    stub_.event_name.clear();
    const Response response = chaincode::invoke(stub_, call_.function, args);
    if (response.status >= 400) return refused(response.message);
    // A write has its event; what is asked for has an answer.
    const bool asks = call_.function == "get" || call_.function == "history" || call_.function == "verify";
    return asks == stub_.event_name.empty() && response.status == 200 ? accepted() : refused("");
  }

 private:
  void must(const crypto::IdentityName& who, const std::string& function, const std::string& json) {
    const Response response = stub_.call(who, function, {json});
    if (response.status >= 400) throw std::logic_error(function + ": " + response.message);
  }

  Call call_;
  bool plain_;
  std::vector<std::string> seeds_;
  FakeStub stub_;
};

/// Any function name.
class FunctionEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    std::vector<std::string> names;
    for (const Call& call : calls) names.push_back(call.function);
    return names;
  }
  std::vector<std::string> probes() override { return {"get"}; }
  Outcome feed(std::string_view bytes) override {
    const Response response = chaincode::invoke(stub_, std::string(bytes), {""});
    return response.status >= 400 ? refused(response.message) : accepted();
  }

 private:
  FakeStub stub_;
};

bool add_all() {
  for (const Call& call : calls) {
    for (const Kind kind : {Kind::protobuf, Kind::json, Kind::text}) {
      if (kind == Kind::text && call.plain.empty()) continue;
      const std::string form = kind == Kind::protobuf ? "protobuf" : kind == Kind::json ? "json" : "plain";
      registered().push_back({"contract." + call.function + "." + form, kind,
                              [&call, kind] { return std::make_unique<ContractEntry>(call, kind); }});
    }
  }
  registered().push_back({"contract.function", Kind::text, [] { return std::make_unique<FunctionEntry>(); }});
  return true;
}
const bool added = add_all();

}  // namespace
}  // namespace ledgerline::fuzz::contract_part
