#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "common/verification/control_events.hpp"
#include "ground/core/flight_types.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {

/// What the ledger says of who may command a drone.
struct Lease {
  std::optional<crypto::IdentityName> owner, holder;
  std::optional<crypto::IdentityName> commander;  ///< the holder, or who commands in its place
  std::optional<Control> record;                  ///< the newest, whole: what control events have to follow from
  Control stoppers;  ///< who has it stopped, and whose stops were cleared; nothing else of the record
  std::uint64_t epoch = 0;
  bool revoked = false;      ///< its holder or its commander
  bool may_command = false;  ///< we are its commander, nobody of it is revoked and the drone is not stopped
};

/// "CN=pilot, who lets CN=station command it"; of a lease that somebody holds.
std::string holder_words(const Lease& lease);

/// The leases of all drones: first as read from the ledger, then by the control events in the blocks, each of which
/// must be signed by somebody who is trusted, be what its signer asked for, and follow from the record before. Without
/// a ledger we command all. Deterministic; one thread.
class LeaseBook {
 public:
  struct Change {
    std::size_t drone = 0;
    bool new_epoch = false;
  };

  LeaseBook(const FlightConfig& config, FlightTransactions& counters);

  /// Applies a record that was read; no change if ours is newer. An error: it is of a drone that does not fly here.
  Result<std::optional<Change>> set(const Control& record);
  /// A control event of a block. One that is refused is counted.
  std::vector<Change> on_event(const fabric::Transaction& tx, std::int64_t realtime_s);
  const Lease& of(std::size_t drone) const { return leases_[drone]; }

 private:
  std::optional<access::Caller> creator_of(const fabric::Transaction& tx, std::int64_t realtime_s) const;
  std::optional<Change> apply_record(std::size_t drone, const Control& control);
  void update(Lease& lease) const;

  const FlightConfig& config_;
  FlightTransactions& counters_;
  std::vector<Lease> leases_;
};

}  // namespace ledgerline::ground
