#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "tools/checks/core/drone.hpp"

namespace ledgerline::checks {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// All is well.
PreflightInputs good() {
  PreflightInputs inputs;
  inputs.link.fence.min_m = {-2, -2, 0};
  inputs.link.fence.max_m = {2, 2, 2};
  inputs.pose_source = "mocap";
  inputs.pose_topic = "/poses/{drone}";
  inputs.clock = {.known = true, .synchronised = true, .max_error_ms = 3};
  inputs.ledger = {.state = LedgerInputs::State::reached, .what = "a network of others"};
  for (const char* name : {"d1", "d2"}) {
    DroneInputs drone{.name = name, .address = "10.0.0.1", .there = true};
    drone.battery = 0.9;
    drone.state_hz = 10;
    drone.pose = PoseInputs{.age_ms = 8, .rate_hz = 100, .delay_ms = 5, .frame = "map", .position_m = {1, -1, 0}};
    drone.lease = LeaseInputs{.drone = name, .self = {"Org2MSP", "CN=pilot"}, .control = Control{}};
    inputs.drones.push_back(drone);
  }
  return inputs;
}

// The one line of a check; of d1 where it is a drone's.
Finding line_of(const PreflightInputs& inputs, const std::string& check) {
  const Findings lines = assess(inputs);
  const auto found = std::find_if(lines.begin(), lines.end(), [&](const Finding& line) {
    return line.check == check && (line.drone == "d1" || line.drone.empty());
  });
  if (found == lines.end()) return fine("", "no line");
  return *found;
}

void expect(const PreflightInputs& inputs, const std::string& check, Severity severity, const std::string& what,
            const std::string& cure) {
  const Finding line = line_of(inputs, check);
  EXPECT_EQ(line.severity, severity) << check << ": " << line.what;
  EXPECT_THAT(line.what, HasSubstr(what)) << check;
  EXPECT_EQ(line.problem.has_value(), severity != Severity::ok) << check;
  EXPECT_THAT(words({line}), HasSubstr(cure)) << check;
  EXPECT_EQ(anything_broken(assess(inputs)), severity == Severity::broken) << check;
}

TEST(PreflightCheck, WarnsOfAPathThatOnboardOdometryDoesNotLast) {
  PreflightInputs inputs = good();
  inputs.pose_source = "tello";
  inputs.link.drones = {{.name = "d1", .source = link::PoseSource::tello}};
  const double lasts_s = odometry_lasts_s(inputs.link.failsafe, inputs.link.drones[0].odometry, 4);
  EXPECT_NEAR(lasts_s, 17, 2) << "three sigma on both sides leave half a metre: 0.58 m each, at 3.5 cm/s";
  EXPECT_GT(odometry_lasts_s(inputs.link.failsafe, inputs.link.drones[0].odometry, 8), 2 * lasts_s - 1);
  inputs.path_s = lasts_s - 1;
  expect(inputs, "fence", Severity::ok, "x -2 to 2", "");
  inputs.path_s = 30;
  expect(inputs, "fence", Severity::warning, "4 m are too narrow for it, and its path takes 30 s", "a wider [fence]");
  EXPECT_EQ(line_of(inputs, "fence").problem, Problem::odometry_short) << "not what a drone says that is uncertain now";
  inputs.link.drones[0].source = link::PoseSource::pads;
  expect(inputs, "fence", Severity::ok, "x -2 to 2", "");
}

TEST(PreflightCheck, WhereAllIsWellNothingIsToBeCured) {
  const Findings lines = assess(good());
  for (const Finding& line : lines) {
    EXPECT_EQ(line.severity, Severity::ok) << line.check << ": " << line.what;
    EXPECT_FALSE(line.problem) << line.check;
  }
  EXPECT_EQ(lines.size(), 2 * 5 + 4);  // drone, battery, state, pose, lease; frame, fence, clocks, ledger
  EXPECT_FALSE(anything_broken(lines));
}

TEST(PreflightCheck, ADroneThatIsNotThereHasNoOtherFacts) {
  PreflightInputs inputs = good();
  inputs.drones[0].there = false;
  inputs.drones[0].interface = "wlan1";
  expect(inputs, "drone", Severity::broken, "10.0.0.1 behind wlan1", "find --address 10.0.0.1 --interface wlan1");
  for (const char* check : {"battery", "state", "pose"}) EXPECT_EQ(line_of(inputs, check).what, "no line");
  EXPECT_EQ(line_of(inputs, "lease").severity, Severity::ok);
}

TEST(PreflightCheck, AnotherDroneAtItsAddressIsNamed) {
  PreflightInputs inputs = good();
  inputs.drones[0].wanted_serial = "A123";
  expect(inputs, "drone", Severity::ok, "10.0.0.1", "");
  inputs.drones[0].serial = "B456";
  expect(inputs, "drone", Severity::broken, "says serial B456, not A123", "ledgerline tello find");
  inputs.drones[0].serial = "A123";
  expect(inputs, "drone", Severity::ok, "10.0.0.1", "");
}

TEST(PreflightCheck, APoseThatAgentRefusesIsNoPose) {
  PreflightInputs inputs = good();
  inputs.drones[0].pose->fault = "its orientation has the length 0.00, not 1";
  expect(inputs, "pose", Severity::broken, "100 a second: its orientation has the length 0.00",
         "three markers or more");
}

TEST(PreflightCheck, ABatteryIsEnoughLowOrTooLow) {
  PreflightInputs inputs = good();
  inputs.drones[0].battery = 0.4;
  expect(inputs, "battery", Severity::warning, "40 %", "charge");
  inputs.drones[0].battery = inputs.link.failsafe.battery_low;
  expect(inputs, "battery", Severity::broken, "15 %; battery_low is 15 %", "charge");
  inputs.drones[0].battery = 0.16;  // within link's margin
  inputs.drones[0].refusal = "battery_low";
  expect(inputs, "battery", Severity::broken, "16 %", "charge");
  inputs.drones[0].refusal.clear();
  inputs.drones[0].battery.reset();
  expect(inputs, "battery", Severity::warning, "10.0.0.1", "info 10.0.0.1");
}

TEST(PreflightCheck, ADroneThatIsHotOnTheGroundIsWarnedOf) {
  PreflightInputs inputs = good();
  EXPECT_EQ(line_of(inputs, "temperature").what, "no line") << "a firmware that does not say it";
  inputs.drones[0].temperature_c = 85;
  expect(inputs, "temperature", Severity::ok, "85 degrees", "");
  inputs.drones[0].temperature_c = 86;
  expect(inputs, "temperature", Severity::warning, "86 degrees", "let it cool");
}

TEST(PreflightCheck, StateTextThatIsRareOrMissing) {
  PreflightInputs inputs = good();
  inputs.drones[0].state_hz = 0;
  expect(inputs, "state", Severity::broken, "none at 0.0.0.0:8890", "firewall");
  inputs.drones[0].state_hz = 3;
  expect(inputs, "state", Severity::broken, "3.0 state texts a second", "nearer");
  inputs.drones[0].state_hz = 6;
  expect(inputs, "state", Severity::warning, "6.0 state texts a second", "nearer");
  inputs.drones[0].state_hz.reset();  // nobody counted
  EXPECT_EQ(line_of(inputs, "state").what, "no line");
}

TEST(PreflightCheck, PosesThatAreMissingOldOrRare) {
  PreflightInputs inputs = good();
  EXPECT_THAT(line_of(inputs, "pose").what,
              AllOf(HasSubstr("/poses/d1, 8 ms old: 1.00, -1.00, 0.00 m in \"map\""), HasSubstr("100 a second")));
  inputs.drones[0].pose->age_ms = 301;
  expect(inputs, "pose", Severity::broken, "301 ms old", "motion capture sees the drone");
  inputs.drones[0].pose->age_ms = 8;
  inputs.drones[0].refusal = "pose_lost";
  expect(inputs, "pose", Severity::broken, "none older than 300 ms", "motion capture sees the drone");
  inputs.drones[0].refusal.clear();
  inputs.drones[0].pose->rate_hz = 5;
  expect(inputs, "pose", Severity::broken, "5 a second", "publish more often");
  inputs.drones[0].pose->rate_hz = 20;
  expect(inputs, "pose", Severity::warning, "20 a second", "publish more often");
  inputs.drones[0].pose.reset();
  expect(inputs, "pose", Severity::broken, "agent has accepted no pose from /poses/d1", "start motion capture");
}

TEST(PreflightCheck, ADroneThatFliesByOdometryNeedsToReportAVelocity) {
  PreflightInputs inputs = good();
  inputs.pose_source = "tello";
  for (DroneInputs& drone : inputs.drones) drone.pose->frame.clear();
  expect(inputs, "pose", Severity::ok, "by onboard odometry (tello): 1.00, -1.00, 0.00 m", "");
  inputs.drones[0].refusal = "position_uncertain";
  expect(inputs, "pose", Severity::broken, "by onboard odometry (tello)", "on its mark");
  inputs.drones[0].refusal = "velocity_lost";
  expect(inputs, "pose", Severity::broken, "none that link accepts", "light");
  inputs.drones[0].refusal.clear();
  inputs.drones[0].has_velocity = false;
  expect(inputs, "pose", Severity::broken, "none that link accepts", "vgx");
}

TEST(PreflightCheck, OdometryThatStandsInForMotionCaptureNeedsBoth) {
  PreflightInputs inputs = good();
  inputs.pose_source = "mocap+tello";
  expect(inputs, "pose", Severity::ok, "/poses/d1", "");
  for (const char* refusal : {"velocity_lost", "position_uncertain"}) {
    PreflightInputs refused = inputs;
    refused.drones[0].refusal = refusal;
    expect(refused, "pose", Severity::broken, refusal, "motion capture sees the drone");
  }
  inputs.drones[0].has_velocity = false;
  expect(inputs, "senses", Severity::warning, "state text", "firmware");
}

TEST(PreflightCheck, TwoFramesAreNoCommonPlace) {
  PreflightInputs inputs = good();
  inputs.drones[1].pose->frame = "world";
  expect(inputs, "frame", Severity::broken, "d1 is in \"map\", d2 in \"world\"", "one frame");
}

TEST(PreflightCheck, WhatElseLinkRefusesIsNamedWithACure) {
  PreflightInputs inputs = good();
  EXPECT_EQ(line_of(inputs, "link").what, "no line");
  for (const char* cause : {"stopped", "state_stale", "agent_silent", "ledger_silent", "ledger_untrusted", "tilted",
                            "too_near", "other_client", "takeoff_refused_by_drone", "fence", "of_tomorrow"}) {
    inputs.drones[0].refusal = cause;
    expect(inputs, "link", Severity::broken, cause, " ");
  }
  inputs.drones[0].phase = "flying";
  expect(inputs, "link", Severity::broken, "flying", "ledgerline tello land 10.0.0.1");
}

Control held_by(const std::string& msp_id, const std::string& subject) {
  Control control;
  control.mutable_holder()->set_msp_id(msp_id);
  control.mutable_holder()->set_subject(subject);
  return control;
}

TEST(PreflightCheck, ALeaseIsOursFreeOrSomebodyElses) {
  PreflightInputs inputs = good();
  expect(inputs, "lease", Severity::ok, "free", "");
  LeaseInputs& lease = *inputs.drones[0].lease;
  lease.control = held_by("Org2MSP", "CN=pilot");
  expect(inputs, "lease", Severity::ok, "ours", "");
  lease.control->add_stoppers()->mutable_stopper()->set_msp_id("Org1MSP");
  expect(inputs, "lease", Severity::broken, "stopped by Org1MSP", "ledgerline control clear_stop d1");
  lease.control = held_by("Org3MSP", "CN=pilot");
  expect(inputs, "lease", Severity::broken, "held by Org3MSP CN=pilot", "ledgerline control request d1");
  lease.control->mutable_delegate()->set_msp_id("Org2MSP");
  expect(inputs, "lease", Severity::broken, "held by Org3MSP CN=pilot, priority 0, who lets Org2MSP", "acquire");
  lease.control->mutable_delegate()->set_subject("CN=pilot");
  expect(inputs, "lease", Severity::ok, "ours to command: held by Org3MSP CN=pilot", "");
  lease.control.reset();
  expect(inputs, "lease", Severity::broken, "no record", "ledgerline control --config admin.toml enroll");
  lease.enrols = true;
  expect(inputs, "lease", Severity::ok, "not enrolled yet", "");
}

TEST(PreflightCheck, AFenceHasTheDronesAndThePathInside) {
  PreflightInputs inputs = good();
  inputs.path = Error{"square with --side 8: d1 would be at 8, 0, 1 m"};
  expect(inputs, "fence", Severity::broken, "d1 would be at 8, 0, 1 m", "smaller side");
  for (const double away_m : {2.1, -2.1, std::numeric_limits<double>::quiet_NaN()}) {
    inputs.drones[0].pose->position_m[1] = away_m;
    expect(inputs, "fence", Severity::broken, "d1 at ", "same origin");
  }
  inputs.path = done;
  inputs.drones[0].pose->position_m = {0, 0, -0.05};  // a floor that is not quite z = 0
  expect(inputs, "fence", Severity::ok, "x -2 to 2, y -2 to 2, z 0 to 2 m", "");
}

TEST(PreflightCheck, ClocksThatDiffer) {
  PreflightInputs inputs = good();
  expect(inputs, "clock", Severity::ok, "synchronised within 3.0 ms", "");
  inputs.clock.synchronised = false;
  expect(inputs, "clock", Severity::warning, "by the kernel's own word", "chrony");
  inputs.clock.known = false;
  expect(inputs, "clock", Severity::warning, "does not report it", "chrony");
  inputs.drones[0].pose->delay_ms = -21;
  expect(inputs, "clock", Severity::broken, "d1's are 21 ms ahead", "chrony");
  inputs.drones[0].pose->delay_ms = 1001;
  expect(inputs, "clock", Severity::broken, "1001 ms behind", "arrival");
  inputs.stamps_count = false;
  expect(inputs, "clock", Severity::warning, "does not report it", "chrony");
}

TEST(PreflightCheck, ALedgerIsReachedStartedOrNot) {
  PreflightInputs inputs = good();
  inputs.ledger = {.state = LedgerInputs::State::starts, .what = "embedded"};
  expect(inputs, "ledger", Severity::ok, "embedded: the flight starts it", "");
  inputs.ledger = {.state = LedgerInputs::State::failed, .what = "control: no route"};
  expect(inputs, "ledger", Severity::broken, "control: no route", "endpoint");
}

TEST(PreflightCheck, LinesForPeopleAndForPrograms) {
  PreflightInputs inputs = good();
  inputs.drones[0].battery = 0.1;
  const Findings lines = assess(inputs);
  EXPECT_THAT(words(lines),
              AllOf(HasSubstr("\nbroken   battery     battery_low: d1: 10 %"),
                    HasSubstr("\n                     cure: charge"), HasSubstr("\nok       battery     d2: 90 %")));
  EXPECT_THAT(check(lines).error().message, testing::StartsWith("d1's battery: 10 %"));
  const auto json = nlohmann::json::parse(to_json(lines));
  EXPECT_EQ(json["ok"], false);
  ASSERT_EQ(json["checks"].size(), lines.size());
  EXPECT_EQ(json["checks"][2], nlohmann::json::parse(R"({"drone":"d1","check":"battery","verdict":"broken",)"
                                                     R"("problem":"battery_low","what":"10 %; battery_low is 15 %",)"
                                                     R"("cure":"charge or change the battery"})"));
  EXPECT_EQ(nlohmann::json::parse(to_json(assess(good())))["ok"], true);
}

}  // namespace
}  // namespace ledgerline::checks
