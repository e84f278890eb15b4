#include <gtest/gtest.h>

#include <algorithm>
#include <iostream>
#include <map>

#include "common/base/random.hpp"
#include "common/msg/contract.hpp"
#include "common/verification/control_records.hpp"
#include "hil/sitl/world.hpp"
#include "tests/unit/campaign.hpp"

/// One drone in the air and two grounds, whose operators pass it to and fro by request and rule; between them a
/// supervisor evicts the holder.
namespace ledgerline::hil {
namespace {

/// The second ground, of the supervisor of the drone's organisation, at the world's ledger.
class OtherGround {
 public:
  OtherGround(SimulatedWorld& world, const WorldConfig& config)
      : world_(world), port_(world.ledger(), supervisor_name, config.seed + 77), core_(flight(world, config)) {
    port_.begin();
    const auto control = verification::read_control(
        drone_name(1), [&](const fabric::Call& call) { return port_.evaluate(world_.now(), call); });
    EXPECT_TRUE(control && core_.set_control(control->SerializeAsString()));
  }

  void step() {
    const TimeNs now = world_.now();
    port_.step(now);
    const auto outcomes = port_.pop_outcomes();
    apply_updates(outcomes, port_.pop_blocks(), [this](const ground::FlightInputs& inputs) { give(inputs); });
    if (now % (50 * ns_per_ms) == 0) give({});
  }
  bool flies() const { return core_.status(0).phase == ground::GroundPhase::manual; }

 private:
  static ground::FlightConfig flight(SimulatedWorld& world, const WorldConfig& config) {
    ground::FlightConfig flight = ground_config(config, world.ledger());
    flight.self = supervisor_name;
    return flight;
  }
  void give(const ground::FlightInputs& inputs) {
    auto out = core_.step(world_.now(), inputs);
    for (auto& submission : out.submissions) port_.submit(world_.now(), submission.id, std::move(submission.call));
  }

  SimulatedWorld& world_;
  LedgerPort port_;
  ground::FlightCore core_;
};

/// What the chain says of one drone.
struct ChainOfOne {
  struct Change {
    std::string function;
    std::uint64_t block = 0, epoch = 0;
    std::optional<std::uint64_t> first_command;  ///< block of the new holder's first valid one
  };
  std::vector<Change> changes;
  std::uint64_t commands = 0;         ///< valid ones
  std::uint64_t losers_commands = 0;  ///< valid, of an epoch that was over
  std::uint64_t late = 0;             ///< invalid: in flight at a change

  explicit ChainOfOne(const std::vector<std::string>& blocks) {
    for (const std::string& bytes : blocks) {
      const auto block = fabric::decode_block(bytes);
      if (!block) continue;
      for (const auto& tx : block->transactions) take(block->number, tx);
    }
  }
  void take(std::uint64_t block, const fabric::Transaction& tx) {
    CommandCall command;
    Controls controls;
    if (tx.event_name == contract::command && command.ParseFromString(tx.event_payload)) {
      if (tx.code != 0) return void(++late);
      ++commands;
      if (changes.empty()) return;
      if (command.plans(0).epoch() != changes.back().epoch) ++losers_commands;
      if (!changes.back().first_command) changes.back().first_command = block;
    } else if (tx.code == 0 && controls.ParseFromString(tx.event_payload) && controls.controls_size() == 1) {
      const bool changes_holder = tx.event_name == contract::hand_over || tx.event_name == contract::evict ||
                                  tx.event_name == contract::acquire;
      if (changes_holder) changes.push_back({tx.event_name, block, controls.controls(0).epoch(), {}});
    }
  }
};

struct Flown {
  int hand_overs = 0, evictions = 0;
  std::uint64_t held = 0;  ///< times that the failsafe held the drone while it was only handed over
  std::uint64_t unasked = 0;
  double lowest_m = 10;
  std::vector<std::uint64_t> gaps;  ///< blocks from a hand-over to the new holder's first command
  std::uint64_t losers_commands = 0, late = 0, commands = 0;
};

/// Passes the drone so many times to and fro, and takes it away so many times.
Flown fly(std::uint64_t seed, int hand_overs, int evictions) {
  WorldConfig config;
  config.seed = seed;
  config.manual = true;
  config.supervisors = true;
  config.request_rule = ground::RequestRule::hand_over;
  auto made = SimulatedWorld::create(config);
  EXPECT_TRUE(made);
  SimulatedWorld& world = **made;
  OtherGround other(world, config);
  Random random(seed);
  Flown flown;
  bool taken_off = false, evicting = false;
  Stopper holder = Stopper::operating;
  TimeNs next_ns = 0;
  const auto flies = [&](Stopper who) {
    return who == Stopper::supervisor
               ? other.flies()
               : world.ground() != nullptr && world.ground()->status(0).phase == ground::GroundPhase::manual;
  };
  while (world.now() < 1'000 * ns_per_s &&
         (flown.hand_overs < hand_overs || flown.evictions < evictions || !flies(holder))) {
    world.step();
    other.step();
    if (!taken_off && world.now() > ns_per_s) {
      world.post_command({.drone = 0, .takeoff = true});
      taken_off = true;
    }
    for (const WorldEvent& event : world.events()) {
      flown.unasked += event.kind == WorldEvent::Kind::unasked ? 1 : 0;
      const bool holds = event.kind == WorldEvent::Kind::mode && world.drones()[0].mode != FailsafeMode::none;
      flown.held += holds && flown.hand_overs > 0 && !evicting ? 1 : 0;
    }
    if (!flies(holder)) continue;
    evicting = false;
    if (next_ns == 0) next_ns = world.now() + (100 + static_cast<TimeNs>(random.next() % 200)) * ns_per_ms;
    flown.lowest_m = std::min(flown.lowest_m, world.drones()[0].truth.position_m[2]);
    if (world.now() < next_ns) continue;
    next_ns = 0;
    const Stopper next = holder == Stopper::operating ? Stopper::supervisor : Stopper::operating;
    const bool evicts =
        flown.hand_overs >= hand_overs ||
        (flown.evictions < evictions &&
         random.next() % static_cast<std::uint64_t>(hand_overs + evictions) < static_cast<std::uint64_t>(evictions));
    if (evicts) {
      evicting = true;
      ++flown.evictions;
      world.post_control(Stopper::supervisor, 0, ControlCommand::evict);
      while (flies(holder) && world.now() < 1'000 * ns_per_s) world.step(), other.step();
      world.post_control(next, 0, ControlCommand::acquire);
    } else {
      ++flown.hand_overs;
      world.post_control(next, 0, ControlCommand::request);
    }
    holder = next;
  }
  const ChainOfOne chain(world.ledger().blocks());
  for (std::size_t i = 0; i < chain.changes.size(); ++i) {
    if (chain.changes[i].function != contract::hand_over) continue;
    EXPECT_TRUE(chain.changes[i].first_command) << "nobody flew epoch " << chain.changes[i].epoch;
    if (chain.changes[i].first_command) flown.gaps.push_back(*chain.changes[i].first_command - chain.changes[i].block);
  }
  flown.losers_commands = chain.losers_commands;
  flown.late = chain.late;
  flown.commands = chain.commands;
  return flown;
}

TEST(HandOverCampaign, OfAThousandAndTwoHundredEvictionsNoneLeavesTwoHoldersOrADroneWithoutOne) {
  Flown all;
  std::map<std::uint64_t, int> gaps;
  for (int seed = 1; seed <= (slow ? 1 : 5); ++seed) {
    const Flown flown = fly(static_cast<std::uint64_t>(seed), 200, 40);
    ASSERT_EQ(flown.hand_overs, 200);
    ASSERT_EQ(flown.evictions, 40);
    EXPECT_EQ(flown.losers_commands, 0u);
    EXPECT_EQ(flown.unasked, 0u);
    EXPECT_EQ(flown.held, 0u) << "the plan that is in flight outlasts the hand-over";
    EXPECT_GT(flown.lowest_m, 0.4);
    EXPECT_EQ(flown.gaps.size(), 200u);
    for (const std::uint64_t gap : flown.gaps) {
      ++gaps[gap];
      EXPECT_LE(gap, 3u) << "between them two blocks at most: a state to answer, and what was in flight";
    }
    all.commands += flown.commands;
    all.late += flown.late;
  }
  std::string text;
  for (const auto& [gap, count] : gaps) text += std::to_string(gap) + " blocks: " + std::to_string(count) + ", ";
  std::cout << text << all.commands << " commands valid, " << all.late << " in flight at a change and invalid\n";
}

}  // namespace
}  // namespace ledgerline::hil
