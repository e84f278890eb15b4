#include "ground/service/core/board.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground::service {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;

FlightConfig manual_config(int drones) {
  FlightConfig config = config_for(drones);
  config.manual = true;
  return config;
}

/// What a client was sent, in words.
std::vector<std::string> words(const std::vector<Event>& events) {
  std::vector<std::string> texts;
  for (const Event& event : events) texts.push_back(event.drone + ": " + event.text);
  return texts;
}

TEST(Board, TellsOfEachDroneWhatItsStateAndItsLeaseSay) {
  FlightWorld world(manual_config(2));
  world.run(1);
  const json drones = json::parse(Board::drones(world.now_ns, world.core));
  ASSERT_EQ(drones.size(), 2U);
  const json& second = drones[1];
  EXPECT_EQ(second["name"], "tello2");
  EXPECT_EQ(second["phase"], "waiting");
  EXPECT_EQ(second["link_phase"], "on_ground");
  EXPECT_EQ(second["lease"]["ours"], true);
  EXPECT_NEAR(second["position"][0].get<double>(), 3, 0.01);
  EXPECT_LT(second["state_age_ms"].get<double>(), 100);
  EXPECT_TRUE(second["command_age_ms"].is_null());
  EXPECT_EQ(second["stopped_by"], json::array());
}

TEST(Board, TellsWhoCommandsForTheHolder) {
  FlightWorld world(manual_config(1));
  Board board;
  (void)board.update(world.now_ns, world.core, {});
  ASSERT_TRUE(world.core.set_control(delegated_record("tello1", "CN=pilot", 2).SerializeAsString()));
  const json lease = json::parse(Board::drones(world.now_ns, world.core))[0]["lease"];
  EXPECT_EQ(lease["holder"], "Org2MSP CN=pilot");
  EXPECT_EQ(lease["commander"], "Org2MSP CN=User1@org2");
  EXPECT_EQ(lease["ours"], true);
  EXPECT_THAT(words(board.update(world.now_ns, world.core, {})),
              Contains("tello1: its lease is held by Org2MSP CN=pilot, who lets Org2MSP CN=User1@org2 command it"));
}

TEST(Board, WarnsOfADroneThatRefusesToTakeOff) {
  FlightWorld world(manual_config(1));
  world.run(1);
  Board board;
  (void)board.update(world.now_ns, world.core, {});
  world.drones[0].cause = FailsafeCause::takeoff_refused_by_drone;
  world.run(1);
  EXPECT_THAT(words(board.update(world.now_ns, world.core, {})),
              Contains(HasSubstr("tello1: the drone itself refuses to take off")));
}

TEST(Board, OfADroneThatWasNeverHeardItSaysNoNumbers) {
  const FlightWorld world(manual_config(1));
  const json drone = json::parse(Board::drones(world.now_ns, world.core))[0];
  for (const char* key :
       {"position", "velocity", "yaw", "battery_percent", "height_m", "state_age_ms", "command_age_ms"})
    EXPECT_TRUE(drone[key].is_null()) << key;
}

TEST(Board, OfAFlightAlongAPathItSaysThePathAndWhereTheDroneWillBe) {
  FlightWorld world(config_for(1));
  world.run(12);
  const json drone = json::parse(Board::drones(world.now_ns, world.core))[0];
  ASSERT_EQ(drone["phase"], "path");
  Board board;
  const auto paths = board.changed_paths(world.core);
  ASSERT_TRUE(paths);
  EXPECT_EQ(json::parse(*paths)["tello1"].size(), 5U) << "four corners, and the first again";
  EXPECT_FALSE(board.changed_paths(world.core)) << "sent once";
  ASSERT_FALSE(drone["predicted"].is_null());
  const double ahead = std::hypot(drone["predicted"][0].get<double>() - drone["position"][0].get<double>(),
                                  drone["predicted"][1].get<double>() - drone["position"][1].get<double>());
  EXPECT_GT(ahead, 0.001);
  EXPECT_LT(ahead, 1);
  const json& committed = drone["committed"];
  ASSERT_GE(committed["points"].size(), 2U);
  EXPECT_LE(committed["points"].size(), CommittedPath::max_points);
  for (const json& point : committed["points"]) EXPECT_EQ(point.size(), 3U);
  EXPECT_EQ(committed["step_ms"], 50);
  EXPECT_GT(committed["until_ms"].get<double>(), 500);
  EXPECT_LT(committed.dump().size(), 24 * 30 + 100U) << "to whole millimetres";
}

TEST(Board, OfAFlightByHandItSaysWhereWhatIsSentTakesTheDrone) {
  FlightWorld world(manual_config(2));
  const auto drone = [&](std::size_t i) { return json::parse(Board::drones(world.now_ns, world.core))[i]; };
  world.run(1);
  EXPECT_TRUE(drone(0)["committed"].is_null()) << "on the ground";
  EXPECT_TRUE(drone(0)["predicted"].is_null());
  world.say({.drone = 0, .takeoff = true});
  world.run(5);
  for (int i = 0; i < 10; ++i) {
    world.say({.drone = 0, .velocity = Twist{{0.5, 0, 0}, {}}});
    world.run(0.1);
  }
  const json flown = drone(0);
  ASSERT_EQ(flown["phase"], "manual");
  const json& points = flown["committed"]["points"];
  EXPECT_GT(points.back()[0].get<double>(), points.front()[0].get<double>() + 0.05);
  EXPECT_GT(flown["predicted"][0].get<double>(), flown["position"][0].get<double>());
  EXPECT_TRUE(drone(1)["committed"].is_null());
}

TEST(Board, WithoutPredictionItSaysNoPlaceAhead) {
  FlightConfig config = config_for(1);
  config.controller.predict = false;
  FlightWorld world(config);
  world.run(12);
  const json drone = json::parse(Board::drones(world.now_ns, world.core))[0];
  ASSERT_EQ(drone["phase"], "path");
  EXPECT_TRUE(drone["committed"].is_null());
  EXPECT_TRUE(drone["predicted"].is_null());
}

TEST(Board, OfADroneWithoutAPoseItSaysNoPlace) {
  FlightWorld world(manual_config(1));
  world.drones[0].has_pose = false;
  world.run(1);
  const json drone = json::parse(Board::drones(world.now_ns, world.core))[0];
  for (const char* key : {"position", "origin", "sigma_m"}) EXPECT_TRUE(drone[key].is_null()) << key;
}

TEST(Board, TheLimitIsNeverAboveTheSpeedThatWasSet) {
  FlightConfig config = config_for(1);
  config.controller.speed_mps = 0.3;
  FlightWorld world(config);
  world.run(12);
  ASSERT_GT(world.core.status(0).limit_mps, 0.3);
  EXPECT_EQ(json::parse(Board::drones(world.now_ns, world.core))[0]["limit_mps"], 0.3);
}

TEST(Board, AStopThatIsClearedIsNoReasonAnyMore) {
  FlightWorld world(manual_config(1));
  const auto why = [&] { return json::parse(Board::drones(world.now_ns, world.core))[0]["why"].get<std::string>(); };
  world.run(1);
  world.say({.drone = 0, .takeoff = true});
  world.run(5);
  world.say({.drone = 0, .stop = true});
  world.run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_THAT(why(), HasSubstr("stopped by"));
  Control cleared = *world.core.lease(0).record;
  cleared.clear_stoppers();
  ASSERT_TRUE(world.core.set_control(cleared.SerializeAsString()));
  EXPECT_EQ(why(), "");
  EXPECT_THAT(world.core.why(), HasSubstr("stopped by")) << "the flight's summary has it";
}

TEST(Board, WhatTheLedgerMakesADroneDoIsAnAlarm) {
  FlightWorld world(manual_config(1));
  world.run(1);
  world.say({.drone = 0, .takeoff = true});
  world.run(5);
  Board board;
  const auto level_of = [&](const std::string& text) {
    for (const Event& event : board.update(world.now_ns, world.core, {})) {
      if (event.text.starts_with(text)) return std::optional(event.level);
    }
    return std::optional<Level>();
  };
  (void)level_of("");
  const auto hold = [&](FailsafeCause cause) {
    world.drones[0].mode = FailsafeMode::hold;
    world.drones[0].cause = cause;
    world.run(0.2);
    return level_of("failsafe: hold");
  };
  EXPECT_EQ(hold(FailsafeCause::plan_ran_out), Level::warning);
  EXPECT_EQ(hold(FailsafeCause::ledger_silent), Level::alarm);
  world.drones[0].silent = true;
  world.run(2.5);
  EXPECT_EQ(level_of("no state comes through the ledger"), Level::alarm);
  world.run(3);
  EXPECT_EQ(level_of("landing: no state came"), Level::alarm);
}

TEST(Board, WarnsOfADroneAtItsFence) {
  FlightWorld world(manual_config(1));
  world.run(1);
  world.say({.drone = 0, .takeoff = true});
  world.run(5);
  Board board;
  (void)board.update(world.now_ns, world.core, {});
  world.drones[0].cause = FailsafeCause::fence;
  world.run(0.2);
  const auto events = board.update(world.now_ns, world.core, {});
  ASSERT_THAT(words(events), Contains("tello1: it is at the fence"));
  EXPECT_EQ(events.front().level, Level::warning);
  world.run(0.2);
  EXPECT_TRUE(board.update(world.now_ns, world.core, {}).empty()) << "said once";
}

TEST(Board, WarnsOfAPositionThatBecomesUncertainAndAtEachDoubling) {
  FlightWorld world(manual_config(1));
  Board board;
  const auto warnings = [&](float sigma_m) {
    world.drones[0].sigma_m = sigma_m;
    world.run(0.2);
    const auto texts = words(board.update(world.now_ns, world.core, {}));
    return std::ranges::count_if(
        texts, [](const std::string& text) { return text.find("uncertain by") != std::string::npos; });
  };
  EXPECT_EQ(warnings(0.1F), 0);
  EXPECT_EQ(warnings(0.2F), 1) << "three sigma above 0.5 m";
  EXPECT_EQ(warnings(0.3F), 0);
  EXPECT_EQ(warnings(0.4F), 1) << "above 1 m";
  EXPECT_EQ(warnings(0.2F), 0) << "half a metre and more: not low enough to warn again";
  EXPECT_EQ(warnings(0.4F), 0);
  EXPECT_EQ(warnings(0.05F), 0);
  EXPECT_EQ(warnings(0.8F), 1) << "once, however far it jumps";
}

TEST(Board, AnEventSaysWhatChangedAndIsSentOnce) {
  FlightWorld world(manual_config(1));
  Board board;
  world.run(1);
  const auto first = board.update(world.now_ns, world.core, {});
  EXPECT_THAT(words(first), Contains("tello1: link reaches it"));
  EXPECT_EQ(first.front().number, 1U);
  EXPECT_TRUE(board.update(world.now_ns, world.core, {}).empty());
  world.drones[0].phase = LinkPhase::disconnected;
  world.run(0.5);
  const auto lost = board.update(world.now_ns, world.core, {"tello1: no take-off: link does not reach it"});
  EXPECT_THAT(words(lost), Contains("tello1: link does not reach it"));
  EXPECT_THAT(words(lost), Contains("tello1: no take-off: link does not reach it")) << "an event of the drone";
  EXPECT_EQ(lost.front().level, Level::alarm);
  EXPECT_EQ(lost.front().number, first.back().number + 1) << "numbers have no gaps";
}

TEST(Board, ARefusedCallIsAWarningInTurnWithTheOtherEvents) {
  FlightWorld world(manual_config(1));
  Board board;
  world.run(1);
  const auto before = board.update(world.now_ns, world.core, {});
  Refusals refusals({"tello1"});
  refusals.add("command", fabric::Outcome::failed(fabric::Outcome::Kind::refused,
                                                  "chaincode response 500, tello1: held by somebody else"));
  const auto events = board.refusals(world.now_ns, refusals);
  ASSERT_EQ(words(events), std::vector<std::string>{"tello1: command refused: tello1: held by somebody else"});
  EXPECT_EQ(events.front().level, Level::warning);
  EXPECT_EQ(events.front().number, before.back().number + 1);
}

}  // namespace
}  // namespace ledgerline::ground::service
