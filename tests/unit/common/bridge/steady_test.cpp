// Counts the heap's use in steady state.
#include <gtest/gtest.h>

#include "tests/unit/allocations.hpp"
#include "tests/unit/common/bridge/world.hpp"

namespace ledgerline::bridge {
namespace {

using namespace testing;

constexpr int topics = 20, per_topic = 50;

/// A call with 50 messages of each of 20 topics.
Uplink::Submit fill(Uplink& uplink, TimeNs now, const std::string& message) {
  for (int n = 0; n < per_topic; ++n) {
    for (int topic = 0; topic < topics; ++topic) uplink.add(now, static_cast<std::size_t>(topic), now, bytes(message));
  }
  return std::move(*uplink.next(now));
}

Uplink twenty_topics(bool stream) {
  Rule all = rule(stream ? "/tello1/*" : "/*");
  all.stream = stream;
  Uplink uplink(uplink_config({all}));
  for (int topic = 0; topic < topics; ++topic)
    EXPECT_TRUE(uplink.open((stream ? "/tello1/t" : "/t") + std::to_string(topic), "p/msg/A").ok());
  return uplink;
}

TEST(BridgeSteady, FromDdsToTheCallNothingIsAllocatedPerMessage) {
  for (const bool stream : {false, true}) {
    Uplink uplink = twenty_topics(stream);
    const std::string message = cdr(std::string(100, 'x'));
    TimeNs now = 0;
    std::size_t before = 0;
    std::size_t carried = 0;
    constexpr int calls = 20;
    for (int call = -3; call < calls; ++call) {
      if (call == 0) before = allocations;
      now += ns_per_s;
      Uplink::Submit submit = fill(uplink, now, message);
      if (call >= 0) carried += submit.call.args[0].size() / message.size();
      uplink.finished(now, submit.number, ended(fabric::Outcome::Kind::committed));
      while (auto rest = uplink.next(now += ns_per_s))
        uplink.finished(now, rest->number, ended(fabric::Outcome::Kind::committed));
    }
    EXPECT_GT(carried, calls * 500U);
    EXPECT_LE(allocations - before, calls * 12U) << "some per call: its arguments, its place in flight";
  }
}

TEST(BridgeSteady, FromTheBlockToDdsNothingIsAllocatedPerMessage) {
  const auto registry = crypto::make_test_registry({"Org1MSP"});
  Downlink downlink({.rules = {rule("/*")}, .self = org2, .writer = writer_of(org2, "")}, *registry);
  Uplink uplink = twenty_topics(false);
  LedgerOfTests ledger;
  std::vector<fabric::Block> blocks;
  TimeNs now = 0;
  constexpr int calls = 20;
  for (int call = 0; call < calls + 3; ++call) {
    LedgerOfTests::Tx tx;
    tx.creator = org1;
    tx.event_name = "set";
    now += ns_per_s;
    Uplink::Submit submit = fill(uplink, now, cdr(std::string(100, 'x')));
    tx.event_payload = submit.call.args[0];
    blocks.push_back(ledger.block({tx}));
    uplink.finished(now, submit.number, ended(fabric::Outcome::Kind::committed));
    while (auto rest = uplink.next(now += ns_per_s))
      uplink.finished(now, rest->number, ended(fabric::Outcome::Kind::committed));
  }
  std::vector<Downlink::Delivery> out;
  std::size_t before = 0, published = 0;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (i == 3) before = allocations;
    out.clear();
    downlink.on_block(0, blocks[i], out);
    if (i >= 3) published += out.size();
  }
  const std::size_t used = allocations - before;
  EXPECT_GT(published, calls * 500U);
  EXPECT_LE(used, calls * 20U) << "some per transaction: its signer is looked at";
}

}  // namespace
}  // namespace ledgerline::bridge
