#include <gmock/gmock.h>

#include <algorithm>
#include <deque>

#include "common/base/random.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/command_call.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// Stops against everything else that changes who flies, in the ledger's own check of what was read (MVCC).
namespace ledgerline::node {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::SizeIs;

class StopConflicts : public ::testing::Test {
 protected:
  StopConflicts() {
    net.submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1", "tello2"}));
    net.submit(net.admin1, "grant", grant_call("Org2MSP", {"tello1", "tello2"}));
    net.submit(net.admin2, "enroll", enroll_call(net.pilot.name, {}, OPERATOR));
    net.submit(net.admin2, "enroll", enroll_call(rival.name, {}, OPERATOR));
    for (int i = 0; i < 10; ++i) {
      stoppers.push_back(crypto::make_test_identity({"Org1MSP", "CN=guard" + std::to_string(i)}));
      net.submit(net.admin1, "enroll", enroll_call(stoppers.back().name, {}, OPERATOR));
    }
    net.submit(net.pilot, "acquire", "tello1");
  }

  /// Blocks of so many transactions from now on.
  void blocks_of(std::size_t count) {
    net.config.batch_count = count;
    net.restart();
  }

  std::string command() { return net.endorsed(net.pilot, "command", command_call(1).SerializeAsString()); }

  std::vector<int> in_one_block(const std::vector<std::string>& envelopes) {
    blocks_of(envelopes.size());
    for (const std::string& envelope : envelopes) EXPECT_EQ(net.core->order(envelope, net.now).code, Code::ok);
    return net.commit();
  }

  FakeNetwork net;
  std::vector<crypto::SigningIdentity> stoppers;
  const crypto::SigningIdentity rival = crypto::make_test_identity({"Org2MSP", "CN=rival"});
};

TEST_F(StopConflicts, TenStopsInOneBlockAreAllValid) {
  std::vector<std::string> stops;
  for (const auto& stopper : stoppers) stops.push_back(net.endorsed(stopper, "stop", "tello1"));
  EXPECT_THAT(in_one_block(stops), AllOf(SizeIs(10), Each(protos::VALID)));
}

TEST_F(StopConflicts, AStopWinsAgainstWhatChangesTheDronesRecordWhicheverComesFirst) {
  ASSERT_THAT(net.submit(net.pilot, "stop", "tello1"), ElementsAre(protos::VALID));
  for (const auto& [who, function] : {std::pair(&net.pilot, "clear_stop"), std::pair(&net.host, "apply_stops"),
                                      std::pair(&net.pilot, "release"), std::pair(&net.pilot, "acquire")}) {
    const auto& first = stoppers[0];
    const std::string before = net.endorsed(first, "stop", "tello1"), change = net.endorsed(*who, function, "tello1");
    EXPECT_THAT(in_one_block({before, change}), ElementsAre(protos::VALID, protos::PHANTOM_READ_CONFLICT)) << function;
  }
  for (const auto& [who, function] : {std::pair(&net.host, "apply_stops"), std::pair(&net.pilot, "clear_stop"),
                                      std::pair(&net.pilot, "release"), std::pair(&net.pilot, "acquire")}) {
    const std::string change = net.endorsed(*who, function, "tello1");
    const std::string after = net.endorsed(stoppers[1], "stop", "tello1");
    EXPECT_THAT(in_one_block({change, after}), ElementsAre(protos::VALID, protos::VALID)) << function;
  }
}

TEST_F(StopConflicts, AStopOfTheHolderDoesNotLoseToTheEndOfItsLease) {
  const std::string stop = net.endorsed(net.pilot, "stop", "tello1");
  const std::string other = net.endorsed(stoppers[0], "stop", "tello1");
  EXPECT_THAT(in_one_block({other, stop}), ElementsAre(protos::VALID, protos::VALID));
  const std::string clear = net.endorsed(stoppers[0], "clear_stop", "tello1");
  const std::string again = net.endorsed(net.pilot, "stop", "tello1");
  EXPECT_THAT(in_one_block({clear, again}), ElementsAre(protos::VALID, protos::VALID));
  const std::string release = net.endorsed(net.pilot, "release", "tello1");
  const std::string late = net.endorsed(net.pilot, "stop", "tello1");
  EXPECT_THAT(in_one_block({release, late}), ElementsAre(protos::VALID, protos::VALID));
}

/// Held back on their way, and sent once their stopper or a supervisor has cleared one that stood.
TEST_F(StopConflicts, AThousandOldStopsSentAgainAfterAClearDoNothing) {
  net.config.max_waiting = 20'000;  // a sixteenth of them may be urgent ones of one identity
  net.restart();
  DronesCall counted;
  counted.add_drones("tello1");
  counted.add_clears(0);
  std::vector<std::string> old;
  for (int i = 0; i < 1'000; ++i) {
    old.push_back(i % 2 == 0 ? net.endorsed(stoppers[0], "stop", "tello1")
                             : net.endorsed(stoppers[0], "stop", counted.SerializeAsString()));
  }
  EXPECT_THAT(in_one_block({old[0]}), ElementsAre(protos::VALID));
  ASSERT_THAT(net.submit(stoppers[0], "clear_stop", "tello1"), ElementsAre(protos::VALID));
  const auto codes = in_one_block(old);
  ASSERT_EQ(codes.size(), 1'000U);
  EXPECT_EQ(codes[0], protos::DUPLICATE_TXID);
  EXPECT_THAT(std::vector(codes.begin() + 1, codes.end()), Each(protos::MVCC_READ_CONFLICT));
  EXPECT_THAT(in_one_block({command()}), ElementsAre(protos::VALID)) << "nobody has it stopped";
  EXPECT_NE(
      net.core->endorse(net.propose(stoppers[0], "stop", counted.SerializeAsString()).signed_proposal, net.now).code,
      Code::ok);
  EXPECT_THAT(net.submit(stoppers[0], "stop", "tello1"), ElementsAre(protos::VALID)) << "a new one stops";
}

TEST_F(StopConflicts, AStopLosesToTheClearOfAnEarlierOneOfItsOwnOnceAtMost) {
  ASSERT_THAT(net.submit(stoppers[0], "stop", "tello1"), ElementsAre(protos::VALID));
  const std::string clear = net.endorsed(stoppers[0], "clear_stop", "tello1");
  const std::string next = net.endorsed(stoppers[0], "stop", "tello1");
  EXPECT_THAT(in_one_block({clear, next}), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
  const std::string again = net.endorsed(stoppers[0], "stop", "tello1");
  ASSERT_NE(net.core->endorse(net.propose(stoppers[0], "clear_stop", "tello1").signed_proposal, net.now).code, Code::ok)
      << "there is no stop of its own that anybody could clear meanwhile";
  EXPECT_THAT(in_one_block({again}), ElementsAre(protos::VALID));
}

TEST_F(StopConflicts, ApplyStopsInvalidatesTheCommandsThatAreInFlight) {
  const std::string early = command(), late = command();
  const std::string stop = net.endorsed(stoppers[0], "stop", "tello1");
  EXPECT_THAT(in_one_block({stop, early}), ElementsAre(protos::VALID, protos::VALID)) << "agent refuses it";
  const std::string applied = net.endorsed(net.host, "apply_stops", "tello1");
  EXPECT_THAT(in_one_block({applied, late}), ElementsAre(protos::VALID, protos::MVCC_READ_CONFLICT));
}

TEST_F(StopConflicts, ApplyStopsThatAStopOvertookIsInvalidAndOneAfterItHasBoth) {
  ASSERT_THAT(net.submit(stoppers[0], "stop", "tello1"), ElementsAre(protos::VALID));
  const std::string applied = net.endorsed(net.host, "apply_stops", "tello1");
  const std::string stop = net.endorsed(stoppers[1], "stop", "tello1");
  EXPECT_THAT(in_one_block({stop, applied}), ElementsAre(protos::VALID, protos::PHANTOM_READ_CONFLICT));
}

/// A stopper or a disturber, as it sends: endorsed against what it finds, again when the ledger says that it lost.
struct Sender {
  const crypto::SigningIdentity* who = nullptr;
  std::vector<std::string> functions;  ///< one after the other, for ever
  std::size_t next = 0;
  bool waits = false;  ///< for its block
};

// Ten who stop, each once, at moments of their own, against a holder that stops and clears its stop and another that
// takes and gives back the lease, as fast as the ledger lets them, and a host that applies stops.
TEST_F(StopConflicts, TenStopsAreOnTheLedgerWithinFiveBlocksWhateverAHolderDoesInALoop) {
  std::size_t worst = 0, invalid = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Random random(seed);
    blocks_of(4);
    std::vector<Sender> disturbers{
        {&net.pilot, {"stop", "clear_stop"}}, {&rival, {"acquire", "release"}}, {&net.host, {"apply_stops"}}};
    struct Stop {
      std::size_t begun = 0;  ///< height at its first submission
      bool waits = false, done = false;
    };
    std::vector<Stop> stops(stoppers.size());
    std::deque<std::pair<int, std::size_t>> ordered;  ///< who waits for which transaction, in order; stoppers from 100
    const auto order = [&](int who, const crypto::SigningIdentity& by, const std::string& function) {
      LeaseCall call;
      call.add_drones("tello1");
      if (function == "acquire") call.set_priority(1'000 + static_cast<std::uint32_t>(net.chain.size()));
      const Reply endorsed =
          net.core->endorse(net.propose(by, function, call.SerializeAsString()).signed_proposal, net.now);
      if (endorsed.code != Code::ok) return false;  // "not stopped", "does not hold": the next one will do
      EXPECT_EQ(net.core->order(*fabric::sign_envelope(by, endorsed.bytes), net.now).code, Code::ok);
      ordered.emplace_back(who, net.chain.size());
      return true;
    };
    for (int turn = 0; turn < 400; ++turn) {
      const auto at = static_cast<std::size_t>(random.next() % 13);
      if (at < 3) {
        Sender& sender = disturbers[at];
        if (!sender.waits) sender.waits = order(static_cast<int>(at), *sender.who, sender.functions[sender.next]);
        if (!sender.waits) sender.next = (sender.next + 1) % sender.functions.size();
      } else if (Stop& stop = stops[at - 3]; !stop.waits && !stop.done && turn > 100) {
        if (stop.begun == 0) stop.begun = net.chain.size();
        stop.waits = order(100 + static_cast<int>(at - 3), stoppers[at - 3], "stop");
        EXPECT_TRUE(stop.waits);
      }
      net.now.monotonic_ns += 3 * ns_per_ms;
      const std::size_t height = net.chain.size();
      for (const int code : net.commit()) {
        ASSERT_FALSE(ordered.empty());
        const int who = ordered.front().first;
        ordered.pop_front();
        if (who < 100) {
          Sender& sender = disturbers[static_cast<std::size_t>(who)];
          sender.waits = false;
          if (code == protos::VALID) sender.next = (sender.next + 1) % sender.functions.size();
          continue;
        }
        Stop& stop = stops[static_cast<std::size_t>(who - 100)];
        stop.waits = false;
        stop.done = code == protos::VALID;
        if (!stop.done) ++invalid;
        if (stop.done) worst = std::max(worst, height + 1 - stop.begun);
      }
    }
    EXPECT_THAT(stops, Each(::testing::Field(&Stop::done, true))) << "seed " << seed;
    net.submit(stoppers[0], "clear_stop", "tello1");
  }
  RecordProperty("worst_blocks", static_cast<int>(worst));
  std::printf("stops that the ledger made invalid: %zu; blocks from a stop's submission to its own: at most %zu\n",
              invalid, worst);
  EXPECT_EQ(invalid, 0U);
  EXPECT_LE(worst, 5U);
}

}  // namespace
}  // namespace ledgerline::node
