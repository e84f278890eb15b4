#include "tools/timing/sample_trace.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/unit/tools/timing/some_traces.hpp"

namespace ledgerline::timing {
namespace {

TEST(SampleTraces, AWholeWalkHasEveryMarkAndEveryStage) {
  Flight flight;
  flight.trace(start, 1);
  const auto traces = flight.traces().pop();
  ASSERT_EQ(traces.size(), 1U);
  for (std::size_t i = 0; i < mark_count; ++i) EXPECT_EQ(traces[0].at_ns[i], start + static_cast<TimeNs>(i) * ms) << i;
  const Metrics metrics = make_metrics(traces, {});
  for (const Stage& stage : stages) {
    EXPECT_EQ(metrics.find(stage.name)->count(), 1U) << stage.name;
    EXPECT_EQ(metrics.find(stage.name)->max(), ms) << stage.name;
  }
  EXPECT_EQ(metrics.find("two_way")->max(), 12 * ms);
  EXPECT_EQ(metrics.find("age")->max(), 15 * ms);
  EXPECT_EQ(metrics.find("setpoint")->max(), 5 * ms);
  EXPECT_EQ(metrics.find("datagram")->max(), 16 * ms);
}

TEST(SampleTraces, TheOrderOfRecordsAndFilesDoesNotMatter) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 20; ++n) flight.trace(start + static_cast<TimeNs>(n) * 3 * ms, n);
  const auto in_order = flight.traces().pop();
  for (auto* records : {&flight.link, &flight.agent, &flight.ground}) std::reverse(records->begin(), records->end());
  SampleTraces reversed;
  reversed.add(Writer::ground, flight.ground);
  reversed.add(Writer::agent, flight.agent);
  reversed.add(Writer::link, flight.link);
  const auto traces = reversed.pop();
  ASSERT_EQ(traces.size(), in_order.size());
  for (std::size_t i = 0; i < traces.size(); ++i) EXPECT_EQ(traces[i].at_ns, in_order[i].at_ns);
}

TEST(SampleTraces, AStageIsNotMeasuredWhereARecordIsLost) {
  Flight flight;
  flight.trace(start, 1);
  flight.lose(TraceKind::command_taken);
  const Metrics metrics = make_metrics(flight.traces().pop(), {});
  EXPECT_EQ(metrics.find("wake")->count(), 0U);
  EXPECT_EQ(metrics.find("verify")->count(), 0U);
  EXPECT_EQ(metrics.find("handover")->count(), 1U);
  EXPECT_EQ(metrics.find("two_way")->count(), 1U);
}

TEST(SampleTraces, ASampleThatWasMergedEndedBeforeItsBatch) {
  Flight flight;
  flight.trace(start, 1);
  flight.link.push_back(record(TraceKind::state_sampled, start + ms, start + ms, 2));
  flight.agent.push_back(record(TraceKind::state_taken, start + 2 * ms, start + ms, 2));
  const Metrics metrics = make_metrics(flight.traces().pop(), {});
  EXPECT_EQ(metrics.traces, 2U);
  EXPECT_EQ(metrics.got_to[static_cast<std::size_t>(Mark::taken)], 1U);
  EXPECT_EQ(metrics.got_to[static_cast<std::size_t>(Mark::at_device)], 1U);
}

TEST(SampleTraces, ADatagramThatTheDeviceHadWithinTheCallWasThereWhenTheCallEnded) {
  Flight flight;
  flight.trace(start, 1);
  flight.of(TraceKind::setpoint_left).t_ns = start + 14 * ms;
  EXPECT_EQ(flight.traces().pop().at(0).at(Mark::at_device), start + 15 * ms);
}

TEST(SampleTraces, OfDoubledRecordsTheFirstCounts) {
  Flight flight;
  flight.trace(start, 1);
  flight.link.push_back(record(TraceKind::setpoint_sent, start + 99 * ms, start));
  auto traces = flight.traces();
  EXPECT_EQ(traces.pop().at(0).at(Mark::sent), start + 15 * ms);
  EXPECT_EQ(traces.counters().doubled, 1U);
}

TEST(SampleTraces, OfTwoBatchesThatASampleRodeInTheLastCounts) {
  Flight flight;
  flight.trace(start, 1);
  flight.of(TraceKind::state_batched).t_ns = start + ms;  // this one was refused because of another drone
  flight.of(TraceKind::state_batched).extra = 77;
  flight.agent.push_back(record(TraceKind::state_batched, start + 2 * ms, start, 1, 1));
  const SampleTrace trace = flight.traces().pop().at(0);
  EXPECT_EQ(trace.at(Mark::batched), start + 2 * ms);
  EXPECT_EQ(trace.at(Mark::endorsed), start + 3 * ms);
}

TEST(SampleTraces, TransactionNumbersRestartWithEachLifeOfTheirWriter) {
  SampleTraces traces;
  for (const std::uint32_t life : {0U, 1U}) {
    Flight flight;
    flight.trace(start + life * ns_per_s, 1);
    traces.add(Writer::link, flight.link, life);
    traces.add(Writer::agent, flight.agent, life);
    traces.add(Writer::ground, flight.ground, life);
  }
  const auto both = traces.pop();
  ASSERT_EQ(both.size(), 2U);
  EXPECT_EQ(both[0].at(Mark::endorsed), start + 3 * ms);
  EXPECT_EQ(both[1].at(Mark::endorsed), start + ns_per_s + 3 * ms);
}

TEST(SampleTraces, AnAcknowledgementThatComesAfterTheBlockCountsAsTheBlock) {
  Flight flight;
  flight.trace(start, 1);
  for (TraceRecord& r : flight.agent) r.t_ns += r.kind == TraceKind::call_ordered ? 50 * ms : 0;
  const SampleTrace late = flight.traces().pop().at(0);
  EXPECT_EQ(late.at(Mark::ordered), late.at(Mark::delivered));
  flight.lose(TraceKind::call_ordered);
  const SampleTrace never = flight.traces().pop().at(0);
  EXPECT_EQ(never.at(Mark::ordered), never.at(Mark::delivered));
  EXPECT_EQ(never.at(Mark::command_ordered), never.at(Mark::in_block));
}

TEST(SampleTraces, APlanThatCameWithinLinksTurnWasReceivedWhenItWasVerified) {
  Flight flight;
  flight.trace(start, 1);
  flight.of(TraceKind::plan_received).t_ns = start + 12 * ms - 20 * ns_per_us;  // when the turn began
  flight.of(TraceKind::command_applied).t_ns = start + 12 * ms - 20 * ns_per_us;
  const SampleTrace trace = flight.traces().pop().at(0);
  EXPECT_EQ(trace.at(Mark::received), start + 12 * ms);
  EXPECT_EQ(trace.at(Mark::applied), start + 12 * ms);
  EXPECT_TRUE(trace.due_at_once());
}

TEST(SampleTraces, TimesThatGoBackAreLeftOutAndCounted) {
  Flight flight;
  flight.trace(start, 1);
  flight.trace(start + ms, 2);
  flight.of(TraceKind::state_received).t_ns = start + 100 * ms;
  auto traces = flight.traces();
  EXPECT_EQ(traces.pop().size(), 1U);
  EXPECT_EQ(traces.counters().backwards, 1U);
}

TEST(SampleTraces, RecordsOfASampleThatLinkDidNotWriteDownAreStrays) {
  Flight flight;
  flight.trace(start, 1);
  flight.lose(TraceKind::state_sampled);
  flight.link.push_back(record(TraceKind::plan_received, -5, start));  // no clock says that
  auto traces = flight.traces();
  EXPECT_TRUE(traces.pop().empty());
  EXPECT_EQ(traces.counters().strays, 2U);
}

TEST(SampleTraces, ATornTraceGivesTheWalksThatAreWhole) {
  Flight flight;
  for (std::uint64_t n = 1; n <= 3; ++n) flight.trace(start + static_cast<TimeNs>(n) * 20 * ms, n);
  const std::string path = testing::TempDir() + "torn" + std::to_string(::getpid());
  {
    auto writer = TraceWriter::create(path);
    ASSERT_TRUE(writer);
    for (const TraceRecord& r : flight.link) writer->add(r);
  }
  ASSERT_EQ(::truncate(path.c_str(), 16 + 64 * 12 - 30), 0);
  flight.link = read_trace(path).value();
  ::unlink(path.c_str());
  const auto traces = flight.traces().pop();
  ASSERT_EQ(traces.size(), 3U);
  EXPECT_TRUE(traces[1].has(Mark::sent));
  EXPECT_FALSE(traces[2].has(Mark::sent));
}

TEST(SampleTraces, AreTakenAsTheyAreOver) {
  Flight flight;
  for (std::uint64_t n = 0; n < 10; ++n) flight.trace(start + static_cast<TimeNs>(n) * 20 * ms, n + 1);
  auto traces = flight.traces();
  EXPECT_EQ(traces.pop(start + 60 * ms).size(), 3U);
  EXPECT_EQ(traces.pop(start + 60 * ms).size(), 0U);
  const auto rest = traces.pop();
  ASSERT_EQ(rest.size(), 7U);
  EXPECT_TRUE(rest[0].has(Mark::command_ordered)) << "its call is still known";
}

TEST(SampleTraces, DueAtOnceIsWhatPlayoutDidNotHoldBack) {
  Flight flight;
  flight.trace(start, 1);
  flight.trace(start + 20 * ms, 2);
  flight.trace(start + 40 * ms, 3);
  std::uint32_t late_us = 0;
  for (TraceRecord& r : flight.link) {  // late by 0, 1 and 2 ms; applied 1 ms after it was received
    if (r.kind != TraceKind::command_applied) continue;
    r.extra = late_us;
    late_us += 1000;
  }
  const auto traces = flight.traces().pop();
  EXPECT_FALSE(traces[0].due_at_once());
  EXPECT_TRUE(traces[1].due_at_once());
  EXPECT_TRUE(traces[2].due_at_once());
  EXPECT_EQ(make_metrics(traces, {}).find(at_once)->count(), 2U);

  // Playout keeps to a margin on purpose.
  for (TraceRecord& r : flight.link) {
    if (r.kind == TraceKind::plan_received) r.extra = 900;
  }
  const auto held_back = flight.traces().pop();
  EXPECT_FALSE(held_back[1].due_at_once());
  EXPECT_TRUE(held_back[2].due_at_once());
}

}  // namespace
}  // namespace ledgerline::timing
