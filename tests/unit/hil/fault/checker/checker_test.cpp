#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <memory>

#include "hil/fault/checker/checker.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

/// One drone in steady flight, as the checker sees it; a test makes something wrong.
class CheckedRun {
 public:
  explicit CheckedRun(const std::string& rule) {
    std::vector<Rule> rules;
    if (!rule.empty()) {
      auto parsed = parse_rule(rule);
      EXPECT_TRUE(parsed.ok()) << parsed.error().message;
      rules.push_back(*parsed);
    }
    checker_ = std::make_unique<Checker>(rules, Limits{});
    drones.resize(1);
    drones[0].name = "tello1";
    drones[0].phase = LinkPhase::flying;
    drones[0].truth.in_flight = true;
    drones[0].truth.position_m = {0, 0, 1};
  }
  void pass(TimeNs duration) {
    for (const TimeNs end = moment.now + duration; moment.now < end;) {
      moment.now += ns_per_ms;
      if (piloted) drones[0].plan_end_ns = moment.now + 100 * ns_per_ms;
      moment.drones = drones;
      moment.events = events;
      checker_->observe(moment);
      events.clear();
    }
  }
  /// What broke, in the words of the rules; empty: nothing.
  std::map<std::string, TimeNs> broken() {
    std::map<std::string, TimeNs> all;
    ending.now = moment.now;
    for (const Verdict& verdict : checker_->finish(ending)) {
      if (verdict.held) continue;
      all[verdict.rule.text] = verdict.broken_ns;
      seen[verdict.rule.text] = verdict.what;
    }
    return all;
  }
  std::map<std::string, std::string> seen;  ///< of what broke, after broken()

  std::vector<DroneObservation> drones;
  std::vector<WorldEvent> events;
  Moment moment;
  Ending ending{.now = 0, .over = true, .ok = true, .why = {}, .in_the_air = {}, .missing = {}, .lost = {}};
  bool piloted = true;

 private:
  std::unique_ptr<Checker> checker_;
};

TEST(FaultChecker, ASteadyFlightBreaksNothing) {
  for (const char* rule :
       {"finishes", "hold within 300 ms after the plan's end", "no command older than 500 ms applied",
        "height below 3 m", "speed below 1.5 m/s", "path within 0.4 m", "pose within 0.2 m",
        "nothing acknowledged is lost", "ends within 60 s", "land is never seen", "pose lost is never seen",
        "sends no emergency", "no crash", "fence kept within 0.2 m"}) {
    CheckedRun run(rule);
    run.pass(10 * ns_per_s);
    EXPECT_TRUE(run.broken().empty()) << rule << ": " << run.broken().begin()->first;
  }
}

TEST(FaultChecker, SaysTheMomentWhenARuleBroke) {
  const TimeNs moment = 2 * ns_per_s + ns_per_ms;
  const auto broken_at = [&](const std::string& rule, const std::function<void(CheckedRun&)>& wrong) {
    CheckedRun run(rule);
    run.moment.first_fault_ns = run.moment.last_fault_end_ns = ns_per_s;
    run.pass(2 * ns_per_s);
    wrong(run);
    run.pass(ns_per_s);
    const auto broken = run.broken();
    return broken.contains(rule) ? broken.at(rule) : -1;
  };
  EXPECT_EQ(broken_at("height below 2 m", [](CheckedRun& r) { r.drones[0].truth.position_m[2] = 2.1; }), moment);
  EXPECT_EQ(broken_at("speed below 1 m/s", [](CheckedRun& r) { r.drones[0].truth.velocity_mps[1] = -1.1; }), moment);
  EXPECT_EQ(broken_at("path within 0.4 m", [](CheckedRun& r) { r.drones[0].off_path_m = 0.5; }), moment);
  EXPECT_EQ(broken_at("pose within 0.2 m", [](CheckedRun& r) { r.drones[0].pose = Pose{}; }), moment);
  EXPECT_EQ(broken_at("no crash", [](CheckedRun& r) { r.drones[0].truth.crashed = true; }), moment);
  EXPECT_EQ(broken_at("brake is never seen", [](CheckedRun& r) { r.drones[0].mode = FailsafeMode::brake; }), moment);
  EXPECT_EQ(broken_at("pose lost is never seen", [](CheckedRun& r) { r.drones[0].cause = FailsafeCause::pose_lost; }),
            moment);
  EXPECT_EQ(broken_at("sends no emergency",
                      [](CheckedRun& r) {
                        r.events.push_back({0, WorldEvent::Kind::sent, 0, 0, "emergency"});
                      }),
            moment);
  EXPECT_EQ(broken_at("no command older than 500 ms applied",
                      [](CheckedRun& r) {
                        r.events.push_back({0, WorldEvent::Kind::applied, 0, 0.501, {}});
                      }),
            moment);
  EXPECT_EQ(broken_at("brakes within 1500 ms", [](CheckedRun&) {}), 2'501 * ns_per_ms);
  EXPECT_EQ(broken_at("lands within 1.5 s", [](CheckedRun&) {}), 2'501 * ns_per_ms);
  // The plan ends 100 ms behind the moment.
  EXPECT_EQ(broken_at("hold within 300 ms after the plan's end", [](CheckedRun& r) { r.piloted = false; }),
            2'401 * ns_per_ms);
  // At the end, 3 s.
  EXPECT_EQ(broken_at("finishes", [](CheckedRun& r) { r.ending.ok = false; }), 3 * ns_per_s);
  EXPECT_EQ(broken_at("ends within 2 s", [](CheckedRun&) {}), 3 * ns_per_s);
  EXPECT_EQ(broken_at("hold is seen", [](CheckedRun&) {}), 3 * ns_per_s);
  EXPECT_EQ(broken_at("sends takeoff", [](CheckedRun&) {}), 3 * ns_per_s);
  EXPECT_EQ(broken_at("nothing acknowledged is lost", [](CheckedRun& r) { r.ending.lost = {"x"}; }), 3 * ns_per_s);
}

TEST(FaultChecker, NobodyCutsAnUprightDroneUnlessItWasAskedFor) {
  const std::string rule = "always: no motors cut while upright";
  const auto broken = [&](const std::string& word, const std::function<void(CheckedRun&)>& set) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    run.moment.excuses = excuses;
    run.pass(ns_per_s);
    set(run);
    run.events.push_back({run.moment.now, WorldEvent::Kind::sent, 0, 0, word});
    run.pass(ns_per_ms);
    return run.broken().contains(rule);
  };
  EXPECT_TRUE(broken("emergency", [](CheckedRun&) {}));
  EXPECT_TRUE(broken("emergency", [](CheckedRun& r) { r.drones[0].truth.tilt_rad = 0.4; }));
  EXPECT_FALSE(broken("land", [](CheckedRun&) {}));
  EXPECT_FALSE(broken("emergency", [](CheckedRun& r) { r.drones[0].truth.tilt_rad = 3; }));
  EXPECT_FALSE(broken("emergency", [](CheckedRun& r) { r.drones[0].truth.in_flight = false; }));
  std::vector<Moment::Excuse> asked(1);
  asked[0].cut = true;
  EXPECT_FALSE(broken("emergency", [&](CheckedRun& r) { r.moment.excuses = asked; }));
  // That it was pushed is no reason.
  std::vector<Moment::Excuse> pushed(1);
  pushed[0] = {.physical = true, .broken = true};
  EXPECT_TRUE(broken("emergency", [&](CheckedRun& r) { r.moment.excuses = pushed; }));
}

TEST(FaultChecker, ADroneWithoutVelocityIsCheckedAgainstTheTruthWithAPhysicalBound) {
  const auto broken = [&](bool blind, double from_m, double to_m, double estimated_m, double mps,
                          bool steered = false) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0].blind = blind;
    excuses[0].steered = steered;
    run.moment.excuses = excuses;
    run.drones[0].truth.position_m[0] = from_m;
    run.drones[0].pose = Pose{.drone = 1, .position_m = {from_m, 0, 1}};
    run.pass(ns_per_s);
    run.drones[0].truth.position_m[0] = to_m;
    run.drones[0].truth.velocity_mps[0] = mps;
    run.drones[0].pose->position_m[0] = estimated_m;
    run.pass(ns_per_s);
    return run.broken();
  };
  const std::string far = "always: never farther than the limits", fast = "always: never faster than the limits";
  EXPECT_TRUE(broken(false, 98, 101, 98, 0).contains(far));
  EXPECT_FALSE(broken(true, 98, 101, 98, 0).contains(far)) << "3 m are what its drag needs";
  EXPECT_TRUE(broken(true, 98, 104, 98, 0).contains(far)) << "6 m are a runaway, wherever it takes itself to be";
  EXPECT_FALSE(broken(true, 98, 98, 104, 0).contains(far)) << "the estimate decides nothing";
  EXPECT_TRUE(broken(true, 0, 0, 0, 3).contains(fast));
  EXPECT_FALSE(broken(true, 0, 0, 0, 2).contains(fast));
  EXPECT_FALSE(broken(true, 0, 0, 0, 3, true).contains(fast)) << "motion capture steers it";
  EXPECT_TRUE(broken(true, 0, 0, 0, 4.5, true).contains(fast)) << "nobody does";
}

TEST(FaultChecker, ABlindDroneThatNobodyCouldTellAnythingRunsOnAndIsSlowedByDragAlone) {
  const auto broken = [](bool blind, double mps, double to_m) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0] = {.blind = blind, .deaf = true};
    run.moment.excuses = excuses;
    run.drones[0].truth.position_m[0] = 94;
    run.pass(ns_per_s);
    excuses[0].deaf = false;
    run.drones[0].truth.velocity_mps[0] = mps;
    run.pass(ns_per_s);
    run.drones[0].truth.position_m[0] = to_m;
    run.pass(ns_per_s);
    return run.broken();
  };
  const std::string far = "always: never farther than the limits", fast = "always: never faster than the limits";
  EXPECT_TRUE(broken(false, 3, 94).contains(fast));
  EXPECT_FALSE(broken(true, 3, 94).contains(fast));
  EXPECT_TRUE(broken(true, 4.5, 94).contains(fast));
  EXPECT_FALSE(broken(true, 3, 98.9).contains(far)) << "from where it could get a command";
  EXPECT_TRUE(broken(true, 3, 101).contains(far));
}

TEST(FaultChecker, ABlindDroneThatIsNotSeenCannotStop) {
  for (const bool blind : {false, true}) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0].blind = blind;
    run.moment.excuses = excuses;
    run.drones[0].phase = LinkPhase::disconnected;
    run.drones[0].truth.velocity_mps[0] = 0.5;
    run.pass(2 * ns_per_s);
    EXPECT_EQ(run.broken().contains("always: who is not seen is stopped and landed"), !blind);
    run.pass(25 * ns_per_s);
    EXPECT_TRUE(run.broken().contains("always: who is not seen is stopped and landed"));
  }
}

TEST(FaultChecker, WhatWasMissedWhileItWasBlindIsNoFaultOfTheFlightBehindIt) {
  const auto broken = [&](double missed_m) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0].blind = true;
    run.moment.excuses = excuses;
    run.drones[0].pose = Pose{.drone = 1, .position_m = {missed_m, 0, 1}};
    run.pass(ns_per_s);
    excuses[0].blind = false;
    run.drones[0].truth.position_m[0] = 100.8;
    run.pass(ns_per_s);
    return run.broken().contains("always: never farther than the limits");
  };
  EXPECT_FALSE(broken(1.0));
  EXPECT_TRUE(broken(0.5));
}

TEST(FaultChecker, WhatASpinningDroneIsSentNeedNotRamp) {
  for (const bool spins : {false, true}) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0] = {.physical = true, .broken = true, .spins = spins};
    run.moment.excuses = excuses;
    run.pass(2 * ns_per_s);
    run.drones[0].sent = {0.6, 0, 0};
    run.pass(ns_per_ms);
    EXPECT_EQ(run.broken().contains("always: commanded speed ramps"), !spins);
  }
}

TEST(FaultChecker, ResumesCountsFromTheLastFaultsEnd) {
  for (const bool again : {true, false}) {
    CheckedRun run("resumes within 2 s");
    run.drones[0].sent_ns = 1;
    run.drones[0].mode = FailsafeMode::hold;
    run.piloted = false;
    run.pass(ns_per_s);
    run.moment.last_fault_end_ns = run.moment.now;
    run.pass(1'900 * ns_per_ms);
    run.piloted = again;
    run.drones[0].mode = again ? FailsafeMode::none : FailsafeMode::hold;
    run.pass(ns_per_s);
    EXPECT_EQ(run.broken().contains("resumes within 2 s"), !again);
  }
}

TEST(FaultChecker, ABrokenTimeSaysWhatItCountsFromAndWhoHadLanded) {
  for (const TimeNs more : {ns_per_s, 3 * ns_per_s}) {  // the run's end, or the time's
    CheckedRun run("resumes within 2 s");
    run.pass(ns_per_s);
    run.drones[0].phase = LinkPhase::landed;
    run.drones[0].truth = {};
    run.pass(ns_per_s);
    run.moment.last_fault_end_ns = run.moment.now;
    run.pass(more);
    (void)run.broken();
    EXPECT_EQ(run.seen["resumes within 2 s"],
              std::string("tello1: ") + (more > 2 * ns_per_s ? "not within 2 s" : "never") +
                  ", counted from the last fault's end at 2.000 s; it had landed by then");
  }
  CheckedRun run("brakes within 1500 ms");
  run.moment.first_fault_ns = ns_per_s;
  run.pass(3 * ns_per_s);
  (void)run.broken();
  EXPECT_EQ(run.seen["brakes within 1500 ms"],
            "tello1: not within 1.5 s, counted from the first fault's beginning at 1.000 s");
}

TEST(FaultChecker, WhatIsBarelyBeyondALimitIsToldFromIt) {
  for (const auto& [off_m, said] : {std::pair{0.40003, "tello1: 0.40003 m"}, std::pair{0.5, "tello1: 0.500 m"}}) {
    CheckedRun run("path within 0.4 m");
    run.drones[0].off_path_m = off_m;
    run.pass(ns_per_s);
    (void)run.broken();
    EXPECT_EQ(run.seen["path within 0.4 m"], said);
  }
}

TEST(FaultChecker, ABrokenLimitNamesTheWorstToo) {
  CheckedRun run("path within 0.4 m");
  for (const double off_m : {0.5, 0.75, 0.6}) {
    run.drones[0].off_path_m = off_m;
    run.pass(ns_per_s);
  }
  (void)run.broken();
  EXPECT_EQ(run.seen["path within 0.4 m"], "tello1: 0.500 m; at worst tello1: 0.750 m");
}

TEST(FaultChecker, WhoRecoversFlewItsPlanAgain) {
  const std::string rule = "recovers and finishes the lap";
  const auto broken = [&](bool again, bool finished) {
    CheckedRun run(rule);
    run.drones[0].sent_ns = 1;
    run.pass(ns_per_s);
    run.moment.last_fault_end_ns = run.moment.now;
    run.drones[0].mode = again ? FailsafeMode::none : FailsafeMode::land;
    run.pass(ns_per_s);
    run.ending.ok = finished;
    return run.broken().contains(rule);
  };
  EXPECT_FALSE(broken(true, true));
  EXPECT_TRUE(broken(true, false));
  EXPECT_TRUE(broken(false, true));
  EXPECT_NE(error_of("title = \"t\"\nmust = [\"" + rule + "\"]\n").find("there is none"), std::string::npos);
}

TEST(FaultChecker, CountsTransactions) {
  for (const std::uint64_t transactions : {140U, 142U}) {
    CheckedRun run("at most 70 transactions a second");
    run.pass(2 * ns_per_s);
    run.ending.transactions = transactions;
    EXPECT_EQ(run.broken().contains("at most 70 transactions a second"), transactions > 140);
  }
}

TEST(FaultChecker, SendsIsOfTheCommandsThatLinkHas) {
  for (const char* command : {"command", "takeoff", "land", "emergency"})
    EXPECT_TRUE(parse_rule(std::string("sends no ") + command)) << command;
  for (const char* bad : {"sends no emergncy", "sends rc", "sends no", "sends no no land"})
    EXPECT_FALSE(parse_rule(bad)) << bad;
}

TEST(FaultChecker, EveryDroneThatTheFirstFaultNamesHasToLand) {
  const auto lands = [](std::vector<std::size_t> named, const std::function<void(CheckedRun&)>& what) {
    CheckedRun run("lands within 2 s");
    run.drones.push_back(run.drones[0]);
    run.drones[1].name = "tello2";
    run.pass(ns_per_s);
    run.moment.first_fault_ns = run.moment.now;
    run.moment.first_fault_drones = named;
    run.pass(ns_per_s);
    what(run);
    run.pass(2 * ns_per_s);
    return !run.broken().contains("lands within 2 s");
  };
  const auto land = [](CheckedRun& run, std::size_t drone) {
    run.drones[drone].truth.in_flight = false;
    run.drones[drone].truth.position_m[2] = 0.02;
  };
  EXPECT_TRUE(lands({0}, [&](CheckedRun& r) { land(r, 0); }));
  EXPECT_FALSE(lands({0}, [&](CheckedRun& r) { land(r, 1); }));
  EXPECT_FALSE(lands({0, 1}, [&](CheckedRun& r) { land(r, 0); }));
  EXPECT_FALSE(lands({}, [&](CheckedRun& r) { land(r, 1); }));
  EXPECT_TRUE(lands({}, [&](CheckedRun& r) { land(r, 0), land(r, 1); }));
  EXPECT_FALSE(lands({0}, [](CheckedRun& r) { r.drones[0].truth.in_flight = false; }));  // it falls
  CheckedRun grounded("lands within 2 s");                                               // never flew
  land(grounded, 0);
  grounded.moment.first_fault_ns = 0;
  grounded.pass(3 * ns_per_s);
  EXPECT_TRUE(grounded.broken().contains("lands within 2 s"));
}

TEST(FaultChecker, AnExcuseIsOfOneDroneAlone) {
  for (const std::size_t excused : {0U, 1U}) {
    CheckedRun run("");
    run.drones.push_back(run.drones[0]);
    std::vector<Moment::Excuse> excuses(2);
    excuses[excused].deaf = true;
    run.moment.excuses = excuses;
    run.drones[0].truth.position_m[2] = 5;
    run.pass(ns_per_s);
    EXPECT_EQ(run.broken().contains("always: never higher than the limits"), excused == 1);
  }
}

TEST(FaultChecker, OnlyADroneThatAFaultBrokeMayTurnOver) {
  for (const bool broken : {true, false}) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0] = {.physical = true, .broken = broken};
    run.moment.excuses = excuses;
    run.drones[0].truth.crashed = true;
    run.pass(ns_per_s);
    EXPECT_EQ(run.broken().contains("always: no crash"), !broken);
  }
}

TEST(FaultChecker, WhereItGotWhileItWasDeafItMayStayButGoNoFarther) {
  for (const double farther : {0.4, 0.6}) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    run.moment.excuses = excuses;
    run.pass(ns_per_s);
    excuses[0].deaf = true;
    run.drones[0].truth.position_m = {104, 0, 5};
    run.pass(ns_per_s);
    excuses[0].deaf = false;
    run.drones[0].truth.position_m = {104 + farther, 0, 5 + farther};
    run.pass(ns_per_s);
    EXPECT_EQ(run.broken().contains("always: never farther than the limits"), farther > 0.5);
    EXPECT_EQ(run.broken().contains("always: never higher than the limits"), farther > 0.5);
  }
}

TEST(FaultChecker, WhoIsNotSeenMustStopAndComeDown) {
  const auto broken = [](double mps, TimeNs duration, bool deaf, bool link_runs) {
    CheckedRun run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0].deaf = deaf;
    run.moment.excuses = excuses;
    run.moment.link_runs = link_runs;
    run.drones[0].phase = LinkPhase::disconnected;
    run.drones[0].truth.velocity_mps = {0, mps, -0.5};
    run.pass(duration);
    return run.broken().contains("always: who is not seen is stopped and landed");
  };
  EXPECT_FALSE(broken(0.6, 900 * ns_per_ms, false, true));
  EXPECT_TRUE(broken(0.6, 1'100 * ns_per_ms, false, true));
  EXPECT_FALSE(broken(0.2, 24 * ns_per_s, false, true));
  EXPECT_TRUE(broken(0.2, 26 * ns_per_s, false, true));
  EXPECT_FALSE(broken(0.6, 26 * ns_per_s, true, true));
  EXPECT_FALSE(broken(0.6, 26 * ns_per_s, false, false));
}

TEST(FaultChecker, InvariantsAreCheckedInEveryRun) {
  const auto broken_by = [](const std::function<void(CheckedRun&)>& wrong) {
    CheckedRun run("");
    run.pass(2 * ns_per_s);
    wrong(run);
    run.pass(6 * ns_per_s);
    const auto broken = run.broken();
    return broken.empty() ? std::string() : broken.begin()->first;
  };
  EXPECT_EQ(broken_by([](CheckedRun&) {}), "");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.drones[0].truth.velocity_mps[0] = 3; }),
            "always: never faster than the limits");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.drones[0].truth.position_m[2] = 4; }),
            "always: never higher than the limits");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.drones[0].truth.position_m[1] = 101; }),
            "always: never farther than the limits");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.drones[0].truth.crashed = true; }), "always: no crash");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.ending.crashed = {"agent was ended by signal 11"}; }), "always: no crash");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.piloted = false; }), "always: a hold or a landing after silence");
  EXPECT_EQ(broken_by([](CheckedRun& r) {
              r.piloted = false;
              r.drones[0].mode = FailsafeMode::land;
              r.drones[0].sent_mps = 0.3;
            }),
            "always: a hold or a landing after silence");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.drones[0].mode = FailsafeMode::hold; }),
            "always: a hold ends in a landing");
  EXPECT_EQ(broken_by([](CheckedRun& r) {
              r.events.push_back({0, WorldEvent::Kind::bad_rc, 0, 0, "rc 300 0 0 0"});
            }),
            "always: rc in the SDK's range");
  // Commanded 0.5 m/s at once; a ramp of 4 m/s2 is no such jump.
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.drones[0].sent = {0.5, 0, 0}; }), "always: commanded speed ramps");
  const auto ramps = [](double mps2, FailsafeMode mode) {
    return [=](CheckedRun& r) {
      for (int i = 1; i <= 10; ++i) {
        r.drones[0].mode = mode;
        r.drones[0].sent[1] = mps2 * 0.02 * i;
        r.pass(20 * ns_per_ms);
      }
      r.drones[0].mode = FailsafeMode::none;
    };
  };
  EXPECT_EQ(broken_by(ramps(4, FailsafeMode::none)), "");
  EXPECT_EQ(broken_by(ramps(8, FailsafeMode::none)), "always: commanded speed ramps");
  EXPECT_EQ(broken_by(ramps(8, FailsafeMode::brake)), "");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.ending.in_the_air = {"tello1"}; }), "always: on the ground in the end");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.ending.over = false; }), "always: no hang");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.ending.missing = {"fault"}; }), "always: every fault began");
  EXPECT_EQ(broken_by([](CheckedRun& r) { r.ending.lost = {"transaction"}; }), "always: nothing acknowledged is lost");
}

TEST(FaultChecker, CommandsAreHandedOnAndFlownInOrderEachOnce) {
  using Kind = WorldEvent::Kind;
  const std::string rule = "always: commands in order, each once";
  const auto broken = [&](const std::vector<WorldEvent>& events, FailsafeMode mode = FailsafeMode::none) {
    CheckedRun run("");
    run.drones[0].mode = mode;
    for (const WorldEvent& event : events) {
      run.events = {event};
      run.pass(ns_per_ms);
    }
    return run.broken().contains(rule);
  };
  const auto of = [](Kind kind, std::uint64_t sequence) { return WorldEvent{0, kind, 0, 0, {}, sequence}; };
  for (const Kind kind : {Kind::handed, Kind::applied}) {
    EXPECT_FALSE(broken({of(kind, 1), of(kind, 2), of(kind, 5)}));
    EXPECT_TRUE(broken({of(kind, 1), of(kind, 1)}));
    EXPECT_TRUE(broken({of(kind, 2), of(kind, 1)}));
    EXPECT_FALSE(broken({of(kind, 0), of(kind, 0)}));  // not known
  }
  EXPECT_FALSE(broken({of(Kind::handed, 1), of(Kind::applied, 1)}));
  EXPECT_FALSE(broken({of(Kind::applied, 2), of(Kind::applied, 2)}, FailsafeMode::land));  // a stop, said again
  const auto started = [](const char* what) { return WorldEvent{0, Kind::started, 0, 0, what}; };
  EXPECT_FALSE(broken({of(Kind::handed, 2), started("agent"), of(Kind::handed, 1)}));
  EXPECT_TRUE(broken({of(Kind::handed, 2), started("link"), of(Kind::handed, 1)}));
  EXPECT_FALSE(broken({of(Kind::applied, 2), started("link"), of(Kind::applied, 1)}));
}

TEST(FaultChecker, ABrakeTakesItsPlansWithIt) {
  for (const bool given : {true, false}) {
    CheckedRun run("");
    run.drones[0].plans_given = 7;
    run.drones[0].mode = FailsafeMode::brake;
    run.pass(ns_per_s);
    run.drones[0].mode = FailsafeMode::none;
    run.pass(100 * ns_per_ms);
    if (given) ++run.drones[0].plans_given;
    run.drones[0].sent_mps = 0.1;
    run.pass(100 * ns_per_ms);
    EXPECT_EQ(run.broken().contains("always: a brake takes its plans with it"), !given);
  }
}

TEST(FaultChecker, AHoverIsMeasuredFromWhereItSettled) {
  CheckedRun run("hovers within 0.15 m");
  run.drones[0].truth.position_m[0] += 0.5;  // as it rises
  run.pass(3 * ns_per_s);
  run.drones[0].truth.position_m[0] += 0.1;
  run.pass(ns_per_s);
  EXPECT_TRUE(run.broken().empty());
  run.drones[0].truth.position_m[1] += 0.2;
  run.pass(ns_per_s);
  EXPECT_TRUE(run.broken().contains("hovers within 0.15 m"));
}

TEST(FaultChecker, TheFenceIsOfTheTruth) {
  for (const auto& [place, kept] : {std::pair(std::array<double, 3>{100.1, 0, 1}, true),
                                    {{100.3, 0, 1}, false},
                                    {{0, -100.3, 1}, false},
                                    {{0, 0, 3.3}, false}}) {
    CheckedRun run("fence kept within 0.2 m");
    run.pass(ns_per_s);
    run.drones[0].truth.position_m = place;
    run.pass(ns_per_ms);
    EXPECT_EQ(run.broken().contains("fence kept within 0.2 m"), !kept) << place[0] << " " << place[1];
  }
}

TEST(FaultChecker, DronesAreApartInTruthUnlessBothStand) {
  for (const auto& [place, flies, kept] : {std::tuple(std::array<double, 3>{0.3, 0, 1.5}, true, true),
                                           {{0.3, 0, 1.3}, true, false},
                                           {{0, 0, 0}, true, true},
                                           {{0.4, 0, 0}, false, true}}) {
    CheckedRun run("drones apart by 0.5 m");
    run.drones.push_back(run.drones[0]);
    run.drones[1].name = "tello2";
    run.drones[1].truth.position_m = place;
    if (!flies) {
      for (DroneObservation& drone : run.drones) {
        drone.truth.in_flight = false;
        drone.truth.position_m[2] = 0;
      }
    }
    run.pass(ns_per_ms);
    EXPECT_EQ(run.broken().contains("drones apart by 0.5 m"), !kept) << place[0] << " " << place[2];
  }
}

}  // namespace
}  // namespace ledgerline::hil
