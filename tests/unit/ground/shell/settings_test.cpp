#include "ground/shell/settings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::ground {
namespace {

TEST(GroundSettings, AWholeConfigIsReadAndDefaultsFillTheRest) {
  auto config = Config::parse(
      "[flight]\nshape = \"x\"\nspeed_mps = 0.8\nlaps = 2\n[output]\ntrace = \"t\"\n"
      "[[drone]]\nname = \"tello1\"\nnumber = 1\n[[drone]]\nname = \"tello5\"\nnumber = 5\n",
      "ground.toml");
  ASSERT_TRUE(config);
  const FlightConfig flight = flight_config(*config);
  const OutputSettings output = output_settings(*config);
  ASSERT_TRUE(config->finish()) << config->finish().error().message;
  EXPECT_EQ(flight.shape, Shape::x);
  EXPECT_EQ(flight.controller.speed_mps, 0.8);
  EXPECT_EQ(flight.laps, 2);
  EXPECT_EQ(flight.side_m, 1.5);
  ASSERT_EQ(flight.drones.size(), 2u);
  EXPECT_EQ(flight.drones[1].name, "tello5");
  EXPECT_EQ(flight.drones[1].number, 5);
  EXPECT_EQ(output.trace, "t");
  EXPECT_EQ(output.status_period_ns, 0);
}

TEST(GroundSettings, ADroneMayFlyACourseOfItsOwn) {
  auto config = Config::parse(
      "[flight]\nside_m = 2\nlaps = 2\n[[drone]]\nname = \"tello1\"\n[[drone]]\nname = \"tello2\"\nshape = "
      "\"triangle\"\n"
      "speed_mps = 0.3\n",
      "ground.toml");
  const FlightConfig flight = flight_config(*config);
  ASSERT_TRUE(config->finish()) << config->finish().error().message;
  EXPECT_FALSE(flight.drones[0].task);
  ASSERT_TRUE(flight.drones[1].task);
  EXPECT_EQ(flight.drones[1].task->shape, Shape::triangle);
  EXPECT_EQ(flight.drones[1].task->side_m, 2) << "the flight's";
  EXPECT_EQ(flight.drones[1].task->laps, 2);
  EXPECT_EQ(task_of(flight, 1).speed_mps, 0.3);
  EXPECT_EQ(task_of(flight, 0).speed_mps, 0.5);

  auto odd =
      Config::parse("[flight]\nshape = \"manual\"\n[[drone]]\nname = \"tello1\"\nshape = \"x\"\n", "ground.toml");
  (void)flight_config(*odd);
  EXPECT_THAT(odd->finish().error().message, testing::HasSubstr("ground.toml:5: drone.0.shape: must not be there"));
}

TEST(GroundSettings, AControllerThatIsNoneIsRefusedByFile) {
  auto config = Config::parse("[flight]\ncontroller = \"/nowhere/my.so\"\n", "ground.toml");
  (void)flight_config(*config);
  EXPECT_THAT(
      config->finish().error().message,
      testing::HasSubstr("ground.toml:2: flight.controller: must be a controller: there is no file /nowhere/my.so"));
}

TEST(GroundSettings, APilotFliesWhereTheShapeIsManual) {
  auto config = Config::parse("[flight]\nshape = \"manual\"\ncmd_timeout_ms = 200\n", "ground.toml");
  ASSERT_TRUE(config);
  const FlightConfig flight = flight_config(*config);
  ASSERT_TRUE(config->finish());
  EXPECT_TRUE(flight.manual);
  EXPECT_EQ(flight.cmd_timeout_ns, 200 * ns_per_ms);

  auto stone = Config::parse("[flight]\nshape = \"manual\"\ncmd_timeout_ms = 5000\n", "ground.toml");
  EXPECT_FALSE(flight_config(*stone).cmd_timeout_ns < 0);
  const auto status = stone->finish();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, testing::HasSubstr("ground.toml:3: flight.cmd_timeout_ms"));
  EXPECT_THAT(status.error().message, testing::HasSubstr("500"));
}

TEST(GroundSettings, PredictionRampAndWaypointsAreRead) {
  const std::string file = testing::TempDir() + "/ground_way.csv";
  ASSERT_TRUE(write_file(file, "0,0\n1,0\n1,1\n"));
  auto config = Config::parse("[flight]\nshape = \"waypoints\"\nwaypoints = \"" + file +
                                  "\"\npredict = false\nramp_start_mps = 0.5\nramp_step_mps = 0.1\n"
                                  "max_acceleration_mps2 = 3\npose_lost_ms = 200\n",
                              "ground.toml");
  ASSERT_TRUE(config);
  const FlightConfig flight = flight_config(*config);
  ASSERT_TRUE(config->finish()) << config->finish().error().message;
  EXPECT_EQ(flight.waypoints.size(), 3u);
  EXPECT_FALSE(flight.controller.predict);
  EXPECT_EQ(flight.controller.ramp.start_mps, 0.5);
  EXPECT_EQ(flight.controller.max_acceleration_mps2, 3);
  EXPECT_EQ(flight.controller.pose_lost_ns, 200 * ns_per_ms);
  EXPECT_EQ(flight.controller.ramp.step_mps, 0.1);

  auto lost = Config::parse("[flight]\nshape = \"waypoints\"\nwaypoints = \"/nowhere/way.csv\"\n", "ground.toml");
  (void)flight_config(*lost);
  const auto status = lost->finish();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, testing::HasSubstr("ground.toml:3: flight.waypoints"));
  EXPECT_THAT(status.error().message, testing::HasSubstr("there is no file /nowhere/way.csv"));
}

TEST(GroundSettings, WhatGroundBringsToROS2ItselfIsNotBridged) {
  auto config = Config::parse("[[drone]]\nname = \"tello1\"\n[[topic]]\nname = \"/*\"\nfrom = \"*\"\n", "ground.toml");
  const FlightConfig flight = flight_config(*config);
  const bridge::BridgeConfig bridged = read_bridge(*config, flight.drones);
  ASSERT_TRUE(config->finish()) << config->finish().error().message;
  for (const char* own : {"/tello1/odom", "/tello1/imu", "/tf", "/diagnostics", "/tello1/cmd_vel", "/tello1/stop"}) {
    EXPECT_EQ(bridge::rule_up(bridged.rules, own), nullptr) << own;
    EXPECT_EQ(bridge::rule_down(bridged.rules, own, std::string(own).substr(1)), nullptr) << own;
  }
  EXPECT_NE(bridge::rule_down(bridged.rules, "/tello1/note", "tello1/note"), nullptr);
}

// A bridge of its own beside ground takes none of these from the ledger by a "*".
TEST(GroundSettings, EveryTopicOfDronesAndPilotsIsGuarded) {
  auto config = Config::parse("[[drone]]\nname = \"tello1\"\n", "ground.toml");
  const FlightConfig flight = flight_config(*config);
  const bridge::BridgeConfig bridged = read_bridge(*config, flight.drones);
  EXPECT_GE(bridged.rules.size(), 11U);
  for (const bridge::Rule& own : bridged.rules) EXPECT_TRUE(bridge::is_guarded(own.name)) << own.name;
}

std::vector<std::string> topics_of_pilots(const std::string& toml, bool has_operators, bool has_dds_security) {
  auto config = Config::parse(toml, "ground.toml");
  const PilotSettings pilot = pilot_settings(*config, has_operators, has_dds_security);
  if (const Status read = config->finish(); !read) return {read.error().message};
  std::vector<std::string> names;
  for (const PilotTopic* topic : topics_read(pilot)) names.emplace_back(topic->name);
  return names;
}

TEST(GroundSettings, WhereOperatorsSignInDdsIsNoWayPastThem) {
  EXPECT_THAT(topics_of_pilots("", true, false), testing::IsEmpty());
  EXPECT_THAT(topics_of_pilots("", true, true), testing::IsEmpty()) << "a member of DDS is no operator, either";
  EXPECT_THAT(topics_of_pilots("[pilot]\ntopics = true\n", true, false),
              testing::ElementsAre("/cmd_vel", "/takeoff", "/land", "/stop"));
  EXPECT_THAT(topics_of_pilots("[pilot]\ntopics = false\n", false, true), testing::IsEmpty());
}

TEST(GroundSettings, MotorsAreCutByDdsWhereItKnowsItsMembersOrTheConfigNamesIt) {
  EXPECT_THAT(topics_of_pilots("", false, false), testing::Not(testing::Contains("/emergency")));
  EXPECT_THAT(topics_of_pilots("", false, true), testing::Contains("/emergency"));
  EXPECT_THAT(topics_of_pilots("[pilot]\nemergency = true\n", false, false), testing::Contains("/emergency"));
  EXPECT_THAT(topics_of_pilots("[pilot]\nemergency = false\n", false, true),
              testing::Not(testing::Contains("/emergency")));
  EXPECT_THAT(topics_of_pilots("[pilot]\nemergency = true\n", true, false),
              testing::ElementsAre(testing::HasSubstr("ground.toml:2: pilot.emergency: must not be true")));
}

TEST(GroundSettings, EveryWrongKeyIsReportedWithItsLine) {
  auto config = Config::parse("[flight]\nshape = \"circle\"\nspeed_mps = 99\nlapse = 3\n", "ground.toml");
  ASSERT_TRUE(config);
  (void)flight_config(*config);
  (void)output_settings(*config);
  const auto status = config->finish();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, testing::HasSubstr("ground.toml:2: flight.shape"));
  EXPECT_THAT(status.error().message, testing::HasSubstr("ground.toml:3: flight.speed_mps"));
  EXPECT_THAT(status.error().message, testing::HasSubstr("ground.toml:4: flight.lapse"));
}

TEST(GroundSettings, ADroneHasANameThatRosTakes) {
  for (const char* name : {"1tello", "tello-1", "tello__1"}) {
    auto config = Config::parse("[[drone]]\nname = \"" + std::string(name) + "\"\n", "ground.toml");
    ASSERT_TRUE(config);
    (void)flight_config(*config);
    const auto status = config->finish();
    ASSERT_FALSE(status) << name;
    EXPECT_THAT(status.error().message, testing::HasSubstr(contract::drone_name_rule));
  }
}

TEST(GroundSettings, StatusAndSummarySayWhatTheContractOfTheProcessesAsksFor) {
  FlightConfig flight;
  flight.drones = {{"tello1", 1}};
  const FlightCore core(flight);
  const auto status = nlohmann::json::parse(status_line(core));
  EXPECT_EQ(status["ground"]["drones"][0]["name"], "tello1");
  EXPECT_EQ(status["ground"]["drones"][0]["phase"], "waiting");
  EXPECT_EQ(status["ground"]["why"], "");
  const auto summary_object = nlohmann::json::parse(summary(core, {.pilots = {{.dds_lost = 4, .dds_refused = 3}}}));
  for (const char* key : {"name", "finished", "landed", "lap_s", "origin", "height_m", "states_received",
                          "commands_made", "commands_sent", "commands_merged"}) {
    EXPECT_TRUE(summary_object["drones"][0].contains(key)) << key;
  }
  EXPECT_EQ(summary_object["drones"][0]["pilot"]["dds_refused"], 3);
  EXPECT_EQ(summary_object["drones"][0]["pilot"]["dds_lost"], 4);
  EXPECT_TRUE(summary_object.contains("transactions"));
}

}  // namespace
}  // namespace ledgerline::ground
