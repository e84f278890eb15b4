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

#include "chaincode/endorser/core/core.hpp"
#include "chaincode/endorser/core/feed.hpp"
#include "chaincode/endorser/core/first_state.hpp"
#include "chaincode/endorser/core/keeping.hpp"
#include "chaincode/endorser/core/readiness.hpp"
#include "chaincode/endorser/shell/settings.hpp"
#include "chaincode/endorser/shell/two_lanes.hpp"
#include "common/crypto/identities/identity_in_use.hpp"
#include "common/fabric/asking/peer_questions.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/stream/block_subscription.hpp"

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
  struct Options {
    int check_one_in = 100;
    std::string checkpoint{};  ///< a file: what it knew, written now and then and at the end; empty: none
    FirstStateSettings first_state{};
  };
  /// `on_failure`: called once, from a thread of its own, when it must not go on; says why.
  static Result<std::unique_ptr<Service>> start(fabric::ClientConfig ledger, const Options& options,
                                                std::function<void(const std::string& why)> on_failure);
  ~Service();

  enum class Caller { own, other };  ///< of this process, or whom it serves: who waits behind blocks and own proposals
  node::Reply process_proposal(const std::string& signed_proposal, Caller caller);
  /// Blocks of a stream that this process reads anyway: once it has met the own stream, the own one is ended.
  void take_shared(const fabric::Block& block, std::string_view raw) { on_block(Feed::Source::shared, block, raw); }
  /// The peer has delivered the same block that the shared stream took from an orderer (Block::confirmed).
  void confirm_shared(std::uint64_t number, const std::string& hash);
  void shared_connected(bool connected, const std::string& why) { on_connection(Feed::Source::shared, connected, why); }
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
  Service(fabric::ClientConfig ledger, int check_one_in, std::function<void(const std::string&)> on_failure);
  /// process_proposal() under the lock. `renewed`: what take_renewed() said.
  node::Reply process_locked(const std::string& signed_proposal, Caller caller, Status& renewed);
  /// Takes the identity that is in use now (ClientConfig::identity) where it is a renewed one; an error: it is refused.
  /// With the lock held.
  Status take_renewed();
  void on_block(Feed::Source from, const fabric::Block& block, std::string_view raw);
  void on_connection(Feed::Source from, bool connected, const std::string& why);
  /// With the lock held; true: then tell_connection() without it, since a log may be slow.
  bool set_connected(bool connected);
  static void tell_connection(bool connected, const std::string& why);
  bool agreed() const { return readiness_.agreed(core_.defined_at()); }
  bool choose_for_check(const std::string& signed_proposal, const std::string& answer);
  /// Of the newest that was chosen: until the peer has answered it, or a while. With the lock held, as `lock`.
  void await_check(std::unique_lock<std::mutex>& lock);
  void run_checks();
  Status restore(const std::string& path, const fabric::ChannelAndContract& where);
  /// A peer's snapshot, until the peer's chain says that it is of it.
  struct FirstState {
    PeerSnapshot said;
    fabric::BlockValidator validator;
    std::string problem{};  ///< why the peer was not reached, as the log has it
  };
  Status read_first_state(const FirstStateSettings& settings, const fabric::ClientConfig& ledger);
  /// Asks the peer's chain, without the lock meanwhile; with it before and after, as `lock`. False: once more.
  bool begin_with_first_state(std::unique_lock<std::mutex>& lock);
  Status take_first_state(const std::string& config_block);
  /// With the lock held.
  void begin_stream();
  void keep();
  void write(std::optional<fabric::Checkpoint> due);
  void check(SampledChecks::Check one);
  bool peer_is_behind();
  /// With the lock held; then tell_failure() without it.
  void stop_signing();
  void tell_failure(const std::string& why);

  static constexpr std::chrono::minutes keep_every{10};  // copying all takes some ten milliseconds

  const std::shared_ptr<const crypto::IdentityInUse> identity_;
  const std::function<void(const std::string&)> on_failure_;
  std::unique_ptr<fabric::PeerQuestions> peer_;
  fabric::KeptCheckpoint kept_;            ///< until begin_stream(), without its records
  std::optional<FirstState> first_state_;  ///< what is in it is the checker's; until it is gone no block is taken

  mutable TwoLanes lanes_;  // its lock guards what follows; by the second lane come the proposals of others alone
  std::condition_variable checks_wake_, checked_wakes_, ready_wakes_;
  std::shared_ptr<const crypto::SigningIdentity> seen_identity_;  ///< the newest of identity_; signs, or was refused
  Core core_;
  Feed feed_;
  Keeping keeping_;
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

}  // namespace ledgerline::endorser
