#pragma once
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "chaincode/endorser/core/peer_follower.hpp"
#include "chaincode/endorser/core/peer_snapshot.hpp"
#include "chaincode/endorser/shell/priority_mutex.hpp"
#include "chaincode/endorser/shell/settings.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/blocks/block_subscription.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::endorser {

/// The answers that the peer is asked for as well, oldest first. One thread at a time.
class SampledChecks {
 public:
  struct Check {
    std::string signed_proposal, answer;
    Readiness::DefinedAt defined_at{};
  };
  /// The peer is slow when so many wait: further ones are left out.
  static constexpr std::size_t max_waiting = 16;

  /// `one_in`: of so many answers one, at random.
  explicit SampledChecks(int one_in);

  bool draw() { return random_() % static_cast<std::uint64_t>(one_in_) == 0; }
  /// False: too many wait.
  bool add(Check one);
  /// The oldest, which is over when ended() is called; none waits: nothing.
  std::optional<Check> next();
  void ended() { ++over_; }
  std::uint64_t added() const { return added_; }
  std::uint64_t over() const { return over_; }

 private:
  const int one_in_;
  std::mt19937_64 random_;
  std::deque<Check> waiting_;
  std::uint64_t added_ = 0, over_ = 0;  ///< so far; they end in their order
};

/// The core with its peer: it follows the peer's blocks, answers proposals while it knows that it has them all, and
/// asks the peer now and then whether it answers the same: always before it signs anything under a definition of the
/// contract that is new to it, since the peer alone knows whether its organisation has approved that. While it is not
/// sure it answers `unavailable`, so that clients ask the peer: before it has all blocks that the peer had when the
/// stream began, and while the stream is gone. A block that cannot be trusted, an answer that differs from the peer's,
/// or a state that stays another one ends it for good. Any thread.
class Service {
 public:
  /// Of `settings` not what is served to others. `on_failure`: called once, from a thread of its own, when it must not
  /// go on.
  static Result<std::unique_ptr<Service>> start(fabric::ClientConfig ledger, const Settings& settings,
                                                std::function<void()> on_failure);
  ~Service();

  enum class Caller { own, other };  ///< of this process, or whom it serves: who waits behind blocks and own proposals
  node::Reply process_proposal(const std::string& signed_proposal, Caller caller);
  /// Blocks of a stream that this process reads anyway: once it has met the own stream, the own one is ended.
  void on_shared_block(const fabric::Block& block, std::string_view raw) {
    on_block(BlockSources::Source::shared, block, raw);
  }
  /// The peer has delivered the same block that the shared stream took from an orderer (Block::confirmed).
  void on_shared_confirmed(std::uint64_t number, const std::string& hash);
  void on_shared_connection(bool connected, const std::string& why) {
    on_connection(BlockSources::Source::shared, connected, why);
  }
  /// It must not go on.
  void fail(const std::string& why);
  /// Waits until it answers, or has failed, or `seconds` are over.
  bool wait_until_ready(double seconds);

  struct Counts {
    std::uint64_t blocks = 0, answered = 0, sent_to_the_peer = 0;
    std::uint64_t checked = 0, same = 0, other_state = 0, peer_refused = 0, apart = 0, not_checked = 0;
    std::uint64_t differ = 0;
    std::uint64_t restored = 0;  ///< blocks that it did not have to read
    bool joined = false;         ///< it lives on a shared stream
  };
  Counts counts() const;

 private:
  Service(fabric::ClientConfig ledger, int check_one_in, std::function<void()> on_failure);
  /// process_proposal() under the lock. `renewed`: what apply_renewed_identity() said.
  node::Reply process_locked(const std::string& signed_proposal, Caller caller, Status& renewed);
  /// Signs with the identity that is in use now (ClientConfig::identity) where it is a renewed one; an error: it is
  /// refused. With the lock held.
  Status apply_renewed_identity();
  void on_block(BlockSources::Source from, const fabric::Block& block, std::string_view raw);
  void on_connection(BlockSources::Source from, bool connected, const std::string& why);
  /// With the lock held; true: then log_connection() without it, since a log may be slow.
  bool set_connected(bool connected);
  static void log_connection(bool connected, const std::string& why);
  bool has_agreed() const { return readiness_.has_agreed(core_.defined_at()); }
  bool choose_for_check(const std::string& signed_proposal, const std::string& answer);
  /// Of the newest that was chosen: until the peer has answered it, or a while. With the lock held, as `lock`.
  void await_check(std::unique_lock<std::mutex>& lock);
  void run_checks();
  Status restore(const std::string& path, const fabric::ChannelAndContract& where);
  /// A peer's snapshot, until the peer's chain says that it is of it.
  struct FirstState {
    PeerSnapshot reported;
    fabric::BlockValidator validator;
    std::string problem{};  ///< why the peer was not reached, as the log has it
  };
  Status read_first_state(const FirstStateSettings& settings, const fabric::ClientConfig& ledger);
  /// Asks the peer's chain, without the lock meanwhile; with it before and after, as `lock`. False: once more.
  bool begin_with_first_state(std::unique_lock<std::mutex>& lock);
  Status apply_first_state(const std::string& config_block);
  /// With the lock held.
  void begin_stream();
  void store_checkpoint();
  void write(std::optional<fabric::Checkpoint> due);
  void compare_with_peer(SampledChecks::Check one);
  bool peer_is_behind();
  /// With the lock held; then report_failure() without it.
  void stop_signing();
  void report_failure(const std::string& why);

  const std::shared_ptr<const crypto::IdentityInUse> identity_;
  const std::function<void()> on_failure_;
  std::unique_ptr<fabric::PeerQueries> peer_;
  fabric::StoredCheckpoint checkpoint_;    ///< until begin_stream(), without its records
  std::optional<FirstState> first_state_;  ///< what is in it is the checker's; until it is gone no block is taken

  mutable PriorityMutex mutex_;  // guards what follows; lock_later() is for the proposals of others alone
  std::condition_variable checker_wakes_, waiters_wake_;  // the second: of those who wait for an answer or readiness
  std::shared_ptr<const crypto::SigningIdentity> last_identity_;  ///< the newest of identity_; signs, or was refused
  EndorserCore core_;
  BlockSources sources_;
  PendingCheckpoint pending_checkpoint_;
  Readiness readiness_;
  bool stopping_ = false;
  SampledChecks checks_;
  Counts counts_;

  std::unique_ptr<fabric::Client> client_;
  std::thread checker_;
  std::unique_ptr<fabric::BlockSubscription> blocks_;  // last: its callbacks use all of the above
};

/// JSON, one key a count.
Status write_summary(const std::string& path, const Service::Counts& counts);

/// The peer's service Endorser on a TLS endpoint of its own, for any client of Fabric. Destruction gives open calls 0.2
/// s.
class Server {
 public:
  virtual ~Server() = default;
  virtual const std::string& endpoint() const = 0;
};
/// `service` must outlive it. `tls`: where a renewed pair of its certificate's file appears; it then listens again with
/// that pair, and gives open calls 0.2 s. An error names the key of `table` ("serve.", "own_endorser.") that is wrong.
Result<std::unique_ptr<Server>> serve(Service& service, const ServeSettings& settings, const std::string& table,
                                      std::shared_ptr<const fabric::TlsPairsInUse> tls);

/// Where `settings` name an identity: an endorser of the organisation of `ledger` in this process, which all clients
/// that are made with `ledger` afterwards ask first, and which the first of their block streams feeds. It goes with the
/// last of them, and writes its summary then. A bad identity is an error here; later it only logs, and clients ask
/// others.
Status start_own_endorser(const Settings& settings, fabric::ClientConfig& ledger);

/// An error where a program on several channels is to have one: it follows one channel.
Status check_channels(const Settings& settings, const fabric::Channels& channels);

}  // namespace ledgerline::endorser
