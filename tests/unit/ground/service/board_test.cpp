#include "ground/service/core/board.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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
}

TEST(Board, AnEventSaysWhatChangedAndIsSentOnce) {
  FlightWorld world(manual_config(1));
  Board board;
  world.run(1);
  const auto first = board.update(world.now_ns, world.core, {});
  EXPECT_THAT(words(first), Contains("tello1: link reaches it"));
  EXPECT_EQ(first.front().number, 1U);
  EXPECT_TRUE(board.update(world.now_ns, world.core, {}).empty());
  world.drones[0].phase = FlightPhase::disconnected;
  world.run(0.5);
  const auto lost = board.update(world.now_ns, world.core, {"tello1: no take-off: link does not reach it"});
  EXPECT_THAT(words(lost), Contains("tello1: link does not reach it"));
  EXPECT_THAT(words(lost), Contains(": tello1: no take-off: link does not reach it"));
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
