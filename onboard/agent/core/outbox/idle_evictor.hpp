#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "common/fabric/sending/repeat.hpp"
#include "common/msg/onboard.hpp"
#include "onboard/agent/core/outbox/batcher.hpp"

namespace ledgerline::agent {

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
    bool ledger_heard = false;
  };
  struct Sending {
    std::uint64_t number = 0;  ///< never that of a frame, of transitions or of apply_stops
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
  IdleEvictor(TimeNs idle_ns, const BatchConfig& config, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// How it is now; for each drone, before next().
  void see(TimeNs now, DroneNumber drone, const View& view);
  /// It was commanded under its lease.
  void heard(TimeNs now, DroneNumber drone);
  /// A call to make now, if any; it is then in flight.
  std::optional<Sending> next(TimeNs now);
  /// How call `number` ended; nothing if it is none of ours.
  std::optional<Ended> finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  /// A call of this drone is in flight: its holder may lose it any moment.
  bool evicting(DroneNumber drone) const;
  bool in_flight() const;
  TimeNs idle_ns() const { return idle_ns_; }
  const Counters& counters() const { return counters_; }

 private:
  struct Slot {
    DroneName drone{};
    std::optional<std::uint64_t> lease{};
    TimeNs idle_since_ns = 0;
    bool ledger_heard = false;
    std::optional<fabric::Repeat> repeat{};  ///< of an eviction that is wanted
    TimeNs next_ns = 0;
    std::uint64_t call = 0;  ///< in flight; 0: none
  };
  Slot* find(DroneNumber drone);
  static void restart_count(TimeNs now, Slot& slot);

  TimeNs idle_ns_;
  std::vector<Slot> slots_;
  fabric::RepeatLimits limits_;
  Random seeds_;
  std::uint64_t last_call_ = std::uint64_t{7} << 61;  // apply_stops counts from three quarters of that range
  Counters counters_;
};

/// The call of the contract.
fabric::Call encode_evict(const IdleEvictor::Sending& sending);

}  // namespace ledgerline::agent
