#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "common/base/file.hpp"
#include "hil/fault/real/real_run.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"

namespace ledgerline::hil {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;

Script script_of(const std::string& text) {
  auto script = parse_script("title = \"t\"\n" + text, "t.toml", true);
  EXPECT_TRUE(script) << script.error().message;
  return script ? std::move(*script) : Script{};
}

Fault fault_of(const std::string& text, const std::string& lasts = "") {
  auto fault = parse_fault(text, "path", lasts, true);
  EXPECT_TRUE(fault) << text << ": " << fault.error().message;
  return fault ? *fault : Fault{};
}

std::string refusal_of(const std::string& what, const std::string& lasts = "", bool fabric = false) {
  const std::string line = lasts.empty() ? "" : "for = \"" + lasts + "\"\n";
  const auto checked = check_real(script_of("[[fault]]\nwhat = \"" + what + "\"\n" + line), {fabric});
  return checked ? "" : checked.error().message;
}

TEST(RealScript, RefusesWhatTheRealProcessesCannotHaveAndSaysWhy) {
  for (const char* what :
       {"drone tello1 to delay 200ms", "drone * both loss 5%", "ledger agent delay 20ms", "ledger both from stall",
        "ledger ground cut", "ledger stall", "agent stop", "ground stop", "sensor tello1 h stuck", "disk full",
        "roudi kill", "cpu 0 burn", "memory take 100MB", "operator stop tello1"}) {
    EXPECT_EQ(refusal_of(what), "") << what;
  }
  EXPECT_EQ(refusal_of("agent kill", "500ms"), "");
  const std::pair<const char*, const char*> cases[] = {
      {"mocap tello1 frozen", "inside of the simulation"},
      {"mocap tello1 loss 5%", "goes past the proxy"},
      {"drone tello1 reboot", "inside of the simulation"},
      {"wind 1 0 0", "inside of the simulation"},
      {"ledger restart", "the flight's end"},
      {"ledger agent stale", "simulated time alone"},
      {"clock jump 5s", "not this flight's alone"},
      {"agent kill", "`for` must be at most 1 s"},
      {"ground kill", "use `ground stop`"},
      {"peer 1 kill", "a part of Fabric"},
      {"operator cut tello1", "are not cut"},
  };
  for (const auto& [what, why] : cases) EXPECT_THAT(refusal_of(what), HasSubstr(why)) << what;
  EXPECT_THAT(refusal_of("disk full", "", true), HasSubstr("Fabric's parts end"));
  EXPECT_EQ(refusal_of("peer 1 kill", "", true), "");
  EXPECT_EQ(refusal_of("orderer 3 kill", "", true), "");
  EXPECT_EQ(refusal_of("orderer leader kill", "", true), "");
  EXPECT_THAT(refusal_of("ledger restart", "", true), HasSubstr("name the part"));
  EXPECT_THAT(check_real(script_of("must = [\"hold within 300 ms after the plan's end\"]"), {}).error().message,
              HasSubstr("do not tell a plan's end"));
  EXPECT_THAT(
      check_real(script_of("[flight]\nside_m = 0.4\nbattery = 0.5\nroom_m = 9\nyaw_deg = 90\npads = \"1:0:0\""), {})
          .error()
          .message,
      testing::AllOf(HasSubstr("flight.side_m"), HasSubstr("flight.battery"), HasSubstr("flight.room_m"),
                     HasSubstr("flight.yaw_deg"), HasSubstr("flight.pads")));
  EXPECT_THAT(refusal_of("drone * flow lost"), HasSubstr("inside of the simulation"));
}

TEST(RealScript, SimulatedTimeRefusesWhatTheRealProcessesAloneHave) {
  for (const char* what : {"peer 1 kill", "orderer 1 kill", "chaincode 1 kill", "cpu 0 burn", "memory take 1MB",
                           "roudi kill", "disk full"}) {
    EXPECT_THAT(parse_fault(what, "path", "").error().message, HasSubstr("needs the real processes")) << what;
  }
  for (const char* what : {"peer 4 kill", "peer 1 stop", "peer leader kill", "orderer leader stop", "cpu -1 burn",
                           "cpu 0.5 burn", "cpu 0", "memory take 0MB", "memory take 5", "roudi stop", "disk half"}) {
    EXPECT_FALSE(parse_fault(what, "path", "", true)) << what;
  }
}

/// As the first of the texts begins, or ends, while the others go on.
RealActs begin_of(const std::vector<std::string>& texts, std::size_t which = 0, int drones = 2, bool fabric = false) {
  std::vector<Fault> active;
  for (const auto& text : texts) active.push_back(fault_of(text));
  return acts_at_begin(active[which], active, drones, {fabric});
}
RealActs end_of(const std::vector<std::string>& texts, std::size_t which = 0, int drones = 2, bool fabric = false) {
  std::vector<Fault> active;
  for (const auto& text : texts) active.push_back(fault_of(text));
  const Fault ends = active[which];
  active.erase(active.begin() + static_cast<std::ptrdiff_t>(which));
  return acts_at_end(ends, active, drones, {fabric});
}

TEST(RealScript, FaultsAtTheSdksCallsAreTheShims) {
  const RealStack shim{.shim = true};
  const Fault fault = fault_of("sdk tello1 answers late 300ms to takeoff");
  EXPECT_TRUE(fault.acts.check_real(fault, shim));
  EXPECT_THAT(fault.acts.check_real(fault, {}).error().message, HasSubstr("--shim"));
  EXPECT_THAT(acts_at_begin(fault, {fault}, 2, shim).proxy, ElementsAre("sdk tello1 answers late 300ms to takeoff"));
  EXPECT_THAT(acts_at_end(fault, {}, 2, shim).proxy, ElementsAre("sdk tello1 answers late 300ms to takeoff off"));
  const auto arguments = fly_arguments(Script{}, 1, shim);
  EXPECT_NE(std::find(arguments.begin(), arguments.end(), "--shim"), arguments.end());
}

TEST(RealScript, SwitchesTheProxyOnAndOffAgain) {
  const auto acts = [](const std::string& text) { return std::pair(begin_of({text}).proxy, end_of({text}).proxy); };
  EXPECT_THAT(acts("drone tello2 from delay 20ms, loss 5%"),
              Pair(ElementsAre("drone tello2 answers clear, delay 20ms, loss 5%",
                               "drone tello2 state clear, delay 20ms, loss 5%"),
                   ElementsAre("drone tello2 answers clear", "drone tello2 state clear")));
  EXPECT_THAT(acts("drone * to stall").first,
              ElementsAre("drone tello1 to clear, stall", "drone tello2 to clear, stall"));
  EXPECT_THAT(
      acts("ledger agent to delay uniform 10ms 20ms"),
      Pair(ElementsAre("server agent* to clear, delay uniform 10ms 20ms"), ElementsAre("server agent* to clear")));
  EXPECT_THAT(acts("ledger both stall"),
              Pair(ElementsAre("server agent* to clear, stall", "server agent* from clear, stall",
                               "server ground* to clear, stall", "server ground* from clear, stall"),
                   ElementsAre("server agent* to clear", "server agent* from clear", "server ground* to clear",
                               "server ground* from clear")));
  EXPECT_THAT(acts("ledger ground cut"), Pair(ElementsAre("server ground* to clear, partition",
                                                          "server ground* from clear, partition", "server ground* cut"),
                                              ElementsAre("server ground* to clear", "server ground* from clear")));
  EXPECT_THAT(acts("sensor tello1  bat bias -5"),
              Pair(ElementsAre("sensor tello1 bat bias -5"), ElementsAre("sensor tello1 bat bias -5 off")));
  EXPECT_THAT(begin_of({"ledger agent from stall"}, 0, 1, true).proxy, ElementsAre("server agent* from clear, stall"));
}

TEST(RealScript, TheEndOfOneFaultLeavesTheOtherAsItIs) {
  const std::vector<std::string> delays{"drone tello1 to delay 10ms, loss 5%", "drone * to delay 20ms"};
  EXPECT_THAT(begin_of(delays, 0).proxy, ElementsAre("drone tello1 to clear, delay 20ms, loss 5%"))
      << "the later one in the script counts";
  EXPECT_THAT(end_of(delays, 1).proxy,
              ElementsAre("drone tello1 to clear, delay 10ms, loss 5%", "drone tello2 to clear"));
  EXPECT_THAT(end_of({"ledger agent stall", "ledger agent cut", "ledger both to delay 5ms"}, 0).proxy,
              ElementsAre("server agent* to clear, delay 5ms, partition", "server agent* from clear, partition"));
  EXPECT_THAT(end_of({"agent stop", "agent stop"}).programs, IsEmpty());
  EXPECT_THAT(end_of({"agent stop", "link stop"}).programs, ElementsAre(Pair("ledgerline-agent", SIGCONT)));
  EXPECT_THAT(end_of({"ledger stall", "ledger stall"}, 0, 1, true).parts, IsEmpty());
  EXPECT_EQ(end_of({"cpu 1 burn", "cpu 1 burn"}).burn_core, -1);
  EXPECT_EQ(end_of({"cpu 1 burn", "cpu 0 burn"}).burn_core, 1);
  EXPECT_FALSE(end_of({"disk full", "disk full"}).fill_disk);
  EXPECT_TRUE(end_of({"disk full", "ledger stall"}).fill_disk);
  EXPECT_EQ(end_of({"memory take 5MB", "memory take 5MB"}).take_bytes, 5'000'000U);
}

TEST(RealScript, SignalsTheProgramThatIsMeant) {
  const auto signals = [](const std::string& text, bool fabric = false) {
    const RealActs begin = begin_of({text}, 0, 1, fabric), end = end_of({text}, 0, 1, fabric);
    return std::pair(fabric ? begin.parts : begin.programs, fabric ? end.parts : end.programs);
  };
  EXPECT_THAT(signals("agent stop"),
              Pair(ElementsAre(Pair("ledgerline-agent", SIGSTOP)), ElementsAre(Pair("ledgerline-agent", SIGCONT))));
  EXPECT_THAT(signals("link kill"), Pair(ElementsAre(Pair("ledgerline-link", SIGKILL)), IsEmpty()));
  EXPECT_THAT(signals("ledger stall"),
              Pair(ElementsAre(Pair("ledgerline-node", SIGSTOP)), ElementsAre(Pair("ledgerline-node", SIGCONT))));
  EXPECT_THAT(signals("ledger stall", true).first,
              ElementsAre(Pair("orderer1", SIGSTOP), Pair("orderer2", SIGSTOP), Pair("orderer3", SIGSTOP)));
  EXPECT_THAT(signals("chaincode 2 kill", true), Pair(ElementsAre(Pair("chaincode2", SIGKILL)), IsEmpty()));
  EXPECT_THAT(signals("orderer leader kill", true).first, ElementsAre(Pair(std::string(leader_part), SIGKILL)));
  EXPECT_EQ(begin_of({"cpu 1 burn"}).burn_core, 1);
  EXPECT_EQ(begin_of({"memory take 5MB"}).take_bytes, 5'000'000U);
}

/// A folder for flights, and in it a `ledgerline fly` that is this text of sh.
class RealStart : public testing::Test {
 protected:
  RealStart() {
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directories(directory_ / "bin");
    std::filesystem::create_directories(out_);
  }
  ~RealStart() override {
    std::error_code error;  // a disk that is still there
    std::filesystem::remove_all(directory_, error);
  }
  std::string error_of(const std::string& fly, const Script& script) {
    const auto program = directory_ / "bin/ledgerline";
    std::ofstream(program) << "#!/bin/sh\nshift\n" << fly << "\n";
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    const auto result = run_really(script, 1, {directory_ / "bin", out_, {}});
    return result ? "" : result.error().message;
  }

  std::filesystem::path directory_ = std::filesystem::path(testing::TempDir()) / "ledgerline_real_start",
                        out_ = directory_ / "out";
};

TEST_F(RealStart, WhatAnotherFlightLeftIsNotCheckedAgain) {
  EXPECT_THAT(error_of("exit 1", script_of("")), HasSubstr("the flight did not begin"));
  for (const char* old : {"run", "result.json"}) {
    std::filesystem::create_directories(out_ / old);
    EXPECT_THAT(error_of("exit 1", script_of("")), HasSubstr((out_ / old).string() + " is of another flight"));
    std::filesystem::remove(out_ / old);
  }
}

TEST_F(RealStart, ASmallDiskIsGoneWithItsFlight) {
  const std::string error = error_of("grep \" $2/ledger tmpfs \" /proc/mounts > \"$2/../seen\"; exit 1",
                                     script_of("[[fault]]\nwhat = \"disk full\"\n"));
  if (error.find("file system of its own") != std::string::npos) GTEST_SKIP() << error;
  EXPECT_THAT(error, HasSubstr("the flight did not begin"));
  const auto seen = read_file(out_ / "seen");
  ASSERT_TRUE(seen);
  EXPECT_THAT(*seen, HasSubstr("tmpfs"));
  std::ifstream mounts("/proc/self/mounts");
  EXPECT_THAT(std::string(std::istreambuf_iterator<char>(mounts), {}), Not(HasSubstr(out_.string())));
}

/// A made-up flight of one drone: up for 3 s, along the first side of the square, down.
class Flight : public testing::Test {
 protected:
  static constexpr TimeNs start = 1'000 * ns_per_s;

  Flight() {
    recording.begin_ns = start;
    recording.end_ns = start + 20 * ns_per_s;
    recording.over = recording.ok = true;
    for (TimeNs t = 0; t <= 20 * ns_per_s; t += ns_per_s / 30) place(t, position(t));
    mode(0, LinkPhase::on_ground);
    mode(ns_per_s, LinkPhase::taking_off);
    mode(3 * ns_per_s, LinkPhase::flying);
    for (TimeNs t = 3 * ns_per_s; t < 15 * ns_per_s; t += 50 * ns_per_ms) {
      applied(t, 80 * ns_per_ms, static_cast<std::uint64_t>(t / ns_per_ms));
      made(t, t < 4 * ns_per_s ? 0 : to_seconds(t - 4 * ns_per_s) * 0.15);
    }
    mode(15 * ns_per_s, LinkPhase::landing);
    mode(18 * ns_per_s, LinkPhase::landed);
  }
  static std::array<double, 3> position(TimeNs t) {
    const double s = to_seconds(t);
    const double z = s < 1 ? 0 : s < 3 ? (s - 1) / 2 : s < 15 ? 1 : std::max(0.0, 1 - (s - 15) / 3);
    return {std::clamp((s - 4) * 0.15, 0.0, 1.5), 0, z};
  }
  void place(TimeNs t, const std::array<double, 3>& at) {
    TraceRecord r{.t_ns = start + t, .kind = TraceKind::truth, .drone = 1, .extra = at[2] > 0.02 ? 1u : 0u};
    std::copy(at.begin(), at.end(), r.v);
    recording.sim.push_back(r);
  }
  void mode(TimeNs t, LinkPhase phase, FailsafeMode mode = FailsafeMode::none,
            FailsafeCause cause = FailsafeCause::none) {
    TraceRecord r{.t_ns = start + t,
                  .kind = TraceKind::mode,
                  .drone = 1,
                  .extra = static_cast<std::uint32_t>(mode),
                  .id = static_cast<std::uint64_t>(phase)};
    r.v[0] = static_cast<double>(cause);
    recording.link.push_back(r);
    sort();
  }
  void applied(TimeNs t, TimeNs age, std::uint64_t sequence = 0) {
    recording.link.push_back({.t_ns = start + t,
                              .kind = TraceKind::command_applied,
                              .drone = 1,
                              .id = sequence,
                              .stamp_ns = start + t - age});
    sort();
  }
  void apply_nothing(TimeNs from, TimeNs to) {
    std::erase_if(recording.link, [&](const TraceRecord& r) {
      return r.kind == TraceKind::command_applied && r.t_ns - start >= from && r.t_ns - start < to;
    });
  }
  void rc(TimeNs t, const std::array<double, 4>& sticks) {
    TraceRecord r{.t_ns = start + t, .kind = TraceKind::rc_sent, .drone = 1};
    std::copy(sticks.begin(), sticks.end(), r.v);
    recording.link.push_back(r);
    sort();
  }
  void made(TimeNs t, double progress_m) {
    TraceRecord r{.t_ns = start + t, .kind = TraceKind::command_made, .drone = 1};
    r.v[3] = progress_m;
    recording.ground.push_back(r);
  }
  void sort() {
    std::stable_sort(recording.link.begin(), recording.link.end(),
                     [](const TraceRecord& a, const TraceRecord& b) { return a.t_ns < b.t_ns; });
  }
  /// What broke, of a script with these rules.
  std::vector<std::string> broken(const std::string& rules, const std::string& more = "") {
    const RunResult result = check_recording(script_of("must = [" + rules + "]\n" + more), 1, recording);
    std::vector<std::string> texts;
    for (const Verdict& verdict : result.verdicts) {
      if (!verdict.held) texts.push_back(verdict.rule.text);
    }
    return texts;
  }

  Recording recording;
};

TEST_F(Flight, HoldsWhatItShouldWhenNothingIsWrong) {
  EXPECT_THAT(broken("\"finishes\", \"height below 1.1 m\", \"path within 0.1 m\", \"speed below 0.8 m/s\", "
                     "\"no command older than 100 ms applied\", \"hold is never seen\", \"ends within 21 s\""),
              IsEmpty());
  EXPECT_THAT(broken("\"height below 0.9 m\", \"path within 0.1 m\", \"speed below 0.4 m/s\", "
                     "\"no command older than 70 ms applied\", \"hold is seen\", \"ends within 19 s\""),
              ElementsAre("height below 0.9 m", "speed below 0.4 m/s", "no command older than 70 ms applied",
                          "hold is seen", "ends within 19 s"));
}

TEST_F(Flight, IsBrokenByWhatTheTracesShow) {
  const Recording good = recording;
  for (TraceRecord& r : recording.sim) {
    if (r.t_ns - start > 8 * ns_per_s && r.t_ns - start < 9 * ns_per_s) r.v[1] = 0.5;
  }
  EXPECT_THAT(broken("\"path within 0.4 m\""), testing::Contains("path within 0.4 m"));
  recording = good;
  for (TraceRecord& r : recording.sim) {
    if (r.t_ns - start > 19 * ns_per_s) r.extra = 1;
  }
  EXPECT_THAT(broken(""), ElementsAre("always: on the ground in the end"));
  recording = good;
  std::erase_if(recording.link, [](const TraceRecord& r) {
    return r.kind == TraceKind::command_applied && r.t_ns - start > 8 * ns_per_s;
  });
  EXPECT_THAT(broken(""), ElementsAre("always: a hold or a landing after silence"));
  mode(9 * ns_per_s, LinkPhase::flying, FailsafeMode::hold, FailsafeCause::plan_ran_out);
  EXPECT_THAT(broken(""), ElementsAre("always: a hold ends in a landing"));
  recording = good;
  recording.over = false;
  recording.lost = {"tello1: 5 transitions made, 4 on the ledger"};
  EXPECT_THAT(broken("\"nothing acknowledged is lost\""),
              ElementsAre("nothing acknowledged is lost", "always: no hang", "always: nothing acknowledged is lost"));
}

TEST_F(Flight, IsBrokenByADroneThatTurnsOverAndByAProgramThatEnds) {
  EXPECT_THAT(broken("\"no crash\""), IsEmpty());
  const Recording good = recording;
  for (TraceRecord& r : recording.sim) {
    if (r.t_ns - start > 17 * ns_per_s) r.extra = 2;
  }
  EXPECT_THAT(broken("\"no crash\""), ElementsAre("no crash", "always: no crash"));
  EXPECT_THAT(broken(""), ElementsAre("always: no crash"));
  recording = good;
  recording.crashed = {"agent was ended by signal 11 (Segmentation fault)"};
  EXPECT_THAT(broken("\"no crash\""), ElementsAre("no crash", "always: no crash"));
  EXPECT_THAT(broken(""), ElementsAre("always: no crash"));
}

TEST_F(Flight, IsBrokenByAnRcThatTheSdkWouldNotTake) {
  rc(5 * ns_per_s, {100, -100, 0, 0});
  EXPECT_THAT(broken(""), IsEmpty());
  rc(6 * ns_per_s, {0, 0, 101, 0});
  EXPECT_THAT(broken(""), ElementsAre("always: rc in the SDK's range"));
}

TEST_F(Flight, IsBrokenByALinkThatHoldsAndStillTellsTheDroneASpeed) {
  std::erase_if(recording.link, [](const TraceRecord& r) {
    return r.kind == TraceKind::command_applied && r.t_ns - start > 8 * ns_per_s;
  });
  mode(10 * ns_per_s, LinkPhase::flying, FailsafeMode::hold, FailsafeCause::plan_ran_out);
  mode(12 * ns_per_s, LinkPhase::flying);
  applied(12 * ns_per_s, 80 * ns_per_ms);
  mode(13 * ns_per_s, LinkPhase::landing);
  rc(10 * ns_per_s, {0, 0, 0, 0});
  EXPECT_THAT(broken(""), IsEmpty());
  rc(10'100 * ns_per_ms, {0, 50, 0, 0});
  EXPECT_THAT(broken(""), ElementsAre("always: a hold or a landing after silence"));
}

TEST_F(Flight, IsBrokenByAPlanFlownOnBehindABrake) {
  mode(8 * ns_per_s, LinkPhase::flying, FailsafeMode::brake, FailsafeCause::pose_lost);
  mode(9 * ns_per_s, LinkPhase::flying);
  rc(9 * ns_per_s, {0, 30, 0, 0});
  apply_nothing(8 * ns_per_s, 9 * ns_per_s);
  EXPECT_THAT(broken(""), IsEmpty());
  apply_nothing(9 * ns_per_s, 9'500 * ns_per_ms);
  EXPECT_THAT(broken(""), ElementsAre("always: a brake takes its plans with it"));
}

TEST_F(Flight, IsBrokenByAnOlderPlanFlownAfterANewerOneUnlessLinkRestarted) {
  applied(9'010 * ns_per_ms, 80 * ns_per_ms, 5);
  EXPECT_THAT(broken(""), ElementsAre("always: commands in order, each once"));
  recording.link_restarts = {start + 9'005 * ns_per_ms};
  EXPECT_THAT(broken(""), IsEmpty());
}

TEST_F(Flight, SaysWhatIsNotChecked) {
  const auto checked = [&](const std::string& rules = "") {
    return check_recording(script_of("must = [" + rules + "]\n"), 1, recording);
  };
  const auto not_checked_rules = [](const RunResult& result) {
    std::vector<std::string> rules;
    for (const Verdict& verdict : result.verdicts) {
      if (!verdict.was_checked()) rules.push_back(verdict.rule.text);
    }
    return rules;
  };
  const RunResult result = checked();
  EXPECT_TRUE(result.all_held());
  EXPECT_THAT(result.not_checked, ElementsAre(HasSubstr("each plan's own end"), HasSubstr("agent hands"),
                                              HasSubstr("waited during a brake"), HasSubstr("transitions alone")));
  EXPECT_THAT(not_checked_rules(result),
              ElementsAre("always: commanded speed ramps", "always: nothing is flown that nobody signed",
                          "always: no motors cut while upright"));
  EXPECT_THAT(not_checked_text(result), HasSubstr("  not checked: always: commanded speed ramps (of what"));
  EXPECT_THAT(json_text({result}, {summary_of(result, "")}), HasSubstr("\"held\": null"));
  recording.lost_is_known = false;
  EXPECT_THAT(not_checked_rules(checked("\"nothing acknowledged is lost\"")),
              testing::IsSupersetOf({"nothing acknowledged is lost", "always: nothing acknowledged is lost"}));
  recording.lost = {"tello1: 3 transitions made, 2 on the ledger"};
  EXPECT_THAT(not_checked_rules(checked()), testing::Not(testing::Contains("always: nothing acknowledged is lost")))
      << "what is lost for certain breaks the rule";
  EXPECT_THAT(broken(""), ElementsAre("always: nothing acknowledged is lost"));
}

TEST_F(Flight, OfTheSdkIsCheckedByTheTruthAlone) {
  recording.has_link = false;
  const RunResult result = check_recording(script_of("[flight]\nkind = \"sdk\"\n"), 1, recording);
  EXPECT_EQ(std::ranges::count_if(result.verdicts, [](const Verdict& verdict) { return !verdict.was_checked(); }), 10);
  const auto is_checked = [&](const std::string& rule) {
    const auto found = std::ranges::find(result.verdicts, rule, [](const Verdict& each) { return each.rule.text; });
    return found != result.verdicts.end() && found->was_checked();
  };
  EXPECT_TRUE(is_checked("always: no crash"));
  EXPECT_FALSE(is_checked("always: nothing acknowledged is lost"));
  EXPECT_THAT(not_checked_text(result), HasSubstr("(a flight by the SDK has no link, agent, ground or ledger)\n"));
}

TEST_F(Flight, CountsFromTheFaultsThatItHad) {
  recording.faults = {{"ledger stall", start + 6 * ns_per_s, start + 8 * ns_per_s}};
  const std::string fault = "[[fault]]\nwhat = \"ledger stall\"\nfor = \"2s\"\n";
  mode(6'700 * ns_per_ms, LinkPhase::flying, FailsafeMode::hold, FailsafeCause::ledger_silent);
  mode(8'300 * ns_per_ms, LinkPhase::flying);
  EXPECT_THAT(broken("\"holds within 1 s\", \"resumes within 500 ms\", \"ledger silent is seen\"", fault), IsEmpty());
  EXPECT_THAT(broken("\"holds within 500 ms\", \"resumes within 200 ms\", \"pose lost is seen\"", fault),
              ElementsAre("holds within 500 ms", "resumes within 200 ms", "pose lost is seen"));
}

TEST_F(Flight, ComparesTransitionsFromTakeOffOnAndPlacesInTheAir) {
  const Script script = script_of("");
  const RunResult a = check_recording(script, 1, recording);
  const Agreement same = compare(a, a);
  EXPECT_TRUE(same.same_transitions);
  EXPECT_LT(same.farthest_m, 1e-6);
  for (TraceRecord& r : recording.sim) {
    if (r.t_ns - start > 8 * ns_per_s && r.t_ns - start < 9 * ns_per_s) r.v[1] = 0.25;
  }
  mode(500 * ns_per_ms, LinkPhase::disconnected);                                      // before take-off
  mode(19 * ns_per_s, LinkPhase::landed, FailsafeMode::none, FailsafeCause::stopped);  // link ends
  Agreement other = compare(a, check_recording(script, 1, recording));
  EXPECT_TRUE(other.same_transitions);
  EXPECT_NEAR(other.farthest_m, 0.25, 0.01);
  mode(9 * ns_per_s, LinkPhase::flying, FailsafeMode::hold, FailsafeCause::plan_ran_out);
  other = compare(a, check_recording(script, 1, recording));
  EXPECT_FALSE(other.same_transitions);
  EXPECT_THAT(other.difference, HasSubstr("flying, hold (plan_ran_out)"));
}

TEST(FaultAgreement, ADifferenceBreaksTheRunInVerdictAndJson) {
  RunResult result;
  result.verdicts = {verdict_on({true, 0.05, {}}, 0.1, ns_per_s)};
  EXPECT_TRUE(result.all_held());
  for (const Agreement& differs : {Agreement{true, 0.11, {}}, Agreement{false, 0, "another mode"}}) {
    result.verdicts = {verdict_on(differs, 0.1, ns_per_s)};
    EXPECT_FALSE(result.all_held());
    EXPECT_THAT(json_text({result}, {summary_of(result, "")}), HasSubstr("\"held\": false"));
  }
}

}  // namespace
}  // namespace ledgerline::hil
