#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>

#include "hil/fault/campaign.hpp"
#include "hil/fault/schedule.hpp"
#include "tests/unit/campaign.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> library() {
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(SCENARIOS)) {
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string error_of(const std::string& toml) {
  const auto script = parse_script(toml, "x.toml");
  return script ? "" : script.error().what;
}

Script scripted(const std::string& toml) {
  auto script = parse_script(toml, "x.toml");
  EXPECT_TRUE(script.ok()) << script.error().what;
  return *script;
}

// --- scripts -------------------------------------------------------------------------------------------------------

TEST(FaultScript, SaysFileLineKeyAndWhatIsAllowed) {
  const std::string error = error_of(
      "title = \"t\"\nmust = [\"flies well\"]\n[flight]\nlaps = 0\nwings = 2\n[[fault]]\nwhat = \"drone tello1 to "
      "sideways\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"noon\"\n[[fault]]\nwhat = \"ledger stall\"\nfor = "
      "\"long\"\n");
  for (const char* wanted :
       {"x.toml:2: must: \"flies well\" is no rule; there are", "x.toml:4: flight.laps: must be a whole number from 1",
        "x.toml:5: flight.wings: unknown key",
        "x.toml:7: fault.0.what:", "x.toml:10: fault.1.at: \"noon\": must be a time", "x.toml:13: fault.2.for:"})
    EXPECT_NE(error.find(wanted), std::string::npos) << wanted << "\nis not in\n" << error;
}

TEST(FaultScript, WhatIsNotImplementedIsRefusedNeverIgnored) {
  for (const char* what : {"peer kill",
                           "orderer kill",
                           "chaincode kill",
                           "cpu burn",
                           "memory 1GB",
                           "disk full",
                           "roudi kill",
                           "ledger agent loss 5%",
                           "ledger both from corrupt 1%",
                           "ledger agent partition",
                           "drone tello1 sideways",
                           "drone tello1 to",
                           "drone tello2 to stall",
                           "drone tello1 plans corrupt 5%",
                           "drone tello1 plans truncate 5%",
                           "drone tello1 plans delay 10ms, rate 1MB/s",
                           "ledger agent lies",
                           "ledger agent lies twice",
                           "operator errs badly",
                           "stranger errs boot",
                           "supervisor dance tello1",
                           "sensor tello1 speed stuck",
                           "sensor tello1 h wild",
                           "mocap tello1",
                           "agent pause",
                           "wind 1 2",
                           "clock jump soon",
                           "operator dance tello1",
                           "drone tello1 to loss off",
                           "drone tello1 to delay 10ms, loss off",
                           "drone tello1 to clear",
                           "mocap tello1 clear",
                           "mocap tello1 every 0s",
                           "sensor tello1 all every 0s",
                           "drone tello1 battery 200%"}) {
    const std::string error = error_of(std::string("title = \"t\"\n[[fault]]\nwhat = \"") + what + "\"\n");
    EXPECT_NE(error.find("x.toml:3: fault.0.what:"), std::string::npos) << what << ": " << error;
  }
  EXPECT_NE(error_of("title = \"t\"\n[[fault]]\nwhat = \"ground end\"\n").find("kill"), std::string::npos);
  EXPECT_EQ(
      error_of("title = \"t\"\n[flight]\nkeeps_rc = false\ncommand_counts = false\n[[fault]]\nwhat = \"link end\"\n"),
      "");
  EXPECT_NE(error_of("title = \"t\"\n[[fault]]\nwhat = \"clock jump 1s\"\nfor = \"1s\"\n").find("leave `for` out"),
            std::string::npos);
  EXPECT_NE(error_of("title = \"t\"\nmust = [\"lands within 3 s\"]\n").find("there is none"), std::string::npos);
}

TEST(FaultScript, WhatCountsFromAnEndNeedsFaultsThatEnd) {
  for (const char* rule : {"resumes within 2 s", "recovers and finishes the lap"}) {
    const auto error = [&](const char* fault) {
      return error_of(std::string("title = \"t\"\nmust = [\"") + rule + "\"]\n[[fault]]\nwhat = " + fault + "\n");
    };
    EXPECT_EQ(error("\"ledger stall\"\nfor = \"2s\""), "");
    EXPECT_EQ(error("\"ledger restart\""), "");
    const std::string refused = error("\"ledger stall\"");
    for (const std::string& wanted :
         {"x.toml:2: must: \"" + std::string(rule), std::string("\"ledger stall\" never ends")})
      EXPECT_NE(refused.find(wanted), std::string::npos) << refused;
  }
}

TEST(FaultScript, APlansFaultIsJudgedByWhatItDoesNotByItsWords) {
  const std::string file = testing::TempDir() + "generated-rate.txt";
  std::ofstream(file) << "0.01\n0.02\n";
  const auto fault = parse_fault("drone tello1 plans delay recorded " + file, "path", "");
  EXPECT_TRUE(fault.ok()) << fault.error().what;
  std::filesystem::remove(file);
}

TEST(FaultScript, IsReadAgainAsItWasWritten) {
  constexpr std::uint64_t drawn_scripts = slow ? 50 : 500;
  std::set<std::string> texts;
  for (std::uint64_t number = 1; number <= drawn_scripts; ++number) {
    const Script drawn = draw_script(number);
    const std::string text = text_of(drawn);
    const auto again = parse_script(text, drawn.name + ".toml");
    ASSERT_TRUE(again.ok()) << again.error().what << "\n" << text;
    EXPECT_EQ(text_of(*again), text);
    texts.insert(text);
  }
  EXPECT_EQ(texts.size(), drawn_scripts);
  for (const std::string& file : library()) {
    const auto script = load_script(file);
    ASSERT_TRUE(script.ok()) << script.error().what;
    const auto again = parse_script(text_of(*script), file);
    ASSERT_TRUE(again.ok()) << again.error().what;
    EXPECT_EQ(text_of(*again), text_of(*script));
  }
}

// --- the judge -----------------------------------------------------------------------------------------------------

/// One drone in steady flight, as the judge sees it; a test makes something wrong.
class Judged {
 public:
  explicit Judged(const std::string& rule) {
    std::vector<Rule> rules;
    if (!rule.empty()) {
      auto parsed = parse_rule(rule);
      EXPECT_TRUE(parsed.ok()) << parsed.error().what;
      rules.push_back(*parsed);
    }
    judge_ = std::make_unique<Judge>(rules, Limits{});
    drones.resize(1);
    drones[0].name = "tello1";
    drones[0].phase = FlightPhase::flying;
    drones[0].truth.in_flight = true;
    drones[0].truth.position_m = {0, 0, 1};
  }
  void pass(TimeNs duration) {
    for (const TimeNs end = moment.now + duration; moment.now < end;) {
      moment.now += ns_per_ms;
      if (piloted) drones[0].plan_end_ns = moment.now + 100 * ns_per_ms;
      moment.drones = drones;
      moment.events = events;
      judge_->look(moment);
      events.clear();
    }
  }
  /// What broke, in the words of the rules; empty: nothing.
  std::map<std::string, TimeNs> broken() {
    std::map<std::string, TimeNs> all;
    ending.now = moment.now;
    for (const Verdict& verdict : judge_->finish(ending)) {
      if (!verdict.held) all[verdict.rule.text] = verdict.broken_ns;
    }
    return all;
  }

  std::vector<DroneFacts> drones;
  std::vector<WorldEvent> events;
  Moment moment;
  Ending ending{.now = 0, .over = true, .ok = true, .why = {}, .in_the_air = {}, .missing = {}, .lost = {}};
  bool piloted = true;

 private:
  std::unique_ptr<Judge> judge_;
};

TEST(FaultJudge, ASteadyFlightBreaksNothing) {
  for (const char* rule :
       {"finishes", "hold within 300 ms after the plan's end", "no command older than 500 ms applied",
        "height below 3 m", "speed below 1.5 m/s", "path within 0.4 m", "pose within 0.2 m",
        "nothing acknowledged is lost", "ends within 60 s", "land is never seen", "pose lost is never seen",
        "sends no emergency", "no crash", "fence kept within 0.2 m"}) {
    Judged run(rule);
    run.pass(10 * ns_per_s);
    EXPECT_TRUE(run.broken().empty()) << rule << ": " << run.broken().begin()->first;
  }
}

TEST(FaultJudge, SaysTheMomentWhenARuleBroke) {
  const TimeNs moment = 2 * ns_per_s + ns_per_ms;
  const auto broken_at = [&](const std::string& rule, const std::function<void(Judged&)>& wrong) {
    Judged run(rule);
    run.moment.first_fault_ns = run.moment.last_fault_end_ns = ns_per_s;
    run.pass(2 * ns_per_s);
    wrong(run);
    run.pass(ns_per_s);
    const auto broken = run.broken();
    return broken.contains(rule) ? broken.at(rule) : -1;
  };
  EXPECT_EQ(broken_at("height below 2 m", [](Judged& r) { r.drones[0].truth.position_m[2] = 2.1; }), moment);
  EXPECT_EQ(broken_at("speed below 1 m/s", [](Judged& r) { r.drones[0].truth.velocity_mps[1] = -1.1; }), moment);
  EXPECT_EQ(broken_at("path within 0.4 m", [](Judged& r) { r.drones[0].off_path_m = 0.5; }), moment);
  EXPECT_EQ(broken_at("pose within 0.2 m", [](Judged& r) { r.drones[0].pose = Pose{}; }), moment);
  EXPECT_EQ(broken_at("no crash", [](Judged& r) { r.drones[0].truth.crashed = true; }), moment);
  EXPECT_EQ(broken_at("brake is never seen", [](Judged& r) { r.drones[0].mode = FailsafeMode::brake; }), moment);
  EXPECT_EQ(broken_at("pose lost is never seen", [](Judged& r) { r.drones[0].cause = FailsafeCause::pose_lost; }),
            moment);
  EXPECT_EQ(broken_at("sends no emergency",
                      [](Judged& r) {
                        r.events.push_back({0, WorldEvent::Kind::sent, 0, 0, "emergency"});
                      }),
            moment);
  EXPECT_EQ(broken_at("no command older than 500 ms applied",
                      [](Judged& r) {
                        r.events.push_back({0, WorldEvent::Kind::applied, 0, 0.501, {}});
                      }),
            moment);
  EXPECT_EQ(broken_at("brakes within 1500 ms", [](Judged&) {}), 2'501 * ns_per_ms);
  EXPECT_EQ(broken_at("lands within 1.5 s", [](Judged&) {}), 2'501 * ns_per_ms);
  // The plan ends 100 ms behind the moment.
  EXPECT_EQ(broken_at("hold within 300 ms after the plan's end", [](Judged& r) { r.piloted = false; }),
            2'401 * ns_per_ms);
  // At the end, 3 s.
  EXPECT_EQ(broken_at("finishes", [](Judged& r) { r.ending.ok = false; }), 3 * ns_per_s);
  EXPECT_EQ(broken_at("ends within 2 s", [](Judged&) {}), 3 * ns_per_s);
  EXPECT_EQ(broken_at("hold is seen", [](Judged&) {}), 3 * ns_per_s);
  EXPECT_EQ(broken_at("sends takeoff", [](Judged&) {}), 3 * ns_per_s);
  EXPECT_EQ(broken_at("nothing acknowledged is lost", [](Judged& r) { r.ending.lost = {"x"}; }), 3 * ns_per_s);
}

TEST(FaultJudge, ResumesCountsFromTheLastFaultsEnd) {
  for (const bool again : {true, false}) {
    Judged run("resumes within 2 s");
    run.drones[0].told_ns = 1;
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

TEST(FaultJudge, WhoRecoversFlewItsPlanAgain) {
  const std::string rule = "recovers and finishes the lap";
  const auto broken = [&](bool again, bool finished) {
    Judged run(rule);
    run.drones[0].told_ns = 1;
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

TEST(FaultJudge, CountsTransactions) {
  for (const std::uint64_t transactions : {140U, 142U}) {
    Judged run("at most 70 transactions a second");
    run.pass(2 * ns_per_s);
    run.ending.transactions = transactions;
    EXPECT_EQ(run.broken().contains("at most 70 transactions a second"), transactions > 140);
  }
}

TEST(FaultJudge, SendsIsOfTheCommandsThatLinkHas) {
  for (const char* command : {"command", "takeoff", "land", "emergency"})
    EXPECT_TRUE(parse_rule(std::string("sends no ") + command)) << command;
  for (const char* bad : {"sends no emergncy", "sends rc", "sends no", "sends no no land"})
    EXPECT_FALSE(parse_rule(bad)) << bad;
}

TEST(FaultJudge, EveryDroneThatTheFirstFaultNamesHasToLand) {
  const auto lands = [](std::vector<std::size_t> named, const std::function<void(Judged&)>& what) {
    Judged run("lands within 2 s");
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
  const auto land = [](Judged& run, std::size_t drone) {
    run.drones[drone].truth.in_flight = false;
    run.drones[drone].truth.position_m[2] = 0.02;
  };
  EXPECT_TRUE(lands({0}, [&](Judged& r) { land(r, 0); }));
  EXPECT_FALSE(lands({0}, [&](Judged& r) { land(r, 1); }));
  EXPECT_FALSE(lands({0, 1}, [&](Judged& r) { land(r, 0); }));
  EXPECT_FALSE(lands({}, [&](Judged& r) { land(r, 1); }));
  EXPECT_TRUE(lands({}, [&](Judged& r) { land(r, 0), land(r, 1); }));
  EXPECT_FALSE(lands({0}, [](Judged& r) { r.drones[0].truth.in_flight = false; }));  // it falls
  Judged grounded("lands within 2 s");                                               // never flew
  land(grounded, 0);
  grounded.moment.first_fault_ns = 0;
  grounded.pass(3 * ns_per_s);
  EXPECT_TRUE(grounded.broken().contains("lands within 2 s"));
}

TEST(FaultJudge, AnExcuseIsOfOneDroneAlone) {
  for (const std::size_t excused : {0U, 1U}) {
    Judged run("");
    run.drones.push_back(run.drones[0]);
    std::vector<Moment::Excuse> excuses(2);
    excuses[excused].deaf = true;
    run.moment.excuses = excuses;
    run.drones[0].truth.position_m[2] = 5;
    run.pass(ns_per_s);
    EXPECT_EQ(run.broken().contains("always: never higher than the limits"), excused == 1);
  }
}

TEST(FaultJudge, WhereItGotWhileItWasDeafItMayStayButGoNoFarther) {
  for (const double farther : {0.4, 0.6}) {
    Judged run("");
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

TEST(FaultJudge, WhoIsNotSeenMustStopAndComeDown) {
  const auto broken = [](double mps, TimeNs duration, bool deaf, bool link_runs) {
    Judged run("");
    std::vector<Moment::Excuse> excuses(1);
    excuses[0].deaf = deaf;
    run.moment.excuses = excuses;
    run.moment.link_runs = link_runs;
    run.drones[0].phase = FlightPhase::disconnected;
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

TEST(FaultJudge, InvariantsAreJudgedInEveryRun) {
  const auto broken_by = [](const std::function<void(Judged&)>& wrong) {
    Judged run("");
    run.pass(2 * ns_per_s);
    wrong(run);
    run.pass(6 * ns_per_s);
    const auto broken = run.broken();
    return broken.empty() ? std::string() : broken.begin()->first;
  };
  EXPECT_EQ(broken_by([](Judged&) {}), "");
  EXPECT_EQ(broken_by([](Judged& r) { r.drones[0].truth.velocity_mps[0] = 3; }),
            "always: never faster than the limits");
  EXPECT_EQ(broken_by([](Judged& r) { r.drones[0].truth.position_m[2] = 4; }), "always: never higher than the limits");
  EXPECT_EQ(broken_by([](Judged& r) { r.drones[0].truth.position_m[1] = 101; }),
            "always: never farther than the limits");
  EXPECT_EQ(broken_by([](Judged& r) { r.piloted = false; }), "always: a hold or a landing after silence");
  EXPECT_EQ(broken_by([](Judged& r) {
              r.piloted = false;
              r.drones[0].mode = FailsafeMode::land;
              r.drones[0].told_mps = 0.3;
            }),
            "always: a hold or a landing after silence");
  EXPECT_EQ(broken_by([](Judged& r) { r.drones[0].mode = FailsafeMode::hold; }), "always: a hold ends in a landing");
  EXPECT_EQ(broken_by([](Judged& r) {
              r.events.push_back({0, WorldEvent::Kind::bad_rc, 0, 0, "rc 300 0 0 0"});
            }),
            "always: rc in the SDK's range");
  // Told 0.5 m/s at once; a ramp of 4 m/s2 is none of that.
  EXPECT_EQ(broken_by([](Judged& r) { r.drones[0].told = {0.5, 0, 0}; }), "always: told speed ramps");
  const auto ramps = [](double mps2, FailsafeMode mode) {
    return [=](Judged& r) {
      for (int i = 1; i <= 10; ++i) {
        r.drones[0].mode = mode;
        r.drones[0].told[1] = mps2 * 0.02 * i;
        r.pass(20 * ns_per_ms);
      }
      r.drones[0].mode = FailsafeMode::none;
    };
  };
  EXPECT_EQ(broken_by(ramps(4, FailsafeMode::none)), "");
  EXPECT_EQ(broken_by(ramps(8, FailsafeMode::none)), "always: told speed ramps");
  EXPECT_EQ(broken_by(ramps(8, FailsafeMode::brake)), "");
  EXPECT_EQ(broken_by([](Judged& r) { r.ending.in_the_air = {"tello1"}; }), "always: on the ground in the end");
  EXPECT_EQ(broken_by([](Judged& r) { r.ending.over = false; }), "always: no hang");
  EXPECT_EQ(broken_by([](Judged& r) { r.ending.missing = {"fault"}; }), "always: every fault began");
  EXPECT_EQ(broken_by([](Judged& r) { r.ending.lost = {"transaction"}; }), "always: nothing acknowledged is lost");
}

TEST(FaultJudge, CommandsAreHandedOnAndFlownInOrderEachOnce) {
  using Kind = WorldEvent::Kind;
  const std::string rule = "always: commands in order, each once";
  const auto broken = [&](const std::vector<WorldEvent>& events, FailsafeMode mode = FailsafeMode::none) {
    Judged run("");
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

TEST(FaultJudge, ABrakeTakesItsPlansWithIt) {
  for (const bool given : {true, false}) {
    Judged run("");
    run.drones[0].plans_given = 7;
    run.drones[0].mode = FailsafeMode::brake;
    run.pass(ns_per_s);
    run.drones[0].mode = FailsafeMode::none;
    run.pass(100 * ns_per_ms);
    if (given) ++run.drones[0].plans_given;
    run.drones[0].told_mps = 0.1;
    run.pass(100 * ns_per_ms);
    EXPECT_EQ(run.broken().contains("always: a brake takes its plans with it"), !given);
  }
}

TEST(FaultJudge, TheFenceIsOfTheTruth) {
  for (const auto& [place, kept] : {std::pair(std::array<double, 3>{100.1, 0, 1}, true),
                                    {{100.3, 0, 1}, false},
                                    {{0, -100.3, 1}, false},
                                    {{0, 0, 3.3}, false}}) {
    Judged run("fence kept within 0.2 m");
    run.pass(ns_per_s);
    run.drones[0].truth.position_m = place;
    run.pass(ns_per_ms);
    EXPECT_EQ(run.broken().contains("fence kept within 0.2 m"), !kept) << place[0] << " " << place[1];
  }
}

// --- faults that lie upon each other -------------------------------------------------------------------------------

struct Written {
  const char *what, *at, *lasts;
};

/// A world and its faults, step by step.
class Faulty {
 public:
  explicit Faulty(const std::vector<Written>& written, const WorldConfig& config = {}) {
    world = std::move(*VirtualWorld::create(config));
    std::vector<Fault> faults;
    for (const Written& w : written) {
      auto fault = parse_fault(w.what, w.at, w.lasts);
      EXPECT_TRUE(fault.ok()) << fault.error().what;
      faults.push_back(*fault);
    }
    schedule = std::make_unique<FaultSchedule>(std::move(*FaultSchedule::create(std::move(faults), world->facts())));
  }
  void fly_to(double t_s) {
    while (world->now() < from_seconds(t_s)) {
      schedule->step(*world);
      world->step();
    }
  }

  std::unique_ptr<VirtualWorld> world;
  std::unique_ptr<FaultSchedule> schedule;
};

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
    const double before = drains.world->facts()[0].truth.battery;
    drains.fly_to(to_s);
    return before - drains.world->facts()[0].truth.battery;
  };
  EXPECT_NEAR(drained(0.6, 1.4), 0.8 * 0.15, 0.005);
  EXPECT_NEAR(drained(1.6, 2.6), 0.1, 0.005);
  EXPECT_NEAR(drained(3.2, 4.2), 0, 0.005);
  // A wind that is none changes nothing of another.
  Faulty one({{"wind 2 0 0", "takeoff", "3s"}}),
      both({{"wind 2 0 0", "takeoff", "3s"}, {"wind 0 0 0", "takeoff + 1s", "500ms"}}), calm({});
  for (Faulty* run : {&one, &both, &calm}) run->fly_to(6);
  EXPECT_EQ(one.world->facts()[0].truth.position_m, both.world->facts()[0].truth.position_m);
  EXPECT_NE(one.world->facts()[0].truth.position_m, calm.world->facts()[0].truth.position_m);
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
    while (run.world->facts()[0].phase != FlightPhase::flying) run.fly_to(to_seconds(run.world->now()) + 0.1);
    const double begin_s = to_seconds(run.world->now());
    for (double t_s = begin_s; t_s < begin_s + 2; t_s += 0.01) {
      run.fly_to(t_s);
      const DroneFacts& drone = run.world->facts()[0];
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
    EXPECT_EQ(run.schedule->effect_on(0, from_seconds(t_s)).pushed, pushed) << t_s;
    EXPECT_FALSE(run.schedule->effect_on(0, from_seconds(t_s)).deafened) << t_s;
    EXPECT_EQ(run.schedule->effect_on(1, from_seconds(t_s)).deafened, deafened) << t_s;
    EXPECT_FALSE(run.schedule->effect_on(1, from_seconds(t_s)).pushed) << t_s;
  }
}

TEST(FaultOverlap, ALinkThatIsBackExcusesTheDroneForOneSecond) {
  Faulty run({{"link kill", "1s", "2s"}});
  run.fly_to(5);
  for (const auto& [t_s, excused] : {std::pair(1.5, true), {3.9, true}, {4.2, false}})
    EXPECT_EQ(run.schedule->effect_on(0, from_seconds(t_s)).deafened, excused) << t_s;
}

TEST(FaultOverlap, TwoBiasesAddUp) {
  const auto lands = [](const std::vector<Written>& faults) {
    Faulty run(faults);
    bool seen = false;
    while (run.world->now() < 10 * ns_per_s) {
      run.fly_to(to_seconds(run.world->now()) + 0.01);
      const FailsafeCause cause = run.world->facts()[0].cause;
      seen = seen || cause == FailsafeCause::battery_critical;
    }
    return seen;
  };
  EXPECT_FALSE(lands({{"sensor tello1 bat bias -1", "path", ""}}));
  EXPECT_FALSE(lands({{"sensor tello1 bat bias -60", "path + 1s", ""}}));
  EXPECT_TRUE(lands({{"sensor tello1 bat bias -35", "path", ""}, {"sensor tello1 bat bias -60", "path + 1s", ""}}));
}

// --- runs ----------------------------------------------------------------------------------------------------------

RunResult flown(const Script& script, std::uint64_t seed) {
  auto result = run_script(script, seed);
  EXPECT_TRUE(result.ok()) << result.error().what;
  return result ? std::move(*result) : RunResult{};
}

TEST(FaultLibrary, EveryScenarioHolds) {
  const auto files = library();
  EXPECT_GE(files.size(), 60U);
  std::vector<Flight> flights;
  for (std::size_t i = 0; i < files.size(); i += slow ? 25 : 1) {
    auto script = load_script(files[i]);
    ASSERT_TRUE(script.ok()) << script.error().what;
    for (int seed = 1; seed <= seeds(1, 20); ++seed) flights.push_back({*script, static_cast<std::uint64_t>(seed)});
  }
  double flown_s = 0;
  const TimeNs begin = monotonic_ns();
  fly_all(
      flights.size(), 2, [&](std::size_t i) { return flights[i]; },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        EXPECT_TRUE(result.ok()) << flight.script.name;
        if (!result) return true;
        flown_s += to_seconds(result->flown_ns);
        EXPECT_TRUE(result->held()) << flight.script.name << " seed " << flight.seed << "\n" << broken_text(*result);
        return true;
      });
  std::printf("%zu flights, %.0f s flown, %.0f times real time in two threads\n", flights.size(), flown_s,
              flown_s / to_seconds(monotonic_ns() - begin));
}

TEST(FaultRun, TheSameSeedGivesTheSameVerdictAndTheSameBytes) {
  for (int number = 1; number <= seeds(slow ? 1 : 3, 100); ++number) {
    const Script script = draw_script(static_cast<std::uint64_t>(number) + 100'000);
    const RunResult first = flown(script, 7), second = flown(script, 7);
    EXPECT_EQ(first.digest, second.digest) << script.name;
    EXPECT_EQ(json_text({first}), json_text({second})) << script.name;
    if (slow || number > 2) continue;
    EXPECT_NE(first.digest, flown(script, 8).digest) << script.name;
  }
}

TEST(FaultRun, ABrokenRuleIsToldWithItsMomentInEveryForm) {
  const Script script = scripted(
      "title = \"Not <so>\"\nmust = [\"height below 0.5 m\", \"no crash\"]\n[[fault]]\nwhat = \"operator stop "
      "tello1\"\n"
      "at = \"height 0.8\"\n");
  const RunResult result = flown(script, 1);
  EXPECT_FALSE(result.held());
  EXPECT_NE(broken_text(result).find("height below 0.5 m: tello1: 0.50 m"), std::string::npos) << broken_text(result);
  EXPECT_NE(json_text({result}).find("\"rule\": \"height below 0.5 m\""), std::string::npos);
  EXPECT_NE(json_text({result}).find("\"broken\": 1"), std::string::npos);
  const std::string junit = junit_text({result});
  EXPECT_NE(junit.find("failures=\"1\""), std::string::npos);
  EXPECT_NE(junit.find("message=\"Not &lt;so&gt;\""), std::string::npos);
  const std::string html = html_text({result});
  EXPECT_NE(html.find("height below 0.5 m"), std::string::npos);
  EXPECT_EQ(html.find("Not <so>"), std::string::npos);
  EXPECT_EQ(html.find("@DATA@"), std::string::npos);
}

TEST(FaultRun, WhoseFaultNeverCameHasNotHeld) {
  for (const char* optional : {"", "optional = true\n"}) {
    const RunResult result = flown(
        scripted(std::string("title = \"t\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"height 50\"\n") + optional), 1);
    EXPECT_EQ(result.held(), *optional != '\0');
    EXPECT_EQ(broken_text(result).find("\"ledger stall\" at height 50 never began") != std::string::npos,
              *optional == '\0');
  }
}

TEST(FaultRun, WaitsForTheStartOfWhatItKilled) {
  const RunResult result =
      flown(scripted("title = \"t\"\n[[fault]]\nwhat = \"ground kill\"\nat = \"path\"\nfor = \"40s\"\n"), 1);
  EXPECT_TRUE(result.over);
  EXPECT_GT(result.flown_ns, 40 * ns_per_s);
}

TEST(FaultRandom, NoInvariantBreaks) {
  const std::size_t count = static_cast<std::size_t>(seeds(slow ? 1 : 200, 10'000));
  double flown_s = 0;
  const TimeNs begin = monotonic_ns();
  fly_all(
      count, 2,
      [](std::size_t i) {
        return Flight{draw_script(i + 1), i + 1};
      },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        EXPECT_TRUE(result.ok()) << flight.script.name;
        if (!result) return true;
        flown_s += to_seconds(result->flown_ns);
        EXPECT_TRUE(result->held()) << text_of(flight.script) << broken_text(*result);
        return true;
      });
  std::printf("%zu random flights, %.0f s flown, %.0f times real time in two threads\n", count, flown_s,
              flown_s / to_seconds(monotonic_ns() - begin));
}

TEST(FaultRandom, DrawsEveryKindOfFaultAndOfDistribution) {
  const fs::path recording = fs::temp_directory_path() / ("delays-" + std::to_string(::getpid()));
  std::ofstream(recording) << "0.02\n0.5\n0.03\n";
  std::string drawn;
  for (std::uint64_t number = 1; number <= 500; ++number) {
    const Script script = draw_script(number, recording);
    for (const Fault& fault : script.faults) drawn += fault.text + "\n";
  }
  for (const char* wanted : {"ledger restart", "ledger stall", " rate ", "normal ", "gamma ", "uniform ", " plans ",
                             "lies hash", "errs twice", "reboot", "corrupt ", "clock jump", "wind "})
    EXPECT_NE(drawn.find(wanted), std::string::npos) << wanted;
  EXPECT_NE(drawn.find("delay recorded " + recording.string()), std::string::npos);
  EXPECT_NE(drawn.find("jitter recorded " + recording.string()), std::string::npos);
  fs::remove(recording);
}

TEST(FaultRandom, AFailingScriptIsShrunkToWhatMakesItFail) {
  Script script = draw_script(4);
  script.flight.laps = 8;
  const auto add = [&](const char* what, const char* at, const char* lasts) {
    auto fault = parse_fault(what, at, lasts);
    ASSERT_TRUE(fault.ok()) << fault.error().what;
    script.faults.push_back(*fault);
  };
  add("mocap tello1 frozen", "path + 1600ms", "800ms");
  // The "failure": a frozen mocap of at least 100 ms, whatever else.
  const auto fails = [](const Script& tried) {
    return std::any_of(tried.faults.begin(), tried.faults.end(), [](const Fault& fault) {
      return fault.what == Fault::What::mocap_frozen && fault.for_ns >= 100 * ns_per_ms;
    });
  };
  const Script shortest = shrink(script, fails);
  ASSERT_EQ(shortest.faults.size(), 1U);
  EXPECT_EQ(shortest.faults[0].text, "mocap tello1 frozen");
  EXPECT_EQ(shortest.faults[0].for_ns, 100 * ns_per_ms);
  EXPECT_EQ(shortest.faults[0].at, "path");
  EXPECT_EQ(shortest.flight.laps, 1);
  EXPECT_TRUE(parse_script(text_of(shortest), "x.toml").ok());
}

TEST(FaultSeeds, AScriptFliesWithItsOwnUnlessAskedOtherwise) {
  Script drawn = draw_script(3);
  drawn.seed = 77;
  const auto again = parse_script(text_of(drawn), "x.toml");
  ASSERT_TRUE(again.ok()) << again.error().what;
  const auto seeds_of = [&](std::optional<std::pair<std::uint64_t, std::uint64_t>> asked) {
    std::vector<std::uint64_t> seeds;
    for (const Flight& flight : flights_of({*again, scripted("title = \"t\"\n")}, asked)) seeds.push_back(flight.seed);
    return seeds;
  };
  EXPECT_EQ(seeds_of({}), (std::vector<std::uint64_t>{77, 1}));
  EXPECT_EQ(seeds_of(std::pair(4, 5)), (std::vector<std::uint64_t>{4, 5, 4, 5}));
  EXPECT_NE(error_of("title = \"t\"\nseed = 0\n"), "");
}

TEST(FaultSeeds, AreANumberOrTwo) {
  EXPECT_EQ(*parse_seeds("7"), std::pair(std::uint64_t{7}, std::uint64_t{7}));
  EXPECT_EQ(*parse_seeds("1..1000"), std::pair(std::uint64_t{1}, std::uint64_t{1000}));
  for (const char* bad : {"", "0", "5..4", "a", "1..", "..2", "-1", "1...3", "99999999999999999999"})
    EXPECT_FALSE(parse_seeds(bad)) << bad;
}

}  // namespace
}  // namespace ledgerline::hil
