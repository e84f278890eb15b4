#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "chaincode/node/core/core.hpp"
#include "chaincode/node/storage/block_store.hpp"
#include "common/base/random.hpp"
#include "common/common.pb.h"
#include "common/crypto/crypto.hpp"
#include "common/fabric/sending/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "hil/sitl/ledger/relay.hpp"
#include "hil/sitl/ledger/way_delay.hpp"

namespace ledgerline::hil {

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
  Client add_client(const crypto::IdentityName& name, WayDelay::Way way = WayDelay::Way::there, double share = 0.5);
  const fabric::ChannelAndContract& where() const { return where_; }
  crypto::MspRegistry& registry() { return *registry_; }
  std::shared_ptr<crypto::MspRegistry> shared_registry() { return registry_; }

  /// The peer that all of them ask.
  Relay& relay() { return relay_; }
  /// Called with every call that a member proposes, as it is signed.
  void on_asked(std::function<void(const fabric::Call&)> asked) { asked_ = std::move(asked); }
  /// Called with every call whose transaction is valid.
  void on_committed(std::function<void(const fabric::Call&)> committed) { committed_ = std::move(committed); }

  /// Starts a transaction; its outcome comes out of take_outcomes() with the same `id`.
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
  std::vector<BlockPtr> take_blocks(TimeNs now, Client client);
  BlockPtr block(std::uint64_t number) const;  ///< of those that are stored
  struct Ended {
    std::uint64_t id = 0;
    fabric::Outcome outcome;
  };
  std::vector<Ended> take_outcomes(TimeNs now, Client client);

  std::uint64_t height() const { return store_->height(); }
  std::uint64_t transactions() const { return core_->counts().transactions; }
  std::optional<node::TxStatus> find(const std::string& tx_id) const { return core_->find(tx_id); }
  /// All blocks as they lie in the store.
  std::vector<std::string> blocks() const;

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
    WayDelay added;
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
  Relay relay_{{crypto::make_test_identity({"Org1MSP", "CN=peer0"}),
                {"Org1MSP", "CN=User1@org1.ledgerline"},
                {"Org2MSP", "CN=User1@org2.ledgerline"}}};
  std::function<void(const fabric::Call&)> asked_, committed_;
};

}  // namespace ledgerline::hil
