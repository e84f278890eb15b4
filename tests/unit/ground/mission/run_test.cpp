#include "ground/mission/run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/unit/ground/mission/conducted_flight.hpp"

namespace ledgerline::ground::mission {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

TEST(MissionRun, AllTakeOffAndBeginTheirPathsInTheSameStepWhenAllHover) {
  Flight flight;
  EXPECT_EQ(flight.run.phase(), RunPhase::approved);
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty()) << "not started";
  ASSERT_TRUE(flight.run.start({}));
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 takeoff", "tello2 takeoff"));
  flight.rises("tello1");
  flight.step(5);
  EXPECT_THAT(flight.commands, IsEmpty()) << "tello2 is not up";
  EXPECT_EQ(flight.run.phase(), RunPhase::taking_off);
  flight.rises("tello2");
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
  EXPECT_EQ(flight.ordered.at("tello1").waypoints.size(), 3U);
  EXPECT_FALSE(flight.ordered.at("tello1").land_behind);
  EXPECT_TRUE(flight.ordered.at("tello2").land_behind);
  EXPECT_EQ(flight.run.phase(), RunPhase::to_start);
  flight.drone("tello1").reached = 1;
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::to_start);
  flight.drone("tello2").reached = 1;
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::flying);
  flight.ends_path("tello1");
  flight.ends_path("tello2");
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::flying) << "tello2 has still to land";
  flight.lands("tello2");
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::done);
  EXPECT_THAT(flight.reported(), Contains("mission survey is done"));
  flight.step(100);
  EXPECT_THAT(flight.commands, IsEmpty());
}

TEST(MissionRun, OneThatHoversAlreadyDoesNotTakeOff) {
  Flight flight;
  flight.rises("tello1");
  ASSERT_TRUE(flight.run.start({}));
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello2 takeoff"));
}

TEST(MissionRun, StartNeedsApprovalsOfThisDigestByDifferentSigners) {
  Flight flight({.required_approvals = 2});
  const crypto::Digest digest = flight.run.digest();
  const auto refused = [&](std::vector<Approval> approvals) {
    flight.run.set_approvals(approvals);
    EXPECT_EQ(flight.run.phase(), RunPhase::checked);
    const Status started = flight.run.start({});
    return started ? "started" : started.error().message;
  };
  EXPECT_THAT(refused({}), HasSubstr("mission survey has 0 of 2 approvals of " + crypto::hex(digest)));
  EXPECT_THAT(refused({{first_signer, digest}}), HasSubstr("1 of 2"));
  EXPECT_THAT(refused({{first_signer, digest}, {first_signer, digest}}), HasSubstr("1 of 2")) << "one person twice";
  crypto::Digest other = digest;
  other[31] ^= 1;
  EXPECT_THAT(refused({{first_signer, digest}, {second_signer, other}}), HasSubstr("1 of 2")) << "another mission";
  flight.approve();
  EXPECT_EQ(flight.run.phase(), RunPhase::approved);
  EXPECT_TRUE(flight.run.start({}));
}

TEST(MissionRun, AChangedMissionMustBeApprovedAgain) {
  Flight flight;
  Mission changed = two_drones();
  changed.drones[0].waypoints[2].at_m.x() += 1e-9;
  ASSERT_TRUE(flight.run.change(changed));
  EXPECT_EQ(flight.run.phase(), RunPhase::checked);
  EXPECT_THAT(flight.run.start({}).error().message, HasSubstr("0 of 1"));
  ASSERT_TRUE(flight.run.change(two_drones()));
  EXPECT_EQ(flight.run.phase(), RunPhase::approved) << "the same again";
  ASSERT_TRUE(flight.run.start({}));
  EXPECT_THAT(flight.run.change(changed).error().message, HasSubstr("is started"));
}

TEST(MissionRun, AFindingThatForbidsItIsNotStarted) {
  Flight flight;
  EXPECT_THAT(flight.run.start(std::vector<Finding>{{"", {}, "a warning", false}, {"tello1", {}, "no pose", true}})
                  .error()
                  .message,
              HasSubstr("mission survey: no pose"));
  EXPECT_TRUE(flight.run.start(std::vector<Finding>{{"", {}, "a warning", false}}));
  EXPECT_THAT(flight.run.start({}).error().message, HasSubstr("started already: taking_off"));
}

TEST(MissionRun, SettingsAndMissionsOutOfBoundsAreRefused) {
  EXPECT_THAT(MissionRun::make(two_drones(), {.required_approvals = 3}).error().message, HasSubstr("1 or 2"));
  EXPECT_THAT(MissionRun::make({"m", {}}, {}).error().message, HasSubstr("0 drones"));
}

TEST(MissionRun, PausedAllHoverAndResumedAllFlyTheRestInTheSameStep) {
  Flight flight;
  flight.to_paths();
  flight.drone("tello1").reached = 2;
  flight.drone("tello2").reached = 1;
  ASSERT_TRUE(flight.run.pause());
  EXPECT_THAT(flight.run.pause().error().message, HasSubstr("is paused"));
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 pause", "tello2 pause"));
  EXPECT_THAT(flight.run.resume().error().message, HasSubstr("tello1 does not hover yet"))
      << "nobody has seen it hover";
  flight.step(60);
  EXPECT_THAT(flight.commands, IsEmpty());
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
  ASSERT_THAT(flight.ordered.at("tello1").waypoints, SizeIs(1));
  EXPECT_EQ(flight.ordered.at("tello1").waypoints[0].at_m.x(), 2);
  ASSERT_THAT(flight.ordered.at("tello2").waypoints, SizeIs(1));
  EXPECT_TRUE(flight.ordered.at("tello2").land_behind);
  flight.ends_path("tello1");
  flight.ends_path("tello2");
  flight.step();
  flight.lands("tello2");
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::done);
}

TEST(MissionRun, PausedBeforeItsPathsItWaitsWithThem) {
  Flight flight;
  ASSERT_TRUE(flight.run.start({}));
  flight.step();
  ASSERT_TRUE(flight.run.pause());
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  flight.step(60);
  EXPECT_THAT(flight.commands, IsEmpty());
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 path", "tello2 path"));
}

TEST(MissionRun, OneThatIsPausedByHandPausesAll) {
  Flight flight({.on_loss = OnLoss::go_on});
  flight.to_paths();
  flight.drone("tello1").phase = GroundPhase::manual;
  flight.drone("tello1").paused = true;
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello2 pause"));
  EXPECT_TRUE(flight.run.paused());
  EXPECT_THAT(flight.reported(), Contains("mission survey: all hover: tello1 was paused"));
}

TEST(MissionRun, EndedAllLand) {
  Flight flight;
  flight.to_paths();
  ASSERT_TRUE(flight.run.end("enough"));
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello1 land", "tello2 land"));
  EXPECT_EQ(flight.run.phase(), RunPhase::aborted);
  EXPECT_EQ(flight.run.why(), "enough");
  flight.step();
  EXPECT_THAT(flight.commands, IsEmpty()) << "once";
  EXPECT_FALSE(flight.run.end("again"));
  EXPECT_FALSE(flight.run.pause());
  EXPECT_FALSE(flight.run.resume());
}

// Each way to lose a drone, by each rule.
TEST(MissionRun, ALossIsAnsweredByItsRule) {
  struct Loss {
    const char* what;
    std::function<void(Flight&, DroneNow&)> happens;
    const char* words;
  };
  const std::vector<Loss> losses{
      {"lands", [](Flight&, DroneNow& d) { d.phase = GroundPhase::landing; }, "it lands"},
      {"stopped", [](Flight&, DroneNow& d) { d.phase = GroundPhase::landing, d.why = "stopped by X"; }, "stopped by X"},
      {"down", [](Flight&, DroneNow& d) { d.phase = GroundPhase::landed, d.on_ground = true; }, "it lands"},
      {"lease", [](Flight&, DroneNow& d) { d.phase = GroundPhase::waiting, d.why = "lost its lease"; },
       "lost its lease"},
      {"failed", [](Flight&, DroneNow& d) { d.phase = GroundPhase::failed; }, "it is flown no longer"},
      {"gave up", [](Flight&, DroneNow& d) { d.phase = GroundPhase::manual; }, "it gave up its path"},
      {"other path", [](Flight&, DroneNow& d) { ++d.paths; }, "somebody else flies it"},
      {"gone", [](Flight&, DroneNow& d) { d.name = "other"; }, "it does not fly here"},
  };
  for (const Loss& loss : losses) {
    for (const OnLoss rule : {OnLoss::hover, OnLoss::land, OnLoss::go_on}) {
      Flight flight({.on_loss = rule});
      flight.to_paths();
      loss.happens(flight, flight.drone("tello1"));
      flight.step();
      EXPECT_THAT(flight.reported(),
                  Contains(testing::AllOf(HasSubstr("tello1: mission survey lost it"), HasSubstr(loss.words))))
          << loss.what;
      const bool ours = flight.run.phase() == RunPhase::aborted;
      EXPECT_EQ(ours, rule == OnLoss::land) << loss.what;
      EXPECT_EQ(flight.run.paused(), rule == OnLoss::hover) << loss.what;
      const std::string word = rule == OnLoss::hover ? "tello2 pause" : "tello2 land";
      if (rule == OnLoss::go_on) {
        EXPECT_THAT(flight.commands, IsEmpty()) << loss.what;
        flight.ends_path("tello2");
        flight.step();
        flight.lands("tello2");
        flight.step();
        EXPECT_EQ(flight.run.phase(), RunPhase::done) << loss.what;
      } else {
        EXPECT_THAT(flight.commanded(), Contains(word)) << loss.what;
      }
    }
  }
}

TEST(MissionRun, ADroneThatItsFailsafeBrakesForAMomentIsWaitedForAndCommandedAgain) {
  Flight flight;
  ASSERT_TRUE(flight.run.start({}));
  flight.step();
  flight.drone("tello2").held = true;
  flight.rises("tello1");
  flight.rises("tello2");
  flight.step();
  flight.step();
  EXPECT_THAT(flight.commanded(), IsEmpty()) << "all begin in the same step";
  flight.drone("tello2").held = false;
  flight.deaf = "tello2";  // it refuses, for a moment
  flight.step();
  EXPECT_THAT(flight.commanded(), testing::UnorderedElementsAre("tello1 path", "tello2 path"));
  flight.step();
  EXPECT_THAT(flight.commanded(), IsEmpty());
  flight.deaf = "";
  for (int i = 0; i < 4; ++i) flight.step();
  EXPECT_EQ(flight.drone("tello2").phase, GroundPhase::path);
}

TEST(MissionRun, ADroneThatDoesNotTakeOffOrDoesNotBeginItsPathIsLost) {
  Flight flight;
  flight.deaf = "tello1";
  ASSERT_TRUE(flight.run.start({}));
  flight.step();
  flight.step(2);
  EXPECT_FALSE(flight.run.paused());
  flight.step(2);
  EXPECT_THAT(flight.reported(), Contains("tello1: mission survey lost it: it did not take off"));
  EXPECT_TRUE(flight.run.paused());
  flight.rises("tello2");
  ASSERT_TRUE(flight.run.resume());
  flight.step();
  EXPECT_THAT(flight.commanded(), ElementsAre("tello2 path")) << "without the one that was lost";

  Flight other;
  ASSERT_TRUE(other.run.start({}));
  other.step();
  other.rises("tello1");
  other.rises("tello2");
  other.deaf = "tello2";
  other.step();
  other.step(4);
  EXPECT_THAT(other.reported(), Contains("tello2: mission survey lost it: it did not begin its path"));
  EXPECT_THAT(other.commanded(), ElementsAre("tello1 pause"));
}

TEST(MissionRun, ADroneThatWasFlownElsewhereWhileItWaitedIsLost) {
  Flight flight;
  flight.to_paths();
  ASSERT_TRUE(flight.run.pause());
  flight.step();
  flight.step();
  ++flight.drone("tello1").paths;  // to a place of its pilot's, where it hovers now
  flight.step();
  EXPECT_THAT(flight.reported(), Contains("tello1: mission survey lost it: somebody else flies it"));
}

TEST(MissionRun, ATakeOffThatNeverEndsIsALoss) {
  Flight flight;
  ASSERT_TRUE(flight.run.start({}));
  flight.step();
  flight.rises("tello1");
  flight.step(39);
  EXPECT_FALSE(flight.run.paused());
  flight.step(2);
  EXPECT_THAT(flight.reported(), Contains("tello2: mission survey lost it: it did not take off"));
}

TEST(MissionRun, WithNoDroneLeftItIsAborted) {
  Flight flight({.on_loss = OnLoss::go_on});
  flight.to_paths();
  flight.drone("tello1").phase = flight.drone("tello2").phase = GroundPhase::failed;
  flight.step();
  EXPECT_EQ(flight.run.phase(), RunPhase::aborted);
  EXPECT_EQ(flight.run.why(), "no drone is left");
}

TEST(MissionRun, ItSaysWhenItIsToBeKept) {
  Flight flight;
  flight.to_paths();
  flight.step();
  EXPECT_FALSE(flight.changed);
  flight.drone("tello1").reached = 1;
  flight.step();
  EXPECT_TRUE(flight.changed);
  flight.step();
  EXPECT_FALSE(flight.changed);
}

}  // namespace
}  // namespace ledgerline::ground::mission
