#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/common.pb.h"
#include "common/fabric/blocks/checkpoint.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/fabric/validation/block_validator.hpp"
#include "common/fabric/validation/key_state.hpp"
#include "common/fabric/validation/transaction_validator.hpp"

namespace ledgerline::fabric {

/// Headers that one of two streams of the same chain has delivered and the other has not yet. Neither waits for the
/// other: of each side the newest max_kept are kept. Pure; one thread.
class ReportedHeaders {
 public:
  static constexpr std::size_t max_kept = 1024;
  static constexpr std::size_t max_signatures_bytes = 16 << 10;  ///< more are as good as none

  struct Ordered {
    std::string hash;       ///< block_header_hash
    common::Block message;  ///< without its data: what is signed, and the signatures
  };
  void ordered(const common::Block& message, std::string hash);
  /// Another orderer delivers from now on.
  void forget_ordered();
  void of_peer(std::uint64_t number, std::string hash);
  /// What the other side delivered of that block, which is then forgotten.
  std::optional<Ordered> pop_ordered(std::uint64_t number);
  std::optional<std::string> pop_of_peer(std::uint64_t number);

 private:
  std::map<std::uint64_t, Ordered> ordered_;
  std::map<std::uint64_t, std::string> of_peer_;
};

/// An orderer's blocks that wait for their turn: so many, and so many bytes; what is beyond is dropped, since the
/// peer's stream brings it. One thread.
class WaitingBlocks {
 public:
  static constexpr std::size_t max_blocks = 64, max_bytes = 16 << 20;

  void add(common::Block message);
  std::optional<common::Block> pop(std::uint64_t number);
  void erase_up_to(std::uint64_t number);

 private:
  std::map<std::uint64_t, common::Block> blocks_;
  std::size_t bytes_ = 0;
};

/// Verifies the blocks that a peer serves, without its I/O: the core of every stream of blocks. Each must be
/// the next of the chain and signed by the channel's orderers; each of its transactions is validated by the rule of
/// validate_transactions, as far as the blocks that came through here allow. Beyond that its flag is accepted.
///
/// Where an orderer's stream is read, too, its blocks have no flags. With BlockSource::ordered the next block is taken
/// from the stream that brings it first:
///
///      orderer's N ──▶ only states and commands, all valid? ──yes──▶ taken ──▶ peer's N: the same? ──yes──▶ confirmed
///                                  │ no                                              │ no
///                                  ▼                                                 ▼
///                          waits for the peer's N                     contradiction: nothing more is taken
///
/// Pure but for the registries' caches; one thread. The same blocks give the same results.
class BlockIntake {
 public:
  struct Setup {
    ChannelAndContract where;
    /// As ClientConfig::config_block. Empty: neither blocks nor transactions are validated: what the peer says counts.
    std::string config_block;
    BlockValidator::MakeRegistry make_registry;
    ContractRules contract_rules{};
    /// This machine's; empty: it has none.
    std::function<TimeNs()> real_time{};
    BlockSource source = BlockSource::peer;  ///< `ordered` needs config_block
  };
  /// An error: the config block is none.
  static Result<BlockIntake> make(Setup setup);

  /// A connection begins: configurations between the one that is known and its first block are fetched.
  void begin() { caught_up_ = false; }
  /// The first block; without it the first that comes.
  void start_at(std::uint64_t number) { next_ = number; }
  /// Goes on behind a checkpoint: an error where the peer's chain, whose newest block that is, cannot continue it.
  using Fetch = BlockValidator::Fetch;
  Result<Continuation> continue_chain(const LastVerified& verified, const common::Block& newest, const Fetch& fetch);

  /// The next block, with the verified transactions: one that is flagged valid and is not is left out
  /// (code_unverified), one that is flagged invalid and is valid says so in its `problem`. An error: it is not the
  /// next block, which may still come. Where confirms_next(), the peer's next block is for confirm().
  Result<Block> add(const common::Block& message, const Fetch& fetch);

  /// Sets the contract's endorsement policy (protos.ApplicationPolicy), as reported, if its definition precedes our
  /// first block.
  void define(const std::string& policy);
  /// Whether that is worth asking.
  bool misses_definition() const { return state_ && !defined_; }

  /// Number of the block that comes next; none: the first one that comes.
  std::optional<std::uint64_t> next() const { return next_; }

  // Where an orderer's stream is read beside the peer's.

  /// So many blocks that were taken may be ahead of the peer; then the orderers' wait for it.
  static constexpr std::size_t max_unconfirmed = 64;
  /// What the peer's stream begins with: what is not confirmed yet comes again.
  std::optional<std::uint64_t> next_of_peer() const {
    return unconfirmed_.empty() ? next_ : std::optional(unconfirmed_.begin()->first);
  }
  bool confirms_next() const { return !unconfirmed_.empty(); }
  /// The peer's word on a block that was taken as it was ordered. An error: it is not that block, which may still come,
  /// or contradiction() says that it never will. Else how many of its transactions had used an id that was used before
  /// this stream: they were taken, and are invalid.
  Result<std::size_t> confirm(const common::Block& message);

  /// A connection to an orderer begins: the number of the block that it begins with. None: the peer's has to come
  /// first.
  std::optional<std::uint64_t> begin_ordered();
  /// What the peer's block has shown of the orderer's stream since the last call.
  std::optional<std::string> pop_orderer_problem() { return std::exchange(orderer_problem_, std::nullopt); }
  /// A block from an orderer. An error: this orderer's block is invalid, or contradiction() says that no source is to
  /// be trusted.
  Status add_ordered(common::Block message);
  /// The next block as an orderer has delivered it; to be called after each add_ordered() and add(), until there is
  /// none: then the peer's stream brings the next one. An error as of add_ordered().
  struct Ordered {
    Block block;
    common::Block message;  ///< with our own verdicts as its flags
  };
  Result<std::optional<Ordered>> pop_ordered();
  /// What that orderer's stream brings next; none: there is no such stream.
  std::optional<std::uint64_t> next_ordered() const { return next_ordered_; }
  /// Once peer and orderers have delivered two chains, or the peer other verdicts: in words. Nothing is taken from then
  /// on.
  const std::optional<std::string>& contradiction() const { return contradiction_; }

  struct Counts {
    std::uint64_t validated = 0;      ///< transactions whose flag rests on our own validation as well
    std::uint64_t by_flag = 0;        ///< on the peer's word
    std::uint64_t differ = 0;         ///< of those that are validated
    std::uint64_t ordered_first = 0;  ///< blocks taken before the peer delivered them
    std::uint64_t confirmed = 0;      ///< of these
    std::uint64_t uncertain = 0;      ///< blocks that an orderer delivered first, and that had to wait for the peer
  };
  const Counts& counts() const { return counts_; }

 private:
  explicit BlockIntake(Setup setup) : setup_(std::move(setup)) {}
  Status validate_block(const common::Block& message, const Fetch& fetch);
  void validate_transactions(const common::Block& message, Block& block);
  Status validate_ordered(const common::Block& message, ChainCheck& chain);
  std::optional<TimeNs> came_ns(const Block& block) const;
  void apply_verdicts(const std::vector<TransactionVerdict>& verdicts, Block& block);
  bool can_take_ordered() const;
  /// An error once there is a contradiction.
  Status consistent() const;
  Error contradict(std::string what);
  /// Whether the channel's orderers have signed that header; true where it cannot be verified.
  bool is_signed(const common::Block& message);
  Status compare_with_ordered(std::uint64_t number, const std::string& hash);
  Status compare_with_taken(const common::Block& message, const std::string& hash);
  void configure();
  void forget();

  Setup setup_;
  std::optional<BlockValidator> validator_;
  bool caught_up_ = false;
  std::optional<std::uint64_t> next_;
  ChainCheck chain_;

  // Of the transactions; none where they are not validated.
  std::optional<KeyState> state_;
  std::unique_ptr<crypto::MspRegistry> members_;
  ValidationRules rules_;
  std::uint64_t configured_ = 0;  ///< the config block by which that is so
  bool defined_ = false;
  Counts counts_;

  // Of the orderers' stream.
  std::optional<std::uint64_t> next_ordered_;
  ReportedHeaders reported_;
  WaitingBlocks waiting_;
  bool next_is_uncertain_ = false;  ///< the peer has to deliver it
  struct Unconfirmed {
    std::string hash;
    std::vector<ReadWriteSet> sets;  ///< of its transactions, all valid
  };
  std::map<std::uint64_t, Unconfirmed> unconfirmed_;
  std::optional<std::string> orderer_problem_;  ///< what an orderer delivered turned out to be forged
  std::optional<std::string> contradiction_;
};

}  // namespace ledgerline::fabric
