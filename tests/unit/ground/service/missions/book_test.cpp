#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "ground/service/missions/book.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground::service {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

const crypto::IdentityName alice{"Org2MSP", "CN=alice"};

mission::Mission mission_of(const std::string& name, const std::vector<std::string>& drones) {
  mission::Mission mission{name, {}};
  for (const std::string& drone : drones) {
    const double x = 3.0 * (drone.back() - '1');
    mission.drones.push_back({.drone = drone, .start_m = {}, .waypoints = {{{x, 2}, 1.0}, {{x, 3}, 1.0}}});
  }
  return mission;
}

FlightConfig config_of(int drones) {
  FlightConfig config = config_for(drones);
  config.manual = true;
  return config;
}

/// A flight whose drones ground holds itself, and its missions.
class Book : public testing::Test {
 protected:
  Result<std::string> add(const mission::Mission& mission) {
    auto run = mission::MissionRun::make(mission, {});
    if (!run) return run.error();
    return book.add(std::move(*run));
  }
  MissionBook::Checked checked(std::vector<mission::Finding> findings = {}) const {
    return {std::move(findings), mission::drones_now(world.core)};
  }
  Status resume(const std::string& id, const std::optional<crypto::IdentityName>& by = {},
                const std::vector<mission::Finding>& findings = {}) {
    return book.resume(id, by, checked(findings), world.core);
  }
  std::string approved(const std::string& name, const std::vector<std::string>& drones) {
    const auto id = add(mission_of(name, drones));
    EXPECT_TRUE(id) << id.error().message;
    book.set_signers(*id, {operator_name});
    return *id;
  }
  void run(double seconds) {
    for (int i = 0; i < seconds * 20; ++i) {
      world.run(0.05);
      auto out = book.step(world.now_ns, world.core);
      for (const PilotCommand& command : out.commands) world.say(command);
      for (const auto& event : out.events) reported.push_back(event.text);
      kept.insert(kept.end(), out.kept.begin(), out.kept.end());
      ended.insert(ended.end(), out.ended.begin(), out.ended.end());
    }
  }
  json one(const std::string& id) const { return json::parse(book.show(id)); }
  Status start(const std::string& id, const std::optional<crypto::IdentityName>& by = {},
               const std::vector<mission::Finding>& findings = {}) {
    return book.start(id, by, checked(findings), world.core);
  }

  FlightWorld world{config_of(3)};
  MissionBook book{{}, operator_name};
  std::vector<std::string> reported, kept, ended;
};

TEST_F(Book, AMissionIsAddedApprovedFlownAndRecorded) {
  world.run(1);
  const std::string id = approved("survey", {"tello1", "tello2"});
  EXPECT_EQ(id.size(), 12U);
  EXPECT_EQ(one(id)["phase"], "approved");
  EXPECT_EQ(one(id)["approvals"], json::array({"Org2MSP CN=User1@org2"}));
  EXPECT_FALSE(book.busy());
  ASSERT_TRUE(start(id));
  EXPECT_TRUE(book.busy());
  run(40);
  EXPECT_EQ(one(id)["phase"], "done") << book.list();
  EXPECT_EQ(one(id)["reached"]["tello2"], 2);
  EXPECT_THAT(ended, ElementsAre(id));
  EXPECT_THAT(kept, Contains(id));
  EXPECT_THAT(reported, Contains("mission survey is done"));
  EXPECT_FALSE(book.busy());
  const json record = json::parse(book.record(id, 1'700'000'000));
  EXPECT_EQ(record["phase"], "done");
  const std::string next = "has been flown; its owner removes it (`ledgerline missions remove " + id + "`)";
  EXPECT_THAT(start(id).error().message, HasSubstr(next));
  EXPECT_THAT(add(mission_of("survey", {"tello1", "tello2"})).error().message, HasSubstr(next));
  EXPECT_EQ(record["unix_time_s"], 1'700'000'000);
  EXPECT_EQ(record["mission"]["name"], "survey");
  EXPECT_EQ(record["by"], "Org2MSP CN=User1@org2");
}

TEST_F(Book, WithoutApprovalsByTheRightOrganisationNothingStarts) {
  world.run(1);
  const auto id = add(mission_of("survey", {"tello1"}));
  ASSERT_TRUE(id);
  EXPECT_THAT(start(*id).error().message, HasSubstr("0 of 1 approvals"));
  book.set_signers(*id, {outsider_name});
  EXPECT_FALSE(start(*id)) << "anybody may anchor a digest";
  EXPECT_TRUE(one(*id)["approvals"].empty());
  book.set_signers(*id, {operator_name});
  EXPECT_TRUE(start(*id));
}

TEST_F(Book, WhoStartsItHoldsAllOfItsDrones) {
  world.run(1);
  const std::string id = approved("survey", {"tello1", "tello2"});
  EXPECT_THAT(start(id, alice).error().message, HasSubstr("tello1: its lease is held by CN=User1@org2: take control"));
  (void)world.core.set_control(control_record("tello2", outsider_name, 2).SerializeAsString());
  EXPECT_THAT(start(id).error().message, HasSubstr("tello2: its lease is held by"));
}

TEST_F(Book, ADroneFliesInOneMissionAtATime) {
  world.run(1);
  const std::string first = approved("first", {"tello1", "tello2"}), second = approved("second", {"tello2", "tello3"});
  ASSERT_TRUE(start(first));
  run(1);
  EXPECT_THAT(start(second).error().message, HasSubstr("tello2 flies in mission first"));
  EXPECT_THAT(book.remove(first, {}).error().message, HasSubstr("is flown"));
  ASSERT_TRUE(book.land(first, "test"));
  run(15);
  EXPECT_EQ(one(first)["phase"], "aborted");
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_TRUE(start(second));
  run(5);
  ASSERT_TRUE(book.land(second, "test"));
  run(0.2);
  EXPECT_THAT(book.remove(second, {}).error().message, HasSubstr("landing"));
  run(15);
  EXPECT_TRUE(book.remove(second, {}));
  EXPECT_TRUE(book.remove(first, {}));
  EXPECT_FALSE(book.has(first));
}

TEST_F(Book, WhatForbidsItIsReportedAndForbidsIt) {
  world.run(1);
  const std::string id = approved("survey", {"tello1"});
  mission::Finding finding;
  finding.drone = "tello1";
  finding.words = "drone tello1: it is too far";
  EXPECT_THAT(start(id, {}, {finding}).error().message, HasSubstr("too far"));
  EXPECT_EQ(one(id)["findings"][0]["words"], finding.words);
  finding.forbids = false;
  EXPECT_TRUE(start(id, {}, {finding}));
}

TEST_F(Book, OnlyWhoStartedItResumesIt) {
  world.run(1);
  const std::string id = approved("survey", {"tello1"});
  ASSERT_TRUE(start(id));
  run(1);
  ASSERT_TRUE(book.pause(id, {}));
  run(10);
  EXPECT_THAT(resume(id, alice).error().message, HasSubstr("CN=User1@org2's, who alone may"));
  mission::Finding finding;
  finding.words = "something stands in its way by now";
  EXPECT_THAT(resume(id, {}, {finding}).error().message, HasSubstr("stands in its way"));
  EXPECT_TRUE(resume(id)) << book.list();
}

TEST_F(Book, WhateverIsAskedOfAMissionButItsLandingIsItsOwnersToAsk) {
  const crypto::IdentityName bob{"Org2MSP", "CN=bob"};
  world.run(1);
  auto run_of_alice = mission::MissionRun::make(mission_of("hers", {"tello1"}), {});
  const auto id = book.add(std::move(*run_of_alice), alice);
  ASSERT_TRUE(id);
  book.set_signers(*id, {operator_name});
  for (const Status& refused : {book.pause(*id, bob), resume(*id, bob), start(*id, bob), book.remove(*id, bob)})
    EXPECT_THAT(refused.error().message, HasSubstr("Org2MSP CN=alice's, who alone may"));
  EXPECT_THAT(start(*id, alice).error().message, HasSubstr("its lease is held by")) << "hers it is";
  Control record = control_record("tello1", alice, 2);
  record.mutable_delegate()->set_msp_id(operator_name.msp_id);
  record.mutable_delegate()->set_subject(operator_name.subject);
  ASSERT_TRUE(world.core.set_control(record.SerializeAsString()));
  world.run(1);
  ASSERT_TRUE(start(*id, alice));
  run(2);
  EXPECT_FALSE(book.pause(*id, bob));
  book.disown(alice);
  EXPECT_FALSE(book.pause(*id, bob)) << "what is flown stays whose it is";
  EXPECT_TRUE(book.land(*id, "bob had it land"));
  run(15);
  EXPECT_FALSE(book.remove(*id, bob));
  book.disown(alice);
  EXPECT_TRUE(book.remove(*id, bob)) << "its owner is no operator any more";
}

TEST_F(Book, ADroneThatIsHandedOverIsLostForItsMissionAndHovers) {
  const crypto::IdentityName bob{"Org2MSP", "CN=bob"};
  for (const char* drone : {"tello1", "tello2"}) {
    Control record = control_record(drone, alice, 2);
    record.mutable_delegate()->set_msp_id(operator_name.msp_id);
    record.mutable_delegate()->set_subject(operator_name.subject);
    ASSERT_TRUE(world.core.set_control(record.SerializeAsString()));
  }
  world.run(1);
  const std::string id = approved("survey", {"tello1", "tello2"});
  ASSERT_TRUE(start(id, alice));
  for (int i = 0; i < 100 && one(id)["phase"] != "to_start"; ++i) run(0.1);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  Control record = control_record("tello1", bob, 3);
  record.mutable_delegate()->set_msp_id(operator_name.msp_id);
  record.mutable_delegate()->set_subject(operator_name.subject);
  ASSERT_TRUE(world.core.set_control(record.SerializeAsString()));
  run(0.5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual) << "a path is its giver's";
  EXPECT_THAT(reported, Contains(HasSubstr("lost it: ")));
  run(2);
  EXPECT_TRUE(one(id)["paused"].get<bool>());
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::manual) << "all hover";
}

TEST_F(Book, ADroneThatHasMovedSinceItWasCheckedIsCheckedAgain) {
  world.run(1);
  const std::string id = approved("survey", {"tello1"});
  MissionBook::Checked before = checked();
  before.then[1].at_m->x() += 0.6;
  EXPECT_THAT(book.start(id, {}, before, world.core).error().message, HasSubstr("tello2 has moved"));
  EXPECT_TRUE(start(id));
}

TEST_F(Book, AnAbortedMissionOfBeforeLandsNobody) {
  world.run(1);
  const std::string id = approved("survey", {"tello1"});
  ASSERT_TRUE(start(id));
  run(5);
  ASSERT_TRUE(book.land(id, "test"));
  run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::landed);
  const std::string kept = book.saved(id);
  world.say({.drone = 0, .takeoff = true});
  world.run(6);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::manual);
  MissionBook other({}, operator_name);
  ASSERT_TRUE(other.restore(kept));
  for (int i = 0; i < 100; ++i) {
    world.run(0.05);
    for (const PilotCommand& command : other.step(world.now_ns, world.core).commands) world.say(command);
  }
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual) << "it was seen down once";
}

TEST_F(Book, TheSameMissionIsThereOnceAndThereAreNotTooMany) {
  ASSERT_TRUE(add(mission_of("m", {"tello1"})));
  EXPECT_THAT(add(mission_of("m", {"tello1"})).error().message, HasSubstr("is here already"));
  for (std::size_t i = 1; i < MissionBook::max_missions; ++i)
    ASSERT_TRUE(add(mission_of("m" + std::to_string(i), {"tello1"})));
  EXPECT_THAT(add(mission_of("more", {"tello1"})).error().message, HasSubstr("remove one"));
}

TEST_F(Book, WhatIsKeptIsRestoredWithWhoStartedIt) {
  world.run(1);
  const std::string id = approved("survey", {"tello1"});
  ASSERT_TRUE(start(id));
  for (int i = 0; i < 100 && one(id)["phase"] != "to_start"; ++i) run(0.1);
  ASSERT_EQ(one(id)["phase"], "to_start") << book.list();
  MissionSettings settings;
  settings.run.after_restart = mission::AfterRestart::go_on;
  MissionBook other(settings, operator_name);
  const auto again = other.restore(book.saved(id));
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(*again, id);
  EXPECT_TRUE(other.busy()) << "it has drones to find";
  MissionBook forbidden(settings, operator_name);
  ASSERT_TRUE(forbidden.restore(book.saved(id)));
  other.set_signers(id, {operator_name});
  forbidden.set_signers(id, {operator_name});
  std::vector<std::string> awaiting;
  for (int i = 0; i < 800 && awaiting.empty(); ++i) {
    world.run(0.05);
    awaiting = forbidden.step(world.now_ns, world.core).awaiting_check;
  }
  EXPECT_EQ(awaiting, std::vector{id}) << "once its drone is found in the air";
  forbidden.resume_after_check(
      id, {.findings = {{.drone = "tello1", .words = "its battery is for 20 s", .forbids = true}}}, world.core);
  EXPECT_TRUE(json::parse(forbidden.show(id))["paused"]);
  int checks = 0;
  for (int i = 0; i < 800; ++i) {
    world.run(0.05);
    const auto out = other.step(world.now_ns, world.core);
    for (const PilotCommand& command : out.commands) world.say(command);
    for (const std::string& due : out.awaiting_check) {
      ++checks;
      other.resume_after_check(due, {}, world.core);
    }
  }
  EXPECT_EQ(checks, 1);
  EXPECT_EQ(json::parse(other.show(id))["phase"], "done");
}

TEST_F(Book, WhatWasNotKeptByABookIsRefused) {
  for (const char* text :
       {"", "[]", "{}", R"({"by":null})", R"({"by":7,"run":{}})", R"({"by":null,"run":{},"more":1})"})
    EXPECT_FALSE(book.restore(text)) << text;
  EXPECT_EQ(book.list(), "[]");
}

TEST_F(Book, OfAnUnknownMissionEverythingIsRefused) {
  for (const Status& status :
       {start("0a"), book.pause("0a", {}), resume("0a"), book.land("0a", ""), book.remove("0a", {})})
    EXPECT_THAT(status.error().message, HasSubstr("there is no mission"));
}

}  // namespace
}  // namespace ledgerline::ground::service
