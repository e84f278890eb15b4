#include "tools/station/core/show.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ledgerline::station {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

json drone(const std::string& name, const std::string& phase) {
  return {{"name", name},
          {"phase", phase},
          {"paused", false},
          {"has_state", true},
          {"link_phase", "flying"},
          {"mode", "none"},
          {"cause_words", ""},
          {"battery_percent", 87},
          {"state_age_ms", 41.7},
          {"position", {1.0, -0.04, 1.26}},
          {"lease", {{"holder", "Org2MSP CN=alice"}}},
          {"requests", json::array()},
          {"stopped_by", json::array()}};
}
std::string drones(const std::vector<json>& all) { return json{{"drones", all}}.dump(); }

json mission_json(const std::string& phase) {
  return {{"id", "3f5a9c01d2e4"},
          {"hash", "77"},
          {"name", "survey"},
          {"drones", {"tello1", "tello2"}},
          {"phase", phase},
          {"paused", false},
          {"why", ""},
          {"by", "Org2MSP CN=alice"},
          {"approvals", {"Org2MSP CN=bob"}},
          {"approvals_needed", 1},
          {"findings", {{{"drone", "tello1"}, {"waypoint", nullptr}, {"words", "no fence"}, {"forbids", false}}}},
          {"reached", {{"tello1", 3}}}};
}
std::string missions(const std::vector<json>& all) { return json{{"missions", all}}.dump(); }

TEST(ATable, HasColumnsAsWideAsWhatIsInThem) {
  EXPECT_EQ(aligned({{"a", "b", "c"}, {"long", "µ", "x"}, {"m", "yy", ""}}), "a     b   c\nlong  µ   x\nm     yy  \n");
}

TEST(ARefusal, NamesItsDroneOnce) {
  EXPECT_EQ(of_drone("tello2", "tello2: bob: take control: refused: tello2: held by alice"),
            "tello2: bob: take control: refused: held by alice");
  EXPECT_EQ(of_drone("tello2", "acquire: tello2: tello2: held"), "tello2: acquire: held");
  EXPECT_EQ(of_drone("tello1", "no take-off: tello12: and tello1 is stopped"),
            "tello1: no take-off: tello12: and tello1 is stopped");
}

TEST(AMission, IsFoundByItsDigest) {
  const auto found = mission_with(missions({mission_json("checked")}), "77");
  ASSERT_TRUE(found);
  EXPECT_EQ(*mission_text(*found), *mission_text(mission_json("checked").dump()));
  EXPECT_EQ(json::parse(digests_json({"survey", "77", {}, {}, {}}, *found))["at_station"]["id"], "3f5a9c01d2e4");
  EXPECT_EQ(*mission_with(missions({mission_json("checked")}), "78"), "");
  EXPECT_FALSE(mission_with("{}", "77"));
}

TEST(Waiting, EndsWhenAllThatWereNamedAreWhereTheVerbBringsThem) {
  json landed = drone("tello2", "waiting");
  landed["link_phase"] = "on_ground";
  const std::string both = drones({drone("tello1", "manual"), landed});
  EXPECT_TRUE(*all_arrived(both, {"tello1"}, "takeoff"));
  EXPECT_FALSE(*all_arrived(both, {"tello1", "tello2"}, "takeoff"));
  EXPECT_FALSE(*all_arrived(both, {}, "stop"));
  EXPECT_TRUE(*all_arrived(both, {"tello2"}, "land"));
  landed["phase"] = "failed";
  EXPECT_THAT(all_arrived(drones({landed}), {"tello2"}, "takeoff").error().message, HasSubstr("tello2: failed"));
  EXPECT_FALSE(all_arrived("[]", {}, "land").ok());
}

TEST(AStop, IsClearedWhenNobodyHasTheDroneStopped) {
  json stopped = drone("tello2", "landed");
  stopped["stopped_by"] = {"Org1MSP CN=eve"};
  const std::string both = drones({drone("tello1", "manual"), stopped});
  EXPECT_THAT(*drones_for(both, "clear_stop", ""), ElementsAre("tello2"));
  EXPECT_TRUE(*is_cleared(both, "tello1"));
  EXPECT_FALSE(*is_cleared(both, "tello2"));
  EXPECT_FALSE(is_cleared("{}", "tello2").ok());
}

TEST(AllDrones, AreThoseForWhichAVerbMakesSense) {
  json of_bob = drone("tello2", "manual"), free = drone("tello3", "waiting");
  of_bob["lease"]["holder"] = "Org2MSP CN=bob";
  free["lease"]["holder"] = "";
  free["link_phase"] = "on_ground";
  const std::string all = drones({drone("tello1", "manual"), of_bob, free}), alice = "Org2MSP CN=alice";
  EXPECT_THAT(*drones_for(all, "acquire", alice), ElementsAre("tello3"));
  EXPECT_THAT(*drones_for(all, "request", alice), ElementsAre("tello2"));
  EXPECT_THAT(*drones_for(all, "release", alice), ElementsAre("tello1"));
  EXPECT_THAT(*drones_for(all, "land", alice), ElementsAre("tello1", "tello2"));
  EXPECT_THAT(*drones_for(all, "clear_stop", alice), IsEmpty());
  EXPECT_FALSE(drones_for("{}", "land", alice));
}

TEST(Waiting, EndsWhenTheMissionIsFlownAndFailsWhenItIsEndedBefore) {
  EXPECT_FALSE(*is_flown(mission_json("flying").dump()));
  EXPECT_TRUE(*is_flown(mission_json("done").dump()));
  json aborted = mission_json("aborted");
  aborted["why"] = "tello2 was stopped";
  EXPECT_EQ(is_flown(aborted.dump()).error().message, "aborted: tello2 was stopped");
}

TEST(TheTableOfDrones, SaysWhatIsKnownOfEach) {
  json held = drone("tello2", "manual");
  held["paused"] = true;
  held["mode"] = "hold";
  held["cause"] = "plan_ran_out";
  held["cause_words"] = "no new command";
  held["requests"] = {{{"msp", "Org2MSP"}, {"subject", "CN=bob"}, {"priority", 1}}};
  held["stopped_by"] = {"Org1MSP CN=eve"};
  json unknown = drone("tello3", "waiting");
  for (const char* key : {"battery_percent", "state_age_ms", "position"}) unknown[key] = nullptr;
  unknown["has_state"] = false;
  unknown["lease"]["holder"] = "";
  json waiting = drone("tello4", "waiting");
  waiting["link_phase"] = "on_ground";
  const auto rows = drone_rows(drones({drone("tello1", "path"), held, unknown, waiting}));
  ASSERT_TRUE(rows) << rows.error().message;
  ASSERT_EQ(rows->size(), 5U);
  EXPECT_THAT((*rows)[1], ElementsAre("tello1", "path (flying)", "-", "87 %", "42 ms", "1.0 0.0 1.3",
                                      "Org2MSP CN=alice", "-", "-"));
  EXPECT_EQ((*rows)[2][1], "manual, paused (flying)");
  EXPECT_EQ((*rows)[2][2], "hold (plan_ran_out: no new command)");
  EXPECT_EQ((*rows)[2][7], "Org2MSP CN=bob");
  EXPECT_EQ((*rows)[2][8], "Org1MSP CN=eve");
  EXPECT_THAT((*rows)[3], ElementsAre("tello3", "waiting (not heard)", "-", "-", "-", "-", "-", "-", "-"));
  EXPECT_EQ((*rows)[4][1], "waiting") << "on the ground, as everyone who waits";
}

TEST(TheOnlyRequester, IsFoundWhereThereIsOne) {
  json wanted = drone("tello2", "manual"), fought_over = drone("tello3", "manual");
  wanted["requests"] = {{{"msp", "Org2MSP"}, {"subject", "CN=bob"}, {"priority", 1}}};
  fought_over["requests"] = {wanted["requests"][0], wanted["requests"][0]};
  const std::string all = drones({drone("tello1", "manual"), wanted, fought_over});
  EXPECT_EQ(only_requester(all, "tello2")->subject, "CN=bob");
  EXPECT_EQ(only_requester(all, "tello1").error().message, "tello1: nobody has requested it");
  EXPECT_THAT(only_requester(all, "tello3").error().message, HasSubstr("2 have requested it"));
  EXPECT_FALSE(only_requester(all, "tello9"));
  EXPECT_FALSE(only_requester("{}", "tello2"));
}

TEST(TheTableOfDrones, IsTheSameUntilMoreThanAgesChange) {
  json later = drone("tello1", "path"), moved = later;
  later["state_age_ms"] = 99;
  moved["position"][0] = 1.1;
  const auto now = drone_rows(drones({drone("tello1", "path")}));
  EXPECT_EQ(settled(*now), settled(*drone_rows(drones({later}))));
  EXPECT_NE(settled(*now), settled(*drone_rows(drones({moved}))));
}

TEST(WhatTheStationSays, IsMadePrintable) {
  json wild = drone("tello1", "path");
  wild["lease"]["holder"] = "Org2MSP CN=\x1b[2J\nroot";
  const auto rows = drone_rows(drones({wild}));
  ASSERT_TRUE(rows);
  EXPECT_THAT(aligned(*rows), testing::Not(HasSubstr("\x1b")));
  EXPECT_EQ(aligned(*rows).find("root"), aligned(*rows).rfind("root"));
}

TEST(WhatTheStationSays, IsAnErrorWhereItIsNotTheApi) {
  for (const char* body : {"", "[]", "{}", R"({"drones":{"a":1}})", R"({"drones":[{"name":"tello1"}]})"}) {
    const auto rows = drone_rows(body);
    ASSERT_FALSE(rows) << body;
    EXPECT_THAT(rows.error().message, HasSubstr("version 1"));
  }
  EXPECT_FALSE(mission_rows("{}"));
  EXPECT_FALSE(mission_text("[]"));
  EXPECT_FALSE(events_from(R"({"events":[{"n":-1}]})"));
  EXPECT_FALSE(now_ms_from(R"({"events":[]})"));
}

TEST(TheTableOfMissions, CountsApprovals) {
  const auto rows = mission_rows(missions({mission_json("checked")}));
  ASSERT_TRUE(rows) << rows.error().message;
  EXPECT_THAT((*rows)[1], ElementsAre("3f5a9c01d2e4", "survey", "checked", "1 of 1", "tello1, tello2", "-"));
  json forbidden = mission_json("checked");
  forbidden["findings"].push_back({{"drone", "tello9"}, {"words", "tello9 does not fly here"}, {"forbids", true}});
  EXPECT_EQ(mission_rows(missions({forbidden}))->at(1).back(), "tello9 does not fly here");
}

TEST(AMission, IsShownWithWhatItsCheckFound) {
  json one = mission_json("aborted");
  one["why"] = "tello2 was stopped";
  one["findings"].push_back({{"drone", "tello2"}, {"waypoint", 1}, {"words", "too near"}, {"forbids", true}});
  one["paths"] = {{"tello1", {{0, 0, 1}, {1, 0, 1}}}};
  const auto text = mission_text(one.dump());
  ASSERT_TRUE(text) << text.error().message;
  for (const char* part : {"survey: aborted: tello2 was stopped", "approved by 1 of 1: Org2MSP CN=bob",
                           "of Org2MSP CN=alice", "tello1 has reached 3 waypoints", "warning: no fence",
                           "forbids its start: too near", "tello1 flies 2 waypoints"})
    EXPECT_THAT(*text, HasSubstr(part));
}

TEST(AMission, SaysHowManyApprovalsItHas) {
  const auto approvals = approvals_from(mission_json("checked").dump());
  ASSERT_TRUE(approvals) << approvals.error().message;
  EXPECT_EQ(approvals->name, "survey");
  ASSERT_EQ(approvals->signers.size(), 1U);
  const std::string refused = "approve mission survey: refused: anchor: ";
  EXPECT_TRUE(
      counts_already(*approvals, refused + approvals->signers[0] + " has anchored this digest already; verify"));
  EXPECT_FALSE(counts_already(*approvals, refused + "Org2MSP CN=eve has anchored this digest already; verify"))
      << "it was withdrawn";
  EXPECT_FALSE(approvals_from("{}"));
}

TEST(AnEvent, IsALine) {
  const char* const body = R"({"t_ms":9.5,"events":[{"n":7,"t_ms":5.5,"level":"alarm","drone":"tello1","text":"failed"},
    {"n":8,"t_ms":6,"level":"info","drone":"","text":"reached"}]})";
  EXPECT_EQ(*now_ms_from(body), 9.5);
  const auto events = events_from(body);
  ASSERT_TRUE(events) << events.error().message;
  EXPECT_EQ(events->at(0).number, 7U);
  EXPECT_EQ(event_line(events->at(0), "12:00:00"), "12:00:00  alarm    tello1: failed");
  EXPECT_EQ(event_line(events->at(1), "12:00:00"), "12:00:00  info     reached");
}

ShownEvent takeoff(const std::string& name, double t_ms) { return {1, t_ms, "info", name, "takeoff"}; }

TEST(Flights, AreRunningMissionsAndDronesBesideThem) {
  const auto flown = active_flights_from(drones({drone("tello1", "path"), drone("tello2", "landed"),
                                                 drone("tello3", "manual"), drone("tello4", "waiting")}),
                                         missions({mission_json("flying"), mission_json("done")}),
                                         {takeoff("tello1", 500), takeoff("tello1", 2'000)}, 5'000);
  ASSERT_TRUE(flown) << flown.error().message;
  ASSERT_EQ(flown->size(), 2U);
  EXPECT_EQ(flown->at(0).what, "mission");
  EXPECT_THAT(flown->at(0).drones, ElementsAre("tello1", "tello2"));
  EXPECT_EQ(flown->at(0).since_s, 3.0) << "its newest take-off";
  EXPECT_EQ(flown->at(1).what, "hand");
  EXPECT_THAT(flown->at(1).drones, ElementsAre("tello3"));
  EXPECT_EQ(flown->at(1).since_s, std::nullopt) << "its take-off is forgotten";
  const json reported = json::parse(active_flights_json(*flown));
  EXPECT_EQ(reported["flights"][0]["mission"], "3f5a9c01d2e4");
  EXPECT_TRUE(reported["flights"][1]["since_s"].is_null());
  EXPECT_THAT(aligned(active_flight_rows(*flown)), HasSubstr("mission survey (3f5a9c01d2e4)"));
}

TEST(Flights, AreNoneOnTheGround) {
  const auto flown =
      active_flights_from(drones({drone("tello1", "landed")}), missions({mission_json("aborted")}), {}, 0);
  ASSERT_TRUE(flown);
  EXPECT_THAT(*flown, IsEmpty());
  EXPECT_FALSE(active_flights_from("{}", missions({}), {}, 0));
}

}  // namespace
}  // namespace ledgerline::station
