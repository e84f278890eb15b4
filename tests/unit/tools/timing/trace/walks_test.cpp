#include "tools/timing/trace/walks.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/unit/tools/timing/some_walks.hpp"

namespace ledgerline::timing {
namespace {

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
  EXPECT_EQ(figures.find("datagram")->max(), 16 * ms);
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
  EXPECT_EQ(figures.got_to[static_cast<std::size_t>(Mark::at_device)], 1U);
}

TEST(Walks, ADatagramThatTheDeviceHadWithinTheCallWasThereWhenTheCallEnded) {
  Flight flight;
  flight.walk(start, 1);
  flight.of(TraceKind::setpoint_left).t_ns = start + 14 * ms;
  EXPECT_EQ(flight.walks().take().at(0).at(Mark::at_device), start + 15 * ms);
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

TEST(Walks, TransactionNumbersRestartWithEachLifeOfTheirWriter) {
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

}  // namespace
}  // namespace ledgerline::timing
