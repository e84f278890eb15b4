#include "ground/mission/mission.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/unit/campaign.hpp"
#include "tests/unit/ground/mission/missions.hpp"

namespace ledgerline::ground::mission {
namespace {

using testing::HasSubstr;

constexpr auto json_text = R"({"name":"survey","drones":[
  {"drone":"tello1","waypoints":[{"x":1,"y":2,"z":1.5,"speed":0.5},{"x":2,"y":2}],"then":"land"},
  {"drone":"tello2","waypoints":[{"x":-1,"y":0.25,"speed":1}]}]})";
constexpr auto csv_text =
    "# two drones\n"
    "drone,x,y,z,speed,then\n"
    "tello2,-1,0.25,,1,\n"
    "tello1,1,2,1.5,0.5,\n"
    "tello1, 2 ,2,,,land  # its end\n";

Mission survey() {
  auto mission = mission_from_json(json_text);
  EXPECT_TRUE(mission) << mission.error().message;
  return *mission;
}

std::string refused_json(std::string_view text) {
  const auto mission = mission_from_json(text);
  return mission ? "taken" : mission.error().message;
}

std::string refused_csv(std::string_view text) {
  const auto mission = mission_from_csv(text, "survey");
  return mission ? "taken" : mission.error().message;
}

std::string json_with(std::string_view drone) { return fmt::format(R"({{"name":"m","drones":[{}]}})", drone); }

std::string csv_with(std::string_view lines) { return "drone,x,y,z,speed\n" + std::string(lines); }

TEST(MissionParse, JsonAndCsvOfOneMissionHaveOneDigest) {
  const auto csv = mission_from_csv(csv_text, "survey");
  ASSERT_TRUE(csv) << csv.error().message;
  EXPECT_EQ(canonical(*csv), canonical(survey()));
  EXPECT_EQ(digest(*csv), digest(survey()));
  EXPECT_EQ(
      canonical(survey()),
      R"({"name":"survey","drones":[{"drone":"tello1","waypoints":[{"x":1,"y":2,"z":1.5,"speed":0.5},{"x":2,"y":2}],)"
      R"("then":"land"},{"drone":"tello2","waypoints":[{"x":-1,"y":0.25,"speed":1}],"then":"hover"}]})");
}

TEST(MissionParse, ByteOrderMarkAndCarriageReturnsChangeNothing) {
  std::string text = "\xef\xbb\xbf" + std::string(csv_text);
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.insert(at, "\r");
  const auto csv = mission_from_csv(text, "survey");
  ASSERT_TRUE(csv) << csv.error().message;
  EXPECT_EQ(digest(*csv), digest(survey()));
  const auto json = mission_from_json("\xef\xbb\xbf" + std::string(json_text));
  ASSERT_TRUE(json) << json.error().message;
  EXPECT_EQ(digest(*json), digest(survey()));
}

TEST(MissionParse, AnyChangeIsAnotherDigest) {
  Mission with_all = survey();
  with_all.drones[0].start_m = Eigen::Vector2d::Zero();
  with_all.drones[0].speed_mps = 0.7;
  constexpr double bit = 1e-15;
  const std::vector<std::function<void(Mission&)>> changes{
      [](Mission& m) { m.name += "2"; },
      [](Mission& m) { m.drones[0].drone = "tello3"; },
      [](Mission& m) { m.drones.pop_back(); },
      [](Mission& m) { m.drones[0].land_behind = false; },
      [](Mission& m) { m.drones[0].start_m->x() = bit; },
      [](Mission& m) { m.drones[0].start_m.reset(); },
      [](Mission& m) { *m.drones[0].speed_mps += bit; },
      [](Mission& m) { m.drones[0].speed_mps.reset(); },
      [](Mission& m) { m.drones[0].waypoints[0].at_m.x() += bit; },
      [](Mission& m) { m.drones[0].waypoints[1].at_m.y() += bit; },
      [](Mission& m) { *m.drones[0].waypoints[0].height_m += bit; },
      [](Mission& m) { m.drones[0].waypoints[0].height_m.reset(); },
      [](Mission& m) { *m.drones[0].waypoints[0].speed_mps += bit; },
      [](Mission& m) { m.drones[0].waypoints[0].speed_mps.reset(); },
      [](Mission& m) { m.drones[0].waypoints.pop_back(); },
      [](Mission& m) { std::swap(m.drones[0].waypoints[0], m.drones[0].waypoints[1]); },
      [](Mission& m) { std::swap(m.drones[0].waypoints, m.drones[1].waypoints); }};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    Mission changed = with_all;
    changes[i](changed);
    EXPECT_NE(digest(changed), digest(with_all)) << "change " << i;
  }
  Mission turned = with_all;
  std::swap(turned.drones[0], turned.drones[1]);
  turned.drones[0].waypoints[0].line = 7;
  EXPECT_EQ(digest(turned), digest(with_all));
}

// Of numbers with all their digits: what was approved is what is flown after a restart.
TEST(MissionParse, TheCanonicalTextIsReadAsTheSameMission) {
  Random random(1);
  for (int i = 0; i < seeds(50, 1'000); ++i) {
    Mission mission{"m", {}};
    const int drones = 1 + static_cast<int>(below(random, 4));
    for (int k = 0; k < drones; ++k) {
      MissionDrone drone{"d" + std::to_string(k)};
      drone.land_behind = below(random, 2) == 1;
      if (below(random, 2) == 1) drone.speed_mps = between(random, 0.05, 8);
      if (below(random, 2) == 1) drone.start_m = Eigen::Vector2d(between(random, -1000, 1000), -0.0);
      for (std::size_t n = 1 + below(random, 20); n-- > 0;) {
        Waypoint waypoint{{between(random, -1000, 1000), between(random, -1e-7, 1e-7)}};
        if (below(random, 2) == 1) waypoint.height_m = between(random, 0.3, 10);
        if (below(random, 2) == 1) waypoint.speed_mps = between(random, 0.05, 8);
        drone.waypoints.push_back(waypoint);
      }
      mission.drones.push_back(drone);
    }
    const auto again = mission_from_json(canonical(mission));
    ASSERT_TRUE(again) << again.error().message << "\n" << canonical(mission);
    ASSERT_EQ(canonical(*again), canonical(mission));
    for (std::size_t k = 0; k < mission.drones.size(); ++k)
      ASSERT_EQ(again->drones[k].waypoints[0].at_m, mission.drones[k].waypoints[0].at_m);
  }
}

TEST(MissionParse, TheLargestMissionIsTaken) {
  Mission mission{"m", {}};
  for (int k = 0; k < 64; ++k) {
    MissionDrone drone{"drone_of_a_long_name_" + std::to_string(k)};
    for (int i = 0; i < 500; ++i)
      drone.waypoints.push_back({{-100 - 0.1 * i, -100 - 1 / 3.0 * i}, 1 + i / 300.0, 0.1 + i / 3000.0});
    mission.drones.push_back(std::move(drone));
  }
  const std::string text = canonical(mission);
  EXPECT_LT(text.size(), max_mission_bytes);
  const auto again = mission_from_json(text);
  ASSERT_TRUE(again) << again.error().message;
  mission.drones.push_back({"one_more", {}, {{{0, 0}}}});
  EXPECT_THAT(refused_json(canonical(mission)), HasSubstr("drones must be a list of 1 to 64"));
}

TEST(MissionParse, JsonErrorsNameTheirPlace) {
  EXPECT_EQ(refused_json(std::string(max_mission_bytes + 1, ' ')), "the mission has 4194305 bytes; 4194304 may be");
  EXPECT_THAT(refused_json(""), HasSubstr("name must be a text"));
  EXPECT_THAT(refused_json("[]"), HasSubstr("must be a JSON object that nests at most 5 deep"));
  EXPECT_THAT(refused_json(R"({"name":"m","drones":[{"drone":"a","waypoints":[{"x":[],"y":0}]}]})"),
              HasSubstr("drone a, waypoint 1: x must be a number"));
  EXPECT_THAT(refused_json(R"({"name":"m","drones":[{"drone":"a","waypoints":[{"x":[[]],"y":0}]}]})"),
              HasSubstr("at most 5 deep"));
  EXPECT_THAT(refused_json(R"({"name":"m","drones":[],"name":"n"})"), HasSubstr("has the key \"name\" twice"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":1,"y":1,"x":2}]})")), HasSubstr("\"x\" twice"));
  EXPECT_THAT(refused_json(R"({"name":"m","drones":[],"more":1})"), HasSubstr("unknown key \"more\""));
  EXPECT_THAT(refused_json(R"({"name":"m","drones":[]})"), HasSubstr("0 drones; 1 to 64 may be"));
  EXPECT_THAT(refused_json(R"({"name":"a b","drones":[]})"), HasSubstr("the mission's name \"a b\" must be"));
  EXPECT_THAT(refused_json(R"({"name":7,"drones":[]})"), HasSubstr("name must be a text"));
  EXPECT_THAT(refused_json(json_with("7")), HasSubstr("drone number 1 must be an object"));
  EXPECT_THAT(refused_json(json_with(R"({"waypoints":[]})")), HasSubstr("drone number 1: drone must be a text"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":0,"y":0}],"color":1})")),
              HasSubstr("drone a: unknown key \"color\""));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a/b","waypoints":[{"x":0,"y":0}]})")), HasSubstr("\"a/b\" must be"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[]})")), HasSubstr("drone a: has 0 waypoints"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a"})")), HasSubstr("drone a: waypoints must be a list of 1 to 500"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":0,"y":0}],"then":"fall"})")),
              HasSubstr("drone a: then must be \"hover\" or \"land\""));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":0,"y":0},{"x":1,"y":0,"z":99}]})")),
              HasSubstr("drone a, waypoint 2: has z 99 m; 0.3 to 10 may be"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":0,"y":0,"speed":0}]})")),
              HasSubstr("drone a, waypoint 1: has speed 0 m/s"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":1001,"y":0}]})")),
              HasSubstr("drone a, waypoint 1: x and y must be from -1000 to 1000 m"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":1e999,"y":0}]})")), HasSubstr("JSON object"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","waypoints":[{"x":0,"y":0},{"x":0,"y":0.001}]})")),
              HasSubstr("drone a, waypoint 2: is closer than 1 cm"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","speed":9,"waypoints":[{"x":0,"y":0}]})")),
              HasSubstr("drone a: has speed 9 m/s"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","start":{"x":0},"waypoints":[{"x":0,"y":0}]})")),
              HasSubstr("drone a: start: needs x and y"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","start":{"x":0,"y":0,"z":1},"waypoints":[{"x":0,"y":0}]})")),
              HasSubstr("drone a: start: is x and y alone"));
  EXPECT_THAT(refused_json(json_with(R"({"drone":"a","start":{"x":0,"y":2e9},"waypoints":[{"x":0,"y":0}]})")),
              HasSubstr("drone a: its start must be within 1000 m"));
  EXPECT_THAT(
      refused_json(json_with(R"({"drone":"a","waypoints":[{"x":0,"y":0}]},{"drone":"a","waypoints":[{"x":0,"y":0}]})")),
      HasSubstr("drone a is there twice"));
}

TEST(MissionParse, CsvErrorsNameTheirLine) {
  EXPECT_EQ(refused_csv(""), "the mission has no line");
  EXPECT_EQ(refused_csv("# nothing\n\n"), "the mission has no line");
  EXPECT_THAT(refused_csv("tello1,0,0,1,1\n"), HasSubstr("line 1: the heading must be drone,x,y,z,speed"));
  EXPECT_THAT(refused_csv("drone,y,x,z,speed\n"), HasSubstr("line 1: the heading"));
  EXPECT_THAT(refused_csv("drone,x,y,z,speed,then,more\n"), HasSubstr("line 1: the heading"));
  EXPECT_THAT(refused_csv("drone,x,y,z,speed\n"), HasSubstr("0 drones; 1 to 64 may be"));
  EXPECT_THAT(refused_csv(csv_with("# a comment\ntello1,0,0\n")), HasSubstr("line 3: 3 columns, not 5"));
  EXPECT_THAT(refused_csv(csv_with("tello1,0,0,1,1,land\n")), HasSubstr("line 2: 6 columns, not 5"));
  EXPECT_THAT(refused_csv(csv_with("a b,0,0,1,1\n")), HasSubstr("line 2: the drone's name \"a b\" must be"));
  EXPECT_THAT(refused_csv(csv_with("tello-1,0,0,1,1\n")), HasSubstr("must be a letter, then letters, digits"));
  EXPECT_THAT(refused_csv(csv_with(",0,0,1,1\n")), HasSubstr("line 2: the drone's name \"\""));
  EXPECT_THAT(refused_csv(csv_with("a,0,0,1,1\na,nan,0,1,1\n")),
              HasSubstr("line 3: x \"nan\" is no number from -1000"));
  EXPECT_THAT(refused_csv(csv_with("a,0,inf,1,1\n")), HasSubstr("line 2: y \"inf\" is no number"));
  EXPECT_THAT(refused_csv(csv_with("a,0,,1,1\n")), HasSubstr("line 2: y \"\" is no number"));
  EXPECT_THAT(refused_csv(csv_with("a,0,0,99,1\n")), HasSubstr("line 2: z \"99\" is no number from 0.3 to 10"));
  EXPECT_THAT(refused_csv(csv_with("a,0,0,1,-1\n")), HasSubstr("line 2: speed \"-1\" is no number from 0.05 to 8"));
  EXPECT_THAT(refused_csv(csv_with("a,1\xff,0,1,1\n")), HasSubstr("line 2: x \"1?\""));
  EXPECT_THAT(refused_csv("drone,x,y,z,speed,then\na,0,0,,,fall\n"), HasSubstr("line 2: then must be hover, land"));
  EXPECT_THAT(refused_csv("drone,x,y,z,speed,then\na,0,0,,,land\na,1,0,,,hover\n"),
              HasSubstr("line 3: then of drone a was another before"));
  EXPECT_THAT(refused_csv(csv_with("a,0,0,,\na,0,0,,\n")), HasSubstr("drone a, waypoint 2: is closer than 1 cm"));
  std::string many, swarm;
  for (int i = 0; i < 501; ++i) many += fmt::format("a,{},0,,\n", i % 2);
  EXPECT_THAT(refused_csv(csv_with(many)), HasSubstr("line 502: more than 500 waypoints of drone a"));
  for (int i = 0; i < 65; ++i) swarm += fmt::format("a{},0,0,,\n", i);
  EXPECT_THAT(refused_csv(csv_with(swarm)), HasSubstr("line 66: more than 64 drones"));
  EXPECT_THAT(mission_from_csv(csv_with("a,0,0,,\n"), "a b").error().message, HasSubstr("the mission's name"));
}

TEST(MissionParse, ADronesSpeedIsThatOfItsWaypointsThatSayNone) {
  const auto mission = mission_from_json(
      json_with(R"({"drone":"a","speed":0.7,"waypoints":[{"x":0,"y":0},{"x":1,"y":0,"speed":0.4}]})"));
  ASSERT_TRUE(mission) << mission.error().message;
  const auto way = mission->drones[0].way();
  EXPECT_EQ(way[0].speed_mps, 0.7);
  EXPECT_EQ(way[1].speed_mps, 0.4);
}

}  // namespace
}  // namespace ledgerline::ground::mission
