#include "hil/netem/emulated_link.hpp"

#include <gtest/gtest.h>

#include <map>
#include <set>
#include <utility>
#include <vector>

namespace ledgerline::hil {
namespace {

using Kind = EmulatedLink::Kind;

EmulatedLink link_with(const std::string& effects, std::uint64_t seed = 1, Kind kind = Kind::datagrams) {
  EmulatedLink link(kind, seed);
  Impairment impairment;
  const auto applied = apply_effects(effects, impairment);
  EXPECT_TRUE(applied) << (applied ? "" : applied.error().message);
  EXPECT_TRUE(link.set(impairment));
  return link;
}

void set(EmulatedLink& link, const std::string& effects) {
  Impairment impairment = link.impairment();
  ASSERT_TRUE(apply_effects(effects, impairment));
  ASSERT_TRUE(link.set(impairment));
}

struct Came {
  TimeNs at = 0;
  std::string bytes;
  std::uint64_t tag = 0;
  bool operator==(const Came&) const = default;
};

void take_due(EmulatedLink& link, TimeNs now, std::vector<Came>& out) {
  while (auto unit = link.pop(now)) out.push_back({now, unit->bytes, unit->tag});
}

/// All that still comes, at the times that next_due() says.
std::vector<Came> drain(EmulatedLink& link) {
  std::vector<Came> out;
  while (const auto due = link.next_due()) take_due(link, *due, out);
  return out;
}

/// Numbered datagrams of 20 bytes, one each `period`, from time 0 on; what comes, each at the millisecond that it is
/// due.
std::vector<Came> send(EmulatedLink& link, int datagrams, TimeNs period = 10 * ns_per_ms) {
  std::vector<Came> out;
  for (int i = 0; i < datagrams; ++i) {
    const TimeNs now = i * period;
    while (link.next_due() && *link.next_due() < now) take_due(link, *link.next_due(), out);
    link.push(now, "datagram " + std::to_string(100'000'000 + i), static_cast<std::uint64_t>(i));
    take_due(link, now, out);
  }
  const auto rest = drain(link);
  out.insert(out.end(), rest.begin(), rest.end());
  return out;
}

void expect_all_accounted_for(const EmulatedLink& link) {
  const EmulatedLinkCounts& c = link.counts();
  EXPECT_EQ(c.pushed + c.duplicated, c.delivered + c.lost + c.no_room + link.waiting());
}

TEST(EmulatedLink, WithoutImpairmentGivesEverythingAtOnceAndAsItCame) {
  EmulatedLink link(Kind::datagrams, 1);
  const auto came = send(link, 50);
  ASSERT_EQ(came.size(), 50u);
  for (std::size_t i = 0; i < came.size(); ++i) {
    EXPECT_EQ(came[i],
              (Came{static_cast<TimeNs>(i) * 10 * ns_per_ms, "datagram " + std::to_string(100'000'000 + i), i}));
  }
  link.push(ns_per_s, "");
  EXPECT_EQ(drain(link).size(), 1u) << "an empty datagram is one too";
}

TEST(EmulatedLink, DelaysByWhatIsAskedAndKeepsTheOrder) {
  EmulatedLink constant = link_with("delay 200ms");
  for (const Came& came : send(constant, 50))
    EXPECT_EQ(came.at, static_cast<TimeNs>(came.tag) * 10 * ns_per_ms + 200 * ns_per_ms);

  EmulatedLink varying = link_with("delay uniform 1ms 300ms");
  std::uint64_t next = 0;
  for (const Came& came : send(varying, 200)) EXPECT_EQ(came.tag, next++);
  EXPECT_EQ(next, 200u);
}

TEST(EmulatedLink, LetsDatagramsOvertakeEachOtherUnderJitter) {
  EmulatedLink link = link_with("delay 100ms, jitter uniform 0ms 50ms");
  int overtaken = 0;
  std::uint64_t last = 0;
  const auto came = send(link, 200);
  ASSERT_EQ(came.size(), 200u);
  for (const Came& one : came) {
    const TimeNs late = one.at - static_cast<TimeNs>(one.tag) * 10 * ns_per_ms;
    EXPECT_GE(late, 100 * ns_per_ms);
    EXPECT_LE(late, 150 * ns_per_ms);
    overtaken += one.tag < last;
    last = one.tag;
  }
  EXPECT_GT(overtaken, 20);
}

TEST(EmulatedLink, LosesTheShareThatIsAsked) {
  EmulatedLink link = link_with("loss 5%");
  const auto came = send(link, 20'000);
  EXPECT_NEAR(static_cast<double>(came.size()), 19'000, 150);
  EXPECT_EQ(link.counts().lost, 20'000 - came.size());
  expect_all_accounted_for(link);
}

TEST(EmulatedLink, LosesInBurstsOfTheLengthThatIsAsked) {
  EmulatedLink link = link_with("loss bursts 1% 20%");  // bad for 1/0.2 datagrams, once in 1/0.01: 0.01/0.21 of all
  const auto came = send(link, 50'000);
  std::vector<bool> there(50'000);
  for (const Came& one : came) there[one.tag] = true;
  int lost = 0, bursts = 0;
  for (std::size_t i = 1; i < there.size(); ++i) {
    lost += !there[i];
    bursts += !there[i] && there[i - 1];
  }
  EXPECT_NEAR(lost / 50'000.0, 0.01 / 0.21, 0.006);
  EXPECT_NEAR(static_cast<double>(lost) / bursts, 5.0, 0.5);
}

TEST(EmulatedLink, LosesTheSharesOfBothStatesOfTheModel) {
  EmulatedLink link = link_with("loss bursts 10% 10% 50% 10%");  // as often bad as good
  EXPECT_NEAR(static_cast<double>(send(link, 20'000).size()), 20'000 * 0.7, 300);
}

TEST(EmulatedLink, DuplicatesAfterTheTimeThatIsAsked) {
  EmulatedLink link = link_with("duplicate 30% 35ms");
  std::map<std::uint64_t, std::vector<TimeNs>> times;
  for (const Came& one : send(link, 1'000)) times[one.tag].push_back(one.at);
  std::uint64_t twice = 0;
  for (const auto& [tag, at] : times) {
    EXPECT_EQ(at[0], static_cast<TimeNs>(tag) * 10 * ns_per_ms);
    if (at.size() == 2) {
      EXPECT_EQ(at[1] - at[0], 35 * ns_per_ms);
      ++twice;
    }
  }
  EXPECT_EQ(times.size(), 1'000u);
  EXPECT_NEAR(static_cast<double>(twice), 300, 45);
  EXPECT_EQ(link.counts().duplicated, twice);
  expect_all_accounted_for(link);
}

TEST(EmulatedLink, HoldsBackTheShareThatIsReorderedSoThatOthersPass) {
  EmulatedLink link = link_with("reorder 10% 25ms");
  std::uint64_t held = 0;
  for (const Came& one : send(link, 1'000)) {
    const TimeNs late = one.at - static_cast<TimeNs>(one.tag) * 10 * ns_per_ms;
    EXPECT_TRUE(late == 0 || late == 25 * ns_per_ms);
    held += late > 0;
  }
  EXPECT_NEAR(static_cast<double>(held), 100, 30);
  EXPECT_EQ(link.counts().reordered, held);
}

TEST(EmulatedLink, CorruptsOneBitAndTruncatesByAByteAtLeast) {
  EmulatedLink corrupting = link_with("corrupt 50%");
  std::uint64_t wrong = 0;
  for (const Came& one : send(corrupting, 400)) {
    const std::string was = "datagram " + std::to_string(100'000'000 + one.tag);
    ASSERT_EQ(one.bytes.size(), was.size());
    int bits = 0;
    for (std::size_t i = 0; i < was.size(); ++i)
      bits += __builtin_popcount(static_cast<unsigned char>(one.bytes[i] ^ was[i]));
    EXPECT_LE(bits, 1);
    wrong += bits == 1;
  }
  EXPECT_EQ(corrupting.counts().corrupted, wrong);
  EXPECT_NEAR(static_cast<double>(wrong), 200, 50);

  EmulatedLink truncating = link_with("truncate 50%");
  std::uint64_t shorter = 0;
  for (const Came& one : send(truncating, 400)) {
    const std::string was = "datagram " + std::to_string(100'000'000 + one.tag);
    EXPECT_EQ(one.bytes, was.substr(0, one.bytes.size()));
    shorter += one.bytes.size() < was.size();
  }
  EXPECT_EQ(truncating.counts().truncated, shorter);
  EXPECT_NEAR(static_cast<double>(shorter), 200, 50);
}

TEST(EmulatedLink, LetsThroughAtItsRateAndLosesWhatItsQueueDoesNotHold) {
  EmulatedLink link = link_with("rate 1kB/s queue 100B");
  for (int i = 0; i < 20; ++i) link.push(0, std::string(20, 'x'));  // 400 bytes at once
  EXPECT_EQ(link.waiting(), 5u) << "100 bytes";
  EXPECT_EQ(link.counts().no_room, 15u);
  const auto came = drain(link);
  for (std::size_t i = 0; i < came.size(); ++i) EXPECT_EQ(came[i].at, static_cast<TimeNs>(i + 1) * 20 * ns_per_ms);
  link.push(ns_per_s, std::string(1'400, 'x'));
  EXPECT_EQ(drain(link).back().at, ns_per_s + 1'400 * ns_per_ms) << "an empty queue takes any datagram";
  expect_all_accounted_for(link);
}

TEST(EmulatedLink, KeepsEverythingDuringAStallAndGivesItWhenTheStallEnds) {
  EmulatedLink link = link_with("delay 10ms");
  link.push(0, "before");
  set(link, "stall");
  link.push(5 * ns_per_ms, "during");
  std::vector<Came> came;
  take_due(link, ns_per_s, came);
  EXPECT_TRUE(came.empty());
  EXPECT_FALSE(link.next_due());
  set(link, "stall off");
  take_due(link, ns_per_s, came);
  ASSERT_EQ(came.size(), 2u);
  EXPECT_EQ(came[0].bytes, "before");
  EXPECT_EQ(came[1].bytes, "during");
}

TEST(EmulatedLink, LosesWhatIsPushedDuringAPartitionButNotWhatIsOnItsWay) {
  EmulatedLink link = link_with("delay 10ms");
  link.push(0, "before");
  set(link, "partition");
  link.push(5 * ns_per_ms, "during");
  set(link, "partition off");
  link.push(6 * ns_per_ms, "after");
  const auto came = drain(link);
  ASSERT_EQ(came.size(), 2u);
  EXPECT_EQ(came[0].bytes, "before");
  EXPECT_EQ(came[1].bytes, "after");
  EXPECT_EQ(link.counts().lost, 1u);
}

TEST(EmulatedLink, IsBoundedAndCountsWhatItDropped) {
  EmulatedLink many = link_with("stall");
  for (std::size_t i = 0; i < EmulatedLink::max_units + 10; ++i) many.push(0, "x");
  EXPECT_EQ(many.waiting(), EmulatedLink::max_units);
  EXPECT_EQ(many.counts().no_room, 10u);
  expect_all_accounted_for(many);

  EmulatedLink large = link_with("stall, duplicate 100%");
  const std::string kilobytes(50'000, 'x');
  for (int i = 0; i < 30; ++i) large.push(0, kilobytes);
  EXPECT_EQ(large.waiting(), EmulatedLink::max_bytes / kilobytes.size());
  EXPECT_EQ(large.counts().no_room, 40u);
  expect_all_accounted_for(large);
}

const char* const everything =
    "delay uniform 1ms 80ms, jitter gamma 20ms 15ms, loss bursts 3% 30% 90% 1%, duplicate 5% uniform 0ms 9ms, "
    "reorder 5% normal 30ms 10ms, corrupt 5%, truncate 5%, rate 4kB/s queue 2kB";

TEST(EmulatedLink, GivesTheSameBytesAtTheSameTimesForTheSameSeed) {
  EmulatedLink a = link_with(everything, 5), b = link_with(everything, 5), c = link_with(everything, 6);
  const auto of_a = send(a, 2'000);
  EXPECT_EQ(of_a, send(b, 2'000));
  EXPECT_NE(of_a, send(c, 2'000));
  expect_all_accounted_for(a);
  EXPECT_EQ(a.waiting(), 0u);
}

TEST(EmulatedLink, DrawsTheSameLossesWithAndWithoutOtherEffects) {
  std::set<std::uint64_t> alone, beside;
  EmulatedLink a = link_with("loss 10%", 9),
               b = link_with("loss 10%, delay uniform 1ms 9ms, corrupt 10%, duplicate 10%", 9);
  for (const Came& one : send(a, 500)) alone.insert(one.tag);
  for (const Came& one : send(b, 500)) beside.insert(one.tag);
  EXPECT_EQ(alone, beside);
}

/// All bytes of a stream, pushed in turns as room() allows, popped as they are due.
struct Streamed {
  std::string bytes;
  TimeNs end = 0;  ///< when its end came
  std::size_t max_waiting = 0;
};
Streamed stream(EmulatedLink& link, const std::string& bytes) {
  Streamed out;
  std::string_view left = bytes;
  bool ended = false;
  for (TimeNs now = 0; now < 1'000 * ns_per_s; now += ns_per_ms) {
    const std::size_t take = std::min({left.size(), link.room(now), std::size_t{16'384}});
    if (take > 0) link.push(now, left.substr(0, take));
    left.remove_prefix(take);
    if (left.empty() && !std::exchange(ended, true)) link.push(now, "");
    out.max_waiting = std::max(out.max_waiting, link.waiting());
    while (auto unit = link.pop(now)) {
      if (unit->bytes.empty()) return out.end = now, out;
      out.bytes += unit->bytes;
    }
  }
  return out;
}

std::string pattern(std::size_t size) {
  std::string bytes(size, ' ');
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<char>(i * 31 + i / 251);
  return bytes;
}

TEST(EmulatedLink, KeepsAStreamWholeAndInOrderUnderEveryImpairmentThatItMayHave) {
  const std::string bytes = pattern(300'000);
  for (const char* effects :
       {"clear", "delay 50ms", "delay uniform 1ms 90ms", "jitter gamma 20ms 15ms", "rate 100kB/s queue 8kB",
        "rate 100kB/s queue 100B, delay 200ms, jitter uniform 0ms 40ms"}) {
    EmulatedLink link = link_with(effects, 3, Kind::stream);
    const Streamed got = stream(link, bytes);
    EXPECT_TRUE(got.bytes == bytes) << effects << ": " << got.bytes.size() << " bytes";
    EXPECT_LE(got.max_waiting, EmulatedLink::max_units) << effects;
    EXPECT_EQ(link.counts().bytes_out, bytes.size());
  }
}

TEST(EmulatedLink, LetsAStreamThroughAtItsRateInPieces) {
  EmulatedLink link = link_with("rate 100kB/s queue 8kB", 3, Kind::stream);
  EXPECT_NEAR(to_seconds(stream(link, pattern(300'000)).end), 3.0, 0.1);
}

TEST(EmulatedLink, TakesNoMoreOfAStreamThanItHolds) {
  EmulatedLink link = link_with("stall", 1, Kind::stream);
  std::size_t taken = 0;
  while (const std::size_t room = link.room(0)) {
    const std::string bytes(std::min<std::size_t>(room, 16'384), 'x');
    link.push(0, bytes);
    taken += bytes.size();
  }
  EXPECT_EQ(taken, EmulatedLink::max_bytes);
  EXPECT_FALSE(link.pop(ns_per_s));
  set(link, "stall off");
  std::size_t came = 0;
  while (auto unit = link.pop(ns_per_s)) came += unit->bytes.size();
  EXPECT_EQ(came, EmulatedLink::max_bytes);
}

TEST(EmulatedLink, HoldsAStreamBackDuringAPartition) {
  EmulatedLink link = link_with("partition", 1, Kind::stream);
  link.push(0, "bytes");
  EXPECT_FALSE(link.pop(ns_per_s));
  set(link, "partition off");
  EXPECT_EQ(link.pop(ns_per_s)->bytes, "bytes");
}

TEST(EmulatedLink, RefusesWhatAStreamCannotHaveAndKeepsWhatItHad) {
  EmulatedLink link = link_with("delay 10ms", 1, Kind::stream);
  Impairment impairment;
  ASSERT_TRUE(apply_effect("loss 1%", impairment));
  EXPECT_FALSE(link.set(impairment));
  EXPECT_EQ(text_of(link.impairment()), "delay 10ms");
}

}  // namespace
}  // namespace ledgerline::hil
