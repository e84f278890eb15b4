#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

using testing::MatchesRegex;

TEST(Sdk, NothingIsHeardBeforeCommand) {
  Flight flight;
  EXPECT_EQ(flight.ask("battery?", 1), "");
  EXPECT_EQ(flight.ask("takeoff", 3), "");
  EXPECT_TRUE(flight.states.empty());
  EXPECT_EQ(flight.ask("command\r\n", 1), "ok");
  EXPECT_EQ(flight.ask("battery?", 1), "100\r\n");
}

TEST(Sdk, AnswersGoToTheSenderAndStateToTheLastOneThatSentCommand) {
  Flight flight;
  const Endpoint first{0x0a000005, 38065}, second{0x0a000006, 8889};
  flight.ask("command", 1, 1, first);
  EXPECT_EQ(flight.answers[0].to, first);
  flight.run(0.3);
  EXPECT_EQ(flight.states.back().to, (Endpoint{first.address, 8890}));
  flight.ask("command", 1, 1, second);
  flight.ask("battery?", 1, 1, first);
  EXPECT_EQ(flight.answers[0].to, first);
  flight.run(0.3);
  EXPECT_EQ(flight.states.back().to, (Endpoint{second.address, 8890}));
}

TEST(Sdk, StateComesTenTimesASecondInTheSdksForm) {
  Flight flight;
  flight.ask("command");
  flight.states.clear();
  flight.run(3);
  EXPECT_NEAR(static_cast<double>(flight.states.size()), 30, 1);
  EXPECT_THAT(
      flight.states[0].bytes,
      MatchesRegex(
          "mid:-2;x:-200;y:-200;z:-200;mpry:-1,-1,-1;pitch:-?[0-9]+;roll:-?[0-9]+;yaw:-?[0-9]+;vgx:-?[0-9]+;"
          "vgy:-?[0-9]+;vgz:-?[0-9]+;templ:[0-9]+;temph:[0-9]+;tof:10;h:0;bat:[0-9]+;baro:-?[0-9]+[.][0-9][0-9];"
          "time:0;agx:-?[0-9]+[.][0-9][0-9];agy:-?[0-9]+[.][0-9][0-9];agz:-[0-9]+[.][0-9][0-9];\r\n"));
  EXPECT_NEAR(std::stod(fields(flight.states.back().bytes)["agz"]), -1000, 20);
  EXPECT_EQ(flight.ask("mon"), "ok");
  flight.run(0.2);
  EXPECT_EQ(flight.states.back().bytes.rfind("mid:-1;x:-100;y:-100;z:-100;", 0), 0u);
  EXPECT_EQ(flight.ask("moff"), "ok");
  flight.run(0.2);
  EXPECT_EQ(flight.states.back().bytes.rfind("mid:-2;", 0), 0u);
}

TEST(Sdk, StateAgreesWithTheFlight) {
  Flight flight;
  flight.take_off();
  flight.ask("cw 90");
  flight.tell("rc 0 60 0 0");
  flight.run(2);
  auto state = fields(flight.states.back().bytes);
  EXPECT_NEAR(std::stoi(state["yaw"]), 90, 3) << "clockwise is positive";
  EXPECT_EQ(std::stoi(state["vgy"]), -6) << "south, in dm/s";
  EXPECT_EQ(state["h"], "100");
  EXPECT_NEAR(std::stoi(state["tof"]), 100, 5);
  EXPECT_GT(std::stoi(state["time"]), 3);
  flight.tell("rc 0 100 0 0");
  flight.run(0.2);
  EXPECT_LT(std::stoi(fields(flight.states.back().bytes)["pitch"]), -3) << "nose down while it speeds up";
}

TEST(Sdk, StateCanGoToAnotherPort) {
  Flight flight;
  flight.ask("command");
  EXPECT_EQ(flight.ask("port 9000 11111"), "ok");
  EXPECT_EQ(flight.ask("port 80 11111"), "out of range");
  EXPECT_EQ(flight.ask("port 9000"), "error");
  flight.run(0.3);
  EXPECT_EQ(flight.states.back().to.port, 9000);
}

TEST(Sdk, QueriesAnswerAsTheFirmwareDoes) {
  Flight flight;
  flight.take_off();
  const std::map<std::string, std::string> answers{{"battery?", "[0-9]+\r\n"},
                                                   {"speed?", "100[.]0\r\n"},
                                                   {"time?", "[0-9]+s\r\n"},
                                                   {"wifi?", "[0-9]+\r\n"},
                                                   {"sdk?", "20\r\n"},
                                                   {"sn?", "[0-9A-Z]+\r\n"},
                                                   {"height?", "10dm\r\n"},
                                                   {"temp?", "[0-9]+~[0-9]+C\r\n"},
                                                   {"attitude?", "pitch:-?[0-9]+;roll:-?[0-9]+;yaw:-?[0-9]+;\r\n"},
                                                   {"baro?", "-?[0-9]+[.][0-9]+\r\n"},
                                                   {"acceleration?", "agx:-?[0-9.]+;agy:-?[0-9.]+;agz:-[0-9.]+;\r\n"},
                                                   {"tof?", "[0-9]+mm\r\n"},
                                                   {"hardware?", ".+\r\n"},
                                                   {"active?", ".+\r\n"},
                                                   {"wifiversion?", ".+\r\n"},
                                                   {"ssid?", ".+\r\n"},
                                                   {"ap?", ".+\r\n"}};
  for (const auto& [query, answer] : answers) EXPECT_THAT(flight.ask(query, 0.01), MatchesRegex(answer)) << query;
}

TEST(Sdk, SettingsAndEduCommandsAreAccepted) {
  Flight flight;
  flight.ask("command");
  for (const char* text : {"command",      "keepalive",    "mon",          "moff",
                           "mdirection 0", "mdirection 2", "streamon",     "streamoff",
                           "speed 10",     "speed 100",    "motoron",      "motoroff",
                           "throwfly",     "setfps high",  "setbitrate 3", "setresolution low",
                           "downvision 1", "ap a b",       "wifi a b",     "EXT led 255 0 0",
                           "stop",         "emergency",    "land"})
    EXPECT_EQ(flight.ask(text, 0.01), "ok") << text;
}

struct Refused {
  const char* text;
  const char* answer;
};

TEST(Sdk, NonsenseIsRefusedInTheFirmwaresWordsAndWithoutAnOk) {
  Flight flight;
  flight.take_off();
  const Truth before = flight.truth();
  for (const Refused& r : std::initializer_list<Refused>{{"up 19", "out of range"},
                                                         {"up 501", "out of range"},
                                                         {"forward 0", "out of range"},
                                                         {"left -50", "out of range"},
                                                         {"up", "error"},
                                                         {"up x", "error"},
                                                         {"up 50 50", "error"},
                                                         {"up 50.5", "error"},
                                                         {"cw 0", "out of range"},
                                                         {"ccw 361", "out of range"},
                                                         {"cw 99999999999999999999", "error"},
                                                         {"go 20 -20 20 50", "out of range"},
                                                         {"go 501 0 0 50", "out of range"},
                                                         {"go 100 0 0 9", "out of range"},
                                                         {"go 100 0 0 101", "out of range"},
                                                         {"go 100 0 0", "error"},
                                                         {"go 100 0 0 50 m1", "error"},
                                                         {"go 100 0 0 50 x1", "error"},
                                                         {"curve 100 0 0 200 0 0 30", "error"},  // on a line
                                                         {"curve 25 25 0 50 0 0 30", "error"},   // radius 0.25 m
                                                         {"curve 100 100 0 200 0 0 61", "out of range"},
                                                         {"curve 100 100 0 600 0 0 30", "out of range"},
                                                         {"curve 100 100 0 200 0 0 30 m1", "error"},
                                                         {"jump 100 0 50 50 0 m1 m2", "error"},
                                                         {"flip x", "error"},
                                                         {"flip", "error"},
                                                         {"speed 9", "out of range"},
                                                         {"speed 101", "out of range"},
                                                         {"mdirection 3", "out of range"},
                                                         {"takeoff", "error"},
                                                         {"motoron", "error"},
                                                         {"reboot", "error"},
                                                         {"fly away", "unknown command: fly"},
                                                         {"token", "unknown command: "},
                                                         {"UP 50", "unknown command: UP"},
                                                         {"\xff\xfe", "unknown command: "}}) {
    EXPECT_EQ(flight.ask(r.text, 0.01), r.answer) << r.text;
  }
  EXPECT_EQ(flight.ask(std::string(300, 'x'), 0.01), "error");
  flight.run(1);
  EXPECT_NEAR(flight.truth().position_m[0], before.position_m[0], 0.05) << "and nothing moved";
}

struct MoveCase {
  const char* text;
  double x, y, z;
};

TEST(Sdk, MovesEndWhereTheyShouldAndAnswerThen) {
  for (const MoveCase& c : std::initializer_list<MoveCase>{{"forward 100", 1, 0, 1},
                                                           {"back 100", -1, 0, 1},
                                                           {"left 150", 0, 1.5, 1},
                                                           {"right 20", 0, -0.2, 1},
                                                           {"up 50", 0, 0, 1.5},
                                                           {"down 50", 0, 0, 0.5},
                                                           {"forward 500", 5, 0, 1},
                                                           {"go 100 -50 30 50", 1, -0.5, 1.3},
                                                           {"curve 100 100 0 200 0 50 60", 2, 0, 1.5}}) {
    Flight flight;
    flight.take_off();
    const TimeNs began = flight.now;
    ASSERT_EQ(flight.ask(c.text), "ok") << c.text;
    const Truth t = flight.truth();
    EXPECT_NEAR(t.position_m[0], c.x, 0.1) << c.text;
    EXPECT_NEAR(t.position_m[1], c.y, 0.1) << c.text;
    EXPECT_NEAR(t.position_m[2], c.z, 0.1) << c.text;
    EXPECT_LT(std::hypot(t.velocity_mps[0], t.velocity_mps[1], t.velocity_mps[2]), 0.2) << c.text;
    EXPECT_LT(to_seconds(flight.now - began), 7.0) << c.text << ": djitellopy would fly it again";
  }
}

TEST(Sdk, SpeedSetsHowFastMovesAre) {
  Flight flight;
  flight.take_off();
  ASSERT_EQ(flight.ask("speed 25"), "ok");
  EXPECT_EQ(flight.ask("speed?"), "25.0\r\n");
  const TimeNs began = flight.now;
  EXPECT_EQ(flight.ask("forward 100"), "ok");
  EXPECT_NEAR(to_seconds(flight.now - began), 4.3, 0.4);
}

TEST(Sdk, TurnsAreClockwiseForCw) {
  Flight flight;
  flight.take_off();
  EXPECT_EQ(flight.ask("cw 90"), "ok");
  EXPECT_NEAR(flight.truth().yaw_rad, -M_PI / 2, 0.05);
  EXPECT_EQ(flight.ask("ccw 180"), "ok");
  EXPECT_NEAR(flight.truth().yaw_rad, M_PI / 2, 0.05);
  EXPECT_EQ(flight.ask("cw 360"), "ok");
  EXPECT_NEAR(flight.truth().yaw_rad, M_PI / 2, 0.05);
}

TEST(Sdk, OneMoveAtATime) {
  Flight flight;
  flight.take_off();
  flight.answers.clear();
  flight.tell("forward 100");
  flight.run(0.5);
  flight.tell("up 50");
  flight.run(5);
  ASSERT_EQ(flight.answers.size(), 2u);
  EXPECT_EQ(flight.answers[0].bytes, "error Not joystick");
  EXPECT_EQ(flight.answers[1].bytes, "ok");
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.05);
}

TEST(Sdk, MovesAndFlipsOnTheGroundAreRefused) {
  Flight flight;
  flight.ask("command");
  for (const char* text : {"forward 50", "cw 90", "go 100 0 0 50", "curve 100 100 0 200 0 0 30", "flip l"})
    EXPECT_EQ(flight.ask(text, 0.01), "error Motor stop") << text;
}

TEST(Sdk, LandIsIgnoredDuringTakeoff) {
  Flight flight;
  flight.ask("command");
  flight.answers.clear();
  flight.tell("takeoff");
  flight.run(1.5);
  flight.tell("land");
  flight.run(6);
  ASSERT_EQ(flight.answers.size(), 1u);
  EXPECT_EQ(flight.answers[0].bytes, "ok");
  EXPECT_TRUE(flight.truth().in_flight);
}

TEST(Sdk, StopAndLandBreakOffAMoveAndEveryCommandIsAnsweredOnce) {
  Flight flight;
  flight.take_off();
  flight.answers.clear();
  flight.tell("forward 500");
  flight.run(1.5);
  flight.tell("stop");
  flight.run(3);
  const double x = flight.truth().position_m[0];
  EXPECT_LT(x, 2.0);
  flight.run(2);
  EXPECT_NEAR(flight.truth().position_m[0], x, 0.05) << "it hovers";
  flight.tell("back 200");
  flight.run(0.5);
  flight.tell("land");
  flight.run(8);
  std::vector<std::string> said;
  for (const Outgoing& answer : flight.answers) said.push_back(answer.bytes);
  EXPECT_EQ(said, (std::vector<std::string>{"error", "ok", "error", "ok"}));
  EXPECT_FALSE(flight.truth().motors_on);
}

TEST(Sdk, RcIsNeverAnsweredAndDoesNothingOnTheGround) {
  Flight flight;
  flight.ask("command");
  for (const char* text : {"rc 0 50 0 0", "rc", "rc 1 2 3", "rc 0 101 0 0", "rc a b c d", "rc 1 2 3 4 5"})
    EXPECT_EQ(flight.ask(text, 0.1), "") << text;
  flight.tell("rc 0 50 0 0");
  flight.run(2);
  EXPECT_NEAR(flight.truth().position_m[0], 0, 0.01);
  EXPECT_EQ(flight.ask("takeoff"), "ok");
  flight.run(2);
  EXPECT_NEAR(flight.truth().position_m[0], 0, 0.02) << "sticks from before takeoff are forgotten";
}

TEST(Sdk, RcDuringAMoveIsForgotten) {
  Flight flight;
  flight.take_off();
  flight.tell("forward 100");
  flight.run(0.5);
  flight.tell("rc 0 100 0 0");
  flight.run(5);
  EXPECT_NEAR(flight.truth().position_m[0], 1.0, 0.1);
}

TEST(Sdk, RcHoldsUntilTheNextOne) {
  Flight flight;
  flight.take_off();
  flight.tell("rc 0 0 0 50");
  flight.run(4);
  EXPECT_NEAR(std::remainder(flight.truth().yaw_rad + 50 * 4 * M_PI / 180, 2 * M_PI), 0, 0.15) << "clockwise";
  flight.tell("rc 0 30 0 0");
  flight.run(4);
  EXPECT_NEAR(std::hypot(flight.truth().velocity_mps[0], flight.truth().velocity_mps[1]), 0.3, 0.02);
  flight.tell("rc 0 0 0 0");
  flight.run(3);
  EXPECT_NEAR(std::hypot(flight.truth().velocity_mps[0], flight.truth().velocity_mps[1]), 0, 0.02);
}

TEST(Sdk, ItLandsByItselfAfterFifteenSecondsOfSilence) {
  Flight flight;
  flight.take_off();
  flight.run(14.9);
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.02);
  flight.run(5);
  EXPECT_FALSE(flight.truth().motors_on);
}

TEST(Sdk, AnyCommandKeepsItInTheAir) {
  for (const char* text : {"rc 0 0 0 0", "keepalive", "battery?", "nonsense"}) {
    Flight flight;
    flight.take_off();
    for (int i = 0; i < 4; ++i) {
      flight.run(12);
      flight.tell(text);
    }
    EXPECT_TRUE(flight.truth().in_flight) << text;
  }
}

TEST(Sdk, ATelloThatDoesNotKeepItsLastRcStopsByItself) {
  for (const bool keeps : {true, false}) {
    Parameters parameters = Flight::calm();
    parameters.sdk.keeps_rc = keeps;
    Flight flight(parameters);
    flight.take_off();
    const auto speed = [&] { return std::hypot(flight.truth().velocity_mps[0], flight.truth().velocity_mps[1]); };
    for (int i = 0; i < 20; ++i) {
      flight.tell("rc 0 50 0 0");
      flight.run(0.1);
    }
    EXPECT_NEAR(speed(), 0.5, 0.03);
    flight.run(parameters.sdk.rc_lasts_s + 2);
    EXPECT_NEAR(speed(), keeps ? 0.5 : 0, 0.03);
    flight.tell("rc 0 50 0 0");
    flight.run(0.4);
    EXPECT_GT(speed(), 0.2) << "a new one is flown again";
  }
}

TEST(Sdk, CommandMayBeNoSignOfLife) {
  for (const bool counts : {true, false}) {
    Parameters parameters = Flight::calm();
    parameters.sdk.command_counts = counts;
    Flight flight(parameters);
    flight.take_off();
    for (int i = 0; i < 6; ++i) {
      flight.run(3);
      EXPECT_EQ(flight.ask("command"), "ok");
    }
    EXPECT_EQ(flight.truth().in_flight && flight.truth().position_m[2] > 0.9, counts);
    flight.run(5);
    EXPECT_EQ(flight.truth().in_flight, counts);
  }
}

TEST(Sdk, EmergencyStopsTheMotorsAndIsAnswered) {
  Flight flight;
  flight.take_off();
  flight.answers.clear();
  flight.tell("forward 200");
  flight.run(0.5);
  flight.tell("emergency");
  flight.run(2);
  ASSERT_EQ(flight.answers.size(), 2u);
  EXPECT_EQ(flight.answers[0].bytes, "error Motor stop");
  EXPECT_EQ(flight.answers[1].bytes, "ok");
  EXPECT_FALSE(flight.truth().motors_on);
}

TEST(Sdk, ALowBatteryRefusesFlipsAndAnEmptyOneTakeoff) {
  Parameters p = Flight::calm();
  p.battery.start = 0.45;
  Flight flight(p);
  flight.take_off();
  EXPECT_EQ(flight.ask("flip l", 0.01), "error");
  p.battery.start = 0.05;
  Flight empty(p);
  empty.ask("command");
  EXPECT_EQ(empty.ask("takeoff", 0.01), "error");
}

TEST(Sdk, ATakeoffThatDoesNotGetUpIsBrokenOff) {
  Parameters p = Flight::calm();
  p.body.max_thrust_by_weight = 0.9;
  Flight heavy(p);
  heavy.ask("command");
  EXPECT_EQ(heavy.ask("takeoff", p.control.takeoff_limit_s + 0.1), "error");
  heavy.run(1);
  EXPECT_FALSE(heavy.truth().motors_on);
}

TEST(Sdk, ADroneThatRestartsInTheAirFallsAndWaitsForCommand) {
  Flight flight;
  flight.take_off();
  flight.simulator.restart(1);
  flight.run(1);
  EXPECT_FALSE(flight.truth().in_flight);
  EXPECT_LT(flight.truth().position_m[2], 0.1);
  EXPECT_EQ(flight.ask("battery?", 0.5), "");
  EXPECT_EQ(flight.ask("command", 0.5), "ok");
}

TEST(Sdk, ADrainedBatteryLandsTheDroneAndSaysSo) {
  Flight flight;
  flight.take_off();
  flight.simulator.set_battery(1, 0.1);
  flight.simulator.drain_battery(1, 0.02);
  EXPECT_NEAR(flight.truth().battery, 0.1, 0.001);
  flight.run(2);
  EXPECT_NEAR(flight.truth().battery, 0.06, 0.005);
  flight.run(5);
  EXPECT_FALSE(flight.truth().in_flight);
}

TEST(Sdk, WithoutAPropellerItTurnsOver) {
  Flight flight;
  flight.take_off();
  flight.simulator.remove_propeller(1);
  flight.run(2);
  EXPECT_TRUE(flight.truth().crashed);
  EXPECT_FALSE(flight.truth().motors_on);
}

TEST(Sdk, RebootLeavesSdkModeWithoutAnAnswer) {
  Flight flight;
  flight.ask("command");
  EXPECT_EQ(flight.ask("reboot", 0.5), "");
  EXPECT_EQ(flight.ask("battery?", 0.5), "");
  EXPECT_EQ(flight.ask("command", 0.5), "ok");
}

TEST(Sdk, DronesHaveEndpointsOfTheirOwn) {
  Parameters p = Flight::calm();
  p.drones = 3;
  Flight flight(p);
  EXPECT_EQ(flight.ask("command", 1, 2), "ok");
  EXPECT_EQ(flight.ask("battery?", 1, 1), "");
  EXPECT_EQ(flight.ask("takeoff", 20, 2), "ok");
  EXPECT_TRUE(flight.truth(2).in_flight);
  EXPECT_FALSE(flight.truth(1).in_flight);
  EXPECT_FALSE(flight.truth(3).in_flight);
}

}  // namespace
}  // namespace ledgerline::sim
