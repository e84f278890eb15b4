#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/calls/repeat.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/core/lease/lease_book.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {

/// A pilot's stops on their way, and what clears ours: each goes out by itself, at once, and again until the ledger has
/// it, the contract refuses it, or 30 s are over. A stop carries the number of clears so far, so it cannot revive a
/// stop that was cleared since. If the contract refuses that number, it is sent once without. One of a drone and
/// stopper at a time; a cut replaces a stop. Deterministic; one thread.
class PilotStops {
 public:
  PilotStops(const std::vector<FlightDrone>& drones, const crypto::IdentityName& self);

  /// `by`: the operator whose stop it is; none: ours.
  void request(TimeNs now, std::size_t drone, bool cut, const std::optional<crypto::IdentityName>& by = std::nullopt);
  /// To clear our own stop of a drone. It is given up when the stop is none of ours any more, or another's stands
  /// beside it: a supervisor's clear would lift that one, too. A stop requested meanwhile is sent at once, and again if
  /// the clear may have been ordered after it. An error: a stop of it is still on its way.
  Status request_clear(TimeNs now, std::size_t drone);
  void submit(TimeNs now, const LeaseBook& leases, std::uint64_t& next_id, std::vector<Submission>& submissions);

  struct Ended {
    std::size_t drone = 0;
    std::string problem;  ///< why the ledger will not have it; empty: it has, or the stop goes out again
  };
  /// Nothing: the outcome is none of ours.
  std::optional<Ended> on_outcome(TimeNs now, const fabric::Outcome& outcome, std::uint64_t id);
  /// One is not on the ledger yet.
  bool pending() const;
  /// A stop of this drone.
  bool pending(std::size_t drone) const;

 private:
  struct Slot {
    std::size_t drone = 0;
    std::optional<crypto::IdentityName> by{};
    std::uint64_t seed = 0;                  ///< of the pauses' jitter
    std::optional<DronesCall> stop{};        ///< to be submitted, or in flight
    bool clears = false;                     ///< it is no stop, but clears it
    bool counted = true;                     ///< it says how often our stops were cleared
    std::optional<fabric::Repeat> repeat{};  ///< of that one
    std::uint64_t id = 0;                    ///< 0: not in flight
    std::uint64_t overtaken_id = 0;          ///< of a clear in flight, before which a stop was asked for; 0: none
    bool cut = false;                        ///< that stop
    TimeNs next_ns = 0;
  };
  Slot& slot_of(std::size_t drone, const std::optional<crypto::IdentityName>& by);

  const std::vector<FlightDrone>& drones_;
  const crypto::IdentityName self_;
  std::vector<Slot> slots_;  ///< one for each that has stopped a drone from here
};

}  // namespace ledgerline::ground
