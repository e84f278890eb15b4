#include "tools/launcher/options.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "common/base/file.hpp"

namespace ledgerline::launcher {
namespace {

using testing::HasSubstr;

void expect_refused(const std::vector<std::string>& arguments, const std::string& words) {
  const auto line = parse_command_line(arguments);
  EXPECT_FALSE(line.fly);
  EXPECT_EQ(line.exit_code, 2);
  EXPECT_THAT(line.text, HasSubstr(words));
}

TEST(FlyOptions, OnTheEmbeddedLedgerAgentEndorsesUnlessTheGatewayIsAskedFor) {
  EXPECT_TRUE(parse_command_line({}).options.endorser_within);
  EXPECT_FALSE(parse_command_line({"--gateway"}).options.endorser_within);
  EXPECT_FALSE(parse_command_line({"--ledger", "fabric"}).options.endorser_within);
  EXPECT_FALSE(parse_command_line({"--ledger", "none"}).options.endorser_within);
}

TEST(FlyOptions, DefaultsAreOneDroneThreeLapsOfASquareOnTheEmbeddedLedger) {
  const auto line = parse_command_line({});
  EXPECT_TRUE(line.fly);
  EXPECT_EQ(line.options.shape, ground::Shape::square);
  EXPECT_EQ(line.options.drones, 1);
  EXPECT_EQ(line.options.rate_hz, 30);
  EXPECT_EQ(line.options.speed_mps, 0.5);
  EXPECT_EQ(line.options.laps, 3);
  EXPECT_EQ(line.options.seconds, 0);
  EXPECT_EQ(line.options.ledger, Ledger::embedded);
  EXPECT_EQ(line.options.batch_timeout_ns, 10 * ns_per_ms);
  EXPECT_EQ(line.options.batch_count, 1);
  EXPECT_EQ(line.options.seed, 1u);
}

TEST(FlyOptions, EveryOptionIsTaken) {
  const auto line =
      parse_command_line({"--shape", "x", "--drones", "16",       "--rate",          "50",   "--speed",       "1.5",
                          "--laps",  "7", "--ledger", "embedded", "--batch-timeout", "2s",   "--batch-count", "10",
                          "--seed",  "9", "--json",   "r.json",   "--out",           "there"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_EQ(line.options.shape, ground::Shape::x);
  EXPECT_EQ(line.options.drones, 16);
  EXPECT_EQ(line.options.rate_hz, 50);
  EXPECT_EQ(line.options.speed_mps, 1.5);
  EXPECT_EQ(line.options.laps, 7);
  EXPECT_EQ(line.options.batch_timeout_ns, 2 * ns_per_s);
  EXPECT_EQ(line.options.batch_count, 10);
  EXPECT_EQ(line.options.seed, 9u);
  EXPECT_EQ(line.options.json, "r.json");
  EXPECT_EQ(line.options.out, "there");
}

std::string deployment_file(const std::string& address) {
  std::string toml = "[ledger]\nkind = \"fabric\"\n[[host]]\nname = \"ground\"\naddress = \"" + address +
                     "\"\nroles = [\"drone-host\", \"ground\", \"ledger\"]\n";
  for (const char* id : {"Org1MSP", "Org2MSP", "Org3MSP"})
    toml += "[[organisation]]\nid = \"" + std::string(id) + "\"\nhost = \"ground\"\n";
  for (int i = 0; i < 3; ++i) toml += "[[orderer]]\nhost = \"ground\"\n";
  for (const char* number : {"1", "2"})
    toml += "[[drone]]\nname = \"tello" + std::string(number) + "\"\nhost = \"ground\"\naddress = \"127.0.0." +
            std::to_string(number[0] - '0' + 1) + "\"\n";
  const std::string file = testing::TempDir() + "/deployment.toml";
  EXPECT_TRUE(write_file(file, toml));
  return file;
}

TEST(FlyOptions, ADeploymentSaysDronesLedgerAndOrderers) {
  const std::string file = deployment_file("127.0.0.1");
  const auto line = parse_command_line({"--deployment", file, "--gateway"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_EQ(line.options.drones, 2);
  EXPECT_EQ(line.options.ledger, Ledger::fabric);
  EXPECT_EQ(line.options.orderers, 3);
  expect_refused({"--deployment", file, "--drones", "2"}, "--drones excludes --deployment");
  expect_refused({"--deployment", file, "--ledger", "fabric"}, "--ledger excludes --deployment");
  expect_refused({"--deployment", file, "--orderers", "3"}, "--orderers excludes --deployment");
}

TEST(FlyOptions, ADeploymentBeyondThisHostIsRefusedWithItsPlace) {
  const std::string file = deployment_file("10.0.0.1");
  expect_refused({"--deployment", file}, "deployment.toml:5: host.0.address: is 10.0.0.1: a flight on one host");
  expect_refused({"--deployment", "/no/such/file"}, "/no/such/file");
}

TEST(FlyOptions, ADeploymentWithoutHostsIsOfItsOwnDrones) {
  const std::string file = testing::TempDir() + "/own_deployment.toml";
  const std::string good =
      "[[drone]]\nname = \"heron\"\naddress = \"192.168.10.1\"\n[pose]\nsource = \"mocap\"\n"
      "[fence]\nmin_m = [-2, -2, 0]\nmax_m = [2, 2, 2]\n";
  ASSERT_TRUE(write_file(file, good + "[flight]\nshape = \"triangle\"\nspeed_mps = 0.3\nlaps = 2\n"));
  const auto line = parse_command_line({"--deployment", file, "--speed", "0.4"});
  ASSERT_TRUE(line.fly) << line.text;
  ASSERT_TRUE(line.options.own);
  EXPECT_EQ(line.options.drones, 1);
  EXPECT_EQ(drone_name(line.options, 1), "heron");
  EXPECT_EQ(line.options.shape, ground::Shape::triangle);
  EXPECT_EQ(line.options.speed_mps, 0.4) << "what is said on the command line counts more";
  EXPECT_EQ(line.options.laps, 2);
  EXPECT_EQ(line.options.ledger, Ledger::embedded);
  expect_refused({"--deployment", file, "--proxy"}, "--proxy stands between simulated drones");
  expect_refused({"--deployment", file, "--watch", "--fault-switches"},
                 "--fault-switches are of the proxy before simulated");
  expect_refused({"--deployment", file, "--seed", "3"}, "--seed is the simulator's");
  ASSERT_TRUE(write_file(file, good + "[flight]\nshape = \"manual\"\n"));
  EXPECT_TRUE(parse_command_line({"--deployment", file}).options.manual);
  const std::string blind =
      "[[drone]]\nname = \"heron\"\naddress = \"192.168.10.1\"\n[pose]\nsource = \"none\"\n"
      "[fence]\nmin_m = [-2, -2, 0]\nmax_m = [2, 2, 2]\n[flight]\nshape = ";
  ASSERT_TRUE(write_file(file, blind + "\"manual\"\n"));
  EXPECT_TRUE(parse_command_line({"--deployment", file}).fly);
  ASSERT_TRUE(write_file(file, blind + "\"square\"\n"));
  expect_refused({"--deployment", file}, "a path needs poses");
  expect_refused({"--pose", "none"}, "a path needs poses");
  EXPECT_TRUE(parse_command_line({"--pose", "none", "--shape", "manual"}).fly);
  ASSERT_TRUE(write_file(file, good + "[flight]\nlapses = 2\n"));
  expect_refused({"--deployment", file}, "own_deployment.toml:10: flight.lapses: unknown key");
}

TEST(FlyOptions, PeersForWhomNobodyWaitsStepBack) {
  const auto step_back = [](std::vector<std::string> words) {
    words.insert(words.end(), {"--ledger", "fabric"});
    return waits_for_no_peer(parse_command_line(words).options);
  };
  EXPECT_FALSE(step_back({}));
  EXPECT_FALSE(step_back({"--blocks", "ordered"})) << "the own peer endorses";
  EXPECT_FALSE(step_back({"--endorser-within"})) << "the own peer's blocks are waited for";
  EXPECT_FALSE(step_back({"--endorser", "--blocks", "ordered"})) << "the endorser follows the peer";
  EXPECT_TRUE(step_back({"--endorser-within", "--blocks", "ordered"}));
}

TEST(FlyOptions, EachLedgerNeedsRoomOfItsOwn) {
  EXPECT_EQ(min_ledger_bytes(parse_command_line({"--ledger", "none"}).options), 0u);
  const auto embedded = min_ledger_bytes(parse_command_line({}).options);
  const auto fabric = min_ledger_bytes(parse_command_line({"--ledger", "fabric"}).options);
  EXPECT_GT(embedded, 0u);
  EXPECT_GT(fabric, embedded);
  EXPECT_GT(min_ledger_bytes(parse_command_line({"--ledger", "fabric", "--orderers", "3"}).options), fabric);
}

TEST(FlyOptions, TheLedgerMayLieInMemory) {
  EXPECT_FALSE(parse_command_line({}).options.tmpfs);
  EXPECT_TRUE(parse_command_line({"--storage", "tmpfs"}).options.tmpfs);
}

TEST(FlyOptions, AuthoritiesGoWithFabricAlone) {
  const auto line = parse_command_line({"--ledger", "fabric", "--ca"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_TRUE(line.options.ca);
  EXPECT_FALSE(parse_command_line({"--ledger", "fabric"}).options.ca);
  expect_refused({"--ca"}, "--ledger fabric");
}

TEST(FlyOptions, AProxyIsAskedForAndAScriptGoesWithOne) {
  EXPECT_FALSE(parse_command_line({}).options.proxy);
  EXPECT_TRUE(parse_command_line({"--proxy"}).options.proxy);
  EXPECT_EQ(parse_command_line({"--proxy", "--faults", "/dev/null"}).options.faults, "/dev/null");
  expect_refused({"--faults", "/dev/null"}, "--proxy");
  expect_refused({"--proxy", "--faults", "/no/such/file"}, "/no/such/file");
  expect_refused({"--proxy", "--ledger", "none"}, "--ledger none");
}

TEST(FlyOptions, EachLedgerHasAGateway) {
  EXPECT_TRUE(parse_command_line({"--ledger", "fabric", "--gateway"}).options.gateway);
  EXPECT_TRUE(parse_command_line({"--gateway"}).options.gateway);
  expect_refused({"--ledger", "none", "--gateway"}, "goes with a ledger");
}

TEST(FlyOptions, DronesAndGroundMayHaveDomainsOfTheirOwn) {
  EXPECT_THAT(parse_command_line({}).options.domains, testing::IsEmpty());
  EXPECT_THAT(parse_command_line({"--domains", "31,232"}).options.domains, testing::ElementsAre(31, 232));
  expect_refused({"--domains", "31"}, "At least 2");
  expect_refused({"--domains", "31,32,33"}, "At Most 2");
  expect_refused({"--domains", "31,233"}, "233");
}

TEST(FlyOptions, DdsLeavesThisMachineOnlyByAFile) {
  EXPECT_EQ(parse_command_line({}).options.cyclonedds, "");
  EXPECT_EQ(parse_command_line({"--dds", "/dev/null"}).options.cyclonedds, "/dev/null");
  expect_refused({"--dds", "/nowhere/lan.xml"}, "/nowhere/lan.xml");
}

TEST(FlyOptions, RosReleaseIsOneThatThereIsAndNotBesideAFileOfCyclones) {
  EXPECT_EQ(parse_command_line({}).options.ros_release, "");
  EXPECT_EQ(parse_command_line({"--ros-release", "jazzy"}).options.ros_release, "jazzy");
  expect_refused({"--ros-release", "noetic"}, "jazzy");
  expect_refused({"--ros-release", "jazzy", "--dds", "/dev/null"}, "--dds");
}

TEST(FlyOptions, SwitchesOfFaultsAreOfThePageAndBringTheProxy) {
  const auto line = parse_command_line({"--shape", "manual", "--watch", "--fault-switches"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_TRUE(line.options.proxy);
  EXPECT_FALSE(parse_command_line({"--shape", "manual", "--watch"}).options.proxy);
  expect_refused({"--fault-switches"}, "--watch");
  for (const char* wrong : {"nowhere", "0.0.0.0", "192.0.2.1"})  // the last is of documents, and of no computer
    expect_refused({"--watch", "--listen", wrong}, "--listen: " + std::string(wrong) + " is no address");
  expect_refused({"--watch", "--fault-switches", "--shim"}, "behind --shim there is none");
  expect_refused({"--watch", "--fault-switches", "--ledger", "none"}, "--ledger none");
}

TEST(FlyOptions, TwoApprovalsNeedTwoOperators) {
  const std::vector<std::string> page{"--shape", "manual", "--watch"};
  const auto with = [&](std::initializer_list<const char*> more) {
    std::vector<std::string> all = page;
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  EXPECT_EQ(parse_command_line(with({"--operators", "a,b"})).options.approvals, 1);
  const auto line = parse_command_line(with({"--operators", "a,b", "--approvals", "2"}));
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_EQ(line.options.approvals, 2);
  expect_refused(with({"--operators", "a", "--approvals", "2"}), "--approvals 2 needs two different --operators");
  expect_refused(with({"--operators", "a,a", "--approvals", "2"}), "--approvals 2 needs two different --operators");
  expect_refused(with({"--operators", "a,b,c", "--approvals", "3"}), "--approvals");
  expect_refused(with({"--approvals", "2"}), "--operators");
}

TEST(FlyOptions, AManualFlightHasNoPathAndNoLaps) {
  const auto line = parse_command_line({"--shape", "manual", "--seconds", "60"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_TRUE(line.options.manual);
  EXPECT_EQ(shape_name(line.options), "manual");
  expect_refused({"--shape", "manual", "--laps", "2"}, "--laps goes with a path");
  expect_refused({"--shape", "manual", "--predict", "off"}, "--predict goes with a path");
  expect_refused({"--shape", "manual", "--side", "2"}, "--side goes with a path");
}

TEST(FlyOptions, ADroneMayFlyATaskOfItsOwn) {
  const std::string file = testing::TempDir() + "/task_way.csv";
  ASSERT_TRUE(write_file(file, "0,0\n1,0\n1,1\n"));
  const auto line = parse_command_line({"--drones", "3", "--side", "2", "--task", "tello2 shape=triangle laps=1",
                                        "--task", "tello3 shape=" + file + " speed=0.25"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_EQ(task_of(line.options, 1).course.shape, ground::Shape::square);
  EXPECT_EQ(task_of(line.options, 2).course.shape, ground::Shape::triangle);
  EXPECT_EQ(task_of(line.options, 2).course.side_m, 2) << "what is left out is the flight's";
  EXPECT_EQ(task_of(line.options, 2).course.laps, 1);
  EXPECT_EQ(task_of(line.options, 3).course.waypoints.size(), 3u);
  EXPECT_EQ(task_of(line.options, 3).file, file);
  EXPECT_DOUBLE_EQ(path_of(line.options, 2, {0, 0}).length_m(), 6);
  expect_refused({"--task", "tello2 laps=1"}, "names none of the 1 drones");
  expect_refused({"--task", "tello1 laps=0"}, "\"laps=0\" is none of shape=SHAPE_OR_FILE");
  expect_refused({"--task", "tello1 shape=circle"}, "none of square, triangle, x, eight, nor a file");
  expect_refused({"--shape", "sqare"}, "none of square, triangle, x, eight, manual, nor a file of waypoints: did you");
  expect_refused({"--shape", "manul"}, "did you mean manual?");
  const std::string far = testing::TempDir() + "/task_far.csv";
  ASSERT_TRUE(write_file(far, "0,0\n30,0\n30,1\n"));
  expect_refused({"--task", "tello1 shape=" + far}, far + ":2: tello1 would be at 30, 0, 1 m, beyond link's fence");
  expect_refused({"--shape", "manual", "--task", "tello1 laps=1"}, "--task goes with a path");
}

TEST(FlyOptions, AControllerOfOnesOwnTakesThePlaceOfOurs) {
  expect_refused({"--controller", "/nowhere/my.so"}, "/nowhere/my.so");
  expect_refused({"--controller", "/etc/hostname", "--predict", "off"}, "--controller takes its place");
  expect_refused({"--controller", "/etc/hostname", "--shape", "manual"}, "--controller goes with a path");
  EXPECT_EQ(parse_command_line({"--controller", "/etc/hostname"}).options.controller, "/etc/hostname");
}

TEST(FlyOptions, PredictionIsOnUnlessItIsSwitchedOff) {
  EXPECT_TRUE(parse_command_line({}).options.predict);
  EXPECT_FALSE(parse_command_line({"--predict", "off"}).options.predict);
  expect_refused({"--predict", "maybe"}, "predict");
}

TEST(FlyOptions, ARampHasAStartAndAStepAndLaps) {
  const auto line = parse_command_line({"--ramp", "0.5:0.1", "--side", "4", "--laps", "6", "--max-age", "3s"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_DOUBLE_EQ(line.options.ramp.start_mps, 0.5);
  EXPECT_DOUBLE_EQ(line.options.ramp.step_mps, 0.1);
  EXPECT_DOUBLE_EQ(line.options.side_m, 4);
  EXPECT_EQ(line.options.max_age_ns, 3 * ns_per_s);
  expect_refused({"--ramp", "fast"}, "\"fast\" is no START:STEP");
  expect_refused({"--ramp", "0.5:0.1", "--seconds", "9"}, "--ramp goes with a path and its laps");
}

TEST(FlyOptions, APathOfOnesOwnIsAFileOfWaypoints) {
  const std::string file = testing::TempDir() + "/way.csv";
  ASSERT_TRUE(write_file(file, "0,0\n1,0\n1,1\n"));
  const auto line = parse_command_line({"--shape", file});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_EQ(line.options.waypoints.size(), 3u);
  EXPECT_EQ(shape_name(line.options), "waypoints");
  EXPECT_NEAR(path_of(line.options, 1, {2, 3}).length_m(), 2 + std::sqrt(2.0), 1e-9);
  ASSERT_TRUE(write_file(file, "0,0\n1\n1,1\n"));
  expect_refused({"--shape", file}, "way.csv:2: 1 columns");
  expect_refused({"--shape", testing::TempDir()}, "there is no file");
}

TEST(FlyOptions, APathThatLeavesLinksFenceIsRefusedWithItsLine) {
  const std::string file = testing::TempDir() + "/high.csv";
  ASSERT_TRUE(write_file(file, "0,0,1\n# up\n1,0,3.5\n1,1\n"));
  expect_refused({"--shape", file}, "high.csv:3: tello1 would be at 1, 0, 3.5 m, beyond link's fence");
  expect_refused({"--shape", file}, "z 0 to 3 m");
  ASSERT_TRUE(write_file(file, "0,0\n18,0\n1,1\n"));
  EXPECT_TRUE(parse_command_line({"--shape", file}).fly);
  expect_refused({"--shape", file, "--drones", "2"}, "high.csv:2: tello2 would be at 21, 0, 1 m");
}

TEST(FlyOptions, AShapeThatLeavesLinksFenceIsRefused) {
  EXPECT_TRUE(parse_command_line({"--drones", "3", "--side", "12"}).fly);
  expect_refused({"--drones", "4", "--side", "12"}, "square with --side 12: tello4 would be at 21, 0, 1 m");
  EXPECT_TRUE(parse_command_line({"--drones", "16", "--shape", "manual"}).fly);
}

TEST(FlyOptions, WithoutALedgerNothingIsAskedOfOne) {
  const auto line = parse_command_line({"--ledger", "none"});
  ASSERT_TRUE(line.fly) << line.text;
  EXPECT_EQ(ledger_program(line.options), "");
  EXPECT_EQ(controller_program(line.options), "local");
  expect_refused({"--ledger", "none", "--batch-count", "3"}, "--batch-count goes with a ledger");
  expect_refused({"--ledger", "none", "--storage", "tmpfs"}, "--storage goes with a ledger");
  expect_refused({"--ledger", "none", "--shape", "manual"}, "--shape manual goes with a ledger");
}

TEST(FlyOptions, WhatCannotBeFlownIsRefusedInWords) {
  expect_refused({"--shape", "circle"}, "circle");
  expect_refused({"--drones", "0"}, "drones");
  expect_refused({"--drones", "17"}, "drones");
  expect_refused({"--rate", "fast"}, "rate");
  expect_refused({"--speed", "-1"}, "speed");
  expect_refused({"--laps", "0"}, "laps");
  expect_refused({"--ledger", "paper"}, "ledger");
  expect_refused({"--storage", "paper"}, "storage");
  expect_refused({"--batch-timeout", "soon"}, "no time from 1ms to 60s");
  expect_refused({"--laps", "3", "--seconds", "5"}, "seconds");
  expect_refused({"--unknown"}, "--unknown");
  expect_refused({"stray"}, "stray");
}

TEST(FlyOptions, HelpIsNoErrorAndShowsExamples) {
  const auto line = parse_command_line({"--help"});
  EXPECT_FALSE(line.fly);
  EXPECT_EQ(line.exit_code, 0);
  EXPECT_THAT(line.text, HasSubstr("Examples"));
  EXPECT_THAT(line.text, HasSubstr("--drones"));
  EXPECT_THAT(line.text, testing::Not(HasSubstr("--batch-timeout")));
  EXPECT_THAT(parse_command_line({"--help-all"}).text, HasSubstr("--batch-timeout"));
}

TEST(FlyOptions, DurationsHaveUnitsOrAreMilliseconds) {
  EXPECT_EQ(*parse_duration("10ms"), 10 * ns_per_ms);
  EXPECT_EQ(*parse_duration("2s"), 2 * ns_per_s);
  EXPECT_EQ(*parse_duration("0.5s"), 500 * ns_per_ms);
  EXPECT_EQ(*parse_duration("250"), 250 * ns_per_ms);
  for (const char* wrong : {"", "ms", "10 years", "-5ms", "0", "61s", "10msx", "nan", "1e99s"}) {
    EXPECT_FALSE(parse_duration(wrong)) << wrong;
  }
}

TEST(FlyOptions, PathsThatConfigsCannotHoldAreRefusedAtTheStart) {
  expect_refused({"--out", "/tmp/caf\xe9"}, "--out: /tmp/caf? is no UTF-8");
  const std::string file = testing::TempDir() + "caf\xe9.csv";
  ASSERT_TRUE(write_file(file, "0,0\n1,0\n1,1\n"));
  expect_refused({"--shape", file}, "--shape: ");
  expect_refused({"--shape", file}, "is no UTF-8");
  expect_refused({"--task", "tello1 shape=" + file}, "is no UTF-8");
  std::remove(file.c_str());
}

TEST(FlyOptions, NotesAPathThatMayHaveDecimalCommas) {
  const std::string file = testing::TempDir() + "/commas.csv";
  ASSERT_TRUE(write_file(file, "0,0,1,1\n1,2,1,1\n3,0,1,1\n"));
  const auto noted = parse_command_line({"--shape", file, "--task", "tello1 shape=" + file});
  ASSERT_EQ(noted.options.notes.size(), 2u) << noted.text;
  EXPECT_THAT(noted.options.notes[0], HasSubstr("commas.csv:1: read as x 0"));
  ASSERT_TRUE(write_file(file, "0,0,1,1\n1,0.5,1,1\n3,0,1,1\n"));
  EXPECT_TRUE(parse_command_line({"--shape", file}).options.notes.empty());
}

}  // namespace
}  // namespace ledgerline::launcher
