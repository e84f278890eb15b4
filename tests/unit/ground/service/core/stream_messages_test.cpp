#include "ground/service/core/stream_messages.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::ground::service {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

TEST(StreamMessages, AVelocityOfTheStreamIsACommandWithItsTime) {
  const std::vector<std::string> names{"tello1", "tello2"};
  const TimeNs now = 2 * ns_per_s;
  const auto said = [&](const std::string& t_ms) {
    return command_from(R"({"op":"velocity","drone":"tello2","linear":[0.5,0,-0.1],"yaw_rate":0.3)" + t_ms + "}", names,
                        now);
  };
  const auto command = said(R"(,"t_ms":1600)");
  ASSERT_TRUE(command) << command.error().message;
  EXPECT_EQ(command->drone, 1U);
  EXPECT_EQ(command->came_ns, now);
  ASSERT_TRUE(command->velocity);
  EXPECT_EQ(command->velocity->linear_mps[2], -0.1);
  EXPECT_EQ(command->velocity->angular_radps[2], 0.3);
  const auto held = said(R"(,"t_ms":1499)");
  ASSERT_TRUE(held);
  EXPECT_FALSE(held->velocity) << "a network held it back: nobody means it any more";
  EXPECT_EQ(held->late, 1U);
  for (const char* t_ms : {"", R"(,"t_ms":2100)", R"(,"t_ms":"1600")", R"(,"t_ms":-1e300)"})
    EXPECT_FALSE(said(t_ms)) << t_ms;
  for (const char* wrong : {"", "[]", R"({"op":"velocity"})", R"({"op":"stop","drone":"tello1"})",
                            R"({"op":"velocity","drone":"tello7","linear":[0,0,0],"yaw_rate":0,"t_ms":0})",
                            R"({"op":"velocity","drone":"tello1","linear":[0,0],"yaw_rate":0,"t_ms":0})",
                            R"({"op":"velocity","drone":"tello1","linear":[0,0,"1"],"yaw_rate":0,"t_ms":0})",
                            R"({"op":"velocity","drone":"tello1","linear":[0,0,0],"yaw_rate":null,"t_ms":0})"})
    EXPECT_FALSE(command_from(wrong, names, 0)) << wrong;
}

class StreamCommands : public testing::Test {
 protected:
  Result<StreamMessage> said(std::string_view message, const StreamClient& client = {}) {
    return read_stream_message(message, client, {names, "[]", "{}", events, operators, nullptr, aloft}, 0);
  }
  const std::vector<std::string> names{"tello1", "tello2"};
  const std::deque<Event> events{};
  std::vector<Operator> operators{{"alice", {"Org2MSP", "CN=alice"}}};
  std::vector<std::size_t> aloft;
};

TEST_F(StreamCommands, WhoLooksOnStopsAndLandsAndNothingElse) {
  const auto all = said(R"({"op":"stop","id":3})");
  ASSERT_TRUE(all && all->command);
  EXPECT_EQ(all->command->id, 3U);
  ASSERT_THAT(all->command->made.commands, SizeIs(2));
  EXPECT_TRUE(all->command->made.commands[1].stop && !all->command->made.commands[1].by);
  const auto one = said(R"({"op":"stop","drone":"tello2"})");
  ASSERT_TRUE(one && one->command);
  EXPECT_FALSE(one->command->id);
  ASSERT_THAT(one->command->made.commands, SizeIs(1));
  EXPECT_EQ(one->command->made.commands[0].drone, 1U);
  EXPECT_TRUE(said(R"({"op":"land","drone":"tello1"})")->command->made.commands.at(0).land);
  for (const char* cut : {R"({"op":"cut","confirmed":true})", R"({"op":"cut","drone":"tello1"})"})
    EXPECT_EQ(said(cut)->command->made.status, 403U) << cut;
}

TEST_F(StreamCommands, AnOperatorsStopIsHisOwnAndHisCutIsConfirmed) {
  aloft = {0};
  const StreamClient alice{.who = 0};
  EXPECT_EQ(said(R"({"op":"stop"})", alice)->command->made.commands.at(0).by, operators[0].identity);
  EXPECT_EQ(said(R"({"op":"cut","drone":"tello1"})", alice)->command->made.status, 409U);
  EXPECT_EQ(said(R"({"op":"cut"})", alice)->command->made.status, 409U);
  EXPECT_THAT(said(R"({"op":"cut","confirmed":true})", alice)->command->made.commands, SizeIs(2));
  const StreamClient over{.session_ended = true};
  EXPECT_EQ(said(R"({"op":"cut","confirmed":true})", over)->command->made.status, 401U);
  EXPECT_THAT(said(R"({"op":"stop"})", over)->command->made.commands, SizeIs(2));
}

TEST_F(StreamCommands, WhatIsNoneIsAnError) {
  for (const char* wrong :
       {R"({"op":"takeoff","drone":"tello1"})", R"({"op":"land"})", R"({"op":"stop","drone":"tello7"})",
        R"({"op":"stop","drone":1})", R"({"op":"stop","id":-1})", R"({"op":"stop","id":"1"})",
        R"({"op":"stop","cut":true})", R"({"op":"stop","drone":{"x":[]}})", R"({"op":1})"})
    EXPECT_FALSE(said(wrong)) << wrong;
  EXPECT_EQ(said(R"({"op":"stop","confirmed":1})")->command->made.status, 400U);
}

TEST(StreamAnswers, SayWhatCameOfIt) {
  EXPECT_EQ(answer_message(7, {202, R"({"accepted":true})"}), R"({"id":7,"op":"answer","status":202})");
  EXPECT_THAT(answer_message(8, refusal(403, "sign in first")), HasSubstr(R"("error":"sign in first")"));
}

}  // namespace
}  // namespace ledgerline::ground::service
