#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <memory>

#include "common/base/random.hpp"
#include "common/msg/ros.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/agent_core.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/onboard/link/core/link_world.hpp"

/// The failsafe's transitions on their whole way, link's core to the blocks of the ledger, while agent dies and comes
/// back and the ledger is away.
namespace ledgerline::hil {
namespace {

constexpr TimeNs ms = ns_per_ms;
const crypto::IdentityName host_name{"Org1MSP", "CN=User1@org1.ledgerline"};

class Host {
 public:
  explicit Host(std::uint64_t seed) : random_(seed), ledger_(quick(), {}, seed), world(1, slow_states()) {
    EnrollCall enroll;
    enroll.mutable_identity()->set_msp_id(host_name.msp_id);
    enroll.mutable_identity()->set_subject(host_name.subject);
    enroll.add_drones("tello1");
    const auto admin = ledger_.add_client({"Org1MSP", "CN=Admin@org1.ledgerline"});
    EXPECT_TRUE(ledger_.commit_now(world.now, admin, {"enroll", {enroll.SerializeAsString()}}));
    client_ = ledger_.add_client(host_name);
    start_agent();
  }

  void start_agent() {
    agent::AgentCoreSettings settings;
    settings.drones = {{1, "tello1"}};
    settings.seed = ++starts_;
    agent_ = std::make_unique<agent::AgentCore>(settings, ledger_.registry());
    out_.clear();
    submitted_.clear();
  }
  void kill_agent() { agent_.reset(); }
  bool agent_lives() const { return agent_ != nullptr; }

  void pass(TimeNs duration) {
    for (const TimeNs end = world.now + duration; world.now < end;) step();
  }
  void step() {
    // Commands come through ledger and agent.
    if (world.now % (33 * ms) == 0 && piloted && agent_ && !away) pilot();
    world.agent = agent_ != nullptr;
    world.step();
    ledger_.step(world.now);
    for (const StateSample& state : world.states) {
      if (agent_) agent_->on_state(world.now, state, out_);
    }
    for (const Transition& transition : world.transitions) {
      // Shared memory may lose one now and then.
      if (agent_ && random_.next() % 10 != 0) agent_->on_transition(transition);
    }
    world.states.clear();
    world.transitions.clear();
    if (agent_) {
      step_agent();
    } else {
      (void)ledger_.pop_blocks(world.now, client_);
    }
  }
  void step_until(LinkPhase phase) {
    for (int i = 0; i < 60'000 && world.core.phase(1) != phase; ++i) step();
    ASSERT_EQ(world.core.phase(1), phase);
  }

  /// What is on the ledger, in order of its blocks.
  std::vector<Transition> on_ledger() const {
    std::vector<Transition> all;
    for (const std::string& bytes : ledger_.blocks()) {
      const auto block = fabric::decode_block(bytes);
      EXPECT_TRUE(block);
      for (const auto& tx : block->transactions) {
        SetCall set;
        if (tx.code != 0 || tx.event_name != "set" || !set.ParseFromString(tx.event_payload)) continue;
        for (const Asset& asset : set.assets()) {
          if (asset.id() != "tello1/failsafe") continue;
          const auto transitions = transitions_from_cdr(asset.msg_data());
          EXPECT_TRUE(transitions);
          all.insert(all.end(), transitions->begin(), transitions->end());
        }
      }
    }
    return all;
  }
  /// Every one is there, each for the first time behind the one before. Returns how many are there twice.
  std::size_t expect_none_lost() {
    const auto made = world.core.reports()[0].transitions;
    EXPECT_EQ(made.on_ledger, made.made);
    EXPECT_EQ(made.kept, 0U);
    EXPECT_EQ(made.lost, 0U);
    std::uint64_t newest = 0;
    std::size_t repeated = 0;
    for (const Transition& t : on_ledger()) {
      EXPECT_EQ(t.boot_id, 42U);
      if (t.number <= newest) {
        ++repeated;
        continue;
      }
      EXPECT_EQ(t.number, newest + 1);
      newest = t.number;
    }
    EXPECT_EQ(newest, made.made);
    return repeated;
  }
  std::uint64_t made() const { return world.core.reports()[0].transitions.made; }

  bool away = false;              ///< the ledger: what is submitted ends as unavailable after a second
  bool answers_are_lost = false;  ///< what is submitted gets there all the same
  bool piloted = true;

 private:
  struct Submitted {
    std::uint64_t call_number = 0;
    TimeNs gives_up_ns = 0;
    bool answer_lost = false;
  };

  static node::CoreConfig quick() {
    node::CoreConfig config;
    config.batch_count = 1;
    return config;
  }
  static link::LinkSettings slow_states() {
    link::LinkSettings settings;
    settings.rate_hz = 5;
    return settings;
  }

  void pilot() {
    if (world.core.phase(1) == LinkPhase::flying) {
      world.fly_plan({0, 0, 0}, 4);
    } else if (!is_in_flight(world.core.phase(1)) && world.now % (33 * 10 * ms) == 0) {
      world.plan(PlanAction::takeoff);
    }
  }

  void step_agent() {
    for (const auto& end : ledger_.pop_outcomes(world.now, client_)) finish(end.id, end.outcome);
    for (auto& [id, submitted] : std::map(submitted_)) {
      if (world.now >= submitted.gives_up_ns) finish(id, {});
    }
    if (!away) {
      for (const auto& block : ledger_.pop_blocks(world.now, client_))
        agent_->on_block(world.now, *fabric::decode_block(block->SerializeAsString()), out_);
    }
    agent_->step(world.now, out_);
    for (const auto& submit : out_.submits) {
      const std::uint64_t id = ++last_id_;  // two starts of agent use the same numbers
      submitted_[id] = {submit.call_number, world.now + ns_per_s, away};
      if (!away || answers_are_lost) ledger_.submit(world.now, client_, id, submit.call);
    }
    if (out_.heartbeat) {
      world.ledger = out_.heartbeat->ledger_alive;
      world.heartbeat = *out_.heartbeat;
    }
    out_.clear();
  }
  void finish(std::uint64_t id, const fabric::Outcome& outcome) {
    const auto found = submitted_.find(id);
    if (found == submitted_.end()) return;  // of an agent that is gone
    const bool given_up = world.now >= found->second.gives_up_ns;
    if ((away || found->second.answer_lost) && !given_up) return;
    agent_->on_outcome(world.now, found->second.call_number, given_up ? fabric::Outcome{} : outcome, out_);
    submitted_.erase(found);
  }

  Random random_;
  SimulatedLedger ledger_;
  SimulatedLedger::Client client_ = 0;
  std::unique_ptr<agent::AgentCore> agent_;
  agent::AgentOutputs out_;
  std::map<std::uint64_t, Submitted> submitted_;
  std::uint64_t last_id_ = 0;
  std::uint64_t starts_ = 0;

 public:
  link::LinkWorld world;
};

TEST(Transitions, OfAnUndisturbedFlightAreOnTheLedgerOnceEach) {
  Host host(1);
  host.step_until(LinkPhase::flying);
  host.pass(ns_per_s);
  host.piloted = false;
  host.step_until(LinkPhase::landed);
  host.pass(ns_per_s);
  EXPECT_EQ(host.expect_none_lost(), 0U);
  EXPECT_GE(host.made(), 6U) << "on the ground, taking off, flying, hold, landing, landed";
}

TEST(Transitions, WhileAgentIsDeadWaitInLink) {
  Host host(2);
  host.step_until(LinkPhase::flying);
  host.pass(ns_per_s);
  host.kill_agent();
  host.step_until(LinkPhase::landed);
  const auto before = host.on_ledger().size();
  host.start_agent();
  host.piloted = false;
  host.pass(3 * ns_per_s);
  EXPECT_EQ(host.expect_none_lost(), 0U);
  EXPECT_GE(host.on_ledger().size(), before + 3) << "hold, landing, landed";
}

TEST(Transitions, WhileTheLedgerIsAwayWaitInAgent) {
  Host host(3);
  host.step_until(LinkPhase::flying);
  host.pass(ns_per_s);
  host.away = true;
  host.step_until(LinkPhase::landed);
  const auto before = host.on_ledger().size();
  host.pass(10 * ns_per_s);
  EXPECT_EQ(host.on_ledger().size(), before);
  host.away = false;
  host.pass(3 * ns_per_s);
  EXPECT_EQ(host.expect_none_lost(), 0U);
  EXPECT_GE(host.on_ledger().size(), before + 3);
}

TEST(Transitions, SurviveAnAgentThatDiesWhileTheLedgerIsAway) {
  Host host(4);
  host.step_until(LinkPhase::flying);
  host.pass(ns_per_s);
  host.away = true;
  host.pass(3 * ns_per_s);
  host.kill_agent();  // with what it kept
  host.step_until(LinkPhase::landed);
  host.start_agent();
  host.pass(5 * ns_per_s);
  host.away = false;
  host.pass(3 * ns_per_s);
  EXPECT_EQ(host.expect_none_lost(), 0U);
}

TEST(Transitions, WhoseCallsFateIsUnknownMayBeThereTwiceWithTheSameNumber) {
  Host host(5);
  host.step_until(LinkPhase::flying);
  host.pass(ns_per_s);
  host.away = host.answers_are_lost = true;
  host.piloted = false;
  host.step_until(LinkPhase::landed);
  host.away = false;
  host.pass(3 * ns_per_s);
  EXPECT_GT(host.expect_none_lost(), 0U);
}

TEST(Transitions, NoneIsLostWhateverComesAndGoes) {
  std::uint64_t made = 0;
  std::size_t repeated = 0;
  for (int seed = 100; seed < 100 + seeds(5, 1000); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    Host host(static_cast<std::uint64_t>(seed));
    host.pass(2 * ns_per_s);
    for (int i = 0; i < 40; ++i) {
      switch (random.next() % 6) {
        case 0:
          host.agent_lives() ? host.kill_agent() : host.start_agent();
          break;
        case 1:
          host.away = !host.away;
          host.answers_are_lost = random.next() % 2 == 0;
          break;
        case 2:
          host.world.mocap = !host.world.mocap;
          break;
        case 3:
          host.world.tellos[0].states = !host.world.tellos[0].states;
          break;
        default:
          host.piloted = !host.piloted;
          break;
      }
      host.pass(static_cast<TimeNs>(random.next() % 2000) * ms);
    }
    if (!host.agent_lives()) host.start_agent();
    host.away = host.piloted = false;
    host.world.tellos[0].states = true;
    host.pass(30 * ns_per_s);
    repeated += host.expect_none_lost();
    made += host.made();
    ASSERT_FALSE(HasFailure()) << "seed " << seed;
  }
  EXPECT_GT(made, 50U);
  std::printf("%llu transitions, none lost, %zu there more than once\n", static_cast<unsigned long long>(made),
              repeated);
}

}  // namespace
}  // namespace ledgerline::hil
