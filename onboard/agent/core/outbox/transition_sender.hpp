#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/retry.hpp"
#include "onboard/agent/core/drone_name.hpp"

namespace ledgerline::agent {

/// Brings the transitions of each drone's failsafe onto the ledger: in order, none left out, never in a batch of states
/// nor behind one. A call takes all that wait, of all drones, since each costs endorsements of two organisations and
/// sixteen drones take off at once; what comes while max_calls are in flight waits for the first that ends. A drone has
/// one call in flight; it is made again, behind a back-off with jitter, until it is committed. From a call that the
/// contract refused on a drone goes by itself until one of its own is committed: none is held up by what is wrong with
/// another. Where a call's fate is unknown (Outcome::Kind::unavailable) its transitions may be on the ledger twice: the
/// same boot id and number is the same transition.
///
///     link -> waiting -> in flight -> committed: reported to link, which forgets them
///                ^           |
///                +-----------+ anything else
///
/// What does not fit link keeps, and sends again. One thread; the same inputs and seed give the same calls.
class TransitionSender {
 public:
  static constexpr std::size_t max_kept = 256;  ///< of a drone
  static constexpr std::size_t max_per_call = 64;
  /// In flight at once, of calls for many drones. With one, a slow peer would block all drones for a call's whole
  /// deadline; more than two gain nothing.
  static constexpr std::size_t max_calls = 2;

  struct Counters {
    std::uint64_t taken = 0, on_ledger = 0, pending = 0;  ///< taken = on_ledger + pending
    std::uint64_t calls_repeated = 0;
    std::uint64_t lost = 0;  ///< by link, as it says
  };
  struct Sending {
    std::uint64_t number = 0;  ///< for finished()
    struct Part {
      const DroneName* drone = nullptr;
      std::vector<Transition> transitions;
    };
    std::vector<Part> parts;
  };

  TransitionSender(const BackOffLimits& back_off, const std::vector<DroneName>& drones, std::uint64_t seed);

  /// One that is not the next of its drone is ignored: it came before, or link will send what is between.
  void add(const Transition& transition);
  /// A call to make now, if any; it is then in flight.
  std::optional<Sending> next(TimeNs now);
  /// How call `number` ended; false if it is none of ours.
  bool finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome);

  /// What link may forget, and what it must send.
  void report(AgentHeartbeat& heartbeat) const;
  bool pending() const;
  Counters counters(DroneNumber drone) const;

 private:
  struct Slot {
    DroneName drone{};
    BackOff pause;
    Counters counters{};
    std::deque<Transition> kept{};
    std::size_t in_flight = 0;  ///< so many of the front
    std::uint64_t call = 0;
    bool alone = false;                       ///< the contract refused a call of many
    std::uint64_t newest = 0, on_ledger = 0;  ///< numbers of this boot
  };

  bool is_due(const Slot& slot, TimeNs now) const;
  /// Into a call, as many as there is room for.
  static void add_to(Slot& slot, Sending& sending, std::size_t room);
  std::size_t calls_of_many() const;

  std::vector<Slot> slots_;
  Random random_;
  std::uint64_t boot_id_ = 0;
  std::uint64_t last_call_ = 0;
};

/// The call, with an asset `<drone>/failsafe` for each drone. `real_offset_ns`: as for encode_batch.
fabric::Call encode_transitions(const TransitionSender::Sending& sending, TimeNs real_offset_ns);

}  // namespace ledgerline::agent
