#include "ground/core/flight/command_outbox.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using Kind = fabric::Outcome::Kind;

class CommandOutboxTest : public testing::Test {
 protected:
  void put(std::size_t drone, std::uint64_t id) {
    PlannedCommand command;
    command.plan.set_drone(config.drones[drone].name);
    command.id = id;
    outbox.put(drone, std::move(command));
  }
  CommandCall submit(TimeNs now) {
    out = {};
    outbox.submit(now, next_id, out);
    CommandCall call;
    if (!out.submissions.empty()) call.ParseFromString(out.submissions[0].call.args.at(0));
    return call;
  }

  FlightConfig config = config_for(2);
  std::vector<FlightStatus> status = std::vector<FlightStatus>(2);
  PlanTiming timing{2};
  FlightTransactions counters;
  std::vector<std::uint64_t> withdrawn;
  FlightOutputs out;
  std::uint64_t next_id = 1;
  const std::function<void(std::uint64_t)> withdraw = [this](std::uint64_t plan) { withdrawn.push_back(plan); };
  CommandOutbox outbox{
      {{config.drones[0], &status.at(0), withdraw}, {config.drones[1], &status.at(1), withdraw}}, timing, counters};
};

TEST_F(CommandOutboxTest, TheNewestOfEachDroneGoesInOneCallAndWhatItReplacesIsWithdrawn) {
  put(0, 1);
  put(0, 2);
  put(1, 3);
  EXPECT_EQ(submit(0).plans_size(), 2);
  EXPECT_EQ(withdrawn, std::vector<std::uint64_t>{1});
  EXPECT_EQ(status[0].commands.merged, 1u);
  put(0, 4);
  EXPECT_EQ(submit(1).plans_size(), 0) << "one is in flight";
  outbox.on_outcome(5, fabric::Outcome::failed(Kind::committed, ""), 1, out);
  EXPECT_LT(timing.of(0).delay_ns, RoundTripEstimate::unknown_ns) << "plans are timed by what the call took";
  EXPECT_EQ(submit(5).plans(0).sequence(), 2u);
}

TEST_F(CommandOutboxTest, ACallRefusedForOneDroneGoesAgainWithoutItUnlessTheLeaseIsAnother) {
  put(0, 1);
  put(1, 2);
  submit(0);
  outbox.on_outcome(1, fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: CN=a tello2: b"), 1,
                    out);
  EXPECT_EQ(withdrawn, std::vector<std::uint64_t>{1});
  const CommandCall again = submit(1);
  ASSERT_EQ(again.plans_size(), 1);
  EXPECT_EQ(again.plans(0).drone(), "tello2");
  outbox.begin_lease(1, "Org1MSP", 7);
  outbox.on_outcome(2, fabric::Outcome::failed(Kind::refused, "chaincode response 500, tello1: no"), 2, out);
  EXPECT_EQ(submit(ns_per_s).plans_size(), 0);
}

TEST_F(CommandOutboxTest, EachOrganisationsDronesGoInACallOfTheirOwnAndDoNotWaitForAnothers) {
  outbox.begin_lease(0, "Org1MSP", 1);
  outbox.begin_lease(1, "Org3MSP", 1);
  put(0, 1);
  put(1, 2);
  submit(0);
  ASSERT_EQ(out.submissions.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    CommandCall call;
    call.ParseFromString(out.submissions[i].call.args.at(0));
    EXPECT_EQ(call.organisation(), i == 0 ? "Org1MSP" : "Org3MSP");
    ASSERT_EQ(call.plans_size(), 1);
    EXPECT_EQ(call.plans(0).drone(), config.drones[i].name);
  }
  outbox.on_outcome(1, fabric::Outcome::failed(Kind::committed, ""), 1, out);
  put(0, 3);
  put(1, 4);
  EXPECT_EQ(submit(1).organisation(), "Org1MSP");
  EXPECT_EQ(out.submissions.size(), 1u) << "the other organisation's is in flight";
}

}  // namespace
}  // namespace ledgerline::ground
