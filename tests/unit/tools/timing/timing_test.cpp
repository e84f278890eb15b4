#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "common/rt/loop_ticker.hpp"
#include "tools/timing/limits.hpp"
#include "tools/timing/self_test.hpp"
#include "tools/timing/show.hpp"
#include "tools/timing/trace/perfetto.hpp"

namespace ledgerline::timing {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr TimeNs start = 100 * ns_per_s;
constexpr TimeNs ms = ns_per_ms;

TraceRecord record(TraceKind kind, TimeNs t_ns, TimeNs stamp_ns, std::uint64_t id = 1, std::uint32_t extra = 0) {
  TraceRecord r;
  r.t_ns = t_ns;
  r.kind = kind;
  r.drone = 1;
  r.extra = extra;
  r.id = id;
  r.stamp_ns = stamp_ns;
  return r;
}

/// The records of one whole walk: it comes to the k-th mark k milliseconds after its sample.
struct Flight {
  std::vector<TraceRecord> link, agent, ground;

  void walk(TimeNs sampled, std::uint64_t n) {
    const auto frame = static_cast<std::uint32_t>(n), call = static_cast<std::uint32_t>(n);
    link.push_back(record(TraceKind::state_sampled, sampled, sampled, n));
    agent.push_back(record(TraceKind::state_taken, sampled + 1 * ms, sampled, n));
    agent.push_back(record(TraceKind::state_batched, sampled + 2 * ms, sampled, n, frame));
    agent.push_back(record(TraceKind::call_endorsed, sampled + 3 * ms, sampled + 2 * ms, n));
    agent.push_back(record(TraceKind::call_ordered, sampled + 4 * ms, sampled + 2 * ms, n));
    ground.push_back(record(TraceKind::state_received, sampled + 5 * ms, sampled, n));
    ground.push_back(record(TraceKind::command_made, sampled + 6 * ms, sampled, n));
    ground.push_back(record(TraceKind::command_submitted, sampled + 7 * ms, sampled, n, call));
    ground.push_back(record(TraceKind::call_endorsed, sampled + 8 * ms, sampled + 7 * ms, n));
    ground.push_back(record(TraceKind::call_ordered, sampled + 9 * ms, sampled + 7 * ms, n));
    agent.push_back(record(TraceKind::command_in_block, sampled + 10 * ms, sampled, n));
    agent.push_back(record(TraceKind::command_taken, sampled + 11 * ms, sampled, n));
    agent.push_back(record(TraceKind::command_verified, sampled + 12 * ms, sampled, n));
    link.push_back(record(TraceKind::plan_received, sampled + 13 * ms, sampled, n));
    link.push_back(record(TraceKind::command_applied, sampled + 14 * ms, sampled, n));
    link.push_back(record(TraceKind::setpoint_sent, sampled + 15 * ms, sampled, n));
  }
  TraceRecord& of(TraceKind kind) {
    for (auto* records : {&link, &agent, &ground}) {
      for (TraceRecord& r : *records) {
        if (r.kind == kind) return r;
      }
    }
    throw std::logic_error("no such record");
  }
  void lose(TraceKind kind) {
    for (auto* records : {&link, &agent, &ground})
      std::erase_if(*records, [&](const auto& r) { return r.kind == kind; });
  }
  Walks walks() const {
    Walks walks;
    walks.add(Writer::link, link);
    walks.add(Writer::agent, agent);
    walks.add(Writer::ground, ground);
    return walks;
  }
};

TEST(Walks, AWholeWalkHasEveryMarkAndEveryStage) {
  Flight flight;
  flight.walk(start, 1);
  const auto walks = flight.walks().take();
  ASSERT_EQ(walks.size(), 1U);
  for (std::size_t i = 0; i < mark_count; ++i) EXPECT_EQ(walks[0].at_ns[i], start + static_cast<TimeNs>(i) * ms) << i;
  const Figures figures = make_figures(walks, {});
  for (const Stage& stage : stages) {
    EXPECT_EQ(figures.find(stage.name)->count(), 1U) << stage.name;
    EXPECT_EQ(figures.find(stage.name)->max(), ms) << stage.name;
  }
  EXPECT_EQ(figures.find("two_way")->max(), 12 * ms);
  EXPECT_EQ(figures.find("age")->max(), 15 * ms);
  EXPECT_EQ(figures.find("setpoint")->max(), 5 * ms);
}

TEST(Walks, TheOrderOfRecordsAndFilesDoesNotMatter) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 20; ++n) flight.walk(start + static_cast<TimeNs>(n) * 3 * ms, n);
  const auto in_order = flight.walks().take();
  for (auto* records : {&flight.link, &flight.agent, &flight.ground}) std::reverse(records->begin(), records->end());
  Walks reversed;
  reversed.add(Writer::ground, flight.ground);
  reversed.add(Writer::agent, flight.agent);
  reversed.add(Writer::link, flight.link);
  const auto walks = reversed.take();
  ASSERT_EQ(walks.size(), in_order.size());
  for (std::size_t i = 0; i < walks.size(); ++i) EXPECT_EQ(walks[i].at_ns, in_order[i].at_ns);
}

TEST(Walks, AStageIsNotMeasuredWhereARecordIsLost) {
  Flight flight;
  flight.walk(start, 1);
  flight.lose(TraceKind::command_taken);
  const Figures figures = make_figures(flight.walks().take(), {});
  EXPECT_EQ(figures.find("wake")->count(), 0U);
  EXPECT_EQ(figures.find("verify")->count(), 0U);
  EXPECT_EQ(figures.find("handover")->count(), 1U);
  EXPECT_EQ(figures.find("two_way")->count(), 1U);
}

TEST(Walks, ASampleThatWasMergedEndedBeforeItsFrame) {
  Flight flight;
  flight.walk(start, 1);
  flight.link.push_back(record(TraceKind::state_sampled, start + ms, start + ms, 2));
  flight.agent.push_back(record(TraceKind::state_taken, start + 2 * ms, start + ms, 2));
  const Figures figures = make_figures(flight.walks().take(), {});
  EXPECT_EQ(figures.walks, 2U);
  EXPECT_EQ(figures.got_to[static_cast<std::size_t>(Mark::taken)], 1U);
  EXPECT_EQ(figures.got_to[static_cast<std::size_t>(Mark::sent)], 1U);
}

TEST(Walks, OfDoubledRecordsTheFirstCounts) {
  Flight flight;
  flight.walk(start, 1);
  flight.link.push_back(record(TraceKind::setpoint_sent, start + 99 * ms, start));
  auto walks = flight.walks();
  EXPECT_EQ(walks.take().at(0).at(Mark::sent), start + 15 * ms);
  EXPECT_EQ(walks.counters().doubled, 1U);
}

TEST(Walks, OfTwoFramesThatASampleRodeInTheLastCounts) {
  Flight flight;
  flight.walk(start, 1);
  flight.of(TraceKind::state_batched).t_ns = start + ms;  // this one was refused because of another drone
  flight.of(TraceKind::state_batched).extra = 77;
  flight.agent.push_back(record(TraceKind::state_batched, start + 2 * ms, start, 1, 1));
  const Walk walk = flight.walks().take().at(0);
  EXPECT_EQ(walk.at(Mark::batched), start + 2 * ms);
  EXPECT_EQ(walk.at(Mark::endorsed), start + 3 * ms);
}

TEST(Walks, NumbersOfTransactionsBeginAnewWithEachLifeOfTheirWriter) {
  Walks walks;
  for (const std::uint32_t life : {0U, 1U}) {
    Flight flight;
    flight.walk(start + life * ns_per_s, 1);
    walks.add(Writer::link, flight.link, life);
    walks.add(Writer::agent, flight.agent, life);
    walks.add(Writer::ground, flight.ground, life);
  }
  const auto both = walks.take();
  ASSERT_EQ(both.size(), 2U);
  EXPECT_EQ(both[0].at(Mark::endorsed), start + 3 * ms);
  EXPECT_EQ(both[1].at(Mark::endorsed), start + ns_per_s + 3 * ms);
}

TEST(Walks, AnAcknowledgementThatComesAfterTheBlockCountsAsTheBlock) {
  Flight flight;
  flight.walk(start, 1);
  for (TraceRecord& r : flight.agent) r.t_ns += r.kind == TraceKind::call_ordered ? 50 * ms : 0;
  const Walk late = flight.walks().take().at(0);
  EXPECT_EQ(late.at(Mark::ordered), late.at(Mark::delivered));
  flight.lose(TraceKind::call_ordered);
  const Walk never = flight.walks().take().at(0);
  EXPECT_EQ(never.at(Mark::ordered), never.at(Mark::delivered));
  EXPECT_EQ(never.at(Mark::command_ordered), never.at(Mark::in_block));
}

TEST(Walks, APlanThatCameWithinLinksTurnWasReceivedWhenItWasVerified) {
  Flight flight;
  flight.walk(start, 1);
  flight.of(TraceKind::plan_received).t_ns = start + 12 * ms - 20 * ns_per_us;  // when the turn began
  flight.of(TraceKind::command_applied).t_ns = start + 12 * ms - 20 * ns_per_us;
  const Walk walk = flight.walks().take().at(0);
  EXPECT_EQ(walk.at(Mark::received), start + 12 * ms);
  EXPECT_EQ(walk.at(Mark::applied), start + 12 * ms);
  EXPECT_TRUE(walk.due_at_once());
}

TEST(Walks, TimesThatGoBackAreLeftOutAndCounted) {
  Flight flight;
  flight.walk(start, 1);
  flight.walk(start + ms, 2);
  flight.of(TraceKind::state_received).t_ns = start + 100 * ms;
  auto walks = flight.walks();
  EXPECT_EQ(walks.take().size(), 1U);
  EXPECT_EQ(walks.counters().backwards, 1U);
}

TEST(Walks, RecordsOfASampleThatLinkDidNotWriteDownAreStrays) {
  Flight flight;
  flight.walk(start, 1);
  flight.lose(TraceKind::state_sampled);
  flight.link.push_back(record(TraceKind::plan_received, -5, start));  // no clock says that
  auto walks = flight.walks();
  EXPECT_TRUE(walks.take().empty());
  EXPECT_EQ(walks.counters().strays, 2U);
}

TEST(Walks, ATornTraceGivesTheWalksThatAreWhole) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 3; ++n) flight.walk(start + static_cast<TimeNs>(n) * 20 * ms, n);
  const std::string path = testing::TempDir() + "torn" + std::to_string(::getpid());
  {
    auto writer = TraceWriter::create(path);
    ASSERT_TRUE(writer);
    for (const TraceRecord& r : flight.link) writer->add(r);
  }
  ASSERT_EQ(::truncate(path.c_str(), 16 + 64 * 12 - 30), 0);
  flight.link = read_trace(path).value();
  ::unlink(path.c_str());
  const auto walks = flight.walks().take();
  ASSERT_EQ(walks.size(), 3U);
  EXPECT_TRUE(walks[1].has(Mark::sent));
  EXPECT_FALSE(walks[2].has(Mark::sent));
}

TEST(Walks, AreTakenAsTheyAreOver) {
  Flight flight;
  for (std::uint64_t n = 0; n < 10; ++n) flight.walk(start + static_cast<TimeNs>(n) * 20 * ms, n + 1);
  auto walks = flight.walks();
  EXPECT_EQ(walks.take(start + 60 * ms).size(), 3U);
  EXPECT_EQ(walks.take(start + 60 * ms).size(), 0U);
  const auto rest = walks.take();
  ASSERT_EQ(rest.size(), 7U);
  EXPECT_TRUE(rest[0].has(Mark::command_ordered)) << "its call is still known";
}

TEST(Walks, DueAtOnceIsWhatPlayoutDidNotHoldBack) {
  Flight flight;
  flight.walk(start, 1);
  flight.walk(start + 20 * ms, 2);
  flight.walk(start + 40 * ms, 3);
  std::uint32_t late_us = 0;
  for (TraceRecord& r : flight.link) {  // late by 0, 1 and 2 ms; applied 1 ms after it was received
    if (r.kind != TraceKind::command_applied) continue;
    r.extra = late_us;
    late_us += 1000;
  }
  const auto walks = flight.walks().take();
  EXPECT_FALSE(walks[0].due_at_once());
  EXPECT_TRUE(walks[1].due_at_once());
  EXPECT_TRUE(walks[2].due_at_once());
  EXPECT_EQ(make_figures(walks, {}).find(at_once)->count(), 2U);

  // Playout keeps to a margin on purpose.
  for (TraceRecord& r : flight.link) {
    if (r.kind == TraceKind::plan_received) r.extra = 900;
  }
  const auto held_back = flight.walks().take();
  EXPECT_FALSE(held_back[1].due_at_once());
  EXPECT_TRUE(held_back[2].due_at_once());
}

std::vector<TraceRecord> turns(std::initializer_list<std::vector<TimeNs>> late_us_of_each) {
  std::vector<TraceRecord> records;
  std::uint64_t number = 0;
  for (const auto& late : late_us_of_each) {
    PackedTurns packed;
    for (const TimeNs us : late) (void)packed.add(start, start + us * ns_per_us);
    records.push_back(packed.record());
    records.back().id = number;
    number += late.size();
  }
  return records;
}

TEST(LoopLateness, CountsEveryTurnItsOverrunsAndWhatTheTraceLost) {
  auto records = turns({{5, 10, 1000}, {1001, 20}, {3}});
  const Figures whole = make_figures({}, records);
  EXPECT_EQ(whole.loop.late.count(), 6U);
  EXPECT_EQ(whole.loop.overruns, 1U) << "a turn that is 1 ms late is not later than 1 ms";
  EXPECT_EQ(whole.loop.lost, 0U);
  EXPECT_NEAR(tail_of(*whole.find(late)).max, 1.001, 1e-9);
  records.insert(records.begin() + 1, records[0]);  // there twice
  EXPECT_EQ(make_figures({}, records).loop.late.count(), 6U);
  records.erase(records.begin() + 2);
  const Figures torn = make_figures({}, records);
  EXPECT_EQ(torn.loop.late.count(), 4U);
  EXPECT_EQ(torn.loop.lost, 2U);
}

Figures some_figures() {
  Flight flight;
  for (std::uint64_t n = 1; n <= 100; ++n) flight.walk(start + static_cast<TimeNs>(n) * 20 * ms, n);
  Figures figures = make_figures(flight.walks().take(), turns({{5, 10, 1500}}));
  figures.load.seconds = 10;
  figures.load.programs = {{"agent", 10.0}, {"link", 4.5}, {"node", 60.0}};
  ThreadLoad loop;
  loop.who.program = "link";
  loop.who.name = "loop</script>";
  loop.who.policy = 1;
  loop.who.priority = 80;
  loop.who.voluntary = 10'000;
  loop.who.major_faults = 3;
  loop.cpu_percent = 4.5;
  figures.load.threads = {loop};
  return figures;
}

bool kept(const std::string& text) { return judge(parse_limit(text).value(), some_figures()).kept; }

TEST(Limits, AreKeptUpToTheirBound) {
  EXPECT_TRUE(kept("p99.apply=1ms"));
  EXPECT_TRUE(kept("p99.9.apply=1000us"));
  EXPECT_TRUE(kept("max.two_way=0.012s"));
  EXPECT_FALSE(kept("max.two_way=11.9ms"));
  EXPECT_FALSE(kept("p50.apply=0.999ms"));
  EXPECT_TRUE(kept("cpu.agent+link=14.5%"));
  EXPECT_FALSE(kept("cpu.agent+link=14.4%"));
  EXPECT_TRUE(kept("overruns=1"));
  EXPECT_FALSE(kept("overruns=0"));
  EXPECT_TRUE(kept("headroom=125%"));
  EXPECT_FALSE(kept("headroom=126%"));
}

TEST(Limits, WhatWasNotMeasuredIsNotKept) {
  for (const char* text : {"p99.apply=1s", "overruns=100", "cpu.link=100%", "headroom=0%"}) {
    const Verdict verdict = judge(parse_limit(text).value(), make_figures({}, {}));
    EXPECT_FALSE(verdict.kept) << text;
    EXPECT_FALSE(verdict.measured) << text;
  }
  EXPECT_FALSE(kept("cpu.agent+nobody=100%"));
}

TEST(Limits, AnUnknownNameIsAnErrorThatSaysWhatThereIs) {
  EXPECT_THAT(parse_limit("p99.aply=1ms").error().what,
              testing::AllOf(HasSubstr("\"aply\""), HasSubstr("apply"), HasSubstr("two_way")));
  EXPECT_THAT(parse_limit("p98.apply=1ms").error().what, testing::AllOf(HasSubstr("\"p98\""), HasSubstr("p99.9")));
  EXPECT_THAT(parse_limit("p99.apply").error().what, HasSubstr("p99.apply=1ms"));
  for (const char* text :
       {"", "=", "p99=1ms", "p99.apply=", "p99.apply=1", "p99.apply=-1ms", "p99.apply=nanms", "p99.apply=1 ms",
        "cpu.link=5", "cpu.=5%", "overruns=1ms", "headroom.x=1%", "max.late=5parsec"}) {
    EXPECT_FALSE(parse_limit(text)) << text;
  }
}

TEST(Show, TheTableAndTheJsonHaveEveryStage) {
  const Figures figures = some_figures();
  const auto verdicts = std::vector{judge(parse_limit("p99.apply=1us").value(), figures)};
  const std::string table = to_table(figures, 5) + to_table(verdicts);
  const json j = to_json(figures, verdicts);
  for (std::size_t i = 0; i < stages.size(); ++i) {
    EXPECT_THAT(table, HasSubstr(std::string(stages[i].name)));
    EXPECT_EQ(j["stages"][i]["name"].get<std::string>(), stages[i].name);
    EXPECT_EQ(j["stages"][i]["count"], 100);
    EXPECT_EQ(j["stages"][i]["max"], 1.0);
  }
  for (const char* part : {"two_way", "setpoint_at_once", "FIFO 80", "headroom 125.5 %", "NOT KEPT p99.apply=1us"})
    EXPECT_THAT(table, HasSubstr(part));
  EXPECT_EQ(j["ok"], false);
  EXPECT_EQ(j["budget"]["headroom_percent"], 125.5);
  EXPECT_EQ(j["threads"][0]["major_faults"], 3);
  EXPECT_EQ(j["loop"]["overruns"], 1);
}

TEST(Show, ThePageNeedsNoNetworkAndNoNameCanEndItsScript) {
  json document = to_json(some_figures(), {});
  document["asked"] = {{"directory", "/run"}};
  document["machine"] = {{"cores", 2}};
  const std::string page = to_page(document);
  EXPECT_THAT(page, HasSubstr("loop\\u003c/script>"));
  for (const char* outside : {"src=", "href=", "http", "@DATA@", "@STYLE@"})
    EXPECT_THAT(page, testing::Not(HasSubstr(outside)));
}

TEST(Perfetto, EveryEventHasItsMembersAndNoSliceIsNegativeOrCrossesAnother) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 50; ++n) flight.walk(start + static_cast<TimeNs>(n) * 4 * ms, n);  // four at a time
  std::ostringstream out;
  EXPECT_EQ(write_perfetto(out, flight.walks().take(), turns({{5, 10, 1500}})), 0U);
  const json document = json::parse(out.str());
  std::map<std::pair<int, int>, std::vector<std::pair<double, double>>> samples;  // of each track
  std::size_t slices = 0, counters = 0;
  for (const json& event : document.at("traceEvents")) {
    for (const char* member : {"ph", "ts", "pid", "tid", "name"}) ASSERT_TRUE(event.contains(member)) << event;
    if (event["ph"] == "C") {
      ++counters;
      EXPECT_EQ(event["args"]["late_us"], 1500);
    }
    if (event["ph"] != "X") continue;
    ++slices;
    const double begin = event["ts"], duration = event.at("dur");
    ASSERT_GE(duration, 0) << event;
    if (event["name"] == "sample") samples[{event["pid"], event["tid"]}].push_back({begin, begin + duration});
  }
  EXPECT_EQ(slices, 50 * (1 + stages.size()));
  EXPECT_EQ(counters, 1U);
  EXPECT_EQ(samples.size(), 4U) << "lanes";
  for (const auto& [track, all] : samples) {
    for (std::size_t i = 1; i < all.size(); ++i) EXPECT_LE(all[i - 1].second, all[i].first);
  }
}

TEST(Perfetto, HasTheNewestWalksAndSaysHowManyItLeftOut) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 50; ++n) flight.walk(start + static_cast<TimeNs>(n) * 20 * ms, n);
  std::ostringstream out;
  EXPECT_EQ(write_perfetto(out, flight.walks().take(), {}, 10), 40U);
  EXPECT_THAT(out.str(), testing::AllOf(HasSubstr("\"sequence\":50"), testing::Not(HasSubstr("\"sequence\":40}"))));
}

constexpr const char* stat_text =
    "4711 (a (funny) name) S 1 4711 4711 0 -1 4194304 1234 5 67 8 150 50 0 0 -81 0 2 0 5054361 1000 100 "
    "18446744073709551615 "
    "1 1 0 0 0 0 0 0 0 0 0 0 17 1 80 1 0 0 0 0 0 0 0 0 0 0 0\n";
constexpr const char* status_text = "Name:\tx\nvoluntary_ctxt_switches:\t4321\nnonvoluntary_ctxt_switches:\t21\n";

TEST(Usage, AThreadIsReadAsProcDescribesIt) {
  const auto usage = parse_thread(stat_text, status_text, "2000000001 3000000 77\n", 100);
  ASSERT_TRUE(usage);
  EXPECT_EQ(usage->name, "a (funny) name");
  EXPECT_EQ(usage->minor_faults, 1234U);
  EXPECT_EQ(usage->major_faults, 67U);
  EXPECT_EQ(usage->user_s, 1.5);
  EXPECT_EQ(usage->system_s, 0.5);
  EXPECT_NEAR(usage->cpu_s, 2.000000001, 1e-12);
  EXPECT_NEAR(usage->waited_s, 0.003, 1e-12);
  EXPECT_EQ(usage->voluntary, 4321U);
  EXPECT_EQ(usage->involuntary, 21U);
  EXPECT_EQ(usage->policy, 1);
  EXPECT_EQ(usage->priority, 80);
  EXPECT_EQ(parse_thread(stat_text, status_text, "", 100)->cpu_s, 2.0) << "without schedstat: the ticks";
}

TEST(Usage, WhatIsNotOfThatFormIsNoThread) {
  for (const char* text : {"", "4711", "4711 (x", "4711 )x( S", "4711 (x) S 1 2 3"})
    EXPECT_FALSE(parse_thread(text, "", "", 100));
}

TEST(Usage, TheHostsTimeIsReadForAllOrOneCore) {
  const char* text = "cpu  100 10 50 9999 3 4 6 20 0 0\ncpu1 40 0 20 999 0 0 0 5 0 0\n";
  EXPECT_EQ(parse_host(text, "cpu", 10)->busy_s, 17);
  EXPECT_EQ(parse_host(text, "cpu", 10)->steal_s, 2);
  EXPECT_EQ(parse_host(text, "cpu1", 10)->busy_s, 6);
  EXPECT_FALSE(parse_host(text, "cpu2", 10));
  EXPECT_FALSE(parse_host("cpu 1 2 3\n", "cpu", 10));
}

TEST(Usage, OurOwnThreadsAreFound) {
  const auto threads = read_threads("test", ::getpid());
  ASSERT_FALSE(threads.empty());
  EXPECT_EQ(threads[0].thread, ::getpid());
  EXPECT_GT(threads[0].minor_faults, 0U);
}

Snapshot snapshot(TimeNs t_ns, double cpu_s, std::uint64_t faults, const std::string& program = "link",
                  pid_t thread = 5) {
  Snapshot s;
  s.t_ns = t_ns;
  s.host = {cpu_s, 0};
  ThreadUsage t;
  t.program = program;
  t.name = "loop";
  t.thread = thread;
  t.cpu_s = cpu_s;
  t.minor_faults = faults;
  s.threads = {t};
  return s;
}

TEST(Usage, ALoadIsWhatWasDoneBetweenTwoSnapshots) {
  auto end = snapshot(start + 10 * ns_per_s, 3, 150);
  end.threads.push_back(snapshot(0, 1, 7, "fabric/peer", 9).threads[0]);  // began meanwhile
  const Load load = load_between(snapshot(start, 2, 100), end);
  EXPECT_EQ(load.seconds, 10);
  ASSERT_EQ(load.threads.size(), 2U);
  EXPECT_EQ(load.threads[0].who.minor_faults, 50U);
  EXPECT_NEAR(load.programs.at("link"), 10, 1e-9);
  EXPECT_NEAR(load.programs.at("fabric"), 10, 1e-9);
  EXPECT_NEAR(load.headroom_percent(), 180, 1e-9);
  EXPECT_EQ(load_between(end, end).seconds, 0) << "no time went by";
}

TEST(Usage, ARecordComesBackAsItWasWritten) {
  const UsageRecord record{{{"link", 5}}, snapshot(start, 2, 100), snapshot(start + 1, 3, 150)};
  const auto back = usage_from_json(to_json(record).dump());
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(to_json(*back), to_json(record));
  EXPECT_FALSE(usage_from_json(""));
  EXPECT_FALSE(usage_from_json("{\"programs\":{}}"));
  EXPECT_FALSE(usage_from_json("{\"programs\":3,\"begin\":{},\"end\":{}}"));
}

TEST(SelfTest, CyclictestsHistogramIsRead) {
  const auto lateness = parse_cyclictest(
      "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000003 000900\n000050 000099\n001001 000001\n"
      "# Total: 000001002\n# Min Latencies: 00003\n# Avg Latencies: 00009\n# Max Latencies: 05000\n"
      "# Histogram Overflows: 00002\n# Histogram Overflow at cycle number:\n# Thread 0: 5 6\n");
  ASSERT_TRUE(lateness) << lateness.error().what;
  EXPECT_EQ(lateness->late.count(), 1002U);
  EXPECT_EQ(lateness->overruns, 3U);
  EXPECT_EQ(lateness->late.quantile(0.5), 3 * ns_per_us);
  EXPECT_EQ(lateness->late.max(), 5 * ms);
}

TEST(SelfTest, WithoutAHistogramItSaysWhatCyclictestPrinted) {
  EXPECT_THAT(parse_cyclictest("ERROR: mlockall\n").error().what, HasSubstr("ERROR: mlockall"));
}

TEST(SelfTest, IsGoodWhereTheLoopIsAboutAsPunctualAsCyclictest) {
  SelfTest test;
  EXPECT_FALSE(test.good()) << "nothing was measured";
  test.loop.late.add(150 * ns_per_us);
  EXPECT_TRUE(test.good());
  test.cyclictest.emplace().late.add(60 * ns_per_us);
  EXPECT_FALSE(test.good());
  test.cyclictest->late = {};
  test.cyclictest->late.add(70 * ns_per_us);
  EXPECT_TRUE(test.good());
  test.loop.late.add(201 * ns_per_us);
  EXPECT_FALSE(test.good());
}

TEST(SelfTest, SaysWhatIsMissingAndHowToGetIt) {
  SelfTest test;
  test.loop.late.add(150 * ns_per_us);
  test.real_time.notices = {"no SCHED_FIFO: Operation not permitted; grant CAP_SYS_NICE"};
  test.why_no_cyclictest = "cyclictest is not installed: apt-get install rt-tests";
  const std::string table = to_table(test);
  for (const char* part : {"link's loop, not FIFO", "grant CAP_SYS_NICE", "apt-get install rt-tests", "steal"})
    EXPECT_THAT(table, HasSubstr(part));
}

}  // namespace
}  // namespace ledgerline::timing
