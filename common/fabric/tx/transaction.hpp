#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

/// Fabric's transactions and blocks as pure functions over bytes: used by the real client and by simulated campaigns.
/// All byte strings are serialized protobuf messages of Fabric, named in the comments.
namespace ledgerline::fabric {

/// Whose endorsements a call needs.
struct EndorsementNeed {
  enum class Count {
    one,               ///< by `organisation`; where none is named, one's own: its endorser, or the own peer
    two,               ///< by two organisations; all that are known are asked side by side
    two_if_there_are,  ///< the same, but it goes out with one where no second one answers in time
  };
  Count count = Count::one;
  std::string organisation{};
  bool in_order = true;  ///< behind what was submitted before it; else whenever it is endorsed
};

/// One call of a contract; arguments are bytes.
struct Call {
  std::string function;
  std::vector<std::string> args;
  /// Its end may be reported as soon as a block stream of the same client brings it, which is sooner and cheaper than
  /// asking the peer; the peer's state may not show it yet, though. For writes that no later call of the client reads.
  bool reported_by_block = false;
  /// Where its maker knows better than its function's name tells (ContractRules::endorsement_need).
  std::optional<EndorsementNeed> need{};
};

/// What a peer, an orderer or a contract says of a call, for logs and terminals: one printable line, of a length into
/// which a refusal fits that names each drone of an organisation.
std::string words_of_peer(std::string_view text);

/// What only those know who know the contract. Each may be missing.
struct ContractRules {
  /// Says of a call's result why its event (no name: none) cannot follow from the call; it is then not signed, and ends
  /// as refused. None: any event of the called contract is signed. On a client's own thread.
  std::function<Status(const Call& call, std::string_view event, std::string_view payload)> event_check{};
  /// Whose endorsements a call needs that does not say so itself. None: that of one peer, the own one. On a client's
  /// own thread.
  std::function<EndorsementNeed(const Call& call)> endorsement_need{};
  /// The policy of its own that a key has once it is there (common.SignaturePolicyEnvelope); none: it has none, or that
  /// is not known. On a stream's thread.
  std::function<std::optional<std::string>(const std::string& key)> likely_policy{};
  /// Keys whose readers go by a count or stamp in the value, so that a write that is delivered twice tells them
  /// nothing. On a stream's thread.
  std::function<bool(const std::string& key)> is_of_hot_path{};
};

struct ChannelAndContract {
  std::string channel = "teleop";
  std::string contract = "ledgerline";
};

struct Proposal {
  std::string tx_id;            ///< hex SHA-256(nonce ‖ creator)
  std::string signed_proposal;  ///< protos.SignedProposal
};
/// `timestamp_ns`: real time, goes into the channel header. `nonce`: 24 bytes.
Result<Proposal> make_proposal(const crypto::SigningIdentity& who, const ChannelAndContract& where, const Call& call,
                               TimeNs timestamp_ns, std::string nonce);

/// The transaction of a proposal that one peer or more endorsed, as common.Envelope without signature, or what the
/// contract refused: for those who ask peers themselves. `responses`: protos.ProposalResponse of each.
Result<std::string> assemble(const Proposal& proposal, const std::vector<std::string>& responses);

/// Says of a result's event (no name: none) why it cannot follow from the call that was asked for.
using EventCheck = std::function<Status(std::string_view name, std::string_view payload)>;
/// The contract's answer, where the endorsed envelope that is to be signed is our own call: a gateway that put another
/// call, channel or transaction id into it is found out here. Nothing is signed without this check.
/// An event of another contract or transaction is refused in any case; what else must be so the caller says with
/// `event_check`, since only who knows the contract can. Writes are the peers' own: nobody sees them here.
Result<std::string> check_prepared(const Proposal& proposal, std::string_view unsigned_envelope,
                                   const EventCheck& event_check = {});

/// Signs a common.Envelope that came unsigned (from Endorse) and returns it whole.
Result<std::string> sign_envelope(const crypto::SigningIdentity& who, std::string_view unsigned_envelope);

/// Whose blocks a stream hands over.
enum class BlockSource {
  peer,     ///< the own peer's
  ordered,  ///< the first that comes: an orderer's, where our own validation needs no flag of the peer, which confirms
            ///< it later
};

/// Up to where a seek asks for blocks.
enum class SeekStop {
  never,     ///< what is not there yet is waited for
  at_start,  ///< the first block alone; where it is not there the peer says so at once
};
/// A signed common.Envelope with SeekInfo for Deliver: from block `start` (nullopt: newest) on. `tls_hash`: of the TLS
/// certificate that the client shows, which a server that wants one compares; empty: it shows none.
Result<std::string> make_seek(const crypto::SigningIdentity& who, const std::string& channel,
                              std::optional<std::uint64_t> start, TimeNs timestamp_ns, std::string nonce,
                              SeekStop stop = SeekStop::never, const std::string& tls_hash = {});

/// Who endorsed, in a transaction.
struct Endorsement {
  std::string endorser;  ///< msp.SerializedIdentity
  std::string signature;
  bool signature_verified = false;  ///< as Transaction::signature_verified
};

/// A verdict of our own beside protos.TxValidationCode, which is a byte: flagged valid by the peers, but it cannot be.
/// One peer's key is enough to get such a transaction into a block, so it must not stop those who follow.
inline constexpr int code_unverified = 256;

/// An endorser transaction, taken apart.
struct Transaction {
  std::string tx_id;
  std::string channel;
  std::string contract;  ///< that was called; an event with this name of another contract means something else
  int code = -1;  ///< protos.TxValidationCode; 0 = VALID; -1: the block has no flags (orderer's); code_unverified
  bool by_flag = false;     ///< our own validation knows too little, and `code` is the peer's claim alone
  TimeNs timestamp_ns = 0;  ///< as the client claimed it
  std::string creator;      ///< msp.SerializedIdentity
  std::string function;     ///< what the creator asked for, read out of `payload`; empty: no call of a contract
  std::vector<std::string> args;
  std::string event_name;  ///< empty: none. Only endorsed: a reader that trusts the creator, not peers, uses `args`
  std::string event_payload;
  std::string payload;  ///< common.Payload, signed by creator as `signature`
  std::string signature;
  /// The source of the block has verified this signature with the key in the identity, so a reader need not verify it
  /// again. False: nobody has, or it does not fit.
  bool signature_verified = false;
  std::string response_payload;  ///< ProposalResponsePayload: each endorsement signs it followed by the endorser
  std::vector<Endorsement> endorsements;
  bool config = false;  ///< a config transaction: only tx_id, channel and code are set
  /// Why its flag is not accepted. Of one that was flagged valid and cannot be read as one (decode_block) only tx_id,
  /// channel, contract and code are set then; else it is as it came, and our own validation contradicts its flag: with
  /// code_unverified (or that of a duplicate, 9) where it was flagged valid.
  std::string problem;
};

/// Whether the owner of the key signed it, as creator or endorser; not verified again where that was done.
inline bool verify_signature(const Transaction& transaction, const crypto::Verifier& key) {
  return transaction.signature_verified || key.verify(transaction.payload, transaction.signature);
}
inline bool verify_signature(const Transaction& transaction, const Endorsement& endorsement,
                             const crypto::Verifier& key) {
  return endorsement.signature_verified ||
         key.verify(transaction.response_payload + endorsement.endorser, endorsement.signature);
}

struct Block {
  std::uint64_t number = 0;
  std::string previous_hash;
  std::string data_hash;
  std::vector<Transaction> transactions;
  /// False: it was taken as an orderer delivered it, and the own peer has still to deliver the same.
  bool confirmed = true;
  TimeNs received_ns = 0;  ///< CLOCK_MONOTONIC, when the client's stream had its bytes; 0: not known
};
/// Takes a common.Block apart. Malformed bytes, data that does not match its hash, a wrong number of flags: an error
/// that names the block; never a crash. A single transaction is never an error, since any member can have a malformed
/// one ordered, and any peer one whose event names another transaction flagged valid: the first is kept with what could
/// be read (code 2 = BAD_PAYLOAD where the block has no flags), the second is left out (code_unverified, no event),
/// so that neither can stop those who follow the chain.
Result<Block> decode_block(std::string_view block);

/// ASN.1 DER of SEQUENCE { INTEGER number, OCTET STRING previous hash, OCTET STRING data hash }: what orderers sign.
std::string block_header_bytes(std::uint64_t number, std::string_view previous_hash, std::string_view data_hash);
/// SHA-256 over these bytes: what the next block names as its previous hash.
std::string block_header_hash(std::uint64_t number, std::string_view previous_hash, std::string_view data_hash);

/// Follows a chain: each block must be the next number and carry the hash of the one before, and its data must match
/// its own data hash (computed over the concatenated envelopes by decode_block, which refuses a mismatch).
class ChainCheck {
 public:
  /// Starts anywhere: the first block is taken as it is.
  ChainCheck() = default;
  /// Starts behind block `number`, whose header has `hash` (block_header_hash): a checkpoint.
  static ChainCheck behind(std::uint64_t number, std::string hash);
  /// After an error nothing has changed: the right block may still come.
  Status add(const Block& block);
  std::uint64_t height() const { return next_; }
  /// Of the last block's header: with height() - 1 what a checkpoint holds. Empty before the first block.
  const std::string& hash() const { return hash_; }

 private:
  bool started_ = false;
  std::uint64_t next_ = 0;
  std::string hash_;
};

/// How many transactions were validated, and how many count by the peer's flag alone, since they rest on what nobody
/// here has seen. At a start those are many, and soon few. When they grow again, a start does not explain it: somebody
/// may have pushed out what was known. Deterministic; one thread.
class ValidatedShare {
 public:
  void add(TimeNs now, const Block& block);
  std::uint64_t validated() const { return validated_; }
  std::uint64_t by_flag() const { return by_flag_; }

  struct Rise {
    std::uint64_t by_flag = 0, of = 0;  ///< transactions of window_ns
  };
  /// Once for each time that more than half go by the flag, after it were fewer than a quarter.
  std::optional<Rise> pop_rise();

  static constexpr TimeNs window_ns = 10 * ns_per_s;
  static constexpr std::uint64_t fewest = 20;  ///< in a window: of fewer the share says nothing

 private:
  std::uint64_t validated_ = 0, by_flag_ = 0;
  TimeNs begun_ns_ = 0;  ///< the window
  Rise now_{};
  bool low_ = false;  ///< in the newest window that says something
  std::optional<Rise> rise_;
};

}  // namespace ledgerline::fabric
