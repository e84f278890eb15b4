#include "tools/launcher/fault_switches.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "hil/proxy/switches.hpp"

namespace ledgerline::launcher {
namespace {

using nlohmann::json;
using testing::HasSubstr;

FaultSwitches two_drones() { return FaultSwitches({"tello1", "tello2"}); }

/// The proxy's, as a flight of two drones on Fabric has it.
hil::proxy::Switches proxy() {
  using Kind = hil::proxy::Target::Kind;
  return hil::proxy::Switches({{Kind::drone, "tello1"},
                               {Kind::drone, "tello2"},
                               {Kind::server, "agent"},
                               {Kind::server, "agent-orderer1"},
                               {Kind::server, "ground"}});
}

std::vector<std::string> names_on(const FaultSwitches& switches) {
  std::vector<std::string> names;
  const json list = json::parse(switches.list()).at("faults");
  for (const json& one : list) {
    if (one.at("on") == true) names.push_back(one.at("name"));
  }
  return names;
}

TEST(FaultSwitches, AreTwoOfTheLedgerAndTwoOfEachDroneInWords) {
  const json list = json::parse(two_drones().list()).at("faults");
  ASSERT_EQ(list.size(), 6u);
  for (const json& one : list) {
    EXPECT_FALSE(one.at("label").get<std::string>().empty());
    EXPECT_FALSE(one.at("words").get<std::string>().empty());
    EXPECT_EQ(one.at("on"), false);
  }
  EXPECT_EQ(list[0].at("name"), "ledger-delayed");
  EXPECT_EQ(list[0].at("drone"), "");
  EXPECT_EQ(list[4].at("name"), "silent-tello2");
  EXPECT_EQ(list[4].at("drone"), "tello2");
}

TEST(FaultSwitches, EachIsACommandThatTheProxyTakesAndItsEndLeavesNothing) {
  FaultSwitches switches = two_drones();
  hil::proxy::Switches proxied = proxy();
  const json list = json::parse(switches.list()).at("faults");
  for (const json& one : list) {
    const std::string name = one.at("name");
    const auto on = switches.step_of("on " + name);
    ASSERT_TRUE(on && *on) << name;
    const auto applied = proxied.apply((*on)->line);
    ASSERT_TRUE(applied) << applied.error().message;
    EXPECT_NE(proxied.list(), "") << name;
    const auto off = switches.step_of("off " + name);
    ASSERT_TRUE(off && *off) << name;
    ASSERT_TRUE(proxied.apply((*off)->line)) << (*off)->line;
    EXPECT_EQ(proxied.list(), "") << name;
  }
}

TEST(FaultSwitches, OneThatEndsTakesNoOtherAlong) {
  FaultSwitches switches = two_drones();
  hil::proxy::Switches proxied = proxy();
  for (const char* name : {"ledger-delayed", "ledger-stalled", "silent-tello1", "commands-lost-tello1"}) {
    ASSERT_TRUE(proxied.apply((*switches.step_of(std::string("on ") + name))->line));
  }
  ASSERT_TRUE(proxied.apply((*switches.step_of("off ledger-stalled"))->line));
  ASSERT_TRUE(proxied.apply((*switches.step_of("off silent-tello1"))->line));
  EXPECT_EQ(proxied.list(),
            "drone tello1 to partition\nserver agent to delay 100ms\nserver agent from delay 100ms\n"
            "server agent-orderer1 to delay 100ms\nserver agent-orderer1 from delay 100ms\n");
}

TEST(FaultSwitches, AreOnOnceTheProxyHasDoneIt) {
  FaultSwitches switches = two_drones();
  const auto step = switches.step_of("on silent-tello1");
  ASSERT_TRUE(step && *step);
  EXPECT_THAT(names_on(switches), testing::ElementsAre());
  switches.on_done(**step);
  EXPECT_THAT(names_on(switches), testing::ElementsAre("silent-tello1"));
  EXPECT_TRUE(*switches.step_of("on silent-tello1")) << "it is sent again";
  const auto off = switches.steps_off();
  ASSERT_EQ(off.size(), 1u);
  EXPECT_EQ(off[0].line, "drone tello1 from partition off");
  switches.on_done(off[0]);
  EXPECT_THAT(names_on(switches), testing::ElementsAre());
}

TEST(FaultSwitches, WhatTheProxyDidNotAnswerMayBeOnAndIsSwitchedOffAtTheEnd) {
  FaultSwitches switches = two_drones();
  switches.on_sent(**switches.step_of("on silent-tello1"));
  EXPECT_THAT(names_on(switches), testing::ElementsAre());
  const auto off = switches.steps_off();
  ASSERT_EQ(off.size(), 1u);
  EXPECT_EQ(off[0].line, "drone tello1 from partition off");
  switches.on_sent(off[0]);
  EXPECT_EQ(switches.steps_off().size(), 1u) << "until the proxy has said so";
  switches.on_done(off[0]);
  EXPECT_TRUE(switches.steps_off().empty());
}

TEST(FaultSwitches, BehindTheEndAreSwitchedOffAlone) {
  FaultSwitches switches = two_drones();
  switches.on_done(**switches.step_of("on silent-tello1"));
  switches.end();
  EXPECT_THAT(switches.step_of("on silent-tello2").error().message, HasSubstr("the flight ends"));
  EXPECT_TRUE(switches.step_of("off silent-tello1"));
  EXPECT_TRUE(switches.step_of("list"));
}

TEST(FaultSwitches, TakeNothingElse) {
  const FaultSwitches switches = two_drones();
  for (const char* wrong : {"", "on", "off", "on ", "clear", "list all", "switch silent-tello1", "On silent-tello1"})
    EXPECT_FALSE(switches.step_of(wrong)) << wrong;
  EXPECT_THAT(switches.step_of("on silent-tello9").error().message, HasSubstr("no switch \"silent-tello9\""));
  EXPECT_THAT(switches.step_of("on drone * both stall").error().message, HasSubstr("no switch"));
}

}  // namespace
}  // namespace ledgerline::launcher
