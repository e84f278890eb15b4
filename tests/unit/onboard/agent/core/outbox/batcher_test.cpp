#include "onboard/agent/core/outbox/batcher.hpp"

#include <gtest/gtest.h>

#include <deque>

#include "common/base/random.hpp"
#include "common/msg/ros.hpp"
#include "ledgerline.pb.h"
#include "tests/unit/campaign.hpp"

namespace ledgerline::agent {
namespace {

using Kind = fabric::Outcome::Kind;

StateSample sample(DroneNumber drone, std::uint64_t sequence, TimeNs stamp = 0) {
  StateSample s;
  s.drone = drone;
  s.boot_id = 1;
  s.sequence = sequence;
  s.stamp_ns = stamp;
  return s;
}

fabric::Outcome outcome(Kind kind, std::string message = "") {
  return fabric::Outcome::failed(kind, std::move(message));
}

void expect_adds_up(const Batcher& batcher, DroneNumber drone) {
  const auto c = batcher.counters(drone);
  EXPECT_EQ(c.sampled, c.on_ledger + c.merged + c.dropped + c.pending) << "tello" << drone;
}

const std::vector<DroneName> three = {{1, "tello1"}, {2, "tello2"}, {3, "tello3"}};

TEST(Batcher, TheNewestSampleOfEachDroneRidesInOneBatch) {
  Batcher batcher({}, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  const auto batch = batcher.next(0);
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->samples.size(), 3U);
}

TEST(Batcher, OneBatchIsInFlightWhereThatIsCommittedSoon) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  const auto first = batcher.next(0);
  ASSERT_TRUE(first);
  batcher.add(1, sample(1, 2, 1));
  EXPECT_FALSE(batcher.next(50 * ns_per_ms));
  batcher.finished(50 * ns_per_ms, first->number, outcome(Kind::committed));
  EXPECT_TRUE(batcher.next(50 * ns_per_ms));
}

// Batches that go out within `limit` while nothing is committed and samples come at 100 Hz.
int frames_in_flight(Batcher& batcher, TimeNs from, TimeNs limit) {
  int batches = 0;
  std::uint64_t sequence = 10;
  for (TimeNs now = from; now < from + limit; now += 10 * ns_per_ms) {
    batcher.add(now, sample(1, ++sequence, now));
    batches += batcher.next(now) ? 1 : 0;
  }
  return batches;
}

// Whose first batch took so long to be endorsed and ordered.
Batcher after_one_frame(TimeNs ordered_after_ns) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  auto committed = outcome(Kind::committed);
  committed.ordered_after_ns = ordered_after_ns;
  batcher.finished(0, batcher.next(0)->number, committed);
  return batcher;
}

TEST(Batcher, WhereBlocksAreCutLateBatchesFollowEachOtherBehindAGap) {
  Batcher batcher = after_one_frame(2 * ns_per_ms);
  const int quickly_ordered = frames_in_flight(batcher, 0, 160 * ns_per_ms);
  EXPECT_GE(quickly_ordered, 9) << "the published settings cut a block of 10";
  EXPECT_LE(quickly_ordered, 16);
  expect_adds_up(batcher, 1);
}

TEST(Batcher, ALedgerAtItsLimitGetsFewerBatches) {
  Batcher batcher = after_one_frame(30 * ns_per_ms);
  EXPECT_LE(frames_in_flight(batcher, 0, 110 * ns_per_ms), 1);
}

TEST(Batcher, ALedgerThatIsAwayFindsABoundedNumber) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  EXPECT_LE(frames_in_flight(batcher, 0, 5 * ns_per_s), 32);
  expect_adds_up(batcher, 1);
}

TEST(Batcher, OfSeveralRefusedForOneDroneTheNewestSamplesOfTheOthersGoAgain) {
  Batcher batcher({}, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  const auto first = batcher.next(0);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(ns_per_s, sample(d, 2, ns_per_s));
  const auto second = batcher.next(ns_per_s);
  ASSERT_TRUE(second);
  batcher.finished(ns_per_s, first->number,
                   outcome(Kind::refused, "chaincode response 500, tello2: enrolled to another"));
  EXPECT_FALSE(batcher.next(ns_per_s)) << "newer ones are on their way";
  batcher.finished(ns_per_s, second->number,
                   outcome(Kind::refused, "chaincode response 500, tello2: enrolled to another"));
  const auto again = batcher.next(ns_per_s);
  ASSERT_TRUE(again);
  ASSERT_EQ(again->samples.size(), 2U);
  EXPECT_EQ(again->samples[0].sequence, 2U);
  for (DroneNumber d = 1; d <= 3; ++d) expect_adds_up(batcher, d);
}

TEST(Batcher, OfWhatArrivesMeanwhileTheNewestRidesAndTheOthersCountAsMerged) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  const auto first = batcher.next(0);
  for (std::uint64_t k = 2; k <= 5; ++k) batcher.add(1, sample(1, k, 1));
  batcher.finished(2, first->number, outcome(Kind::committed));
  const auto second = batcher.next(2);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->samples.at(0).sequence, 5U);
  EXPECT_EQ(batcher.counters(1).merged, 3U);
  EXPECT_EQ(batcher.counters(1).on_ledger, 1U);
  EXPECT_EQ(batcher.counters(1).sent, 2U);
  expect_adds_up(batcher, 1);
}

TEST(Batcher, ASampleThatIsNotNewerNeverReplacesTheNewest) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 5));
  batcher.add(0, sample(1, 4));
  EXPECT_EQ(batcher.next(0)->samples.at(0).sequence, 5U);
  expect_adds_up(batcher, 1);
}

TEST(Batcher, ASampleOfANewBootIsNewerWhateverItsSequence) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 500));
  auto after_restart = sample(1, 1);
  after_restart.boot_id = 2;
  batcher.add(0, after_restart);
  EXPECT_EQ(batcher.next(0)->samples.at(0).boot_id, 2U);
}

TEST(Batcher, WaitsALittleForTheOtherDronesOfTheSameInstant) {
  BatchSettings settings;
  settings.linger_ns = 500;
  Batcher batcher(settings, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  batcher.finished(0, batcher.next(0)->number, outcome(Kind::committed));
  batcher.add(1000, sample(1, 2, 1000));
  EXPECT_FALSE(batcher.next(1000));
  EXPECT_FALSE(batcher.next(1499));
  EXPECT_TRUE(batcher.next(1500));
}

TEST(Batcher, DoesNotWaitForADroneThatHasLongBeenSilent) {
  Batcher batcher({}, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  batcher.finished(0, batcher.next(0)->number, outcome(Kind::committed));
  batcher.add(ns_per_s, sample(1, 2, ns_per_s));
  EXPECT_TRUE(batcher.next(ns_per_s));
}

TEST(Batcher, ADroneWithoutANewSampleRidesAlongWithItsLastOneAndIsNotCountedAgain) {
  Batcher batcher({}, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  const auto first = batcher.next(0);
  EXPECT_TRUE(first->repeated.empty());
  batcher.finished(0, first->number, outcome(Kind::committed));
  batcher.add(ns_per_s, sample(1, 2, ns_per_s));
  const auto second = batcher.next(ns_per_s);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->samples.size(), 1U);
  ASSERT_EQ(second->repeated.size(), 2U);
  EXPECT_EQ(second->repeated[0].drone, 2);
  batcher.finished(ns_per_s, second->number, outcome(Kind::committed));
  EXPECT_EQ(batcher.counters(2).on_ledger, 1U);
  EXPECT_EQ(batcher.counters(2).sent, 1U);
  expect_adds_up(batcher, 2);
}

TEST(Batcher, ADroneThatOnlyRidesAlongAndIsRefusedPausesTooAndNothingIsLost) {
  Batcher batcher({}, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  batcher.finished(0, batcher.next(0)->number, outcome(Kind::committed));
  batcher.add(ns_per_s, sample(1, 2, ns_per_s));
  batcher.finished(ns_per_s, batcher.next(ns_per_s)->number,
                   outcome(Kind::refused, "chaincode response 500, tello2: enrolled to another"));
  const auto again = batcher.next(ns_per_s);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->samples.at(0).sequence, 2U);
  ASSERT_EQ(again->repeated.size(), 1U);
  EXPECT_EQ(again->repeated[0].drone, 3);
  for (DroneNumber d = 1; d <= 3; ++d) expect_adds_up(batcher, d);
}

TEST(Batcher, KeepsTheMinimalGapBetweenBatches) {
  BatchSettings settings;
  settings.min_gap_ns = 10 * ns_per_ms;
  Batcher batcher(settings, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  batcher.finished(ns_per_ms, batcher.next(0)->number, outcome(Kind::committed));
  batcher.add(ns_per_ms, sample(1, 2, ns_per_ms));
  EXPECT_FALSE(batcher.next(10 * ns_per_ms - 1));
  EXPECT_TRUE(batcher.next(10 * ns_per_ms));
}

TEST(Batcher, ABatchRefusedBecauseOfOneDroneIsSentAgainAtOnceWithoutIt) {
  BatchSettings settings;
  settings.min_gap_ns = ns_per_s;
  Batcher batcher(settings, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  const auto first = batcher.next(0);
  batcher.add(1, sample(1, 2, 1));
  batcher.finished(2, first->number,
                   outcome(Kind::refused, "chaincode response 500, tello3: is enrolled to somebody else"));
  const auto again = batcher.next(2);
  ASSERT_TRUE(again);
  ASSERT_EQ(again->samples.size(), 2U);
  EXPECT_EQ(again->samples[0].sequence, 2U);  // a newer one came meanwhile
  EXPECT_EQ(again->samples[1].drone, 2);
  EXPECT_EQ(batcher.counters(1).merged, 1U);
  EXPECT_EQ(batcher.counters(2).sent, 1U);  // the same sample twice is one sample sent
  EXPECT_EQ(batcher.counters(3).dropped, 1U);
  for (DroneNumber d = 1; d <= 3; ++d) expect_adds_up(batcher, d);
}

TEST(Batcher, AnOutsidersNameInARefusalIsNoDronesAndAPeersWordsAreNotTheContracts) {
  for (const char* message :
       {"chaincode response 500, Org2MSP CN=a tello2: not a member", "tello2: the peer is not ready"}) {
    Batcher batcher({}, three, 1);
    for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
    batcher.finished(0, batcher.next(0)->number, outcome(Kind::refused, message));
    EXPECT_FALSE(batcher.next(0)) << message;
    EXPECT_EQ(batcher.counters(2).dropped, 1U) << "as those of the others";
    EXPECT_EQ(batcher.counters(1).dropped, 1U);
  }
}

TEST(Batcher, ARefusalOfTello12IsNotBlamedOnTello1) {
  Batcher batcher({}, {{1, "tello1"}, {12, "tello12"}}, 1);
  batcher.add(0, sample(1, 1));
  batcher.add(0, sample(12, 1));
  batcher.finished(0, batcher.next(0)->number, outcome(Kind::refused, "chaincode response 500, tello12: not enrolled"));
  EXPECT_EQ(batcher.next(0)->samples.at(0).drone, 1);
}

TEST(Batcher, ARefusedDronePausesAndThenRidesAgain) {
  BatchSettings settings;
  Batcher batcher(settings, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  batcher.finished(0, batcher.next(0)->number, outcome(Kind::refused, "chaincode response 500, tello1: not enrolled"));
  batcher.add(1, sample(1, 2, settings.refused_drone_pause_ns - 1));
  EXPECT_FALSE(batcher.next(settings.refused_drone_pause_ns - 1));
  EXPECT_TRUE(batcher.next(settings.refused_drone_pause_ns));
}

TEST(Batcher, SamplesOfAnInvalidatedBatchAreDroppedAndTheNextGoesOnAtOnce) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  const auto first = batcher.next(0);
  batcher.add(1, sample(1, 2, 1));
  batcher.finished(2, first->number, outcome(Kind::invalidated));
  EXPECT_EQ(batcher.counters(1).dropped, 1U);
  EXPECT_EQ(batcher.transactions().invalidated, 1U);
  EXPECT_TRUE(batcher.next(2));
}

TEST(Batcher, AnUnreachableLedgerIsLeftAloneForATimeThatGrowsToItsBound) {
  BatchSettings settings;
  Batcher batcher(settings, {{1, "tello1"}}, 1);
  TimeNs now = 0;
  TimeNs max_pause = 0;
  for (std::uint64_t k = 1; k <= 20; ++k) {
    batcher.add(now, sample(1, k, now));
    const auto batch = batcher.next(now);
    ASSERT_TRUE(batch);
    batcher.finished(now, batch->number, outcome(Kind::unavailable));
    const TimeNs pause = batcher.back_off_until_ns() - now;
    EXPECT_GE(pause, settings.back_off.first_ns / 2);
    EXPECT_LE(pause, settings.back_off.max_ns);
    batcher.add(now, sample(1, 1000 + k, now));
    EXPECT_FALSE(batcher.next(batcher.back_off_until_ns() - 1));
    max_pause = std::max(max_pause, pause);
    now = batcher.back_off_until_ns();
  }
  EXPECT_GE(max_pause, settings.back_off.max_ns / 2);
}

TEST(Batcher, ASampleThatHadToWaitPastItsFreshnessIsDroppedAndCounted) {
  BatchSettings settings;
  Batcher batcher(settings, {{1, "tello1"}, {2, "tello2"}}, 1);
  for (DroneNumber d = 1; d <= 2; ++d) batcher.add(0, sample(d, 1));
  const auto first = batcher.next(0);
  batcher.add(1, sample(1, 2, 1));
  batcher.add(settings.freshness_ns, sample(2, 2, settings.freshness_ns));
  batcher.finished(settings.freshness_ns + 2, first->number, outcome(Kind::committed));
  const auto second = batcher.next(settings.freshness_ns + 2);
  ASSERT_TRUE(second);
  ASSERT_EQ(second->samples.size(), 1U);
  EXPECT_EQ(second->samples[0].drone, 2);
  EXPECT_EQ(batcher.counters(1).stale, 1U);
  EXPECT_EQ(batcher.counters(1).dropped, 1U);
  EXPECT_EQ(batcher.counters(2).stale, 0U);
  for (DroneNumber d = 1; d <= 2; ++d) expect_adds_up(batcher, d);
}

TEST(Batcher, ACommitEndsTheGrowthOfTheBackOff) {
  BatchSettings settings;
  Batcher batcher(settings, {{1, "tello1"}}, 1);
  TimeNs now = 0;
  const auto round = [&](Kind kind, std::uint64_t k) {
    batcher.add(now, sample(1, k, now));
    batcher.finished(now, batcher.next(now)->number, outcome(kind));
    const TimeNs pause = std::max<TimeNs>(0, batcher.back_off_until_ns() - now);
    now += pause;
    return pause;
  };
  for (std::uint64_t k = 1; k <= 6; ++k) round(Kind::unavailable, k);
  round(Kind::committed, 7);
  EXPECT_LE(round(Kind::unavailable, 8), settings.back_off.first_ns);
}

TEST(Batcher, SeedsGiveDifferentJitterAndTheSameSeedTheSame) {
  const auto pause = [](std::uint64_t seed) {
    Batcher batcher({}, {{1, "tello1"}}, seed);
    batcher.add(0, sample(1, 1));
    batcher.finished(0, batcher.next(0)->number, outcome(Kind::unavailable));
    return batcher.back_off_until_ns();
  };
  EXPECT_EQ(pause(1), pause(1));
  EXPECT_NE(pause(1), pause(2));
}

TEST(Batcher, TheEndOfABatchThatIsNotInFlightChangesNothing) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  batcher.add(0, sample(1, 1));
  const auto batch = batcher.next(0);
  EXPECT_FALSE(batcher.finished(0, batch->number + 1, outcome(Kind::committed)));
  EXPECT_TRUE(batcher.finished(0, batch->number, outcome(Kind::committed)));
  EXPECT_FALSE(batcher.finished(0, batch->number, outcome(Kind::committed)));
  EXPECT_EQ(batcher.counters(1).on_ledger, 1U);
}

TEST(Batcher, CountersAddUpAndNeverTwoAreInFlightWhateverHappens) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    Random random(seed);
    Batcher batcher({.min_gap_ns = seed % 3 == 0 ? 5 * ns_per_ms : 0}, three, seed);
    std::deque<std::uint64_t> in_flight;
    std::uint64_t sequence = 0;
    std::uint64_t added[4] = {};
    TimeNs now = 0;
    for (int step = 0; step < 3000; ++step) {
      now += static_cast<TimeNs>(random.uniform() * 3e6);
      if (random.uniform() < 0.6) {
        const auto drone = static_cast<DroneNumber>(1 + random.next() % 3);
        batcher.add(now, sample(drone, ++sequence, now));
        ++added[drone];
      }
      if (auto batch = batcher.next(now)) {
        in_flight.push_back(batch->number);
        ASSERT_EQ(in_flight.size(), 1U) << "seed " << seed;
        ASSERT_LE(batch->samples.size(), 3U);
        ASSERT_GE(batch->samples.size(), 1U);
      }
      if (!in_flight.empty() && random.uniform() < 0.3) {
        const auto kind = static_cast<Kind>(random.next() % 5);
        const char* messages[] = {"chaincode response 500, tello1: no", "chaincode response 500, tello3: no", "no"};
        ASSERT_TRUE(batcher.finished(now, in_flight.front(), outcome(kind, messages[random.next() % 3])));
        in_flight.pop_front();
      }
      for (DroneNumber d = 1; d <= 3; ++d) {
        const auto c = batcher.counters(d);
        ASSERT_EQ(c.sampled, added[d]);
        ASSERT_EQ(c.sampled, c.on_ledger + c.merged + c.dropped + c.pending) << "seed " << seed;
        ASSERT_LE(c.pending, 2U) << "one in flight and one waiting at most: memory is bounded";
        ASSERT_LE(c.on_ledger + c.dropped - c.stale, c.sent);
      }
    }
    if (!in_flight.empty()) batcher.finished(now, in_flight.front(), outcome(Kind::unavailable));
    const BatchSettings defaults;
    now += defaults.back_off.max_ns + defaults.refused_drone_pause_ns;
    batcher.add(now, sample(1, ++sequence, now));
    EXPECT_TRUE(batcher.next(now + defaults.linger_ns)) << "it always goes on, seed " << seed;
  }
}

TEST(EncodeBatch, WithoutAPoseThereIsNoOdometry) {
  StateBatch batch;
  batch.samples = {sample(1, 3)};
  SetCall set;
  ASSERT_TRUE(set.ParseFromString(encode_batch(batch, three, 0).args.at(0)));
  for (const Asset& asset : set.assets()) EXPECT_NE(asset.id(), "tello1/odom");
}

TEST(EncodeBatch, WritesTheStateOfEachDroneWithRealTimeInHeadersAndTheBatteryThatIsDue) {
  StateBatch batch;
  auto s = sample(2, 9, 5 * ns_per_s);
  s.position_m = {1, 2, 3};
  s.velocity_mps = {1, 0, 0.5};
  s.yaw_rad = 1.5707963267948966;
  s.battery = 0.75F;
  s.pose_stamp_ns = s.stamp_ns - 5 * ns_per_ms;
  auto old = sample(1, 3);
  old.pose_stamp_ns = 1;
  batch.samples = {s};
  batch.repeated = {old};
  batch.batteries = {2};
  const auto call = encode_batch(batch, three, 1000 * ns_per_s);
  EXPECT_EQ(call.function, "set");
  SetCall set;
  ASSERT_TRUE(set.ParseFromString(call.args.at(0)));
  EXPECT_TRUE(set.stream());
  ASSERT_EQ(set.assets_size(), 5);
  EXPECT_EQ(set.assets(0).id(), "tello2/battery");
  EXPECT_FLOAT_EQ(battery_from_cdr(set.assets(0).msg_data())->percentage, 0.75F);
  EXPECT_EQ(set.assets(1).id(), "tello2/odom");
  EXPECT_EQ(set.assets(1).topic(), "/tello2/odom");
  EXPECT_EQ(set.assets(1).msg_type(), "nav_msgs/msg/Odometry");
  EXPECT_EQ(set.assets(3).id(), "tello1/odom");
  const auto odometry = odometry_from_cdr(set.assets(1).msg_data());
  ASSERT_TRUE(odometry);
  EXPECT_EQ(odometry->header.stamp_ns, 1005 * ns_per_s - 5 * ns_per_ms) << "the pose's own time";
  EXPECT_EQ(odometry->header.frame_id, "map");
  // Moving east while looking north is moving to the right: REP 105's y is to the left.
  EXPECT_NEAR(odometry->linear_mps[0], 0, 1e-9);
  EXPECT_NEAR(odometry->linear_mps[1], -1, 1e-9);
  EXPECT_NEAR(odometry->linear_mps[2], 0.5, 1e-9);
  EXPECT_EQ(set.assets(2).id(), "tello2/link");
  const auto status = state_from_cdr(set.assets(2).msg_data(), set.assets(1).msg_data());
  ASSERT_TRUE(status);
  EXPECT_EQ(status->sample.sequence, 9U);
  EXPECT_EQ(status->sample.stamp_ns, 5 * ns_per_s);
  EXPECT_EQ(status->sample.pose_stamp_ns, s.pose_stamp_ns);
  EXPECT_EQ(status->real_ns, 1005 * ns_per_s);
}

/// What a second at 30 states costs: a call's bytes are on the ledger as its argument and as the value that it writes.
TEST(EncodeBatch, BytesOfAStateAreKnown) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  std::size_t bytes = 0;
  constexpr int states = 480;
  for (std::uint64_t k = 1; k <= states; ++k) {
    const TimeNs now = static_cast<TimeNs>(k) * ns_per_s / 30;
    auto s = sample(1, k, now);
    s.pose_stamp_ns = now;
    s.battery = k < states / 2 ? 0.75F : 0.74F;
    batcher.add(now, s);
    const auto batch = batcher.next(now);
    ASSERT_TRUE(batch);
    bytes += encode_batch(*batch, {{1, "tello1"}}, 1'700'000'000 * ns_per_s).args.at(0).size();
    batcher.finished(now, batch->number, outcome(Kind::committed));
  }
  EXPECT_EQ(bytes / states, 976U) << "1,219 with a pose in both messages and a battery each time";
}

TEST(Batcher, ABatteryIsSentWhenItChangesOrWasNotCommittedWithEvery16thStateAndEachSecond) {
  Batcher batcher({}, {{1, "tello1"}}, 1);
  std::uint64_t sequence = 0;
  TimeNs now = ns_per_s, gap_ns = 50 * ns_per_ms;
  const auto sends_battery = [&](float charge, Kind end) {
    now += gap_ns;
    gap_ns = (end == Kind::committed ? 50 : 900) * ns_per_ms;  // behind the back-off
    auto s = sample(1, ++sequence, now);
    s.battery = charge;
    batcher.add(now, s);
    const auto batch = batcher.next(now);
    EXPECT_TRUE(batch);
    batcher.finished(now, batch->number, outcome(end));
    return batch->batteries.size() == 1;
  };
  EXPECT_TRUE(sends_battery(0.5F, Kind::committed)) << "the first";
  for (int k = 1; k < 16; ++k) EXPECT_FALSE(sends_battery(0.5F, Kind::committed)) << k;
  EXPECT_TRUE(sends_battery(0.5F, Kind::committed)) << "the 16th behind it";
  EXPECT_FALSE(sends_battery(0.5F, Kind::committed));
  EXPECT_TRUE(sends_battery(0.49F, Kind::unavailable)) << "changed";
  EXPECT_TRUE(sends_battery(0.49F, Kind::invalidated)) << "that was not committed";
  EXPECT_TRUE(sends_battery(0.49F, Kind::committed));
  EXPECT_FALSE(sends_battery(0.49F, Kind::unavailable)) << "it had none to lose";
  EXPECT_FALSE(sends_battery(0.49F, Kind::committed));
  now += ns_per_s;
  EXPECT_TRUE(sends_battery(0.49F, Kind::committed)) << "a second without";
  EXPECT_FALSE(sends_battery(0.49F, Kind::committed));
}

TEST(Batcher, ABatchThatLingersIsDueWhenItHasLingered) {
  Batcher batcher({.linger_ns = 3 * ns_per_ms}, three, 1);
  for (DroneNumber d = 1; d <= 3; ++d) batcher.add(0, sample(d, 1));
  batcher.finished(1, batcher.next(0)->number, outcome(Kind::committed));
  EXPECT_EQ(batcher.due_ns(1), INT64_MAX) << "nothing waits";
  batcher.add(10, sample(1, 2));
  EXPECT_FALSE(batcher.next(10));
  EXPECT_EQ(batcher.due_ns(10), 10 + 3 * ns_per_ms);
}

/// Who sleeps until a batch is due must not miss it, and who finds it due must get it: else a loop that waits for that
/// moment sleeps too long, or spins.
TEST(Batcher, ItIsDueExactlyWhenThereIsABatch) {
  const int flights = seeds(300, 20'000);
  int batches = 0;
  for (int seed = 1; seed <= flights; ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    const auto up_to = [&](TimeNs limit) { return static_cast<TimeNs>(random.uniform() * static_cast<double>(limit)); };
    Batcher batcher({.min_gap_ns = seed % 2 == 0 ? 0 : up_to(20 * ns_per_ms),
                     .linger_ns = up_to(2 * ns_per_ms),
                     .freshness_ns = 100 * ns_per_s},
                    three, static_cast<std::uint64_t>(seed));
    std::deque<std::uint64_t> under_way;
    TimeNs now = ns_per_s;
    for (std::uint64_t k = 1; k <= 200; ++k) {
      now += up_to(10 * ns_per_ms);
      const int what = static_cast<int>(up_to(10));
      if (what < 6 || under_way.empty()) {
        batcher.add(now, sample(static_cast<DroneNumber>(1 + up_to(3)), k, now));
      } else {
        auto end = outcome(what < 8    ? Kind::committed
                           : what == 8 ? Kind::unavailable
                                       : Kind::refused,
                           what == 9 ? "chaincode response 500, tello2: enrolled to another" : "");
        end.ordered_after_ns = up_to(30 * ns_per_ms);
        batcher.finished(now, under_way.front(), end);
        under_way.pop_front();
      }
      for (auto batch = batcher.next(now); batch; batch = batcher.next(now)) under_way.push_back(batch->number);
      const TimeNs due_ns = batcher.due_ns(now);
      ASSERT_GT(due_ns, now) << "seed " << seed << ": due, and yet there was none";
      if (due_ns == INT64_MAX) {
        Batcher later = batcher;
        ASSERT_FALSE(later.next(now + 200 * ns_per_ms)) << "seed " << seed;
        continue;
      }
      if (due_ns - now > 250 * ns_per_ms) continue;  // by then a silent drone is not waited for any more
      Batcher before = batcher, then = batcher;
      ASSERT_FALSE(before.next(due_ns - 10)) << "seed " << seed << ": it went before it was due";
      ASSERT_TRUE(then.next(due_ns)) << "seed " << seed << ": due, and it did not go";
      ++batches;
    }
  }
  EXPECT_GT(batches, flights);
}

}  // namespace
}  // namespace ledgerline::agent
