#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "common/fabric/calls/repeat.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/retry.hpp"
#include "onboard/agent/core/drone_name.hpp"

namespace ledgerline::agent {

/// Applies stops: a stop writes nothing that commands read, so the drone's host calls `apply_stops` until the ledger
/// has it. From then on the contract refuses the holder's commands, and those in flight are invalid. Likewise a
/// holder's revocation, which writes nothing but his role: `apply_stops` ends his lease. Agent itself obeys both at
/// once, whatever becomes of its call. And a contract of a newer version: `apply_stops` renews the drone's records,
/// without which no batch is valid. That has a pause of its own, with back-off, since a batch may lack endorsements for
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
    std::uint64_t number = 0;  ///< for finished()
    const DroneName* drone = nullptr;
  };

  StopApplier(const BackOffLimits& back_off, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// A stop of this drone, or a revocation that concerns it, was seen in a block or in its record.
  void request(TimeNs now, DroneNumber drone);
  /// A batch of states lacked endorsements: apply_stops of all drones, at most so often as the pause has it.
  void request_renewal(TimeNs now);
  /// A batch of states is on the ledger, so the records are good: the pause is short again.
  void on_renewed() { renewal_pause_.succeeded(); }
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
  std::uint64_t last_call_ = 0;
  std::uint64_t applied_ = 0, repeated_ = 0;
};

/// The call of the contract.
fabric::Call encode_apply_stops(const StopApplier::Sending& sending);

/// Ten minutes: a change of batteries, a briefing or a charge between two flights is shorter, a forgotten laptop is
/// not. Half as long would take the drone from crews that still prepare; twice as long is a shift's time to wait for
/// others.
inline constexpr TimeNs usual_idle_ns = 600 * ns_per_s;

/// Ends leases that nobody uses, as the drone's host: a ledger has no clock. A drone's holder is idle once the drone
/// was seen on the ground, under this lease and without a command under it, for the idle time by this host's monotonic
/// clock. Then `evict` goes out, one call at a time:
///
///     counting -> idle -> in flight -> committed: restarts the count, mostly nobody holds it now
///        ^          ^        |      -> refused by the contract: restarts the count
///        |          +--------+ anything else, behind a back-off with jitter: ten calls in 30 s, then a new count
///        +- from anywhere: another lease, a command under it, the drone in the air or without state
///
/// While the ledger is silent commands may be on their way: nothing is sent, nor before what came meanwhile has had
/// `catch_up_ns` to get here. One thread; the same inputs and seed give the same calls.
class IdleEvictor {
 public:
  static constexpr TimeNs catch_up_ns = 10 * ns_per_s;  ///< a block stream that is open again brings what it missed

  struct View {
    std::optional<std::uint64_t> lease;  ///< its epoch; none: nobody holds the drone
    bool on_ground = false;              ///< link sees it there now
    bool ledger_alive = false;
  };
  struct Sending {
    std::uint64_t number = 0;  ///< for finished()
    const DroneName* drone = nullptr;
    std::uint64_t lease = 0;  ///< its epoch: a client that has acquired the drone since keeps it
  };
  struct Ended {
    const DroneName* drone = nullptr;
    std::optional<fabric::Repeat::Next> next;  ///< none: it did not get through, and is not wanted any more
  };
  struct Counters {
    std::uint64_t evicted = 0, refused = 0, repeated = 0, given_up = 0;
  };

  /// `idle_ns`: 0: nobody is ever evicted.
  IdleEvictor(TimeNs idle_ns, const BackOffLimits& back_off, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// How it is now; for each drone, before next().
  void update(TimeNs now, DroneNumber drone, const View& view);
  /// It was commanded under its lease.
  void on_command(TimeNs now, DroneNumber drone);
  /// A call to make now, if any; it is then in flight.
  std::optional<Sending> next(TimeNs now);
  /// How call `number` ended; nothing if it is none of ours.
  std::optional<Ended> finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  /// A call of this drone is in flight: its holder may lose it any moment.
  bool is_evicting(DroneNumber drone) const;
  bool has_call_in_flight() const;
  TimeNs idle_ns() const { return idle_ns_; }
  const Counters& counters() const { return counters_; }

 private:
  struct Slot {
    DroneName drone{};
    std::optional<std::uint64_t> lease{};
    TimeNs idle_since_ns = 0;
    bool ledger_alive = false;
    std::optional<fabric::Repeat> repeat{};  ///< of an eviction that is wanted
    TimeNs next_ns = 0;
    std::uint64_t call = 0;  ///< in flight; 0: none
  };
  static void restart_count(TimeNs now, Slot& slot);

  TimeNs idle_ns_;
  std::vector<Slot> slots_;
  fabric::RepeatLimits limits_;
  Random seeds_;
  std::uint64_t last_call_ = 0;
  Counters counters_;
};

/// The call of the contract.
fabric::Call encode_evict(const IdleEvictor::Sending& sending);

}  // namespace ledgerline::agent
