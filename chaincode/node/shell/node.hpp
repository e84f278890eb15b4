#pragma once
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "chaincode/node/core/node_core.hpp"
#include "chaincode/node/shell/block_feed.hpp"
#include "chaincode/node/shell/task_turns.hpp"
#include "chaincode/node/storage/block_store.hpp"
#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/histogram.hpp"

namespace ledgerline::node {

/// What the node needs of the identities under DIR/crypto.
struct Identities {
  std::vector<crypto::MspRoot> organisations;  ///< Org1MSP..Org3MSP with their certificate authorities
  std::vector<crypto::SigningIdentity> peers;  ///< one for each
  crypto::SigningIdentity orderer;
  crypto::MspRoot orderers;  ///< its organisation
  struct Tls {
    std::string key_pem, certificate_pem;
  };
  std::vector<Tls> tls;  ///< of each peer
};

/// Loads them; makes them first when DIR/crypto is missing (chaincode/identities).
Result<Identities> open_identities(const std::string& dir);

/// A user's msp folder: user_msp_dir(DIR, 2, "User1").
std::string user_msp_dir(const std::string& dir, int organisation, const std::string& user);

inline Now read_now() { return {monotonic_ns(), realtime_ns()}; }

/// The core, worked by whoever brings a task: one thread at a time has the core, and does what others have brought
/// meanwhile, from two bounded queues. Who has cut a block puts it on disk, while others may have the core, and then
/// sends it to its readers. So nothing waits for a thread to wake up. The clock, a thread of the node's own, cuts
/// blocks that are due by time, goes on with tasks whose thread is busy with a block, and waits where the disk is full.
class Node {
 public:
  struct Options {
    std::string dir;
    CoreConfig core;
    std::vector<std::string> drones{};      ///< that a new ledger enrolls; none: tello1 to tello16
    std::uint64_t kept_bytes = 64'000'000;  ///< of the disk, for what is urgent; of a small one a thirty-second
  };
  /// Opens or makes everything under dir, replays the ledger, enrolls who comes with a new one, starts the threads.
  static Result<std::unique_ptr<Node>> open(Options options);
  ~Node();
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  using Task = std::function<void(NodeCore&)>;
  /// Any thread, which does the task before it returns unless another one has the core. In each turn requesters take
  /// turns. False: the queue is full, the task was not taken.
  bool post(Task task, Turn turn = Turn::first, const Requester& requester = {});
  /// The same without a limit: for what ends something (a cancelled call), which must never be lost. There is one for
  /// each open call at most. It comes behind what the requester has posted before.
  void post_always(Task task, const Requester& requester = {});
  /// When an unchecked proposal is processed, and who requests it: a query, and one that cannot be read, comes later.
  struct TaskPriority {
    Turn turn = Turn::later;
    Requester requester;
  };
  TaskPriority priority_of(std::string_view signed_proposal) const;
  /// `serialized`: msp.SerializedIdentity.
  Requester requester_of(const std::string& serialized) const;
  /// Of whom an envelope says that it is.
  Requester sender_of(const common::Envelope& envelope) const;

  BlockFeed& feed() { return *feed_; }
  const Identities& identities() const { return identities_; }
  const CoreConfig& config() const { return options_.core; }
  /// Called once, by who has the core, for each answer to a waiter that a task left with NodeCore::watch. Set before
  /// serving.
  void on_answer(std::function<void(std::uint64_t waiter, const TxStatus&)> handler);
  /// Called when the ledger cannot go on (the disk failed). Set before serving.
  void on_failure(std::function<void(const std::string&)> handler);

  /// Ends after the queued tasks and the block in progress. Nobody posts any more.
  void stop();
  NodeCore::Counts counts() const { return core_->counts(); }  ///< after stop()
  /// How long blocks took to be on disk; after stop().
  Quantiles disk_ms() const { return disk_.quantiles_ms(); }

 private:
  explicit Node(Options options) : options_(std::move(options)) {}
  Status open_ledger();
  /// For clients: the trust anchor.
  std::string config_block_file() const { return options_.dir + "/" + options_.core.channel + ".block"; }
  Status write_config_block();
  Status enroll_first();
  Status submit_now(const crypto::SigningIdentity& who, const std::string& function, const std::string& arg);
  Status commit_now(const CutBlock& block);
  using Lock = std::unique_lock<std::mutex>;
  // With the lock held, which they give up meanwhile:
  bool has_work() const { return !tasks_.empty() || written_ || (due_ && *due_ <= monotonic_ns()); }
  void work(Lock& lock);
  void store(Lock& lock, CutBlock block);
  void run_clock();
  // By who has the core:
  void check_disk();
  void apply(const CutBlock& block);

  Options options_;
  Identities identities_;
  std::unique_ptr<Files> files_;
  std::unique_ptr<BlockStore> store_;
  std::unique_ptr<BlockFeed> feed_;
  std::unique_ptr<NodeCore> core_;
  std::function<void(std::uint64_t, const TxStatus&)> on_answer_;
  TimeNs check_disk_ns_ = 0;  // of who has the core

  std::mutex mutex_;  // guards what follows
  std::condition_variable clock_wakes_;
  TaskQueue<Task> tasks_;
  bool busy_ = false;                // somebody has the core
  bool writing_ = false;             // a block is to be on disk
  std::optional<CutBlock> no_room_;  // that one, while the disk is full
  std::optional<CutBlock> written_;  // it is, and is to be applied
  std::optional<TimeNs> due_;        // when the next block is cut, as of when somebody had the core last
  bool failed_ = false, stopping_ = false;
  Histogram disk_;
  std::function<void(const std::string&)> on_failure_;

  std::thread clock_;
};

}  // namespace ledgerline::node
