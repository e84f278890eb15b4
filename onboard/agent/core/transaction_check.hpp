#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/access/access.hpp"
#include "common/base/enum_count.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/verification/control_records.hpp"

namespace ledgerline::agent {

/// Why a command or control event was refused. Values are in traces: only append.
enum class RefusalReason : std::uint8_t {
  none = 0,
  broken_chain = 1,         ///< its block does not follow the one before
  invalid_transaction = 2,  ///< flagged invalid by the peers
  wrong_channel = 3,        ///< of another channel or another contract
  malformed = 4,            ///< not a CommandCall, or an action that this version does not know
  unknown_signer = 5,       ///< the creator's certificate is of no trusted organisation, expired or revoked
  bad_signature = 6,        ///< the creator's signature does not fit the transaction
  not_endorsed = 7,         ///< no peer of our own organisation signed this result of this proposal
  not_holder = 8,           ///< the signer neither holds the drone's lease at that block nor commands for who does
  stopped = 9,              ///< the drone is stopped; its commander may still land it
  wrong_epoch = 10,         ///< made under another lease
  foreign_boot = 11,        ///< answers a state of another start of link
  unknown_stamp = 12,       ///< answers a state that this agent did not send
  replayed = 13,            ///< its sequence does not grow
  too_old = 14,             ///< its state is older than the limit
  over_limits = 15,         ///< setpoints: not finite, too fast, too many, out of order, or beyond the horizon
  altered = 16,      ///< not what its creator asked for and signed; or a record that does not follow from the last
  revoked = 17,      ///< the holder's or his delegate's organisation has taken its role back
  evicting = 18,     ///< to take off, while this agent's eviction of its idle holder is in flight
  may_not_stop = 19  ///< a stop by somebody whom neither role nor grant lets stop this drone
};
inline constexpr std::size_t refusal_count = enum_count<RefusalReason>;
constexpr std::string_view refusal_name(RefusalReason reason) { return enum_name(reason); }

/// What a block has for our drones.
struct CheckedBlock {
  struct Refused {
    DroneNumber drone = 0;
    std::uint64_t sequence = 0;
    TimeNs state_stamp_ns = 0;
    RefusalReason why = RefusalReason::none;
  };
  /// A stop that is obeyed although the reported ledger has none such: a peer may be tampering, or it came to nothing.
  struct UnconfirmedStop {
    DroneNumber drone = 0;
    crypto::IdentityName stopper;
    int code = 0;            ///< its flag, protos.TxValidationCode
    bool validated = false;  ///< our own validation of the transaction says the same as its flag
  };
  /// In block order, verified_ns not set yet; a `stop` event comes as stop or cut, the last stopper's `clear_stop` as
  /// stop_cleared; a change of who commands as one without setpoints.
  std::vector<Plan> plans;
  std::vector<Refused> refused;
  std::vector<DroneNumber> revoked;  ///< drones whose record names somebody who is now revoked: apply_stops is due
  std::vector<UnconfirmedStop> unconfirmed;
  /// Transactions that the stream does not accept (fabric::Transaction::problem): how many, and the first's problem.
  std::uint64_t unverified = 0;
  std::string unverified_problem;
  std::vector<DroneNumber> commanded;  ///< drones with a command under their lease, accepted or not
  bool chain_ok = true;
  std::string chain_error;  ///< in words, when not chain_ok; the block was then not looked at further
};

/// Who signed a transaction, and who endorsed it. The registry must outlive it.
class TransactionCheck {
 public:
  TransactionCheck(fabric::ChannelAndContract where, crypto::MspRegistry& registry)
      : where_(std::move(where)), registry_(registry) {}

  /// Channel, contract, and who signed it; `now_s`: nullopt: whatever the time is.
  RefusalReason check_creator(std::optional<std::int64_t> now_s, const fabric::Transaction& tx,
                              access::Caller& signer) const;
  /// The same, and that a peer of one of the organisations endorsed it.
  RefusalReason check(std::int64_t now_s, const fabric::Transaction& tx, const verification::Organisations& endorsers,
                      access::Caller& signer) const;
  bool is_endorsed_by(const verification::Organisations& organisations, std::optional<std::int64_t> now_s,
                      const fabric::Transaction& tx) const;

 private:
  fabric::ChannelAndContract where_;
  crypto::MspRegistry& registry_;
};

}  // namespace ledgerline::agent
