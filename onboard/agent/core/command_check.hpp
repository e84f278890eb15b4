#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/onboard.hpp"
#include "common/verification/control_events.hpp"
#include "common/verification/roles.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/drone_name.hpp"
#include "onboard/agent/core/records/first_records.hpp"

namespace ledgerline::agent {

/// Why a command was refused. Values are in traces: only append.
enum class Refusal : std::uint8_t {
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
inline constexpr std::size_t refusal_count = enum_count<Refusal>;
std::string_view refusal_name(Refusal refusal);

struct CheckConfig {
  std::string msp_id = "Org1MSP";  ///< our own organisation: whose endorsement counts
  fabric::ChannelAndContract where;
  TimeNs max_age_ns = 500 * ns_per_ms;
  double max_speed_mps = 8.0;  ///< a Tello's top speed in fast mode (docs/sources.md); link limits further
  double max_yaw_rate_radps = 3.5;
  TimeNs horizon_ns = contract::max_plan_ns;  ///< no setpoint is meant for later than now plus this
  std::size_t stamps_kept = 256;              ///< per drone: newest states sent; 8 s at 30 Hz
};

/// Turns blocks into plans, each of which was checked against everything in Refusal. The source of its blocks, and the
/// peer that ran the contract, with its real key, can delay a command, never make one: a plan
/// is taken out of the arguments under its creator's signature, and only where the event says the same. Who may command
/// comes from Control records: the first ones are set by the caller as read from the ledger, later ones come from the
/// control events in the blocks. Such an event must be what its creator asked for, of the drones that were asked for,
/// and follow from the record before (common/verification/control_events.hpp), so an epoch never goes back and nobody's
/// stop is cleared by another. A stop needs less: its creator's signature and right by these records, whatever flag,
/// endorser or clock; a cut is only flown where it is flagged valid. What stays the peers' word: the first records and
/// roles, and what they leave out.
///
// clang-format off
///     block -> chain -> flag -> channel -> signer, signature -> endorsement -> asked for
///         -+-> control event: follows -> record updated; a stop also gives a plan; under a revoked lease nothing flies
///          +-> command: lease -> epoch -> boot, stamp -> sequence -> age -> limits -> Plan
// clang-format on
///
/// One thread; deterministic; memory bounded by drones × stamps_kept. The registry must outlive it.
class CommandCheck {
 public:
  CommandCheck(CheckConfig config, const std::vector<DroneName>& drones, crypto::MspRegistry& registry);

  struct Refused {
    DroneNumber drone = 0;
    std::uint64_t sequence = 0;
    TimeNs state_stamp_ns = 0;
    Refusal why = Refusal::none;
  };
  struct Checked {
    /// In block order, verified_ns not set yet; a `stop` event comes as stop or cut, the last stopper's `clear_stop` as
    /// stop_cleared; a change of who commands as one without setpoints.
    std::vector<Plan> plans;
    std::vector<Refused> refused;
    std::vector<DroneNumber> revoked;  ///< drones whose record names somebody who is now revoked: apply_stops is due
    /// Stops that are obeyed although the reported ledger has none such: a peer may lie, or it came to nothing.
    struct UnconfirmedStop {
      DroneNumber drone = 0;
      crypto::IdentityName stopper;
      int code = 0;            ///< its flag, protos.TxValidationCode
      bool validated = false;  ///< our own validation of the transaction says the same as its flag
    };
    std::vector<UnconfirmedStop> unconfirmed;
    /// Transactions that the stream does not accept (fabric::Transaction::problem): how many, and the first's problem.
    std::uint64_t unverified = 0;
    std::string unverified_problem;
    std::vector<DroneNumber> commanded;  ///< drones with a command under their lease, accepted or not
    bool chain_ok = true;
    std::string chain_error;  ///< in words, when not chain_ok; the block was then not looked at further
  };
  struct Counters {
    std::uint64_t on_ledger = 0;  ///< in a block, flagged valid
    std::uint64_t verified = 0;
    std::uint64_t refused = 0;
    std::array<std::uint64_t, refusal_count> reasons{};
  };

  /// The roles of the organisations that our drones belong or are granted to, as read from the ledger at start: until
  /// then a stop must be one that our own peer endorsed.
  void set_roles(verification::Roles roles);
  /// Organisations that a record names since, whose roles are to be read; each is asked for once. Until add_roles()
  /// their stops must be endorsed so, too.
  verification::Organisations await_roles();
  void add_roles(const verification::Roles& read);
  /// Organisations whose roles were left out, since they are too many.
  const verification::Organisations& roles_left_out() const { return roles_.left_out(); }
  /// The record of one of our drones, as read from the ledger at start. Others are ignored.
  void set_control(const Control& control);
  /// A state that was submitted: commands may answer it. Of another boot than the one before: that one's are forgotten.
  void sent(const StateSample& sample);
  /// Whether its holder may lose the drone any moment by our own doing: it does not take off then.
  void set_evicting(DroneNumber number, bool evicting);
  /// `now_s`: real time, for the certificates' validity.
  Checked check(TimeNs now, std::int64_t now_s, const fabric::Block& block);

  /// A block that the stream refused: of no chain, by nobody's flag. A stop proves itself by its signer, nothing else
  /// does.
  Checked check_refused(TimeNs now, const fabric::Block& block);

  /// The stop that the ledger's record asks of link, or one that was heard and must be flown once; none when the drone
  /// is not stopped.
  std::optional<Plan> standing_stop(TimeNs now, DroneNumber number) const;
  /// For a link that does not know yet that nobody has the drone stopped; none while somebody has, or without a record.
  std::optional<Plan> no_stop(TimeNs now, DroneNumber number) const;
  /// The drone is on the ground, stopped: a heard stop that is not on the ledger has been obeyed.
  void landed(DroneNumber number);
  /// The epoch of its holder's lease; none: nobody holds the drone, or no record of it was read.
  std::optional<std::uint64_t> lease(DroneNumber number) const;

  /// The verified records now, as set at the start and changed by the blocks since.
  FirstRecords records() const;

  const Counters& counters(DroneNumber number) const;
  std::uint64_t height() const { return chain_.height(); }
  const std::string& chain_hash() const { return chain_.hash(); }  ///< of the newest block's header; empty before one
  std::uint64_t broken_blocks() const { return broken_blocks_; }
  std::uint64_t malformed_commands() const { return malformed_commands_; }  ///< of no drone, therefore
  std::uint64_t refused_control_events() const { return refused_control_events_; }
  std::uint64_t unconfirmed_stops() const { return unconfirmed_stops_; }
  std::uint64_t unverified_transactions() const { return unverified_transactions_; }  ///< of anybody

 private:
  static constexpr std::size_t max_remembered_stops = 256;  ///< remembered, so that each lands its drones once
  using Organisations = std::set<std::string>;
  /// A stop that its creator may give, and that the blocks do not show as valid. It stands until the drone is down, and
  /// the record of an apply_stops, which comes from behind it, does not show it either.
  struct PendingStop {
    bool not_on_ledger = false;
  };
  struct Drone {
    DroneName name;
    std::optional<Control> control;
    std::optional<PendingStop> pending_stop;
    std::uint64_t boot_id = 0;
    std::deque<TimeNs> stamps;
    std::uint64_t epoch = 0, last_sequence = 0;  ///< the newest plan accepted under that epoch
    bool evicting = false;
    Counters counters;
  };
  Drone* find(std::string_view name);
  const Drone* find(DroneNumber number) const;
  /// Channel, contract, and who signed it; `now_s`: nullopt: whatever the time is.
  Refusal check_creator(std::optional<std::int64_t> now_s, const fabric::Transaction& tx, access::Caller& signer);
  /// The same, and that a peer of one of the organisations endorsed it.
  Refusal check_transaction(std::int64_t now_s, const fabric::Transaction& tx, const Organisations& endorsers,
                            access::Caller& signer);
  bool endorsed_by(const Organisations& organisations, std::optional<std::int64_t> now_s,
                   const fabric::Transaction& tx);
  /// Takes what link still has of another's plans away.
  static Plan empty_plan(TimeNs now, DroneNumber number, std::uint64_t epoch);
  static Plan contract_word(TimeNs now, const Drone& drone, PlanAction action);
  static bool commands(const Drone& drone, const crypto::IdentityName& signer, const DronePlan& plan);
  Refusal check_plan(TimeNs now, const Drone& drone, const crypto::IdentityName& signer, const DronePlan& plan) const;
  Refusal check_setpoints(TimeNs now, const DronePlan& plan) const;
  Refusal check_whole(std::int64_t now_s, const fabric::Transaction& tx, const Checked& out, access::Caller& signer);
  static void refuse(Drone& drone, const DronePlan& plan, Refusal why, Checked& out);
  void refuse_altered(const fabric::Transaction& tx, CommandCall asked, Checked& out);
  void take_commands(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, Checked& out);
  /// A control event, of any function but stop, that concerns us and is what its creator asked for; else it was
  /// refused.
  std::optional<verification::ControlEvent> verified_event(std::int64_t now_s, const fabric::Transaction& tx,
                                                           access::Caller& signer, Checked& out);
  void refuse_control_event(Refusal why, DroneNumber drone, Checked& out);
  void take_controls(TimeNs now, std::int64_t now_s, const fabric::Transaction& tx, Checked& out);
  bool concerns_us(const Controls& reported);
  void take_role(const verification::RoleChange& change, Checked& out);
  void take_stops(TimeNs now, const fabric::Transaction& tx, Checked& out);
  /// A call of `stop`, well signed.
  struct StopEvent {
    const access::Caller& signer;
    bool endorsed_by_us = false;                        ///< of an event alone is it asked
    bool again = false;                                 ///< it was heard before
    const verification::ControlEvent* event = nullptr;  ///< what the ledger is said to have made of it; null: nothing
    const fabric::Transaction& tx;
  };
  void take_stop(TimeNs now, const StopEvent& said, const Stop& stop, Drone& drone, Checked& out);

  CheckConfig config_;
  std::vector<Drone> drones_;
  verification::Roles roles_;
  std::deque<std::string> heard_stops_;  ///< transactions, newest last
  crypto::MspRegistry& registry_;
  fabric::ChainCheck chain_;
  std::uint64_t broken_blocks_ = 0;
  std::uint64_t malformed_commands_ = 0;
  std::uint64_t refused_control_events_ = 0;
  std::uint64_t unconfirmed_stops_ = 0;
  std::uint64_t unverified_transactions_ = 0;
};

}  // namespace ledgerline::agent
