#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/node/core/node_core.hpp"
#include "chaincode/node/storage/block_store.hpp"
#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "common/crypto/crypto.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/clock.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/sitl/ledger/relay.hpp"

namespace ledgerline::hil {

class CommonIntake;

/// Two-way delays that are injected so that what is measured has a published box (tools/report/results.hpp), with a
/// few of 100 beyond its upper whisker: quantiles, seconds, straight in between. They are not the box itself, since
/// blocks keep their order: what is slow holds up what follows, and the newest of those that come together is answered.
/// Found by flying; a test compares boxes.
struct PublishedDelay {
  static constexpr std::array shares{0.0, 0.25, 0.5, 0.75, 0.96, 1.0};
  std::string_view name;  ///< of the option
  std::array<double, shares.size()> quantiles_s;
  /// 0 <= share < 1.
  double quantile(double share) const;
};
inline constexpr std::array published_delays{
    PublishedDelay{"published", {0.277, 0.360, 0.435, 0.500, 0.756, 1.911}},
    PublishedDelay{"published-triangle", {0.262, 0.346, 0.442, 0.483, 0.743, 1.895}},
    PublishedDelay{"published-x", {0.252, 0.384, 0.488, 0.592, 1.003, 2.151}},
    PublishedDelay{"published-three", {0.354, 0.714, 0.778, 0.836, 1.110, 2.242}},
};

/// What is added to a ledger's own delay between a state and its command, both ways together.
struct AddedDelay {
  const PublishedDelay* published = nullptr;
  std::optional<Distribution> own{};  ///< where it is no published one
  double agent_share = 0.5;           ///< of it that lies between agent and ledger; the rest: between ground and ledger
  bool none() const { return !published && !own; }
};
/// "none", seconds from 0 to 3, a name of published_delays, or a file of such seconds, one a line.
Result<AddedDelay> added_delay_from(const std::string& text, const ReadRecording& read = read_recording);

/// One of the two ways of an AddedDelay: its share, and the other one has the rest. Drawn again every 100 ms, so what
/// is sent meanwhile stays together; a recording is played in its order, from a place that the seed chooses. The way
/// back has what the newest that came there had: with the same seed, both ways of a state and its command together are
/// one draw of the whole delay. Deterministic for a seed; one thread.
class OneWayDelay {
 public:
  enum class Direction { there, back };
  OneWayDelay(const AddedDelay& delay, Direction direction, double share, std::uint64_t seed)
      : delay_(delay), direction_(direction), share_(share), random_(seed), draws_of_own_(seed) {}
  /// Times must not go back.
  TimeNs at(TimeNs now);

 private:
  TimeNs draw();

  static constexpr std::uint64_t kept = 32;  ///< draws: more than the maximum delay spans
  AddedDelay delay_;
  Direction direction_;
  double share_;
  Random random_;
  Draws draws_of_own_;
  std::array<TimeNs, kept> draws_{};
  std::uint64_t drawn_ = 0;
};

/// How long each step of a transaction takes on the simulated clock. Defaults: what the embedded node takes on one
/// machine.
struct LedgerDelays {
  TimeNs endorse_ns = 1 * ns_per_ms;   ///< submit() until endorsed
  TimeNs submit_ns = 1 * ns_per_ms;    ///< endorsed until ordered
  TimeNs write_ns = 1 * ns_per_ms;     ///< block cut until on disk
  TimeNs deliver_ns = 1 * ns_per_ms;   ///< on disk until a client has the block or its commit status
  TimeNs jitter_ns = 500 * ns_per_us;  ///< each of them longer by up to this, uniform
  AddedDelay added{};                  ///< to deliver_ns
};

/// The embedded node's core with its clients on a simulated clock: real proposals, endorsements, blocks and flags, with
/// test signers; only the wire is left out. Deterministic for a seed; one thread.
class SimulatedLedger {
 public:
  using Client = std::size_t;
  using BlockPtr = std::shared_ptr<const common::Block>;

  SimulatedLedger(const node::CoreConfig& config, const LedgerDelays& delays, std::uint64_t seed);

  /// `way`: of the added delay, that from the ledger to this client: `back` for the one that commands go to; `share`:
  /// how much of it. The shares of both add up to 1.
  Client add_client(const crypto::IdentityName& name, OneWayDelay::Direction way = OneWayDelay::Direction::there,
                    double share = 0.5);
  const fabric::ChannelAndContract& where() const { return where_; }
  crypto::MspRegistry& registry() { return *registry_; }
  std::shared_ptr<crypto::MspRegistry> shared_registry() { return registry_; }

  /// The peer that all of them ask.
  Relay& relay() { return relay_; }
  /// Called with every call that a member proposes, as it is signed.
  void on_call_proposed(std::function<void(const fabric::Call&)> asked) { asked_ = std::move(asked); }
  /// Called with every call whose transaction is valid.
  void on_committed(std::function<void(const fabric::Call&)> committed) { committed_ = std::move(committed); }

  /// Starts a transaction; its outcome comes out of pop_outcomes() with the same `id`.
  void submit(TimeNs now, Client client, std::uint64_t id, const fabric::Call& call);
  /// Has a common.Envelope ordered that somebody made by other ways; nobody hears what became of it.
  void order(TimeNs now, const std::string& envelope);
  /// Real time on the simulated clock.
  static TimeNs real(TimeNs now);
  /// For the set-up before the flight: commits at once, at `now`.
  Status commit_now(TimeNs now, Client client, const fabric::Call& call);
  Result<std::string> evaluate(TimeNs now, Client client, const fabric::Call& call);

  /// Runs everything that is due.
  void step(TimeNs now);

  /// The node ends, its machine loses power, and it starts again from its store (in memory). What was not in a block is
  /// gone: it ends as unavailable.
  void restart(TimeNs now);

  /// What has reached this client since the last call. Blocks come in order, from the one after add_client() on.
  std::vector<BlockPtr> pop_blocks(TimeNs now, Client client);
  BlockPtr block(std::uint64_t number) const;  ///< of those that are stored
  /// Of its readers, by the block at which they began.
  using CommonIntakes = std::map<std::uint64_t, std::weak_ptr<CommonIntake>>;
  CommonIntakes& common_intakes() { return common_intakes_; }
  struct Ended {
    std::uint64_t id = 0;
    fabric::Outcome outcome;
  };
  std::vector<Ended> pop_outcomes(TimeNs now, Client client);

  std::uint64_t height() const { return store_->height(); }
  std::uint64_t transactions() const { return core_->counts().transactions; }
  std::optional<node::TxStatus> find(const std::string& tx_id) const { return core_->find(tx_id); }
  /// All blocks as they lie in the store.
  std::vector<std::string> blocks() const;
  /// Of these transactions those that are not on it, or not as valid: in words.
  std::vector<std::string> missing(const std::vector<std::string>& tx_ids) const;
  /// Transitions of the failsafe whose numbers do not follow each other on it, in words: of each drone and start of its
  /// link.
  std::vector<std::string> transition_gaps() const;

 private:
  struct Pending {
    Client client = 0;
    std::uint64_t id = 0;
    std::string tx_id;
    fabric::Call call{};
    std::string bytes;  ///< a signed proposal, then a signed envelope
    bool endorsed = false;
    TimeNs begun_ns = 0;
    TimeNs ordered_after_ns = 0;
  };
  struct Member {
    crypto::SigningIdentity identity;
    OneWayDelay added;
    std::deque<std::pair<TimeNs, BlockPtr>> blocks;
    std::deque<std::pair<TimeNs, Ended>> outcomes;
  };

  Result<fabric::Proposal> propose(TimeNs now, const Member& member, const fabric::Call& call);
  void open();
  TimeNs later(TimeNs now, TimeNs delay);
  TimeNs delivered(TimeNs now, Member& member);
  void advance(TimeNs now, Pending pending);
  Result<std::string> sign(const Pending& pending, const std::string& envelope);
  void end(TimeNs now, const Pending& pending, const node::Reply& refusal);
  void cut_if_due(TimeNs now);
  void apply(TimeNs now, const node::CutBlock& block);

  node::CoreConfig config_;
  LedgerDelays delays_;
  fabric::ChannelAndContract where_;
  Random random_;
  std::uint64_t added_seed_ = random_.next();
  std::shared_ptr<crypto::MspRegistry> registry_;
  node::MemoryFiles files_;
  std::unique_ptr<node::BlockStore> store_;
  std::unique_ptr<node::NodeCore> core_;
  std::vector<Member> members_;
  std::multimap<TimeNs, Pending> due_;        ///< equal times keep their order of insertion
  std::map<std::uint64_t, Pending> waiting_;  ///< by waiter, until their block is applied
  std::uint64_t next_waiter_ = 1;
  std::optional<std::pair<TimeNs, node::CutBlock>> writing_;
  CommonIntakes common_intakes_;
  Relay relay_{{crypto::make_test_identity({"Org1MSP", "CN=peer0"}),
                {"Org1MSP", "CN=User1@org1.ledgerline"},
                {"Org2MSP", "CN=User1@org2.ledgerline"}}};
  std::function<void(const fabric::Call&)> asked_, committed_;
};

}  // namespace ledgerline::hil
