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
FlightFacts good() {
  FlightFacts facts;
  facts.link.fence.min_m = {-2, -2, 0};
  facts.link.fence.max_m = {2, 2, 2};
  facts.pose_source = "mocap";
  facts.pose_topic = "/poses/{drone}";
  facts.clock = {.known = true, .synchronised = true, .max_error_ms = 3};
  facts.ledger = {.state = LedgerFacts::State::reached, .what = "a network of others"};
  for (const char* name : {"d1", "d2"}) {
    DroneFacts drone{.name = name, .address = "10.0.0.1", .there = true};
    drone.battery = 0.9;
    drone.state_hz = 10;
    drone.pose = PoseFacts{.age_ms = 8, .rate_hz = 100, .delay_ms = 5, .frame = "map", .position_m = {1, -1, 0}};
    drone.lease = LeaseFacts{.drone = name, .self = {"Org2MSP", "CN=pilot"}, .control = Control{}};
    facts.drones.push_back(drone);
  }
  return facts;
}

// The one line of a check; of d1 where it is a drone's.
Finding line_of(const FlightFacts& facts, const std::string& check) {
  const Findings lines = assess(facts);
  const auto found = std::find_if(lines.begin(), lines.end(), [&](const Finding& line) {
    return line.check == check && (line.drone == "d1" || line.drone.empty());
  });
  if (found == lines.end()) return fine("", "no line");
  return *found;
}

void expect(const FlightFacts& facts, const std::string& check, Severity severity, const std::string& what,
            const std::string& cure) {
  const Finding line = line_of(facts, check);
  EXPECT_EQ(line.severity, severity) << check << ": " << line.what;
  EXPECT_THAT(line.what, HasSubstr(what)) << check;
  EXPECT_EQ(line.problem.has_value(), severity != Severity::ok) << check;
  EXPECT_THAT(words({line}), HasSubstr(cure)) << check;
  EXPECT_EQ(anything_broken(assess(facts)), severity == Severity::broken) << check;
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
  FlightFacts facts = good();
  facts.drones[0].there = false;
  facts.drones[0].interface = "wlan1";
  expect(facts, "drone", Severity::broken, "10.0.0.1 behind wlan1", "find --address 10.0.0.1 --interface wlan1");
  for (const char* check : {"battery", "state", "pose"}) EXPECT_EQ(line_of(facts, check).what, "no line");
  EXPECT_EQ(line_of(facts, "lease").severity, Severity::ok);
}

TEST(PreflightCheck, AnotherDroneAtItsAddressIsNamed) {
  FlightFacts facts = good();
  facts.drones[0].wanted_serial = "A123";
  expect(facts, "drone", Severity::ok, "10.0.0.1", "");
  facts.drones[0].serial = "B456";
  expect(facts, "drone", Severity::broken, "says serial B456, not A123", "ledgerline tello find");
  facts.drones[0].serial = "A123";
  expect(facts, "drone", Severity::ok, "10.0.0.1", "");
}

TEST(PreflightCheck, ABatteryIsEnoughLowOrTooLow) {
  FlightFacts facts = good();
  facts.drones[0].battery = 0.4;
  expect(facts, "battery", Severity::warning, "40 %", "charge");
  facts.drones[0].battery = facts.link.failsafe.battery_low;
  expect(facts, "battery", Severity::broken, "15 %; battery_low is 15 %", "charge");
  facts.drones[0].battery = 0.16;  // within link's margin
  facts.drones[0].refusal = "battery_low";
  expect(facts, "battery", Severity::broken, "16 %", "charge");
  facts.drones[0].refusal.clear();
  facts.drones[0].battery.reset();
  expect(facts, "battery", Severity::warning, "10.0.0.1", "info 10.0.0.1");
}

TEST(PreflightCheck, ADroneThatIsHotOnTheGroundIsWarnedOf) {
  FlightFacts facts = good();
  EXPECT_EQ(line_of(facts, "temperature").what, "no line") << "a firmware that does not say it";
  facts.drones[0].temperature_c = 85;
  expect(facts, "temperature", Severity::ok, "85 degrees", "");
  facts.drones[0].temperature_c = 86;
  expect(facts, "temperature", Severity::warning, "86 degrees", "let it cool");
}

TEST(PreflightCheck, StateTextThatIsRareOrMissing) {
  FlightFacts facts = good();
  facts.drones[0].state_hz = 0;
  expect(facts, "state", Severity::broken, "none at 0.0.0.0:8890", "firewall");
  facts.drones[0].state_hz = 3;
  expect(facts, "state", Severity::broken, "3.0 state texts a second", "nearer");
  facts.drones[0].state_hz = 6;
  expect(facts, "state", Severity::warning, "6.0 state texts a second", "nearer");
  facts.drones[0].state_hz.reset();  // nobody counted
  EXPECT_EQ(line_of(facts, "state").what, "no line");
}

TEST(PreflightCheck, PosesThatAreMissingOldOrRare) {
  FlightFacts facts = good();
  EXPECT_THAT(line_of(facts, "pose").what,
              AllOf(HasSubstr("/poses/d1, 8 ms old: 1.00, -1.00, 0.00 m in \"map\""), HasSubstr("100 a second")));
  facts.drones[0].pose->age_ms = 301;
  expect(facts, "pose", Severity::broken, "301 ms old", "motion capture sees the drone");
  facts.drones[0].pose->age_ms = 8;
  facts.drones[0].refusal = "pose_lost";
  expect(facts, "pose", Severity::broken, "none older than 300 ms", "motion capture sees the drone");
  facts.drones[0].refusal.clear();
  facts.drones[0].pose->rate_hz = 5;
  expect(facts, "pose", Severity::broken, "5 a second", "publish more often");
  facts.drones[0].pose->rate_hz = 20;
  expect(facts, "pose", Severity::warning, "20 a second", "publish more often");
  facts.drones[0].pose.reset();
  expect(facts, "pose", Severity::broken, "none has come from /poses/d1", "start motion capture");
}

TEST(PreflightCheck, ADroneThatFliesByOdometryNeedsToReportAVelocity) {
  FlightFacts facts = good();
  facts.pose_source = "tello";
  for (DroneFacts& drone : facts.drones) drone.pose->frame.clear();
  expect(facts, "pose", Severity::ok, "by onboard odometry (tello): 1.00, -1.00, 0.00 m", "");
  facts.drones[0].refusal = "position_uncertain";
  expect(facts, "pose", Severity::broken, "by onboard odometry (tello)", "on its mark");
  facts.drones[0].refusal = "velocity_lost";
  expect(facts, "pose", Severity::broken, "none that link accepts", "light");
  facts.drones[0].refusal.clear();
  facts.drones[0].has_velocity = false;
  expect(facts, "pose", Severity::broken, "none that link accepts", "vgx");
}

TEST(PreflightCheck, OdometryThatStandsInForMotionCaptureNeedsBoth) {
  FlightFacts facts = good();
  facts.pose_source = "mocap+tello";
  expect(facts, "pose", Severity::ok, "/poses/d1", "");
  for (const char* refusal : {"velocity_lost", "position_uncertain"}) {
    FlightFacts refused = facts;
    refused.drones[0].refusal = refusal;
    expect(refused, "pose", Severity::broken, refusal, "motion capture sees the drone");
  }
  facts.drones[0].has_velocity = false;
  expect(facts, "senses", Severity::warning, "state text", "firmware");
}

TEST(PreflightCheck, TwoFramesAreNoCommonPlace) {
  FlightFacts facts = good();
  facts.drones[1].pose->frame = "world";
  expect(facts, "frame", Severity::broken, "d1 is in \"map\", d2 in \"world\"", "one frame");
}

TEST(PreflightCheck, WhatElseLinkRefusesIsNamedWithACure) {
  FlightFacts facts = good();
  EXPECT_EQ(line_of(facts, "link").what, "no line");
  for (const char* cause : {"stopped", "state_stale", "agent_silent", "ledger_silent", "ledger_untrusted", "tilted",
                            "too_near", "other_client", "fence", "of_tomorrow"}) {
    facts.drones[0].refusal = cause;
    expect(facts, "link", Severity::broken, cause, " ");
  }
  facts.drones[0].phase = "flying";
  expect(facts, "link", Severity::broken, "flying", "ledgerline tello land 10.0.0.1");
}

Control held_by(const std::string& msp_id, const std::string& subject) {
  Control control;
  control.mutable_holder()->set_msp_id(msp_id);
  control.mutable_holder()->set_subject(subject);
  return control;
}

TEST(PreflightCheck, ALeaseIsOursFreeOrSomebodyElses) {
  FlightFacts facts = good();
  expect(facts, "lease", Severity::ok, "free", "");
  LeaseFacts& lease = *facts.drones[0].lease;
  lease.control = held_by("Org2MSP", "CN=pilot");
  expect(facts, "lease", Severity::ok, "ours", "");
  lease.control->add_stoppers()->mutable_stopper()->set_msp_id("Org1MSP");
  expect(facts, "lease", Severity::broken, "stopped by Org1MSP", "ledgerline control clear_stop d1");
  lease.control = held_by("Org3MSP", "CN=pilot");
  expect(facts, "lease", Severity::broken, "held by Org3MSP CN=pilot", "ledgerline control request d1");
  lease.control->mutable_delegate()->set_msp_id("Org2MSP");
  expect(facts, "lease", Severity::broken, "held by Org3MSP CN=pilot, priority 0, who lets Org2MSP", "acquire");
  lease.control->mutable_delegate()->set_subject("CN=pilot");
  expect(facts, "lease", Severity::ok, "ours to command: held by Org3MSP CN=pilot", "");
  lease.control.reset();
  expect(facts, "lease", Severity::broken, "no record", "ledgerline control --config admin.toml enroll");
  lease.enrols = true;
  expect(facts, "lease", Severity::ok, "not enrolled yet", "");
}

TEST(PreflightCheck, AFenceHasTheDronesAndThePathInside) {
  FlightFacts facts = good();
  facts.path = Error{"square with --side 8: d1 would be at 8, 0, 1 m"};
  expect(facts, "fence", Severity::broken, "d1 would be at 8, 0, 1 m", "smaller side");
  for (const double away_m : {2.1, -2.1, std::numeric_limits<double>::quiet_NaN()}) {
    facts.drones[0].pose->position_m[1] = away_m;
    expect(facts, "fence", Severity::broken, "d1 at ", "same origin");
  }
  facts.path = done;
  facts.drones[0].pose->position_m = {0, 0, -0.05};  // a floor that is not quite z = 0
  expect(facts, "fence", Severity::ok, "x -2 to 2, y -2 to 2, z 0 to 2 m", "");
}

TEST(PreflightCheck, ClocksThatDiffer) {
  FlightFacts facts = good();
  expect(facts, "clock", Severity::ok, "synchronised within 3.0 ms", "");
  facts.clock.synchronised = false;
  expect(facts, "clock", Severity::warning, "by the kernel's own word", "chrony");
  facts.clock.known = false;
  expect(facts, "clock", Severity::warning, "does not report it", "chrony");
  facts.drones[0].pose->delay_ms = -21;
  expect(facts, "clock", Severity::broken, "d1's are 21 ms ahead", "chrony");
  facts.drones[0].pose->delay_ms = 1001;
  expect(facts, "clock", Severity::broken, "1001 ms behind", "arrival");
  facts.stamps_count = false;
  expect(facts, "clock", Severity::warning, "does not report it", "chrony");
}

TEST(PreflightCheck, ALedgerIsReachedStartedOrNot) {
  FlightFacts facts = good();
  facts.ledger = {.state = LedgerFacts::State::starts, .what = "embedded"};
  expect(facts, "ledger", Severity::ok, "embedded: the flight starts it", "");
  facts.ledger = {.state = LedgerFacts::State::failed, .what = "control: no route"};
  expect(facts, "ledger", Severity::broken, "control: no route", "endpoint");
}

TEST(PreflightCheck, LinesForPeopleAndForPrograms) {
  FlightFacts facts = good();
  facts.drones[0].battery = 0.1;
  const Findings lines = assess(facts);
  EXPECT_THAT(words(lines),
              AllOf(HasSubstr("\nbroken   battery     battery_low: d1: 10 %"),
                    HasSubstr("\n                     cure: charge"), HasSubstr("\nok       battery     d2: 90 %")));
  EXPECT_THAT(check(lines).error().message, testing::StartsWith("d1's battery: 10 %"));
  const auto json = nlohmann::json::parse(to_json(lines));
  EXPECT_EQ(json["ok"], false);
  ASSERT_EQ(json["checks"].size(), lines.size());
  EXPECT_EQ(json["checks"][1], nlohmann::json::parse(R"({"drone":"d1","check":"battery","verdict":"broken",)"
                                                     R"("problem":"battery_low","what":"10 %; battery_low is 15 %",)"
                                                     R"("cure":"charge or change the battery"})"));
  EXPECT_EQ(nlohmann::json::parse(to_json(assess(good())))["ok"], true);
}

}  // namespace
}  // namespace ledgerline::checks
