#include "common/bridge/core/rules.hpp"

#include <gmock/gmock.h>

namespace ledgerline::bridge {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string problem_of(const std::string& toml, const Host* host = nullptr) {
  auto config = Config::parse(toml, "bridge.toml");
  EXPECT_TRUE(config.ok());
  (void)read_bridge(*config, host);
  const Status status = config->finish();
  return status ? "" : status.error().message;
}

TEST(BridgeRules, AStarStandsForAnyCharacters) {
  EXPECT_TRUE(matches("/a/b", "/a/b"));
  EXPECT_TRUE(matches("/*", "/a/b"));
  EXPECT_TRUE(matches("/camera/*/image", "/camera/left/rect/image"));
  EXPECT_TRUE(matches("*", ""));
  EXPECT_FALSE(matches("/a/b", "/a/bc"));
  EXPECT_FALSE(matches("/a/b", "/a"));
  EXPECT_FALSE(matches("/camera/*/image", "/camera/image"));
}

TEST(BridgeRules, ATopicsIdIsBelowTheEnrolledNameOrTheOrganisation) {
  EXPECT_EQ(ledger_id("/tello1/odom", "Org1MSP", {"tello1"}), "tello1/odom");
  EXPECT_EQ(ledger_id("/tello1/odom", "Org2MSP", {}), "Org2MSP/tello1/odom");
  EXPECT_EQ(ledger_id("/tello1", "Org1MSP", {"tello1"}), "Org1MSP/tello1") << "a name alone is no id below it";
  std::string buffer;
  EXPECT_EQ(ros_topic_of("tello1/odom", buffer), "/tello1/odom");
  EXPECT_EQ(ros_topic_of("Org2MSP/tello1/odom", buffer), "/tello1/odom");
  EXPECT_EQ(ros_topic_of("Org2MSP", buffer), "");
}

TEST(BridgeRules, TypesAreROS2s) {
  EXPECT_TRUE(is_ros_type("std_msgs/msg/String"));
  for (const char* wrong :
       {"", "String", "std_msgs/String", "std_msgs/srv/String", "/msg/A", "a/msg/", "a/msg/b/c", "a/msg/\n"})
    EXPECT_FALSE(is_ros_type(wrong)) << wrong;
}

TEST(BridgeRules, WhatTheConfigSaysComesOut) {
  auto config = Config::parse(
      "[bridge]\nname = \"arm\"\nmin_gap_ms = 5\n[[enrolled]]\nname = \"robot7\"\n"
      "[[topic]]\nname = \"/robot7/*\"\nfrom = \"robot7\"\nstream = true\nkeep = \"latest\"\npriority = 9\nrate_hz = "
      "20\n"
      "[[topic]]\nname = \"/map\"\ntype = \"nav_msgs/msg/OccupancyGrid\"\ndirection = \"from_ledger\"\nlatched = true\n"
      "from = \"Org2MSP\"\n",
      "bridge.toml");
  const BridgeConfig bridge = read_bridge(*config);
  ASSERT_TRUE(config->finish().ok()) << config->finish().error().message;
  EXPECT_EQ(bridge.min_gap_ns, 5 * ns_per_ms);
  ASSERT_EQ(bridge.rules.size(), 2U);
  EXPECT_TRUE(bridge.rules[0].to_ledger && bridge.rules[0].from_ledger && bridge.rules[0].stream);
  EXPECT_EQ(bridge.rules[0].queue, 1U) << "only the newest waits";
  EXPECT_FALSE(bridge.rules[1].to_ledger);
  EXPECT_EQ(bridge.rules[1].depth, 1) << "of a latched topic";
}

TEST(BridgeRules, AWrongValueIsNamedWithFileLineKeyAndWhatIsAllowed) {
  EXPECT_THAT(problem_of("[[topic]]\nname = \"chatter\"\n"),
              HasSubstr("bridge.toml:2: topic.0.name: is \"chatter\", must be a ROS 2 topic as in /a/b"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\ntype = \"String\"\n"), HasSubstr("bridge.toml:3: topic.0.type: "));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\ndirection = \"up\"\n"),
              HasSubstr("bridge.toml:3: topic.0.direction: is \"up\", must be one of to_ledger, from_ledger, both"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\npriority = 10\n"), HasSubstr("a whole number from 0 to 9"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\nlatchd = true\n"),
              HasSubstr("bridge.toml:3: topic.0.latchd: unknown"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\nlatched = true\n"), HasSubstr("topic.0.latched: needs from"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a/b\"\nstream = true\n"),
              HasSubstr("topic.0.stream: needs a topic below"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\nfrom = \"a/b\"\n"), HasSubstr("topic.0.from: is \"a/b\""));
  EXPECT_THAT(problem_of("[[topic]]\ntype = \"a/msg/B\"\n"), HasSubstr("topic.0.name: is missing"));
}

TEST(BridgeRules, WhatComesFromTheLedgerSaysFromWhom) {
  for (const char* direction : {"", "direction = \"both\"\n", "direction = \"from_ledger\"\n"}) {
    EXPECT_THAT(
        problem_of("[[topic]]\nname = \"/a\"\n" + std::string(direction)),
        AllOf(HasSubstr("bridge.toml"), HasSubstr("topic.0.from: is missing"), HasSubstr("\"*\" for anybody's")));
  }
  EXPECT_EQ(problem_of("[[topic]]\nname = \"/a\"\ndirection = \"to_ledger\"\n"), "");
  EXPECT_EQ(problem_of("[[topic]]\nname = \"/a\"\nfrom = \"*\"\n"), "") << "anybody's, said aloud";
  EXPECT_EQ(problem_of("[[topic]]\nname = \"/a\"\nfrom = \"tello1\"\n"), "");
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\nfrom = \"Org*\"\n"), HasSubstr("topic.0.from: is \"Org*\""));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/a\"\nfrom = \"*\"\nlatched = true\n"),
              HasSubstr("topic.0.latched: needs from"));

  Rule nobodys;
  nobodys.name = "/a";
  nobodys.from_ledger = true;
  EXPECT_EQ(rule_down({nobodys}, "/a", "Org2MSP/a"), nullptr) << "a rule that names nobody takes from nobody";
}

TEST(BridgeRules, TheFirstOneThatMatchesDecidesAndMayLeaveATopicOut) {
  auto config = Config::parse(
      "[[topic]]\nname = \"/a\"\ndirection = \"to_ledger\"\n[[topic]]\nname = \"/*\"\nfrom = \"Org2MSP\"\n",
      "bridge.toml");
  BridgeConfig bridge = read_bridge(*config);
  ASSERT_TRUE(config->finish().ok());
  EXPECT_EQ(rule_up(bridge.rules, "/a"), &bridge.rules[0]);
  EXPECT_EQ(rule_up(bridge.rules, "/b"), &bridge.rules[1]);
  EXPECT_EQ(rule_down(bridge.rules, "/a", "Org2MSP/a"), &bridge.rules[1]);
  EXPECT_EQ(rule_down(bridge.rules, "/a", "Org1MSP/a"), nullptr);
  bridge.rules[0].left_out = true;
  EXPECT_EQ(rule_up(bridge.rules, "/a"), nullptr) << "though a later one matches, too";
  EXPECT_TRUE(bridge.carries_something());
  bridge.rules[1].left_out = true;
  EXPECT_FALSE(bridge.carries_something());
}

TEST(BridgeRules, WhatAProgramCarriesItselfIsNotBridgedBesideIt) {
  const Host agent{.topics = {"/tello1/odom"}, .enrolled = {"tello1"}, .sends_states = true};
  auto config = Config::parse("[[topic]]\nname = \"/tello1/*\"\nfrom = \"tello1\"\n", "agent.toml");
  const BridgeConfig bridge = read_bridge(*config, &agent);
  ASSERT_TRUE(config->finish().ok());
  EXPECT_TRUE(bridge.beside);
  EXPECT_EQ(bridge.enrolled, std::vector<std::string>{"tello1"});
  EXPECT_EQ(rule_up(bridge.rules, "/tello1/odom"), nullptr);
  EXPECT_EQ(rule_down(bridge.rules, "/tello1/odom", "tello1/odom"), nullptr);
  EXPECT_NE(rule_up(bridge.rules, "/tello1/note"), nullptr);

  EXPECT_THAT(problem_of("[[topic]]\nname = \"/tello1/odom\"\n", &agent),
              HasSubstr("bridge.toml:2: topic.0.name: is \"/tello1/odom\", which this program brings"));
  EXPECT_THAT(problem_of("[[topic]]\nname = \"/tello1/note\"\nstream = true\n", &agent),
              HasSubstr("bridge.toml:3: topic.0.stream: must not be true here"));
  const Host ground{.topics = {}, .enrolled = {"rover"}, .sends_states = false};
  EXPECT_EQ(problem_of("[[topic]]\nname = \"/rover/note\"\nfrom = \"rover\"\nstream = true\n", &ground), "");
  EXPECT_EQ(problem_of("", &agent), "") << "no topics: no bridge";
}

TEST(BridgeRules, EachBlockStreamHasACheckpointOfItsOwn) {
  const std::string toml = "[output]\ncheckpoint = \"/var/a\"\n";
  auto config = Config::parse(toml, "bridge.toml");
  const BridgeConfig bridge = read_bridge(*config);
  ASSERT_TRUE(config->finish().ok());
  EXPECT_EQ(checkpoint_of(bridge, "teleop", "teleop"), "/var/a");
  EXPECT_EQ(checkpoint_of(bridge, "yard", "teleop"), "/var/a.yard");

  BridgeConfig beside;
  EXPECT_EQ(checkpoint_of(beside, "yard", "teleop"), "") << "none is kept";
  EXPECT_EQ(checkpoint_beside(""), "");
  beside.checkpoint = checkpoint_beside("/var/agent");
  EXPECT_EQ(checkpoint_of(beside, "teleop", "teleop"), "/var/agent.bridge") << "the program's is its own";
  EXPECT_EQ(checkpoint_of(beside, "yard", "teleop"), "/var/agent.bridge.yard");
  const Host agent;
  auto others = Config::parse(toml, "agent.toml");
  EXPECT_EQ(read_bridge(*others, &agent).checkpoint, "") << "it is the program's";
}

}  // namespace
}  // namespace ledgerline::bridge
