#include "tools/timing/usage.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "tests/unit/tools/timing/some_traces.hpp"

namespace ledgerline::timing {
namespace {

using nlohmann::json;

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
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(to_json(*back), to_json(record));
  EXPECT_FALSE(usage_from_json(""));
  EXPECT_FALSE(usage_from_json("{\"programs\":{}}"));
  EXPECT_FALSE(usage_from_json("{\"programs\":3,\"begin\":{},\"end\":{}}"));
}

}  // namespace
}  // namespace ledgerline::timing
