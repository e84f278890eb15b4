#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/verification/control_events.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/records.hpp"

namespace ledgerline::agent {

/// Why a command or control event was refused. Values are in traces: only append.
enum class RefusalReason : std::uint8_t {
  none = 0,
  broken_chain = 1,         ///< its block does not follow the one before
  invalid_transaction = 2,  ///< flagged invalid by the peers
  wrong_channel = 3,        ///< of another channel or another contract
  malformed = 4,            ///< not a CommandCall, or an action that this version does not know
  unknown_signer = 5,       ///< the creator's certificate is not from an organisation that is trusted
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
std::string_view refusal_name(RefusalReason reason);

/// What a block has for our drones.
struct CheckedBlock {
  struct Refused {
    DroneNumber drone = 0;
    std::uint64_t sequence = 0;
    TimeNs state_stamp_ns = 0;
    RefusalReason why = RefusalReason::none;
  };
  /// A stop that is obeyed although the reported ledger has none such: a peer may lie, or it came to nothing.
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

/// Who may command and who has stopped our drones: their control records and the roles beside them, as read from the
/// ledger at start, and as the blocks change them since. A control event must be what its creator asked for, of the
/// drones that were asked for, and follow from the record before (common/verification/control_events.hpp), so an epoch
/// never goes back and nobody's stop is cleared by another. A stop needs less: its creator's signature and right by
/// these records, whatever flag, endorser or clock; a cut is only flown where it is flagged valid. What stays the
/// peers' word: the first records and roles, and what they leave out.
///
/// The plans that it adds to a block's have drone and action alone, but for those that end a lease. One thread;
/// deterministic.
class ControlCheck {
 public:
  /// `msp_id`: our own organisation, whose endorsement counts.
  ControlCheck(std::string msp_id, const std::vector<DroneName>& drones, TransactionCheck transactions);

  /// The roles of the organisations that our drones belong or are granted to, as read from the ledger at start: until
  /// then a stop must be one that our own peer endorsed.
  void set_roles(verification::Roles roles) { roles_ = std::move(roles); }
  /// Organisations that a record names since, whose roles are to be read; each is asked for once. Until add_roles()
  /// their stops must be endorsed so, too.
  verification::Organisations await_roles();
  void add_roles(const verification::Roles& read) { roles_.add(read); }
  /// Organisations whose roles were left out, since they are too many.
  const verification::Organisations& roles_left_out() const { return roles_.left_out(); }
  /// The record of one of our drones, as read from the ledger at start. Others are ignored.
  void set_control(const Control& control);

  /// A valid control event, but no stop.
  void check_control_event(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, CheckedBlock& out);
  /// A call of `stop`, or an event of that name.
  void check_stop(const fabric::Transaction& tx, CheckedBlock& out);
  /// The drone is on the ground, stopped: a stop that is not on the ledger has been obeyed.
  void on_landed(DroneNumber number);

  /// Null: no record of it was read.
  const Control* control(DroneNumber number) const;
  /// Stop or cut, as the ledger's record asks of link, or a stop that must be flown once; none: nobody has the drone
  /// stopped, or no record of it was read.
  std::optional<PlanAction> standing_stop(DroneNumber number) const;
  /// The epoch of its holder's lease; none: nobody holds the drone, or no record of it was read.
  std::optional<std::uint64_t> lease(DroneNumber number) const;
  /// The verified records now, as set at the start and changed by the blocks since.
  FirstRecords records() const;
  std::uint64_t refused_events() const { return refused_events_; }
  std::uint64_t unconfirmed_stops() const { return unconfirmed_stops_; }

 private:
  static constexpr std::size_t max_remembered_stops = 256;  ///< so that each lands its drones once
  /// A stop that its creator may give, and that the blocks do not show as valid. It stands until the drone is down, and
  /// the record of an apply_stops, which comes from behind it, does not show it either.
  struct PendingStop {
    bool not_on_ledger = false;
  };
  struct Drone {
    DroneName name;
    std::optional<Control> control{};
    std::optional<PendingStop> pending_stop{};
  };
  /// A call of `stop`, well signed.
  struct SignedStop {
    const fabric::Transaction& tx;
    const access::Caller& signer;
    bool is_endorsed = false;                           ///< by our own organisation; of an event alone is it asked
    bool is_repeated = false;                           ///< it was obeyed before
    const verification::ControlEvent* event = nullptr;  ///< what the ledger is said to have made of it; null: nothing
  };
  Drone* find(std::string_view name);
  const Drone* find(DroneNumber number) const;
  /// An event that concerns us and is what its creator asked for; else it was refused.
  std::optional<verification::ControlEvent> verified_event(std::int64_t now_s, const fabric::Transaction& tx,
                                                           access::Caller& signer, CheckedBlock& out);
  void refuse(RefusalReason why, DroneNumber drone, CheckedBlock& out);
  bool concerns_us(const Controls& reported);
  bool event_follows(const verification::ControlEvent& event, const access::Caller& signer, CheckedBlock& out);
  void apply_control(TimeNs now, const verification::ControlEvent& event, const Control& control,
                     const access::Caller& signer, CheckedBlock& out);
  void apply_role_change(const verification::RoleChange& change, CheckedBlock& out);
  void apply_stop(const SignedStop& given, const Stop& stop, Drone& drone, CheckedBlock& out);

  std::string msp_id_;
  std::vector<Drone> drones_;
  TransactionCheck transactions_;
  verification::Roles roles_;
  std::deque<std::string> obeyed_stops_;  ///< transactions, newest last
  std::uint64_t refused_events_ = 0, unconfirmed_stops_ = 0;
};

}  // namespace ledgerline::agent
