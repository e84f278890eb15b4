#include "common/verification/calls.hpp"

#include <gtest/gtest.h>

#include "common/msg/proto_json.hpp"
#include "common/verification/control_events.hpp"

namespace ledgerline::verification {
namespace {

using Args = std::vector<std::string>;

SetCall set_of(const std::string& id, const std::string& data, bool with_topic) {
  SetCall call;
  Asset& asset = *call.add_assets();
  asset.set_id(id);
  if (with_topic) asset.set_topic("/" + id);
  asset.set_msg_type("std_msgs/msg/String");
  asset.set_msg_data(data);
  return call;
}

TEST(CheckEvent, ACallWhoseEventIsTheCallIsSignedAndNoOther) {
  CommandCall command;
  command.add_plans()->set_drone("tello1");
  const Args asked{command.SerializeAsString()};
  EXPECT_TRUE(check_event({"command", asked}, "command", asked[0]));
  EXPECT_FALSE(check_event({"command", asked}, "set", asked[0]));
  EXPECT_FALSE(check_event({"command", asked}, "", ""));
  command.mutable_plans(0)->set_action(TAKEOFF);
  EXPECT_FALSE(check_event({"command", asked}, "command", command.SerializeAsString()));
}

TEST(CheckEvent, TheTopicThatTheContractWritesDownIsNoDifference) {
  const std::string full = set_of("tello1/note", "text", true).SerializeAsString();
  const Args bare{set_of("tello1/note", "text", false).SerializeAsString()};
  EXPECT_TRUE(check_event({"set", bare}, "set", full));
  EXPECT_FALSE(check_event({"set", bare}, "set", set_of("tello1/note", "another", true).SerializeAsString()));
  const Args single{to_json(set_of("tello1/note", "text", false).assets(0))};  // one asset stands for a call of one
  EXPECT_TRUE(check_event({"set", single}, "set", to_json(set_of("tello1/note", "text", true))));
  EXPECT_FALSE(check_event({"set", single}, "set", to_json(set_of("tello2/note", "text", true))));
}

TEST(TellsSet, EqualBytesAreTheCallWhateverTheyAre) {
  const Args asked{"no message at all"};
  EXPECT_TRUE(reports_set({"set", asked}, asked[0]));
  EXPECT_FALSE(reports_set({"set", asked}, "")) << "a stream's event alone has no payload";
  SetCall stream = set_of("tello1/odom", "text", true);
  stream.set_stream(true);
  EXPECT_TRUE(reports_set({"set", {stream.SerializeAsString()}}, ""));
  EXPECT_FALSE(reports_set({"command", asked}, ""));
  EXPECT_FALSE(reports_set({"set", asked}, "another"));
  EXPECT_FALSE(reports_set({"command", asked}, asked[0])) << "of another function";
  const Args two{asked[0], asked[0]};
  EXPECT_FALSE(reports_set({"set", two}, asked[0]));
}

TEST(CheckEvent, ADeletionNamesTheId) {
  DeleteCall call;
  call.set_id("tello1/note");
  for (const Args& asked : {Args{"tello1/note"}, Args{call.SerializeAsString()}, Args{to_json(call)}}) {
    EXPECT_TRUE(check_event({"delete", asked}, "delete", to_json(call)));
    DeleteCall other;
    other.set_id("tello1/odom");
    EXPECT_FALSE(check_event({"delete", asked}, "delete", to_json(other)));
    EXPECT_FALSE(check_event({"delete", asked}, "delete", other.SerializeAsString()));
  }
}

TEST(CheckEvent, AnAnchorsEventIsItsCall) {
  AnchorCall asked, other;
  asked.set_digest(std::string(32, 'a'));
  other.set_digest(std::string(32, 'b'));
  EXPECT_TRUE(check_event({"anchor", {asked.SerializeAsString()}}, "anchor", asked.SerializeAsString()));
  EXPECT_TRUE(check_event({"anchor", {to_json(asked)}}, "anchor", to_json(asked)));
  EXPECT_FALSE(check_event({"anchor", {asked.SerializeAsString()}}, "anchor", other.SerializeAsString()));
  EXPECT_FALSE(check_event({"anchor", {asked.SerializeAsString()}}, "set", asked.SerializeAsString()));
  EXPECT_FALSE(check_event({"verify", {asked.SerializeAsString()}}, "anchor", asked.SerializeAsString()));
}

TEST(CheckEvent, AControlEventIsOfItsFunctionAndTheDronesThatWereAskedFor) {
  Controls controls;
  for (const char* drone : {"tello1", "tello2"}) controls.add_controls()->set_drone(drone);
  LeaseCall lease;
  lease.add_drones("tello2");
  lease.add_drones("tello1");
  lease.add_drones("tello1");  // named twice
  for (const Args& asked :
       {Args{"tello2", "tello1", "priority=3"}, Args{lease.SerializeAsString()}, Args{to_json(lease)}}) {
    EXPECT_TRUE(check_event({"acquire", asked}, "acquire", controls.SerializeAsString()));
    EXPECT_FALSE(check_event({"acquire", asked}, "release", controls.SerializeAsString()));
    EXPECT_FALSE(check_event({"acquire", asked}, "", ""));
    Controls more = controls, less, twice = controls;
    more.add_controls()->set_drone("tello3");
    less.add_controls()->set_drone("tello1");
    twice.add_controls()->set_drone("tello1");
    for (const Controls& other : {more, less, twice})
      EXPECT_FALSE(check_event({"acquire", asked}, "acquire", other.SerializeAsString()));
  }
  EnrollCall role;
  role.set_role(OPERATOR);
  const Args asked{role.SerializeAsString()};
  EXPECT_FALSE(check_event({"enroll", asked}, "enroll", Controls().SerializeAsString())) << "of another role";
  Controls reported;
  reported.set_role(OPERATOR);
  EXPECT_TRUE(check_event({"enroll", asked}, "enroll", reported.SerializeAsString()));
  EXPECT_FALSE(check_event({"enroll", asked}, "enroll", controls.SerializeAsString()));
}

TEST(ReadControlEvent, JsonOfBlocksWrittenBeforeIsReadByTheOldNames) {
  const Args asked{R"({"drones":["tello1"],"resumes":[3]})"};
  const auto stop = read_control_event({"stop", asked}, "stop", R"({"stops":[{"drone":"tello1","resumes":"3"}]})");
  ASSERT_TRUE(stop);
  EXPECT_EQ(std::get<DronesCall>(stop->call.message).clears(0), 3U);
  EXPECT_EQ(stop->stops.stops(0).clears(), 3U);
  const auto clear = read_control_event({"resume", {"tello1"}}, "resume",
                                        R"({"controls":[{"drone":"tello1","resumed":[{"resumes" : "4"}]}]})");
  ASSERT_TRUE(clear);
  EXPECT_EQ(clear->call.function, "clear_stop");
  EXPECT_EQ(clear->controls.controls(0).cleared(0).clears(), 4U);
  Stop lifted;
  EXPECT_TRUE(parse_message(R"({"lifted":true,"drone":"resumes"})", lifted));
  EXPECT_TRUE(lifted.cleared());
  EXPECT_EQ(lifted.drone(), "resumes") << "a value is no name";
}

TEST(CheckEvent, AQuestionHasNoEventAndAForeignFunctionIsNotChecked) {
  EXPECT_TRUE(check_event({"get", {}}, "", ""));
  EXPECT_FALSE(check_event({"get", {}}, "clear_stop", "tello1"));
  EXPECT_FALSE(check_event({"history", {}}, "set", ""));
  EXPECT_TRUE(check_event({"transfer", {}}, "anything", "at all"));
}

TEST(LikelyPolicy, IsThatOfTheOrganisationWhichTheKeyNames) {
  EXPECT_TRUE(likely_policy("role/Org2MSP/7"));
  EXPECT_EQ(likely_policy("role/Org2MSP/7"), likely_policy("drones/Org2MSP"));
  EXPECT_NE(likely_policy("role/Org2MSP/7"), likely_policy("role/Org1MSP/7"));
  EXPECT_FALSE(likely_policy("role/0123456789abcdef")) << "of the version before: whose it is it does not say";
  EXPECT_FALSE(likely_policy("control/tello1"));
}

}  // namespace
}  // namespace ledgerline::verification
