#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/printable.hpp"
#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::node {

/// gRPC's status codes with their numbers; the core needs no gRPC.
enum class Code {
  ok = 0,
  unknown = 2,
  invalid_argument = 3,
  not_found = 5,
  permission_denied = 7,
  failed_precondition = 9,
  aborted = 10,
  unavailable = 14,
};

/// What a service answers: bytes of the message named at the function, or a code with a message and a detail (what
/// gateway.ErrorDetail.message says; empty: none).
struct Reply {
  Code code = Code::ok;
  std::string message;
  std::string detail;
  std::string bytes;
};

/// Names that strangers chose are shown up to here (printable).
inline constexpr std::size_t max_name = 200;

struct Now {
  TimeNs monotonic_ns = 0;
  TimeNs real_ns = 0;  ///< for the lifetimes of certificates alone
};

struct CoreConfig {
  std::string channel = "teleop";
  std::string contract = "ledgerline";
  std::size_t batch_count = 1;                 ///< a block is cut when this many envelopes wait,
  std::size_t batch_bytes = 2'000'000;         ///< or this many bytes,
  TimeNs batch_timeout_ns = 10 * ns_per_ms;    ///< or the oldest has waited this long
  std::size_t max_envelope_bytes = 10 << 20;   ///< larger ones are refused (Fabric's AbsoluteMaxBytes)
  std::size_t max_waiting = 10'000;            ///< envelopes that wait for a block; more are refused
  std::size_t max_waiting_bytes = 64'000'000;  ///< of them together; one alone is always taken
  std::vector<crypto::MspRoot> organisations;  ///< written into the config block
};

struct TxStatus {
  std::string tx_id;
  std::uint64_t block = 0;
  int code = 0;  ///< protos.TxValidationCode; 0 = VALID, 9 = DUPLICATE_TXID, 10 = ENDORSEMENT_POLICY_FAILURE, 11 = MVCC
};

/// A block that was cut and validated, on its way to the disk.
struct CutBlock {
  std::uint64_t number = 0;
  std::string bytes;  ///< common.Block with flags in metadata[2]
  std::vector<TxStatus> transactions;
  std::string warning;  ///< not empty: the block has no orderer's signature, and why
};

struct Applied {
  std::uint64_t block = 0;
  std::vector<TxStatus> transactions;
  /// Answers to waiters (see watch), in the order in which they came.
  struct Answer {
    std::uint64_t waiter;
    TxStatus status;
  };
  std::vector<Answer> answers;
};

/// One channel of a Fabric network in one object: endorser, orderer and committer. It decides everything and does no
/// I/O: proposals, envelopes and time in; answers and blocks out. The same inputs give the same bytes (with
/// deterministic signers). One thread at a time.
///
///     endorse(proposal) -> envelope; the client signs it
///     order(envelope)   -> waits
///     cut(now)          -> block  -> [caller writes and syncs it] -> apply(block) -> statuses, answers to waiters
///
/// From cut to apply at most one block is under way: endorsements see the state before it, envelopes go on waiting.
class NodeCore {
 public:
  /// Gives back a block that was applied or replayed (for history). The core keeps no block.
  using ReadBlock = std::function<Result<std::string>(std::uint64_t number)>;

  /// `peers`: one for each organisation, all of them endorse. `orderer`: signs blocks.
  NodeCore(CoreConfig config, std::shared_ptr<crypto::MspRegistry> registry, std::vector<crypto::SigningIdentity> peers,
           crypto::SigningIdentity orderer, ReadBlock read_block);
  ~NodeCore();
  NodeCore(const NodeCore&) = delete;
  NodeCore& operator=(const NodeCore&) = delete;

  /// The config block, as number 0: for an empty ledger. To be written, then given to apply() as any other.
  CutBlock genesis();
  /// Takes a block from disk: state, history, transaction ids. In order, before anything else.
  Status replay(std::string_view block);
  std::uint64_t height() const;

  /// gateway.Endorse. In: protos.SignedProposal. Out: common.Envelope without signature, endorsed by all peers.
  Reply endorse(std::string_view signed_proposal, Now now);
  /// gateway.Evaluate. In: protos.SignedProposal. Out: protos.Response.
  Reply evaluate(std::string_view signed_proposal, Now now);
  /// protos.Endorser.ProcessProposal. Out: protos.ProposalResponse of the first peer (refusals too, as Fabric does; a
  /// code only when the proposal cannot be answered). Here and in evaluate the peer's own contracts answer as well
  /// (core_system.cpp).
  Reply process_proposal(std::string_view signed_proposal, Now now);
  /// gateway.Submit and orderer.Broadcast. In: common.Envelope. Out: nothing; ok = accepted for ordering. `detail` of a
  /// refusal is in the words of Fabric's gateway; invalid_argument stands for the orderer's BAD_REQUEST,
  /// permission_denied for FORBIDDEN, unavailable for SERVICE_UNAVAILABLE, not_found for BAD_REQUEST as well, but the
  /// gateway tells it apart: an unknown channel.
  Reply order(std::string_view envelope, Now now);
  /// Checks a signed request of a member: `signature` of `message` by `serialized` (a msp.SerializedIdentity).
  Result<crypto::IdentityName> check_signer(std::string_view serialized, std::string_view message,
                                            std::string_view signature, Now now);

  /// When cut() has to be called: now or in the past when a block is full; nullopt when nothing waits or a block is
  /// under way.
  std::optional<TimeNs> next_cut() const;
  /// Makes the next block if one is due: full, or the oldest envelope's time is up.
  std::optional<CutBlock> cut(Now now);
  /// Commits the block that cut() or genesis() gave. Only after it is on disk.
  Applied apply(const CutBlock& block);

  /// A transaction's status if it is committed; otherwise `waiter` (a name that the caller chose) gets it from apply().
  std::optional<TxStatus> watch(const std::string& tx_id, std::uint64_t waiter);
  void unwatch(const std::string& tx_id, std::uint64_t waiter);
  std::optional<TxStatus> find(const std::string& tx_id) const;

  struct Counts {
    std::uint64_t blocks = 0, transactions = 0, invalid = 0;
  };
  Counts counts() const;  ///< since the ledger began, the config block left out of transactions

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace ledgerline::node
