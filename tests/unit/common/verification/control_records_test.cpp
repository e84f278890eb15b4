#include "common/verification/control_records.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace ledgerline::verification {
namespace {

using testing::HasSubstr;

fabric::Block block(std::uint64_t number) {
  fabric::Block b;
  b.number = number;
  return b;
}

/// A ledger that has the record of one drone, under any name that is asked for.
Evaluate ledger_with(const std::string& drone, int records = 1) {
  return [=](const fabric::Call& call) -> Result<std::string> {
    EXPECT_EQ(call.function, "get");
    Control control;
    control.set_drone(drone);
    control.set_epoch(7);
    Assets assets;
    for (int i = 0; i < records; ++i) assets.add_assets()->set_msg_data(control.SerializeAsString());
    return assets.SerializeAsString();
  };
}

TEST(ControlRecords, AreReadOfEveryDrone) {
  const auto read = read_controls({"tello1"}, ledger_with("tello1"));
  ASSERT_TRUE(read);
  ASSERT_EQ(read->size(), 1U);
  EXPECT_EQ((*read)[0].epoch(), 7U);
  EXPECT_TRUE(read_controls({}, ledger_with("tello1"))->empty());
}

TEST(ControlRecords, PagesAreReadToTheirEndAndAPeerThatGoesInCirclesIsSeen) {
  std::vector<std::string> bookmarks{"a/1", "a/2", ""};
  const Evaluate pages = [&](const fabric::Call&) -> Result<std::string> {
    Assets page;
    page.add_assets();
    page.set_bookmark(bookmarks.front());
    std::rotate(bookmarks.begin(), bookmarks.begin() + 1, bookmarks.end());
    return page.SerializeAsString();
  };
  int taken = 0;
  const auto take = [&](const Assets&) -> Status { return ++taken < 20 ? done : Status(Error{"it goes on and on"}); };
  EXPECT_TRUE(read_pages("a/*", pages, take));
  EXPECT_EQ(taken, 3);
  bookmarks = {"a/1", "a/2"};
  EXPECT_THAT(read_pages("a/*", pages, take).error().message, HasSubstr("do not end"));
  EXPECT_EQ(taken, 5);
}

TEST(ControlRecords, WhatIsNoRecordOfThisDroneIsAnError) {
  EXPECT_THAT(read_control("tello2", ledger_with("tello1")).error().message, HasSubstr("of another"));
  EXPECT_THAT(read_control("tello1", ledger_with("tello1", 0)).error().message, HasSubstr("not enrolled"));
  const auto silent = [](const fabric::Call&) -> Result<std::string> { return Error{"not reached"}; };
  EXPECT_THAT(read_control("tello1", silent).error().message, HasSubstr("control/tello1: not reached"));
  EXPECT_FALSE(read_control("tello1", [](const fabric::Call&) { return Result<std::string>(std::string("\xff")); }));
}

TEST(ControlRecords, AreReadAgainUntilTheyCome) {
  int asked = 0;
  const auto late = [&](const fabric::Call& call) -> Result<std::string> {
    if (++asked < 3) return Error{"not reached"};
    return ledger_with("tello1")(call);
  };
  std::stop_source stop;
  EXPECT_EQ(read_controls_repeatedly(stop.get_token(), {"tello1"}, late)->size(), 1U);
  EXPECT_EQ(asked, 3);
  stop.request_stop();
  asked = 0;
  EXPECT_FALSE(read_controls_repeatedly(stop.get_token(), {"tello1"}, late));
}

TEST(ControlRecords, OfALedgerThatNeverAnswersAreGivenUp) {
  TimeNs now_ns = 0;
  const TryWorld world{.now = [&] { return now_ns; },
                       .sleep = [&](TimeNs pause_ns) { now_ns += pause_ns; },
                       .warn = [](const std::string&) {}};
  const auto silent = [](const fabric::Call&) -> Result<std::string> { return Error{"not reached"}; };
  const auto read = read_controls_repeatedly(std::stop_token(), {"tello1"}, silent, world);
  ASSERT_FALSE(read);
  EXPECT_THAT(read.error().message, HasSubstr("gave up after 60 s"));
  EXPECT_THAT(read.error().message, HasSubstr("not reached"));
  EXPECT_GT(now_ns, max_controls_wait_ns);
}

TEST(ControlStart, TheFirstBlockAsksForTheRecordsAndWaitsForThemWithThoseBehindIt) {
  ControlStart start;
  EXPECT_EQ(*start.on_block(block(4)), ControlStart::Next::read);
  EXPECT_EQ(*start.on_block(block(5)), ControlStart::Next::hold);
  const auto held = start.on_read();
  ASSERT_EQ(held.size(), 2U);
  EXPECT_EQ(held[0].number, 4U);
  EXPECT_EQ(held[1].number, 5U);
  EXPECT_EQ(*start.on_block(block(6)), ControlStart::Next::take);
  EXPECT_TRUE(start.on_read().empty());
}

TEST(ControlStart, WhereTheRecordsCannotBeReadTheNextBlockRequestsThemAgain) {
  ControlStart start;
  EXPECT_EQ(*start.on_block(block(1)), ControlStart::Next::read);
  start.restart();
  EXPECT_FALSE(start.known());
  EXPECT_EQ(*start.on_block(block(2)), ControlStart::Next::read);
  const auto held = start.on_read();
  ASSERT_EQ(held.size(), 1U) << "what came before is in what was read";
  EXPECT_EQ(held[0].number, 2U);
  EXPECT_EQ(*start.on_block(block(3)), ControlStart::Next::take);
}

TEST(ControlStart, WhatIsReadWhileBlocksAreForgottenIsUselessAndNobodyReadsASecondTimeMeanwhile) {
  ControlStart start(1);
  EXPECT_EQ(*start.on_block(block(1)), ControlStart::Next::read);
  EXPECT_FALSE(start.on_block(block(2)));
  start.forget();
  EXPECT_TRUE(start.is_useless());
  EXPECT_EQ(*start.on_block(block(3)), ControlStart::Next::hold);
  start.restart();
  EXPECT_FALSE(start.is_useless());
  EXPECT_EQ(*start.on_block(block(4)), ControlStart::Next::read);
}

TEST(ControlStart, MoreBlocksThanCanBeHeldAreAnError) {
  ControlStart start(2);
  EXPECT_TRUE(start.on_block(block(1)));
  EXPECT_TRUE(start.on_block(block(2)));
  EXPECT_FALSE(start.on_block(block(3)));
}

}  // namespace
}  // namespace ledgerline::verification
