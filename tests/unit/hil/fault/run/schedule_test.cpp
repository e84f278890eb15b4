#include <gtest/gtest.h>

#include "hil/fault/run/schedule.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

struct Written {
  const char *what, *at, *lasts;
};

/// A world and its faults, step by step.
class Faulty {
 public:
  explicit Faulty(const std::vector<Written>& written, const WorldConfig& config = {}) {
    world = std::move(*SimulatedWorld::create(config));
    std::vector<Fault> faults;
    for (const Written& w : written) {
      auto fault = parse_fault(w.what, w.at, w.lasts);
      EXPECT_TRUE(fault.ok()) << fault.error().message;
      faults.push_back(*fault);
    }
    schedule = std::make_unique<FaultSchedule>(std::move(*FaultSchedule::create(std::move(faults), world->drones())));
  }
  void fly_to(double t_s) {
    while (world->now() < from_seconds(t_s)) {
      schedule->step(*world);
      world->step();
    }
  }

  std::unique_ptr<SimulatedWorld> world;
  std::unique_ptr<FaultSchedule> schedule;
};

TEST(FaultSchedule, StatesOfAnotherDroneNeedAnotherDrone) {
  const auto refused = [](int drones) {
    WorldConfig config;
    config.drones = drones;
    const auto world = SimulatedWorld::create(config);
    const auto made =
        FaultSchedule::create({*parse_fault("sdk tello1 states other 30%", "path", "")}, (*world)->drones());
    return made ? std::string() : made.error().message;
  };
  EXPECT_NE(refused(1).find("tello1 flies alone"), std::string::npos);
  EXPECT_EQ(refused(2), "");
}

TEST(FaultOverlap, TheEndOfOneLeavesTheOtherAsItIs) {
  Faulty stalls({{"ledger agent stall", "100ms", "1s"}, {"ledger agent to stall", "500ms", "2s"}});
  const LedgerPort& port = stalls.world->port(Process::agent);
  for (const auto& [t_s, reachable] : {std::pair(0.05, true), {0.3, false}, {1.5, false}, {2.6, true}}) {
    stalls.fly_to(t_s);
    EXPECT_EQ(port.reachable(), reachable) << t_s;
  }
  Faulty delays({{"ledger agent delay 300ms", "100ms", "3s"}, {"ledger agent to delay 10ms", "500ms", "1s"}});
  const LedgerPort& delayed = delays.world->port(Process::agent);
  for (const auto& [t_s, to, from] :
       {std::tuple(0.3, "300ms", "300ms"), {1.0, "10ms", "300ms"}, {2.0, "300ms", "300ms"}, {3.2, "", ""}}) {
    delays.fly_to(t_s);
    EXPECT_EQ(delayed.delay_to() ? text_of(*delayed.delay_to()) : "", to) << t_s;
    EXPECT_EQ(delayed.delay_from() ? text_of(*delayed.delay_from()) : "", from) << t_s;
  }
  Faulty drains({{"drone tello1 drain 10%", "100ms", "3s"}, {"drone tello1 drain 5%", "500ms", "1s"}});
  const auto drained = [&](double from_s, double to_s) {
    drains.fly_to(from_s);
    const double before = drains.world->drones()[0].truth.battery;
    drains.fly_to(to_s);
    return before - drains.world->drones()[0].truth.battery;
  };
  EXPECT_NEAR(drained(0.6, 1.4), 0.8 * 0.15, 0.005);
  EXPECT_NEAR(drained(1.6, 2.6), 0.1, 0.005);
  EXPECT_NEAR(drained(3.2, 4.2), 0, 0.005);
  // A wind that is none changes nothing of another.
  Faulty one({{"wind 2 0 0", "takeoff", "3s"}}),
      both({{"wind 2 0 0", "takeoff", "3s"}, {"wind 0 0 0", "takeoff + 1s", "500ms"}}), calm({});
  for (Faulty* run : {&one, &both, &calm}) run->fly_to(6);
  EXPECT_EQ(one.world->drones()[0].truth.position_m, both.world->drones()[0].truth.position_m);
  EXPECT_NE(one.world->drones()[0].truth.position_m, calm.world->drones()[0].truth.position_m);
}

TEST(FaultOverlap, ARestartEndsNoCut) {
  Faulty run({{"ledger both cut", "1s", "2s"}, {"ledger restart", "2s", ""}});
  for (const Process process : {Process::agent, Process::ground}) {
    EXPECT_TRUE(run.world->port(process).reachable());
  }
  for (const auto& [t_s, reachable] : {std::pair(1.5, false), {2.1, false}, {2.9, false}, {3.1, true}}) {
    run.fly_to(t_s);
    for (const Process process : {Process::agent, Process::ground})
      EXPECT_EQ(run.world->port(process).reachable(), reachable) << t_s;
  }
}

TEST(FaultClock, AJumpShorterThanStampsMayBeOffLosesNoPose) {
  for (const char* jump : {"clock jump 3ms", "clock jump 20ms", "clock jump -20ms", "clock jump -900ms"}) {
    Faulty run({{jump, "flying + 500ms", ""}});
    while (run.world->drones()[0].phase != LinkPhase::flying) run.fly_to(to_seconds(run.world->now()) + 0.1);
    const double begin_s = to_seconds(run.world->now());
    for (double t_s = begin_s; t_s < begin_s + 2; t_s += 0.01) {
      run.fly_to(t_s);
      const DroneObservation& drone = run.world->drones()[0];
      ASSERT_NE(drone.cause, FailsafeCause::pose_lost) << jump << " " << t_s;
      ASSERT_LE(run.world->now() - drone.pose->stamp_ns, 30 * ns_per_ms) << jump << " " << t_s;
      ASSERT_LE(drone.pose->stamp_ns, run.world->now()) << jump << " " << t_s;
    }
    EXPECT_EQ(run.schedule->never_begun(), std::vector<std::string>()) << jump;
  }
}

TEST(FaultOverlap, WhoWaitsForTheLedgerCanBeKilled) {
  for (const auto& [name, process] : {std::pair("agent", Process::agent), std::pair("ground", Process::ground)}) {
    const std::string kill = std::string(name) + " kill", cut = std::string("ledger ") + name + " cut";
    // Started at 1.5 s, but not before the cut's end at 3 s; killed again before.
    Faulty run({{kill.c_str(), "500ms", "1s"}, {cut.c_str(), "1s", "2s"}, {kill.c_str(), "2s", "3s"}});
    for (const auto& [t_s, lives] : {std::pair(0.4, true), {1.8, false}, {3.5, false}, {5.1, true}}) {
      run.fly_to(t_s);
      EXPECT_EQ(run.world->lives(process), lives) << name << " " << t_s;
    }
  }
}

TEST(FaultOverlap, AnExcuseEndsFiveSecondsBehindTheFault) {
  WorldConfig config;
  config.drones = 2;
  Faulty run({{"drone tello2 to loss 1%", "1s", "2s"}, {"drone tello1 kick 0 0 0", "2s", ""}}, config);
  run.fly_to(8.5);
  for (const auto& [t_s, pushed, deafened] : {std::tuple(6.9, true, true), {7.5, false, true}, {8.2, false, false}}) {
    EXPECT_EQ(run.schedule->excuse_of(0, from_seconds(t_s)).physical, pushed) << t_s;
    EXPECT_FALSE(run.schedule->excuse_of(0, from_seconds(t_s)).deaf) << t_s;
    EXPECT_EQ(run.schedule->excuse_of(1, from_seconds(t_s)).deaf, deafened) << t_s;
    EXPECT_FALSE(run.schedule->excuse_of(1, from_seconds(t_s)).physical) << t_s;
  }
}

TEST(FaultOverlap, ALinkThatIsBackExcusesTheDroneForOneSecond) {
  Faulty run({{"link kill", "1s", "2s"}});
  run.fly_to(5);
  for (const auto& [t_s, excused] : {std::pair(1.5, true), {3.9, true}, {4.2, false}})
    EXPECT_EQ(run.schedule->excuse_of(0, from_seconds(t_s)).deaf, excused) << t_s;
}

TEST(FaultOverlap, ACutThatWasAskedForExcusesItsDroneForGood) {
  WorldConfig config;
  config.drones = 2;
  Faulty run({{"operator cut tello2", "2s", ""}, {"operator stop tello1", "2s", ""}}, config);
  run.fly_to(1.9);
  EXPECT_FALSE(run.schedule->excuse_of(1, from_seconds(1.9)).cut);
  run.fly_to(3);
  EXPECT_TRUE(run.schedule->excuse_of(1, from_seconds(60)).cut);
  EXPECT_FALSE(run.schedule->excuse_of(0, from_seconds(3)).cut);
  EXPECT_FALSE(run.schedule->excuse_of(1, from_seconds(60)).physical);
}

TEST(FaultOverlap, TwoBiasesAddUp) {
  const auto lands = [](const std::vector<Written>& faults) {
    Faulty run(faults);
    bool seen = false;
    while (run.world->now() < 10 * ns_per_s) {
      run.fly_to(to_seconds(run.world->now()) + 0.01);
      const FailsafeCause cause = run.world->drones()[0].cause;
      seen = seen || cause == FailsafeCause::battery_critical;
    }
    return seen;
  };
  EXPECT_FALSE(lands({{"sensor tello1 bat bias -1", "path", ""}}));
  EXPECT_FALSE(lands({{"sensor tello1 bat bias -60", "path + 1s", ""}}));
  EXPECT_TRUE(lands({{"sensor tello1 bat bias -35", "path", ""}, {"sensor tello1 bat bias -60", "path + 1s", ""}}));
}

}  // namespace
}  // namespace ledgerline::hil
