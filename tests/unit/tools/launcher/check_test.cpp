#include "tools/launcher/preflight/check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "tools/launcher/preflight/records.hpp"

namespace ledgerline::fly {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using Holder = LeaseFacts::Holder;

// All is well.
Facts good() {
  Facts facts;
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
    drone.lease.holder = Holder::free;
    facts.drones.push_back(drone);
  }
  return facts;
}

// The one line of a check; of d1 where it is a drone's.
Line line_of(const Facts& facts, const std::string& check) {
  const std::vector<Line> lines = assess(facts);
  const auto found = std::find_if(lines.begin(), lines.end(), [&](const Line& line) {
    return line.check == check && (line.drone == "d1" || line.drone.empty());
  });
  if (found == lines.end()) return {"", "", Verdict::ok, "no line", ""};
  return *found;
}

void expect(const Facts& facts, const std::string& check, Verdict verdict, const std::string& what,
            const std::string& cure) {
  const Line line = line_of(facts, check);
  EXPECT_EQ(line.verdict, verdict) << check << ": " << line.what;
  EXPECT_THAT(line.what, HasSubstr(what)) << check;
  EXPECT_THAT(line.cure, HasSubstr(cure)) << check;
  EXPECT_EQ(line.cure.empty(), verdict == Verdict::ok) << check;
  EXPECT_EQ(anything_bad(assess(facts)), verdict == Verdict::bad) << check;
}

TEST(PreflightCheck, WhereAllIsWellNothingIsToBeCured) {
  const std::vector<Line> lines = assess(good());
  for (const Line& line : lines) {
    EXPECT_EQ(line.verdict, Verdict::ok) << line.check << ": " << line.what;
    EXPECT_EQ(line.cure, "") << line.check;
  }
  EXPECT_EQ(lines.size(), 2 * 5 + 4);  // drone, battery, state, pose, lease; frame, fence, clocks, ledger
  EXPECT_FALSE(anything_bad(lines));
}

TEST(PreflightCheck, ADroneThatIsNotThereHasNoOtherFacts) {
  Facts facts = good();
  facts.drones[0].there = false;
  facts.drones[0].interface = "wlan1";
  expect(facts, "drone", Verdict::bad, "10.0.0.1 behind wlan1 does not answer",
         "find --address 10.0.0.1 --interface wlan1");
  for (const char* check : {"battery", "state", "pose"}) EXPECT_EQ(line_of(facts, check).what, "no line");
  EXPECT_EQ(line_of(facts, "lease").verdict, Verdict::ok);
}

TEST(PreflightCheck, AnotherDroneAtItsAddressIsNamed) {
  Facts facts = good();
  facts.drones[0].wanted_serial = "A123";
  expect(facts, "drone", Verdict::ok, "10.0.0.1", "");
  facts.drones[0].serial = "B456";
  expect(facts, "drone", Verdict::bad, "says serial B456, not A123", "ledgerline tello find");
  facts.drones[0].serial = "A123";
  expect(facts, "drone", Verdict::ok, "10.0.0.1", "");
}

TEST(PreflightCheck, ABatteryIsEnoughLowOrTooLow) {
  Facts facts = good();
  facts.drones[0].battery = 0.4;
  expect(facts, "battery", Verdict::warn, "40 %: enough to take off", "charge");
  facts.drones[0].battery = facts.link.failsafe.battery_low;
  expect(facts, "battery", Verdict::bad, "15 %: link takes off above 15 %", "charge");
  facts.drones[0].battery = 0.16;  // within link's margin
  facts.drones[0].refusal = "battery_low";
  expect(facts, "battery", Verdict::bad, "16 %", "charge");
  facts.drones[0].refusal.clear();
  facts.drones[0].battery.reset();
  expect(facts, "battery", Verdict::warn, "does not say", "info 10.0.0.1");
}

TEST(PreflightCheck, ADroneThatIsHotOnTheGroundIsWarnedOf) {
  Facts facts = good();
  EXPECT_EQ(line_of(facts, "temperature").what, "no line") << "a firmware that does not say it";
  facts.drones[0].temperature_c = 85;
  expect(facts, "temperature", Verdict::ok, "85 degrees", "");
  facts.drones[0].temperature_c = 86;
  expect(facts, "temperature", Verdict::warn, "86 degrees: on the ground nothing cools it", "let it cool");
}

TEST(PreflightCheck, StateTextThatIsRareOrMissing) {
  Facts facts = good();
  facts.drones[0].state_hz = 0;
  expect(facts, "state", Verdict::bad, "no state text", "firewall");
  facts.drones[0].state_hz = 3;
  expect(facts, "state", Verdict::bad, "3.0 state texts a second, of ten", "nearer");
  facts.drones[0].state_hz = 6;
  expect(facts, "state", Verdict::warn, "6.0 state texts a second, of ten", "nearer");
  facts.drones[0].state_hz.reset();  // nobody counted
  EXPECT_EQ(line_of(facts, "state").what, "no line");
}

TEST(PreflightCheck, PosesThatAreMissingOldOrRare) {
  Facts facts = good();
  EXPECT_THAT(line_of(facts, "pose").what,
              AllOf(HasSubstr("/poses/d1, 8 ms old: 1.00, -1.00, 0.00 m in \"map\""), HasSubstr("100 a second")));
  facts.drones[0].pose->age_ms = 301;
  expect(facts, "pose", Verdict::bad, "301 ms old", "motion capture sees the drone");
  facts.drones[0].pose->age_ms = 8;
  facts.drones[0].refusal = "pose_lost";
  expect(facts, "pose", Verdict::bad, "none older than 300 ms", "motion capture sees the drone");
  facts.drones[0].refusal.clear();
  facts.drones[0].pose->rate_hz = 5;
  expect(facts, "pose", Verdict::bad, "5 a second", "publish more often");
  facts.drones[0].pose->rate_hz = 20;
  expect(facts, "pose", Verdict::warn, "20 a second: slow", "publish more often");
  facts.drones[0].pose.reset();
  expect(facts, "pose", Verdict::bad, "no pose of it has come from /poses/d1", "start motion capture");
}

TEST(PreflightCheck, ADroneThatFliesByOdometryNeedsToReportAVelocity) {
  Facts facts = good();
  facts.pose_source = "tello";
  for (DroneFacts& drone : facts.drones) drone.pose->frame.clear();
  expect(facts, "pose", Verdict::ok, "by onboard odometry (tello): 1.00, -1.00, 0.00 m", "");
  facts.drones[0].refusal = "position_uncertain";
  expect(facts, "pose", Verdict::bad, "too uncertain for the fence", "on its mark");
  facts.drones[0].refusal = "velocity_lost";
  expect(facts, "pose", Verdict::bad, "reports no velocity", "light");
  facts.drones[0].refusal.clear();
  facts.drones[0].has_velocity = false;
  expect(facts, "pose", Verdict::bad, "reports no velocity", "vgx");
}

TEST(PreflightCheck, OdometryThatStandsInForMotionCaptureNeedsBoth) {
  Facts facts = good();
  facts.pose_source = "mocap+tello";
  expect(facts, "pose", Verdict::ok, "/poses/d1", "");
  for (const char* refusal : {"velocity_lost", "position_uncertain"}) {
    Facts refused = facts;
    refused.drones[0].refusal = refusal;
    expect(refused, "pose", Verdict::bad, "of onboard odometry", "motion capture sees the drone");
  }
  facts.drones[0].has_velocity = false;
  expect(facts, "senses", Verdict::warn, "nothing stands in", "firmware");
}

TEST(PreflightCheck, TwoFramesAreNoCommonPlace) {
  Facts facts = good();
  facts.drones[1].pose->frame = "world";
  expect(facts, "frame", Verdict::bad, "d1 is in \"map\", d2 in \"world\"", "one frame");
}

TEST(PreflightCheck, WhatElseLinkRefusesIsNamedWithACure) {
  Facts facts = good();
  EXPECT_EQ(line_of(facts, "link").what, "no line");
  for (const char* cause : {"stopped", "state_stale", "agent_silent", "ledger_silent", "ledger_untrusted", "tilted",
                            "too_near", "other_client", "fence", "of_tomorrow"}) {
    facts.drones[0].refusal = cause;
    expect(facts, "link", Verdict::bad, cause, " ");
  }
  facts.drones[0].phase = "flying";
  expect(facts, "link", Verdict::bad, "not on the ground: flying", "ledgerline tello land 10.0.0.1");
}

TEST(PreflightCheck, ALeaseIsOursFreeOrSomebodyElses) {
  Facts facts = good();
  expect(facts, "lease", Verdict::ok, "free", "");
  facts.drones[0].lease.holder = Holder::ours;
  expect(facts, "lease", Verdict::ok, "ours", "");
  facts.drones[0].lease.holder = Holder::other;
  facts.drones[0].lease.holder_name = "Org3MSP CN=pilot";
  expect(facts, "lease", Verdict::bad, "held by Org3MSP CN=pilot", "ledgerline control request d1");
  EXPECT_THAT(line_of(facts, "lease").cure, HasSubstr("acquire --priority N d1"));
  facts.drones[0].lease = {.holder = Holder::ours, .stoppers = {"Org1MSP CN=host"}};
  expect(facts, "lease", Verdict::bad, "stopped by Org1MSP CN=host", "ledgerline control clear_stop d1");
  facts.drones[0].lease = {.enrolled = false};
  expect(facts, "lease", Verdict::ok, "not enrolled yet", "");
  facts.enrols = false;
  expect(facts, "lease", Verdict::bad, "nobody has enrolled it", "ledgerline control enroll d1");
}

TEST(PreflightCheck, AFenceHasTheDronesAndThePathInside) {
  Facts facts = good();
  facts.path_beyond = "square with --side 8: d1 would be at 8, 0, 1 m";
  expect(facts, "fence", Verdict::bad, "d1 would be at 8, 0, 1 m", "smaller side");
  for (const double away_m : {2.1, -2.1, std::numeric_limits<double>::quiet_NaN()}) {
    facts.drones[0].pose->position_m[1] = away_m;
    expect(facts, "fence", Verdict::bad, "d1 stands outside", "same origin");
  }
  facts.path_beyond.clear();
  facts.drones[0].pose->position_m = {0, 0, -0.05};  // a floor that is not quite z = 0
  expect(facts, "fence", Verdict::ok, "x -2 to 2, y -2 to 2, z 0 to 2 m", "");
}

TEST(PreflightCheck, ClocksThatDiffer) {
  Facts facts = good();
  expect(facts, "clocks", Verdict::ok, "synchronised, within 3.0 ms", "");
  facts.clock.synchronised = false;
  expect(facts, "clocks", Verdict::warn, "is not synchronised", "chrony");
  facts.clock.known = false;
  expect(facts, "clocks", Verdict::warn, "does not say", "chrony");
  facts.drones[0].pose->delay_ms = -21;
  expect(facts, "clocks", Verdict::bad, "stamps of d1's poses are 21 ms ahead of this computer's clock", "chrony");
  facts.drones[0].pose->delay_ms = 1001;
  expect(facts, "clocks", Verdict::bad, "1001 ms behind", "arrival");
  facts.stamps_count = false;
  expect(facts, "clocks", Verdict::warn, "does not say", "chrony");
}

TEST(PreflightCheck, ALedgerIsReachedStartedOrNot) {
  Facts facts = good();
  facts.ledger = {.state = LedgerFacts::State::starts, .what = "embedded"};
  expect(facts, "ledger", Verdict::ok, "embedded: the flight starts it", "");
  facts.ledger = {.state = LedgerFacts::State::failed, .what = "control: no route"};
  expect(facts, "ledger", Verdict::bad, "control: no route", "endpoint");
}

TEST(PreflightCheck, LinesForPeopleAndForPrograms) {
  Facts facts = good();
  facts.drones[0].battery = 0.1;
  const std::vector<Line> lines = assess(facts);
  EXPECT_THAT(words(lines), AllOf(HasSubstr("\n  BAD   d1         battery  10 %"), HasSubstr("\n        cure: charge"),
                                  HasSubstr("\n  ok    d2         battery  90 %")));
  const auto json = nlohmann::json::parse(to_json(lines));
  EXPECT_EQ(json["ok"], false);
  ASSERT_EQ(json["checks"].size(), lines.size());
  EXPECT_EQ(json["checks"][1], nlohmann::json::parse(R"({"drone":"d1","check":"battery","verdict":"bad",)"
                                                     R"("what":"10 %: link takes off above 15 %",)"
                                                     R"("cure":"charge or change it"})"));
  EXPECT_EQ(nlohmann::json::parse(to_json(assess(good())))["ok"], true);
}

TEST(PreflightRecords, SayWhoHoldsADrone) {
  Facts facts = good();
  const crypto::IdentityName self{"Org2MSP", "CN=pilot"};
  const auto take = [&](const std::string& line) { return take_records(line, self, facts).ok(); };
  ASSERT_TRUE(take(R"({"controls":[{"drone":"d1","owner":{"mspId":"Org1MSP","subject":"CN=host"},"holder":)"
                   R"({"mspId":"Org3MSP","subject":"CN=pilot"},"stoppers":[{"stopper":{"mspId":"Org1MSP",)"
                   R"("subject":"CN=h\u001b"}}]},{"drone":"d2","holder":{"mspId":"Org2MSP","subject":"CN=pilot"}}]})"));
  EXPECT_EQ(facts.drones[0].lease.holder, Holder::other);
  EXPECT_EQ(facts.drones[0].lease.holder_name, "Org3MSP CN=pilot");
  EXPECT_EQ(facts.drones[0].lease.stoppers, std::vector<std::string>{"Org1MSP CN=h?"});
  EXPECT_EQ(facts.drones[1].lease.holder, Holder::ours);
  ASSERT_TRUE(take(R"({"controls":[{"drone":"d2"}]})"));
  EXPECT_FALSE(facts.drones[0].lease.enrolled);
  EXPECT_EQ(facts.drones[1].lease.holder, Holder::free);
  for (const char* other : {"", "[]", "no", R"({"controls":7})"}) EXPECT_FALSE(take(other)) << other;
  EXPECT_EQ(facts.drones[1].lease.holder, Holder::free);
  ASSERT_TRUE(take("{}"));  // a ledger without any record
  EXPECT_FALSE(facts.drones[1].lease.enrolled);
}

}  // namespace
}  // namespace ledgerline::fly
