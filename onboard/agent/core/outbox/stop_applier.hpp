#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "common/fabric/sending/repeat.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/retry.hpp"
#include "onboard/agent/core/outbox/batcher.hpp"

namespace ledgerline::agent {

/// Applies stops: a stop writes nothing that commands read, so the drone's host calls `apply_stops` until the ledger
/// has it. From then on the contract refuses the holder's commands, and those in flight are invalid. Likewise a
/// holder's revocation, which writes nothing but his role: `apply_stops` ends his lease. Agent itself obeys both at
/// once, whatever becomes of its call. And a contract of a newer version: `apply_stops` renews the drone's records,
/// without which no frame is valid. That has a pause of its own, with back-off, since a frame may lack endorsements for
/// other reasons, for as long as those last.
///
///     stop seen -> wanted -> in flight -> committed: over, unless another stop came meanwhile
///                    ^           |     -> refused by the contract: over (another host's drone by now)
///                    +-----------+ anything else, behind a back-off with jitter
///
/// A call that another stop overtook is invalid by the ledger's own check (it reads the stops as a range), so a
/// committed one knows all stops before it. One call a drone at a time. One thread; the same inputs and seed give the
/// same calls.
class StopApplier {
 public:
  /// Between two renewals. A channel that moves has its new contract a second or more behind the definition that asks
  /// for the endorsements, and drones land after 5 s of silence; a call a drone and second is no load where it lasts.
  static constexpr TimeNs first_renewal_pause_ns = 200 * ns_per_ms, max_renewal_pause_ns = 1 * ns_per_s;

  struct Sending {
    std::uint64_t number = 0;  ///< never that of a frame or of transitions
    const DroneName* drone = nullptr;
  };

  StopApplier(const BatchConfig& config, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// A stop of this drone, or a revocation that concerns it, was seen in a block or in its record.
  void want(TimeNs now, DroneNumber drone);
  /// A frame of states lacked endorsements: apply_stops of all drones, at most so often as the pause has it.
  void renew(TimeNs now);
  /// A frame of states is on the ledger, so the records are good: the pause is short again.
  void renewed() { renewal_pause_.succeeded(); }
  /// A call to make now, if any; it is then in flight.
  std::optional<Sending> next(TimeNs now);
  /// How call `number` ended; false if it is none of ours.
  bool finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  bool pending() const;
  std::uint64_t applied() const { return applied_; }    ///< calls committed
  std::uint64_t repeated() const { return repeated_; }  ///< calls made again

 private:
  struct Slot {
    DroneName drone{};
    std::optional<fabric::Repeat> repeat{};  ///< of a stop that is not applied yet
    TimeNs next_ns = 0;
    std::uint64_t call = 0;  ///< in flight; 0: none
    bool again = false;      ///< a stop came while it was
  };
  void begin(TimeNs now, Slot& slot);

  std::vector<Slot> slots_;
  fabric::RepeatLimits limits_;
  Random seeds_;
  BackOff renewal_pause_{first_renewal_pause_ns, max_renewal_pause_ns};
  std::uint64_t last_call_ = std::uint64_t{3} << 62;  // transitions count from the half of that range
  std::uint64_t applied_ = 0, repeated_ = 0;
};

/// The call of the contract.
fabric::Call encode_apply_stops(const StopApplier::Sending& sending);

}  // namespace ledgerline::agent
