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

/// The core, worked by who brings a task, so that nothing waits for a thread to wake up: one thread at a time has
/// the core, and does what others have brought meanwhile, from two bounded queues. It puts the block that it has cut on
/// disk, while others may have the core, and then sends it to its readers. The clock, a thread of the node's own, cuts
/// blocks that are due by time, does what others leave, and tries a full disk again.
class Node {
 public:
  struct Options {
    std::string dir;
    CoreConfig core;
    std::vector<std::string> drones{};      ///< that a new ledger enrolls; none: tello1 to tello16
    std::uint64_t kept_bytes = 64'000'000;  ///< of the disk, for what is urgent; of a small one a thirty-second
  };
  /// Opens or makes everything under dir, replays the ledger, enrolls who comes with a new one, starts the clock.
  static Result<std::unique_ptr<Node>> open(Options options);
  ~Node();
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  using Task = std::function<void(NodeCore&)>;
  /// What the thread that brings a task does once it has the core.
  enum class Stay {
    briefly,     ///< one task, as where an answer leaves only when the thread returns; the clock does the rest
    long_enough  ///< what it finds, for some milliseconds at most, and the block that it cuts
  };
  /// Any thread, which does the task before it returns unless another one has the core. In each turn requesters take
  /// turns. False: the queue is full, the task was not taken.
  bool post(Task task, Turn turn = Turn::first, const Requester& requester = {}, Stay stay = Stay::long_enough);
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
  bool has_work() const { return !tasks_.empty() || written_ || (due_ && *due_ <= monotonic_ns()); }
  // With the lock held, which they give up meanwhile:
  void work(Lock& lock, TimeNs until_ns, bool stores);
  void work(Lock& lock, Stay stay);
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
  bool busy_ = false;                 // somebody has the core
  bool writing_ = false;              // a block is cut, and not on disk yet
  std::optional<CutBlock> to_store_;  // the same, where the clock is to store it
  TimeNs store_at_ns_ = 0;            // not before: the disk was full
  std::optional<CutBlock> written_;   // on disk, and not applied yet
  std::optional<TimeNs> due_;         // when the next block is cut; none while somebody has the core
  bool failed_ = false, stopping_ = false;
  Histogram disk_;
  std::function<void(const std::string&)> on_failure_;

  std::thread clock_;
};

}  // namespace ledgerline::node
