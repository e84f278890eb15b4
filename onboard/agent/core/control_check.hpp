#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/verification/control_events.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/drone_name.hpp"
#include "onboard/agent/core/records.hpp"
#include "onboard/agent/core/transaction_check.hpp"

namespace ledgerline::agent {

/// Who may command and who has stopped our drones: their control records and the roles beside them, as read from the
/// ledger at start, and as the blocks change them since. A control event must be what its creator asked for, of the
/// drones that were asked for, and follow from the record before (common/verification/control_events.hpp), so an epoch
/// never goes back and nobody's stop is cleared by another. A stop needs less: its creator's signature and right by
/// these records, whatever flag, endorser or clock; a cut is only flown where it is flagged valid. Still trusted to
/// the peers: the first records and roles, and that they leave nothing out.
///
/// The plans that it adds to a block's have drone and action alone, but for those that end a lease. One thread;
/// deterministic.
class ControlCheck {
 public:
  /// `msp_id`: our own organisation, whose endorsement counts.
  ControlCheck(std::string msp_id, const std::vector<DroneName>& drones, TransactionCheck transactions);

  /// The roles of the organisations that our drones belong or are granted to, as read from the ledger at start: until
  /// then a stop must be one that our own peer endorsed.
  void set_roles(verification::RolesByOrganisation roles) { roles_ = std::move(roles); }
  /// Organisations that a record names since, whose roles are to be read; each is asked for once. Until add_roles()
  /// their stops must be endorsed so, too.
  verification::Organisations await_roles();
  void add_roles(const verification::RolesByOrganisation& read) { roles_.add(read); }
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
  /// A stop that its creator may give, and that the blocks do not show as valid. It stands until a later apply_stops
  /// record shows no stop and the drone has landed, or until a clear_stop leaves none.
  enum class PendingStop : std::uint8_t { none, unconfirmed, not_on_ledger };
  struct Drone {
    DroneName drone;
    std::optional<Control> control{};
    PendingStop pending_stop = PendingStop::none;
  };
  /// A call of `stop`, well signed.
  struct SignedStop {
    const fabric::Transaction& tx;
    const access::Caller& signer;
    bool is_endorsed = false;                           ///< by our own organisation; checked only if there is an event
    bool is_repeated = false;                           ///< it was obeyed before
    const verification::ControlEvent* event = nullptr;  ///< what the ledger is said to have made of it; null: nothing
  };
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
  verification::RolesByOrganisation roles_;
  std::deque<std::string> obeyed_stops_;  ///< transactions, newest last
  std::uint64_t refused_events_ = 0, unconfirmed_stops_ = 0;
};

}  // namespace ledgerline::agent
