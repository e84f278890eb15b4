#include "ground/service/core/api.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::ground::service {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;

class Api : public testing::Test {
 protected:
  ApiAnswer ask(std::string_view method, std::string_view target, std::string_view body = "",
                std::optional<std::size_t> who = {}) {
    return answer({method, target, body, who},
                  {names, drones, R"({"tello1":[[1,2,3]]})", events, operators, nullptr, aloft, stopped,
                   stopped_by_ground, unplaced, leases, phases, manual, &fence});
  }
  std::vector<std::size_t> aloft;              ///< on the ground: all
  std::vector<std::size_t> stopped;            ///< none
  std::vector<std::size_t> unplaced;           ///< none
  std::vector<std::size_t> stopped_by_ground;  ///< none
  std::vector<LeaseState> leases;              ///< not known
  std::vector<GroundPhase> phases;             ///< not known
  bool manual = true;
  const mission::Fence fence{{-5, -5, 0}, {5, 5, 2}};
  std::vector<Operator> operators;  ///< none: ground's own identity signs all
  const std::vector<std::string> names{"tello1", "tello2"};
  const std::string drones = R"([{"name":"tello1"}])";
  std::deque<Event> events{{3, 1'000'000, Level::info, "tello1", "takeoff"},
                           {4, 2'000'000, Level::alarm, "", "a \xff text that is no UTF-8"}};
};

TEST_F(Api, GivesTheDronesAsTheBoardHasThem) {
  EXPECT_EQ(ask("GET", "/api/v1/drones").body, R"({"drones":[{"name":"tello1"}]})");
}

TEST_F(Api, GivesThePathsAsTheBoardHasThem) {
  EXPECT_EQ(ask("GET", "/api/v1/paths").body, R"({"paths":{"tello1":[[1,2,3]]}})");
  EXPECT_EQ(ask("POST", "/api/v1/paths").status, 405U);
}

TEST_F(Api, GivesTheEventsBehindOneThatTheClientHas) {
  EXPECT_THAT(ask("GET", "/api/v1/events").body, HasSubstr(R"("text":"takeoff")"));
  const ApiAnswer rest = ask("GET", "/api/v1/events?since=3");
  EXPECT_THAT(rest.body, Not(HasSubstr("takeoff")));
  EXPECT_THAT(rest.body, HasSubstr(R"("level":"alarm","n":4)"));
  EXPECT_EQ(ask("GET", "/api/v1/events?since=4").body, R"({"events":[],"t_ms":0.0})");
  for (const char* wrong : {"?since=", "?since=-1", "?since=3x", "?from=3", "?since=99999999999999999999999"})
    EXPECT_EQ(ask("GET", std::string("/api/v1/events") + wrong).status, 400U) << wrong;
}

TEST_F(Api, ACommandIsOfItsDroneAlone) {
  const ApiAnswer takeoff = ask("POST", "/api/v1/drones/tello2/takeoff");
  EXPECT_EQ(takeoff.status, 202U);
  ASSERT_THAT(takeoff.commands, SizeIs(1));
  EXPECT_EQ(takeoff.commands[0].drone, 1U);
  EXPECT_TRUE(takeoff.commands[0].takeoff);
  EXPECT_FALSE(takeoff.commands[0].stop);
  const ApiAnswer cut = ask("POST", "/api/v1/drones/tello1/cut", "{}");
  ASSERT_THAT(cut.commands, SizeIs(1));
  EXPECT_TRUE(cut.commands[0].stop && cut.commands[0].cut);
  EXPECT_TRUE(ask("POST", "/api/v1/drones/tello1/land").commands.at(0).land);
  const ApiAnswer stop = ask("POST", "/api/v1/drones/tello1/stop");
  EXPECT_TRUE(stop.commands.at(0).stop && !stop.commands.at(0).cut);
}

TEST_F(Api, APathIsAnOrderWithItsWaypointsAndItsEnd) {
  const ApiAnswer path = ask("POST", "/api/v1/drones/tello1/path",
                             R"({"waypoints":[{"x":1,"y":-2},{"x":0,"y":0,"z":1.5,"speed":0.4}],"then":"land"})");
  ASSERT_THAT(path.commands, SizeIs(1)) << path.body;
  const auto& order = path.commands[0].order;
  ASSERT_TRUE(order);
  EXPECT_EQ(order->kind, PilotOrder::Kind::path);
  EXPECT_TRUE(order->land_behind);
  ASSERT_THAT(order->waypoints, SizeIs(2));
  EXPECT_EQ(order->waypoints[0].at_m.y(), -2);
  EXPECT_FALSE(order->waypoints[0].height_m);
  EXPECT_EQ(order->waypoints[1].height_m, 1.5);
  EXPECT_EQ(order->waypoints[1].speed_mps, 0.4);
  EXPECT_TRUE(ask("POST", "/api/v1/drones/tello1/pause").commands.at(0).pause);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/resume").commands.at(0).order->kind, PilotOrder::Kind::resume);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/return").commands.at(0).order->kind, PilotOrder::Kind::return_home);
  std::string long_list = R"({"waypoints":[)";
  for (int i = 0; i < 501; ++i) long_list += std::string(i > 0 ? "," : "") + R"({"x":1,"y":1})";
  for (const std::string& wrong :
       {std::string("{}"), std::string(R"({"waypoints":[]})"), std::string(R"({"waypoints":[1]})"),
        std::string(R"({"waypoints":[{"x":1}]})"), std::string(R"({"waypoints":[{"x":1,"y":"2"}]})"),
        std::string(R"({"waypoints":[{"x":1,"y":2,"w":3}]})"), std::string(R"({"waypoints":[{"x":1,"y":2,"x":3}]})"),
        std::string(R"({"waypoints":[{"x":1,"y":2}],"then":"dance"})"), long_list + "]}"})
    EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/path", wrong).status, 400U) << wrong.substr(0, 60);
}

TEST_F(Api, StopAllStopsEveryDroneAndCutsOnlyWhereRequested) {
  const ApiAnswer stop = ask("POST", "/api/v1/stop");
  ASSERT_THAT(stop.commands, SizeIs(2));
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(stop.commands[i].drone, i);
    EXPECT_TRUE(stop.commands[i].stop && !stop.commands[i].cut);
  }
  EXPECT_TRUE(ask("POST", "/api/v1/stop", R"({"cut":true})").commands.at(0).cut);
}

TEST_F(Api, UnknownCallsAreRefusedAndCommandNothing) {
  const struct {
    const char *method, *target, *body;
    unsigned status;
    const char* words;
  } cases[] = {
      {"POST", "/api/v1/drones/tello3/land", "", 404, "tello3"},
      {"POST", "/api/v1/drones/tello1/fly", "", 404, "takeoff, land, stop"},
      {"POST", "/api/v1/drones/tello1", "", 404, "takeoff, land, stop"},
      {"GET", "/api/v1/drones/tello1/takeoff", "", 405, "POST"},
      {"GET", "/api/v1/stop", "", 405, "POST"},
      {"POST", "/api/v1/drones", "", 405, "GET"},
      {"POST", "/api/v1/stop", R"({"cut":"yes"})", 400, "cut"},
      {"POST", "/api/v1/stop", R"({"cutt":true})", 400, "cutt"},
      {"POST", "/api/v1/stop", "[]", 400, "object"},
      {"POST", "/api/v1/stop", R"({"a":{"b":{"c":{"d":{"e":1}}}}})", 400, "deep"},
      {"POST", "/api/v1/drones/tello1/takeoff", "{", 400, "object"},
      {"GET", "/api/v2/drones", "", 404, "/api/v1/"},
      {"GET", "/api/v1/nothing", "", 404, "drones"},
  };
  for (const auto& c : cases) {
    const ApiAnswer refused = ask(c.method, c.target, c.body);
    EXPECT_EQ(refused.status, c.status) << c.target;
    EXPECT_THAT(refused.body, HasSubstr(c.words)) << c.target;
    EXPECT_TRUE(refused.commands.empty()) << c.target;
  }
}

class SignedIn : public Api {
 protected:
  SignedIn() { operators = {{"alice", {"Org2MSP", "CN=alice"}}, {"bob", {"Org2MSP", "CN=bob"}}}; }
};

TEST_F(SignedIn, WhoClicksIsWhoIsMeant) {
  const ApiAnswer takeoff = ask("POST", "/api/v1/drones/tello2/takeoff", "", 1);
  ASSERT_THAT(takeoff.commands, SizeIs(1));
  EXPECT_EQ(takeoff.commands[0].by, operators[1].identity);
  EXPECT_EQ(takeoff.commands[0].requests, std::vector<std::string>{"take off, asked for by bob"});
  EXPECT_EQ(
      ask("GET", "/api/v1/operators", "", 1).body,
      R"({"operators":[{"identity":"Org2MSP CN=alice","name":"alice"},{"identity":"Org2MSP CN=bob","name":"bob"}],"you":"bob"})");
}

TEST_F(Api, ACutInTheAirIsConfirmed) {
  aloft = {1};
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/cut").status, 202U) << "on the ground";
  const ApiAnswer refused = ask("POST", "/api/v1/drones/tello2/cut", "{}");
  EXPECT_EQ(refused.status, 409U);
  EXPECT_THAT(refused.body, HasSubstr("tello2 is in the air"));
  EXPECT_TRUE(refused.commands.empty());
  EXPECT_TRUE(ask("POST", "/api/v1/drones/tello2/cut", R"({"confirmed":true})").commands.at(0).cut);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello2/cut", R"({"confirmed":"yes"})").status, 400U);
  EXPECT_EQ(ask("POST", "/api/v1/stop", R"({"cut":true})").status, 409U);
  EXPECT_THAT(ask("POST", "/api/v1/stop", R"({"cut":true,"confirmed":true})").commands, SizeIs(2));
  EXPECT_THAT(ask("POST", "/api/v1/stop").commands, SizeIs(2)) << "a stop is never asked twice for";
}

TEST_F(Api, AStoppedDroneTakesOffOnlyOnceItsStopIsCleared) {
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/clear_stop").status, 409U) << "it is not stopped";
  stopped = {0};
  phases = {GroundPhase::landed, GroundPhase::waiting};
  EXPECT_THAT(ask("POST", "/api/v1/drones/tello1/takeoff").body, HasSubstr("clear the stop first"));
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello2/takeoff").status, 202U);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/clear_stop").status, 409U) << "by others";
  stopped_by_ground = {0};
  aloft = {0};
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/clear_stop").status, 409U) << "it still lands";
  aloft = {};
  const ApiAnswer cleared = ask("POST", "/api/v1/drones/tello1/clear_stop");
  EXPECT_EQ(cleared.status, 202U);
  EXPECT_TRUE(cleared.commands.at(0).clear_stop);
}

TEST_F(Api, AnOrderThatDoesNotFitTheDronesPhaseIsRefusedAtOnce) {
  const auto refused = [&](const std::string& verb) {
    const char* const body = verb == "path" ? R"({"waypoints":[{"x":1,"y":1}]})" : "";
    const ApiAnswer made = ask("POST", "/api/v1/drones/tello1/" + verb, body);
    EXPECT_EQ(made.status, made.commands.empty() ? 409U : 202U) << verb;
    return made.commands.empty() ? made.body : "";
  };
  phases = {GroundPhase::landed, GroundPhase::waiting};
  EXPECT_EQ(refused("takeoff"), "");
  for (const char* verb : {"path", "pause", "resume", "return"})
    EXPECT_THAT(refused(verb), HasSubstr("tello1 is on the ground: let it take off first")) << verb;
  aloft = {0};
  EXPECT_EQ(refused("path"), "") << "why it is not flown from here, the flight says";
  phases[0] = GroundPhase::takeoff;
  EXPECT_THAT(refused("path"), HasSubstr("is taking off: wait"));
  phases[0] = GroundPhase::manual;
  EXPECT_EQ(refused("path"), "");
  unplaced = {0};
  for (const char* verb : {"path", "return"}) EXPECT_THAT(refused(verb), HasSubstr("has no pose")) << verb;
  unplaced = {};
  EXPECT_THAT(refused("takeoff"), HasSubstr("in the air already: land it first"));
  phases[0] = GroundPhase::landing;
  for (const char* verb : {"takeoff", "path"}) EXPECT_THAT(refused(verb), HasSubstr("is landing: wait")) << verb;
  for (const char* verb : {"land", "stop"}) EXPECT_EQ(refused(verb), "") << verb;
  manual = false;
  EXPECT_THAT(refused("takeoff"), HasSubstr("flies its flight's path"));
}

TEST_F(Api, APathBeyondTheFenceIsRefused) {
  const auto path = [&](const char* waypoints) {
    return ask("POST", "/api/v1/drones/tello1/path", R"({"waypoints":[)" + std::string(waypoints) + "]}");
  };
  EXPECT_EQ(path(R"({"x":5,"y":-5,"z":2})").status, 202U);
  const ApiAnswer refused = path(R"({"x":1,"y":1},{"x":5.5,"y":1})");
  EXPECT_EQ(refused.status, 409U);
  EXPECT_TRUE(refused.commands.empty());
  EXPECT_THAT(refused.body, HasSubstr("waypoint 2: 5.5, 1, 1 m is beyond the fence: x -5 to 5"));
  EXPECT_THAT(path(R"({"x":1,"y":1,"z":2.5})").body, HasSubstr("1, 1, 2.5 m is beyond")) << "its ceiling";
}

TEST_F(Api, AnOrderWithoutTheLeaseIsRefusedAndSaysHowToGetIt) {
  leases = {{.holder = {}, .words = "nobody holds its lease", .ours = false},
            {.holder = {{"Org2MSP", "CN=eve"}}, .words = "its lease is held by CN=eve", .ours = false}};
  const ApiAnswer refused = ask("POST", "/api/v1/drones/tello1/takeoff");
  EXPECT_EQ(refused.status, 409U);
  EXPECT_TRUE(refused.commands.empty());
  EXPECT_THAT(refused.body, HasSubstr("tello1: nobody holds its lease: `ledgerline control --config operator.toml "
                                      "acquire tello1`"));
  EXPECT_THAT(ask("POST", "/api/v1/drones/tello2/pause").body, HasSubstr("held by CN=eve: `ledgerline control"));
  EXPECT_THAT(ask("POST", "/api/v1/drones/tello2/pause").body, HasSubstr("request tello2"));
  for (const char* verb : {"land", "stop", "cut"})
    EXPECT_EQ(ask("POST", std::string("/api/v1/drones/tello1/") + verb).status, 202U) << verb;
  leases = {{.holder = {}, .words = "", .ours = true}};
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/takeoff").status, 202U) << "without a ledger nobody holds it";
}

TEST_F(SignedIn, AnOrderOfWhoDoesNotHoldTheLeaseIsRefused) {
  leases = {{.holder = operators[0].identity, .words = "its lease is held by CN=alice", .ours = true},
            {.holder = operators[0].identity, .words = "its lease is held by CN=alice", .ours = false}};
  for (const char* verb : {"takeoff", "pause", "resume", "return"}) {
    const std::string target = std::string("/api/v1/drones/tello1/") + verb;
    EXPECT_EQ(ask("POST", target, "", 0).status, 202U) << verb;
    EXPECT_EQ(ask("POST", target).status, 403U) << "first of all one signs in";
    EXPECT_THAT(ask("POST", target, "", 1).body, HasSubstr("held by CN=alice: `ledgerline drones request tello1`"));
  }
  EXPECT_THAT(ask("POST", "/api/v1/drones/tello2/takeoff", "", 0).body, HasSubstr("drones acquire tello2"))
      << "hers, and commanded from elsewhere";
}

TEST_F(SignedIn, WithoutASessionNoMotorsAreCut) {
  for (const char* body : {R"({"confirmed":true})", "{}"}) {
    const ApiAnswer refused = ask("POST", "/api/v1/drones/tello1/cut", body);
    EXPECT_EQ(refused.status, 403U) << body;
    EXPECT_TRUE(refused.commands.empty()) << body;
  }
  EXPECT_EQ(ask("POST", "/api/v1/stop", R"({"cut":true,"confirmed":true})").status, 403U);
  EXPECT_TRUE(ask("POST", "/api/v1/drones/tello1/cut", "", 0).commands.at(0).cut);
}

TEST_F(SignedIn, WhatGroundHasStoppedByItselfAnOperatorMayClear) {
  EXPECT_FALSE(ask("POST", "/api/v1/drones/tello1/clear_stop", "", 0).call->ground_too);
  stopped_by_ground = {0};
  EXPECT_TRUE(ask("POST", "/api/v1/drones/tello1/clear_stop", "", 0).call->ground_too);
  EXPECT_FALSE(ask("POST", "/api/v1/drones/tello2/clear_stop", "", 0).call->ground_too);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/clear_stop").status, 403U);
}

TEST_F(SignedIn, WithoutASessionThereAreOnlyLooksLandingsAndStops) {
  for (const char* verb : {"takeoff", "pause", "resume", "return", "acquire", "release", "request", "clear_stop"}) {
    const ApiAnswer refused = ask("POST", std::string("/api/v1/drones/tello1/") + verb);
    EXPECT_EQ(refused.status, 403U) << verb;
    EXPECT_TRUE(refused.commands.empty() && !refused.call) << verb;
  }
  EXPECT_EQ(ask("GET", "/api/v1/drones").status, 200U);
  EXPECT_FALSE(ask("POST", "/api/v1/stop").commands.at(0).by);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/land").commands.at(0).requests.at(0),
            "land, asked for by the page's token");
  EXPECT_TRUE(ask("POST", "/api/v1/drones/tello1/land").commands.at(0).land);
  EXPECT_EQ(ask("POST", "/api/v1/stop", "", 0).commands.at(1).by, operators[0].identity) << "his own stop";
}

TEST_F(SignedIn, ASessionThatIsOverStopsAndLandsAndDoesNothingElse) {
  const auto ask_over = [this](std::string_view method, const std::string& target, std::string_view body = "") {
    return answer({.method = method, .target = target, .body = body, .session_ended = true},
                  {names, drones, "{}", events, operators});
  };
  EXPECT_THAT(ask_over("POST", "/api/v1/stop").commands, SizeIs(2));
  EXPECT_EQ(ask_over("POST", "/api/v1/stop", R"({"cut":true,"confirmed":true})").status, 401U);
  for (const char* verb : {"land", "stop"}) {
    const ApiAnswer taken = ask_over("POST", std::string("/api/v1/drones/tello1/") + verb);
    ASSERT_THAT(taken.commands, SizeIs(1)) << verb;
    EXPECT_FALSE(taken.commands[0].by) << verb;
    EXPECT_EQ(taken.commands[0].requests.at(0), std::string(verb) + ", asked for by a session that is over");
  }
  EXPECT_EQ(ask_over("POST", "/api/v1/missions/12/land").mission->kind, MissionRequest::Kind::land);
  for (const char* target : {"drones",
                             "events",
                             "paths",
                             "operators",
                             "missions",
                             "missions/12",
                             "missions/12/start",
                             "missions/12/pause",
                             "missions/12/resume",
                             "missions/12/approve",
                             "drones/tello1/takeoff",
                             "drones/tello1/cut",
                             "drones/tello1/pause",
                             "drones/tello1/resume",
                             "drones/tello1/return",
                             "drones/tello1/path",
                             "drones/tello1/acquire",
                             "drones/tello1/release",
                             "drones/tello1/clear_stop",
                             "session"}) {
    for (const char* method : {"GET", "POST", "DELETE"}) {
      const ApiAnswer refused = ask_over(method, std::string("/api/v1/") + target);
      EXPECT_EQ(refused.status, 401U) << method << " " << target;
      EXPECT_TRUE(refused.commands.empty() && !refused.call && !refused.mission && !refused.sign_in &&
                  !refused.sign_out)
          << target;
    }
  }
}

TEST_F(SignedIn, WhatAnOperatorSignsIsACall) {
  using Kind = OperatorCall::Kind;
  const ApiAnswer acquire = ask("POST", "/api/v1/drones/tello2/acquire", R"({"priority":3})", 0);
  ASSERT_TRUE(acquire.call) << acquire.body;
  EXPECT_EQ(acquire.call->kind, Kind::acquire);
  EXPECT_EQ(acquire.call->drone, 1U);
  EXPECT_EQ(acquire.call->priority, 3U);
  const ApiAnswer over =
      ask("POST", "/api/v1/drones/tello1/hand_over", R"({"to":{"msp":"Org2MSP","subject":"CN=bob"}})", 0);
  ASSERT_TRUE(over.call) << over.body;
  EXPECT_EQ(over.call->to, operators[1].identity);
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/clear_stop", "", 0).call->kind, Kind::clear_stop);
  for (const auto& [verb, body] : {std::pair("acquire", R"({"priority":-1})"),
                                   std::pair("acquire", R"({"priority":1000000000})"), std::pair("hand_over", "{}"),
                                   std::pair("deny", R"({"to":"bob"})"), std::pair("release", R"({"priority":1})")}) {
    const ApiAnswer refused = ask("POST", std::string("/api/v1/drones/tello1/") + verb, body, 0);
    EXPECT_EQ(refused.status, 400U) << verb << body;
    EXPECT_FALSE(refused.call) << verb << body;
  }
}

TEST_F(SignedIn, ADroneInTheAirIsGivenBackOnlyWhereThatIsConfirmed) {
  const char* const release = "/api/v1/drones/tello1/release";
  EXPECT_TRUE(ask("POST", release, "", 0).call);
  aloft = {1};
  EXPECT_TRUE(ask("POST", release, "", 0).call) << "another one is";
  aloft = {0, 1};
  const ApiAnswer refused = ask("POST", release, "{}", 0);
  EXPECT_EQ(refused.status, 409U);
  EXPECT_FALSE(refused.call);
  EXPECT_THAT(refused.body, HasSubstr("tello1 is in the air"));
  EXPECT_EQ(ask("POST", release, R"({"confirmed":false})", 0).status, 409U);
  EXPECT_TRUE(ask("POST", release, R"({"confirmed":true})", 0).call);
  EXPECT_EQ(ask("POST", release, R"({"confirmed":1})", 0).status, 400U);
  EXPECT_EQ(ask("POST", release, R"({"confirmed":true})").status, 403U);
}

TEST_F(SignedIn, SignsInByNameAndPassPhraseAndOut) {
  const ApiAnswer in = ask("POST", "/api/v1/session", R"({"operator":"bob","passphrase":"open"})");
  ASSERT_TRUE(in.sign_in) << in.body;
  EXPECT_EQ(in.sign_in->who, 1U);
  EXPECT_EQ(in.sign_in->pass_phrase->view(), "open");
  EXPECT_EQ(ask("POST", "/api/v1/session", R"({"operator":"eve","passphrase":"open"})").status, 404U);
  EXPECT_EQ(ask("POST", "/api/v1/session", R"({"operator":"bob"})").status, 400U);
  EXPECT_EQ(
      ask("POST", "/api/v1/session", R"({"operator":"bob","passphrase":")" + std::string(257, 'x') + "\"}").status,
      400U);
  EXPECT_TRUE(ask("DELETE", "/api/v1/session", "", 1).sign_out);
  EXPECT_EQ(ask("DELETE", "/api/v1/session").status, 403U);
}

TEST_F(SignedIn, WhatIsAskedOfMissionsSaysWhoAsks) {
  using Kind = MissionRequest::Kind;
  EXPECT_EQ(ask("GET", "/api/v1/missions").mission->kind, Kind::list);
  EXPECT_EQ(ask("GET", "/api/v1/missions/0a1b").mission->id, "0a1b");
  const ApiAnswer start = ask("POST", "/api/v1/missions/0a1b/start", "", 1);
  ASSERT_TRUE(start.mission) << start.body;
  EXPECT_EQ(start.mission->kind, Kind::start);
  EXPECT_EQ(start.mission->by, operators[1].identity);
  EXPECT_EQ(start.mission->asker, "bob");
  EXPECT_EQ(ask("DELETE", "/api/v1/missions/0a1b", "", 1).mission->kind, Kind::remove);
  for (const char* verb : {"approve", "withdraw", "start", "pause", "resume"})
    EXPECT_EQ(ask("POST", std::string("/api/v1/missions/0a1b/") + verb).status, 403U) << verb;
  EXPECT_EQ(ask("POST", "/api/v1/missions", "{}").status, 403U);
  EXPECT_EQ(ask("DELETE", "/api/v1/missions/0a1b").status, 403U);
  EXPECT_EQ(ask("POST", "/api/v1/missions/0a1b/land").mission->kind, Kind::land) << "nobody has to sign in for that";
  EXPECT_EQ(ask("POST", "/api/v1/missions/0a1b/fly", "", 1).status, 404U);
  EXPECT_EQ(ask("POST", "/api/v1/missions/0a1b/start", "[]", 1).status, 400U);
  EXPECT_EQ(ask("PUT", "/api/v1/missions", "", 1).status, 405U);
  EXPECT_EQ(ask("POST", "/api/v1/missions?name=x", "{}", 1).status, 400U) << "JSON has its name within";
}

TEST_F(Api, AMissionComesAsJsonOrAsCsvWithAName) {
  const auto post = [&](std::string_view target, std::string_view type) {
    return answer({.method = "POST", .target = target, .body = "text", .content_type = type},
                  {names, drones, "{}", events, operators});
  };
  const auto csv = post("/api/v1/missions?name=survey", "text/csv; charset=utf-8");
  ASSERT_TRUE(csv.mission) << csv.body;
  EXPECT_TRUE(csv.mission->csv);
  EXPECT_EQ(csv.mission->name, "survey");
  EXPECT_EQ(csv.mission->text, "text");
  EXPECT_FALSE(post("/api/v1/missions", "application/json").mission->csv);
  EXPECT_EQ(body_limit("/api/v1/missions?name=x"), max_mission_body_bytes);
  EXPECT_EQ(body_limit("/api/v1/missions/0a/start"), max_body_bytes);
}

TEST_F(Api, WhereNobodySignsInThereIsNoCallToSign) {
  EXPECT_EQ(ask("POST", "/api/v1/drones/tello1/acquire").status, 404U);
  EXPECT_FALSE(ask("POST", "/api/v1/drones/tello1/takeoff").commands.at(0).by);
}

TEST(PendingCommands, NoActionIsLostAndTheNewestVelocityCounts) {
  PilotCommand waiting{.drone = 0, .velocity = Twist{{0.1, 0, 0}, {}}, .came_ns = 1, .takeoff = true};
  for (int i = 0; i < 2; ++i) merge({.drone = 0, .stop = true, .requests = {"stop, asked for by alice"}}, waiting);
  EXPECT_EQ(waiting.requests, std::vector<std::string>{"stop, asked for by alice"});
  EXPECT_TRUE(waiting.takeoff && waiting.stop && !waiting.cut);
  EXPECT_EQ(waiting.came_ns, 1);
  merge({.drone = 0, .pause = true}, waiting);
  merge({.drone = 0, .order = PilotOrder{.kind = PilotOrder::Kind::return_home}, .late = 2}, waiting);
  EXPECT_TRUE(waiting.pause && waiting.order);
  EXPECT_EQ(waiting.late, 2U);
  merge({.drone = 0, .velocity = Twist{{0.2, 0, 0}, {}}, .came_ns = 2}, waiting);
  EXPECT_EQ(waiting.velocity->linear_mps[0], 0.2);
  EXPECT_EQ(waiting.came_ns, 2);
  EXPECT_EQ(waiting.replaced, 1U);
}

}  // namespace
}  // namespace ledgerline::ground::service
