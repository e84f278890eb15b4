#include <fmt/format.h>
#include <gmock/gmock.h>

#include "tests/unit/ground/mission/conducted_flight.hpp"

namespace ledgerline::ground::mission {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

/// In progress: tello1 has two of its three waypoints behind it, tello2 one of two.
struct Killed : Flight {
  explicit Killed(AfterRestart rule, RunConfig settings = {}) : Flight(settings) {
    to_paths();
    drone("tello1").reached = 2;
    drone("tello2").reached = 1;
    step();
    EXPECT_EQ(run.phase(), RunPhase::flying);
    restart(rule);
  }
};

TEST(MissionRestored, InEveryPhaseItIsThereAsItWas) {
  const auto same = [](Flight& flight, RunPhase phase) {
    flight.step();
    EXPECT_EQ(flight.run.phase(), phase);
    const auto restored = MissionRun::restore(flight.run.saved(), {});
    ASSERT_TRUE(restored) << restored.error().message << "\n" << flight.run.saved();
    EXPECT_EQ(restored->phase(), phase == RunPhase::approved ? RunPhase::checked : phase) << "approvals are not kept";
    EXPECT_EQ(restored->digest(), flight.run.digest());
    EXPECT_EQ(restored->paused(), flight.run.paused());
    EXPECT_EQ(restored->why(), flight.run.why());
    for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(restored->reached(i), flight.run.reached(i));
  };
  Flight flight;
  flight.run.set_approvals({});
  same(flight, RunPhase::checked);
  flight.approve();
  same(flight, RunPhase::approved);
  ASSERT_TRUE(flight.run.start({}));
  same(flight, RunPhase::taking_off);
  flight.rises("tello1");
  same(flight, RunPhase::taking_off);
  flight.rises("tello2");
  same(flight, RunPhase::to_start);
  flight.drone("tello1").reached = flight.drone("tello2").reached = 1;
  same(flight, RunPhase::flying);
  ASSERT_TRUE(flight.run.pause());
  same(flight, RunPhase::flying);
  same(flight, RunPhase::flying);
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  flight.ends_path("tello1");
  flight.ends_path("tello2");
  same(flight, RunPhase::flying);
  Flight ended = flight;
  ASSERT_TRUE(ended.run.end("enough"));
  same(ended, RunPhase::aborted);
  flight.lands("tello2");
  same(flight, RunPhase::done);
}

TEST(MissionRestored, ItGoesOnWithTheRestOfEachPathInOneStepWhenAllAreFound) {
  Killed flight(AfterRestart::go_on);
  flight.step(5);
  flight.rises("tello1");
  flight.step(5);
  EXPECT_THAT(flight.commands, IsEmpty()) << "tello2 is not found yet";
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
  EXPECT_THAT(flight.ordered.at("tello1").waypoints, SizeIs(1));
  EXPECT_THAT(flight.ordered.at("tello2").waypoints, SizeIs(1));
  EXPECT_TRUE(flight.ordered.at("tello2").land_behind);
  EXPECT_THAT(flight.reported(), Contains("mission survey goes on after a restart"));
  flight.ends_path("tello1");
  flight.ends_path("tello2");
  flight.step();
  flight.lands("tello2");
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::done);
}

// Its battery, its corridors and the fence may be others than at its start.
TEST(MissionRestored, OneWhoseChargeIsNotKnownYetIsWaitedFor) {
  Killed flight(AfterRestart::go_on);
  flight.rises("tello1");
  flight.rises("tello2");
  flight.drone("tello2").battery_share.reset();
  flight.step(5);
  EXPECT_THAT(flight.commands, IsEmpty()) << "the check would forbid what nobody knows";
  flight.drone("tello2").battery_share = 0.8;
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
}

TEST(MissionRestored, WhatTheCheckForbidsByNowHoversUntilSomebodyResumes) {
  Killed flight(AfterRestart::go_on);
  flight.checked = Error{"tello1: its battery is for 20 s, its path takes 60 s"};
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
  EXPECT_THAT(flight.reported(), Contains(HasSubstr("all hover: tello1: its battery is for 20 s")));
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
}

TEST(MissionRestored, NothingIsFlownBeforeTheCheckIsThere) {
  Killed flight(AfterRestart::go_on);
  flight.rises("tello1");
  flight.rises("tello2");
  (void)flight.run.step(flight.now, flight.drones);
  EXPECT_TRUE(flight.run.awaits_check());
  EXPECT_THAT(flight.run.step(flight.now + ns_per_s, flight.drones).commands, IsEmpty());
  ASSERT_TRUE(flight.run.pause());
  flight.run.resume_after_check(done);
  EXPECT_TRUE(flight.run.paused()) << "a pause counts more than a check that comes late";
  EXPECT_THAT(flight.run.step(flight.now + 2 * ns_per_s, flight.drones).commands, IsEmpty());
}

TEST(MissionRestored, ItHoversUntilSomebodyResumesIt) {
  Killed flight(AfterRestart::hover);
  flight.step();
  EXPECT_THAT(flight.run.resume().error().message, HasSubstr("not paused"));
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  flight.step(60);
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
}

TEST(MissionRestored, ItLandsEachDroneAsSoonAsItIsFound) {
  Killed flight(AfterRestart::land);
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty()) << "FlightCore has none of them";
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello2 land"));
  flight.rises("tello1");
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 land"));
  EXPECT_EQ(flight.run.phase(), RunPhase::aborted);
}

// They are the ledger's, which is asked while the drones are found: whichever is sooner.
TEST(MissionRestored, ItGoesOnWhenItsApprovalsAreRead) {
  Killed flight(AfterRestart::go_on);
  flight.run = *MissionRun::restore(flight.run.saved(), flight.config);
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  flight.step(5);
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_FALSE(flight.run.paused()) << "nobody knows yet that they are missing";
  flight.approve();
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
}

TEST(MissionRestored, ItHoversIfItsApprovalsCannotBeRead) {
  Killed flight(AfterRestart::go_on);
  flight.run = *MissionRun::restore(flight.run.saved(), flight.config);
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  flight.step(31);
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
  EXPECT_THAT(flight.reported(), Contains(HasSubstr("all hover: mission survey has 0 of 1 approvals")));
}

// A writer of the saved file must not be able to fly a path that nobody approved.
TEST(MissionRestored, WhatIsNotApprovedHovers) {
  Killed flight(AfterRestart::go_on);
  flight.run.set_approvals(std::vector<Approval>{{first_signer, crypto::Digest{}}});
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
  EXPECT_THAT(flight.reported(), Contains(HasSubstr("all hover: mission survey has 0 of 1 approvals")));
  EXPECT_THAT(flight.run.resume().error().message, HasSubstr("0 of 1 approvals"));
  flight.approve();
  EXPECT_TRUE(flight.run.resume());
}

TEST(MissionRestored, APauseOutlivesTheRestart) {
  Flight flight;
  flight.to_paths();
  ASSERT_TRUE(flight.run.pause());
  flight.step();
  flight.restart(AfterRestart::go_on);
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
}

TEST(MissionRestored, NobodyTakesOffByItself) {
  Flight flight;
  ASSERT_TRUE(flight.run.start({}));
  ASSERT_TRUE(flight.run.pause());
  flight.step();
  ASSERT_TRUE(flight.run.resume());
  const std::string before = flight.run.saved();  // both still stand
  flight.step();
  flight.rises("tello1");
  flight.step();
  flight.restart(AfterRestart::go_on);
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));

  Flight standing_ones;
  standing_ones.config.after_restart = AfterRestart::go_on;
  standing_ones.run = *MissionRun::restore(before, standing_ones.config);
  standing_ones.approve();
  standing_ones.step();
  EXPECT_THAT(standing_ones.commands, IsEmpty());
  ASSERT_TRUE(standing_ones.run.resume());
  standing_ones.step();
  EXPECT_THAT(standing_ones.commanded(), ElementsAre("tello1 takeoff", "tello2 takeoff"));
}

TEST(MissionRestored, ADroneThatIsOnTheGroundOrNotFoundIsLost) {
  Killed flight(AfterRestart::go_on, {.on_loss = OnLoss::go_on});
  flight.lands("tello1");
  flight.step();
  EXPECT_THAT(flight.reported(), Contains("tello1: mission survey lost it: it was found on the ground"));
  flight.step(29);
  EXPECT_THAT(flight.commands, IsEmpty());
  flight.step(2);
  EXPECT_THAT(flight.reported(), Contains("tello2: mission survey lost it: it was not found in the air"));
  EXPECT_EQ(flight.run.phase(), RunPhase::aborted);
}

TEST(MissionRestored, ALossBeforeItGoesOnKeepsTheOthersHovering) {
  Killed flight(AfterRestart::go_on);
  flight.lands("tello1");
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty());
  EXPECT_TRUE(flight.run.paused());
}

TEST(MissionRestored, OneThatWasLandingAtItsEndAndHasLandedIsNoLoss) {
  Flight flight;
  flight.to_paths();
  flight.drone("tello1").reached = 1;
  flight.ends_path("tello2");
  flight.step();
  flight.restart(AfterRestart::go_on);
  flight.lands("tello2");
  flight.rises("tello1");
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path"));
  EXPECT_THAT(flight.reported(), Contains("tello2: mission survey: it has landed"));
}

TEST(MissionRestored, AnAbortedOneLandsAllThatAreStillInTheAir) {
  Flight flight;
  flight.to_paths();
  ASSERT_TRUE(flight.run.end("enough"));
  flight.step();
  flight.lands("tello2");
  flight.restart(AfterRestart::go_on);
  flight.step();
  flight.rises("tello1");
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 land"));
  flight.rises("tello2");  // by its pilot, later
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty());
}

TEST(MissionRestored, WhatIsNoKeptMissionIsRefusedWithItsPlace) {
  Killed flight(AfterRestart::hover);
  const std::string good = flight.run.saved();
  const auto refused = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    const auto found = text.find(from);
    EXPECT_NE(found, std::string::npos) << from << " in " << good;
    if (found != std::string::npos) text.replace(found, from.size(), to);
    const auto restored = MissionRun::restore(text, {});
    return restored ? "taken" : restored.error().message;
  };
  EXPECT_EQ(refused("{", "{"), "taken");
  EXPECT_THAT(MissionRun::restore("", {}).error().message, HasSubstr("version must be 1"));
  EXPECT_THAT(MissionRun::restore(std::string(max_saved_bytes + 1, ' '), {}).error().message, HasSubstr("bytes; "));
  EXPECT_THAT(MissionRun::restore(good, {.required_approvals = 0}).error().message, HasSubstr("1 or 2 approvals"));
  EXPECT_THAT(refused("\"version\":1", "\"version\":2"), HasSubstr("version must be 1"));
  EXPECT_THAT(refused("\"version\":1", "\"version\":1,\"more\":1"), HasSubstr("unknown key \"more\""));
  EXPECT_THAT(refused("\"phase\":\"flying\"", "\"phase\":\"diving\""), HasSubstr("phase must be one"));
  EXPECT_THAT(refused("\"paused\":false", "\"paused\":0"), HasSubstr("paused must be true or false"));
  EXPECT_THAT(refused("\"name\":\"survey\"", "\"name\":\"\""), HasSubstr("the mission's name"));
  EXPECT_THAT(refused("\"leg\":\"halted\"", "\"leg\":\"gone\""), HasSubstr("drone number 1: leg must be one"));
  EXPECT_THAT(refused("\"leg\":\"halted\"", "\"leg\":\"ended\""), HasSubstr("leg ended does not go with 2 of 3"));
  EXPECT_THAT(refused("\"reached\":2", "\"reached\":4"), HasSubstr("drone number 1: reached must be 0 to 3"));
  EXPECT_THAT(refused("\"reached\":2", "\"reached\":3"), HasSubstr("leg halted does not go with 3 of 3"));
  EXPECT_THAT(refused("\"reached\":2", "\"reached\":-1"), HasSubstr("reached must be 0 to 3"));
  EXPECT_THAT(refused("{\"drone\":\"tello1\",\"leg\"", "{\"drone\":\"tello2\",\"leg\""), HasSubstr("must be tello1"));
}

}  // namespace
}  // namespace ledgerline::ground::mission
