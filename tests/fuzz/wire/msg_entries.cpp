#include <cmath>

#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "ledgerline.pb.h"
#include "tests/fuzz/entry.hpp"

/// CDR of ROS 2 messages, and both forms of every message of the contract.
namespace ledgerline::fuzz::msg_part {
namespace {

StateSample sample() {
  StateSample s;
  s.phase = LinkPhase::flying;
  s.boot_id = 77;
  s.sequence = 1234;
  s.stamp_ns = s.pose_stamp_ns = 55 * ns_per_s;
  s.position_m = {1, 2, 1};
  s.velocity_mps = {0.5, 0, 0};
  s.battery = 0.5F;
  s.applied_sequence = 3;
  s.sent_velocity_mps = {0.1F, 0.2F, 0.3F};
  return s;
}

std::unique_ptr<Entry> odometry() {
  Odometry message;
  message.header = {1'700'000'000 * ns_per_s + 5, "map"};
  message.child_frame_id = "tello1/base_link";
  message.position_m = {1, 2, 3};
  return std::make_unique<Function>(std::vector<std::string>{to_cdr(message), to_cdr(Odometry{})},
                                    [](std::string_view bytes) {
                                      const auto read = odometry_from_cdr(bytes);
                                      if (read && odometry_from_cdr(to_cdr(*read)).ok() != true) return refused("");
                                      return outcome_of(read);
                                    });
}

std::unique_ptr<Entry> battery() {
  BatteryState message;
  message.header = {1'700'000'000 * ns_per_s, "tello1"};
  message.percentage = 0.5F;
  return std::make_unique<Function>(std::vector<std::string>{to_cdr(message)},
                                    [](std::string_view bytes) { return outcome_of(battery_from_cdr(bytes)); });
}

std::unique_ptr<Entry> twist() {
  std::string message("\0\1\0\0", 4);
  message.resize(4 + 6 * sizeof(double));
  return std::make_unique<Function>(std::vector<std::string>{message},
                                    [](std::string_view bytes) { return outcome_of(twist_from_cdr(bytes)); });
}

std::unique_ptr<Entry> link_status() {
  return std::make_unique<Function>(
      std::vector<std::string>{link_status_to_cdr(sample(), 0), link_status_to_cdr(StateSample{}, 0)},
      [odometry = to_cdr(odometry_of(sample(), "tello1", 0))](std::string_view bytes) {
        const auto state = state_from_cdr(bytes, odometry);
        if (!state) return refused(state.error().message);
        const StateSample* read = &state->sample;
        // What comes out goes into a controller: nothing that arithmetic could trip over.
        for (const auto& values : {read->position_m, read->velocity_mps}) {
          for (const double value : values) {
            if (!std::isfinite(value)) return refused("");
          }
        }
        return read->stamp_ns >= 0 && read->pose_stamp_ns >= 0 ? accepted() : refused("");
      });
}

std::unique_ptr<Entry> transitions() {
  const Transition hold{.phase = LinkPhase::flying,
                        .mode = FailsafeMode::hold,
                        .cause = FailsafeCause::plan_ran_out,
                        .boot_id = 77,
                        .number = 5,
                        .stamp_ns = 55 * ns_per_s};
  return std::make_unique<Function>(
      std::vector<std::string>{transitions_to_cdr({ns_per_s, "tello1"}, "tello1", {hold, hold}),
                               transitions_to_cdr({}, "", {})},
      [](std::string_view bytes) { return outcome_of(transitions_from_cdr(bytes)); });
}

std::unique_ptr<Entry> alarms() {
  const Alarm differs{"records_differ", true, 3, "tello1: not held; there held by Org2MSP", 41};
  return std::make_unique<Function>(
      std::vector<std::string>{alarms_to_cdr({ns_per_s, "tello1"}, "tello1", {differs, differs}),
                               alarms_to_cdr({}, "", {})},
      [](std::string_view bytes) { return outcome_of(alarms_from_cdr(bytes)); });
}

const Registration cdr_odometry({"cdr.odometry", Kind::bytes, odometry});
const Registration cdr_battery({"cdr.battery", Kind::bytes, battery, 0.1});
const Registration cdr_twist({"cdr.twist", Kind::bytes, twist, 0.1});
const Registration cdr_link_status({"cdr.link_status", Kind::bytes, link_status});
const Registration cdr_transitions({"cdr.transitions", Kind::bytes, transitions});
const Registration cdr_alarms({"cdr.alarms", Kind::bytes, alarms, 0.1});

// ---- forms

template <typename Message>
std::string bytes_of(const char* json) {
  Message message;
  (void)parse_message(json, message);
  return message.SerializeAsString();
}

template <typename Message>
bool add_forms(const std::string& name, const std::vector<const char*>& texts) {
  const auto feed = [](std::string_view bytes) {
    Message message;
    const Status parsed = parse_message(bytes, message);
    if (!parsed) return refused(parsed.error().message);
    // What was taken can be said again in either form and means the same.
    Message again;
    if (!parse_message(to_json(message), again) || again.SerializeAsString() != message.SerializeAsString()) {
      Message from_bytes;
      if (!from_bytes.ParseFromString(message.SerializeAsString())) return refused("");
    }
    return accepted();
  };
  std::vector<std::string> json, bytes;
  for (const char* text : texts) {
    json.emplace_back(text);
    bytes.push_back(bytes_of<Message>(text));
  }
  registered().push_back({"form.json." + name, Kind::json, [=] { return std::make_unique<Function>(json, feed); }});
  // Nearly all that parses as fields is some message.
  registered().push_back(
      {"form.protobuf." + name, Kind::protobuf, [=] { return std::make_unique<Function>(bytes, feed); }, 0.05});
  return true;
}

const char* const asset =
    R"({"id":"tello1/odom","topic":"/tello1/odom","msgType":"nav_msgs/msg/Odometry","msgData":"AAEAAA=="})";
const char* const control =
    R"({"drone":"tello1","owner":{"mspId":"Org1MSP","subject":"CN=host"},"holder":{"mspId":"Org2MSP","subject":"CN=pilot"},"epoch":"7","priority":3,"formerOwners":[{"mspId":"Org1MSP","subject":"CN=old"}],"stoppers":[{"drone":"tello1","stopper":{"mspId":"Org1MSP","subject":"CN=x"},"cut":true}]})";

const char* const stops_text =
    R"({"stops":[{"drone":"tello1","stopper":{"mspId":"Org1MSP","subject":"CN=x"},"cut":true},{"drone":"tello2","stopper":{"mspId":"Org1MSP","subject":"CN=x"},"cleared":true}]})";

const std::string asset_list = std::string(R"({"assets":[)") + asset + "," + asset + "]";
const std::string assets_text = asset_list + R"(,"bookmark":"a/b"})", set_text = asset_list + R"(,"stream":true})";
const std::string stored_text = asset_list + R"(,"signer":{"mspId":"Org1MSP","subject":"CN=a"},"deleted":true})";
const std::string controls_text =
    std::string(R"({"controls":[)") + control + R"(],"identity":{"mspId":"a","subject":"b"},"role":"OPERATOR"})";
const std::string versions_text =
    std::string(
        R"({"versions":[{"txId":"ab","timestampNs":"17","signer":{"mspId":"a","subject":"b"},"deleted":true,"asset":)") +
    asset + R"(}],"bookmark":"3:ab/0:"})";

const bool forms =
    add_forms<Asset>("Asset", {asset}) && add_forms<SetCall>("SetCall", {set_text.c_str()}) &&
    add_forms<Assets>("Assets", {assets_text.c_str()}) && add_forms<Stored>("Stored", {stored_text.c_str()}) &&
    add_forms<Control>("Control", {control}) && add_forms<Stops>("Stops", {stops_text}) &&
    add_forms<Controls>("Controls", {controls_text.c_str()}) &&
    add_forms<Versions>("Versions", {versions_text.c_str()}) &&
    add_forms<EnrollCall>(
        "EnrollCall",
        {R"({"identity":{"mspId":"Org1MSP","subject":"CN=a"},"drones":["tello1"],"role":"SUPERVISOR"})"}) &&
    add_forms<RevokeCall>("RevokeCall", {R"({"identity":{"mspId":"Org1MSP","subject":"CN=a"}})"}) &&
    add_forms<GrantCall>(
        "GrantCall",
        {R"({"drones":["tello1"],"grant":{"to":{"mspId":"Org2MSP","subject":"CN=a"},"fly":true,"maxPriority":5,"stop":true,"cut":true}})"}) &&
    add_forms<LeaseCall>("LeaseCall", {R"({"drones":["tello1","tello2"],"priority":5})"}) &&
    add_forms<AnswerCall>("AnswerCall", {R"({"drones":["tello1"],"to":{"mspId":"Org2MSP","subject":"CN=a"}})"}) &&
    add_forms<AnchorCall>("AnchorCall", {R"({"digest":"qqqq","what":"flight 7"})"}) &&
    add_forms<DronesCall>("DronesCall", {R"({"drones":["tello1"],"cut":true})"}) &&
    add_forms<DeleteCall>("DeleteCall", {R"({"id":"tello1/odom"})"}) &&
    add_forms<QueryCall>("QueryCall", {R"({"id":"tello1/*","bookmark":"tello1/odom"})"}) &&
    add_forms<CommandCall>(
        "CommandCall",
        {R"({"plans":[{"drone":"tello1","action":"FLY","bootId":"9","stateStampNs":"55","sequence":"3","epoch":"1","setpoints":[{"atNs":"60","vx":0.5,"vy":-0.25,"vz":0.125,"yawRate":1},{"atNs":"70","vx":1e-3}]},{"drone":"tello2","action":"LAND"}]})"});

}  // namespace
}  // namespace ledgerline::fuzz::msg_part
