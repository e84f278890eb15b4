#include "hil/shim/scripted_agent.hpp"

#include <gtest/gtest.h>

namespace ledgerline::hil::shim {
namespace {

class Scripted : public ::testing::Test {
 protected:
  Scripted() {
    script.drones = 2;
    script.end_ns = 3 * ns_per_s;
    script.says.push_back({ns_per_s, 2 * ns_per_s, 2, PlanAction::fly, {0.5F, 0, 0}, 0.1F});
    script.silences.push_back({ns_per_s + 500 * ns_per_ms, ns_per_s + 700 * ns_per_ms});
  }
  /// All that it says in its time, asked every `period_ns`.
  ScriptedAgent::DueMessages all(TimeNs period_ns) {
    sim::Parameters parameters;
    parameters.drones = script.drones;
    const sim::Simulator drones(parameters, 0);
    ScriptedAgent agent(script, 0);
    ScriptedAgent::DueMessages everything;
    for (TimeNs now = 0; !agent.over(now); now += period_ns) {
      const auto& said = agent.step(now, drones);
      everything.plans.insert(everything.plans.end(), said.plans.begin(), said.plans.end());
      everything.poses.insert(everything.poses.end(), said.poses.begin(), said.poses.end());
      everything.heartbeats.insert(everything.heartbeats.end(), said.heartbeats.begin(), said.heartbeats.end());
    }
    return everything;
  }
  PlanScript script;
};

TEST_F(Scripted, SaysPlansPosesAndSignsOfLifeButInItsSilence) {
  const auto said = all(ns_per_ms);
  EXPECT_EQ(said.plans.size(), 25U);               // 30 a second for one second, and one, less the six of the silence
  EXPECT_EQ(said.poses.size(), 2 * (300U - 20U));  // 100 a second of each
  EXPECT_EQ(said.heartbeats.size(), 60U - 4U);     // 20 a second
  for (std::size_t i = 0; i < said.plans.size(); ++i) {
    const Plan& plan = said.plans[i];
    EXPECT_EQ(plan.drone, 2);
    const std::uint64_t missed = plan.verified_ns >= script.silences[0].until_ns ? 6 : 0;
    EXPECT_EQ(plan.sequence, i + 1 + missed);
    ASSERT_EQ(plan.count, 12U);
    EXPECT_FLOAT_EQ(plan.setpoints[11].velocity_mps[0], 0.5F);
    EXPECT_EQ(plan.setpoints[11].at_ns - plan.setpoints[0].at_ns, 550 * ns_per_ms);
    const TimeNs said_ns = plan.setpoints[0].at_ns - 20 * ns_per_ms;
    EXPECT_FALSE(said_ns >= script.silences[0].at_ns && said_ns < script.silences[0].until_ns);
  }
}

TEST_F(Scripted, SaysTheSameHoweverLateItIsAsked) {
  const auto early = all(ns_per_ms), late = all(7 * ns_per_ms);
  ASSERT_EQ(early.plans.size(), late.plans.size());
  for (std::size_t i = 0; i < early.plans.size(); ++i)
    EXPECT_EQ(std::pair(early.plans[i].setpoints[0].at_ns, early.plans[i].sequence),
              std::pair(late.plans[i].setpoints[0].at_ns, late.plans[i].sequence));
}

TEST_F(Scripted, TakesEachTransitionOnceAndSaysSo) {
  sim::Parameters parameters;
  const sim::Simulator drones(parameters, 0);
  script.drones = 1;
  ScriptedAgent agent(script, 0);
  Transition first;
  first.drone = 1;
  first.boot_id = 7;
  first.number = 1;
  agent.add(first);
  agent.add(first);
  Transition third = first;
  third.number = 3;
  agent.add(third);
  EXPECT_EQ(agent.transitions().size(), 1U);
  const auto& said = agent.step(0, drones);
  ASSERT_EQ(said.heartbeats.size(), 1U);
  EXPECT_EQ(said.heartbeats[0].boot_id, 7U);
  EXPECT_EQ(said.heartbeats[0].transitions_on_ledger[1], 1U);
}

}  // namespace
}  // namespace ledgerline::hil::shim
