#pragma once
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/calls/in_flight.hpp"
#include "ground/core/flight/planner.hpp"

namespace ledgerline::ground {

/// Brings plans onto the ledger: those of all drones of an organisation in one call, since its peer endorses them; one
/// call of each organisation in flight until it is committed, or behind a gap (fabric::InFlight). What is made
/// meanwhile waits, the newest per drone; what it replaces is counted as merged. A call that is refused for one drone
/// is sent again at once without it.
///
///     put() -> waiting -> in flight -> committed: over
///                 ^           |     -> refused for one drone: that one's is over, the others wait again unless a
///                 |           |        newer plan does, or went out
///                 +-----------+     -> anything else: over, each drone's next plan says more
///
/// Deterministic; one thread.
class CommandOutbox {
 public:
  struct Slot {
    FlightDrone drone;
    FlightStatus* status = nullptr;                    ///< whose counters of commands it keeps
    std::function<void(std::uint64_t plan)> withdraw;  ///< the plan will not be flown
  };

  CommandOutbox(std::vector<Slot> slots, PlanTiming& timing, FlightTransactions& counters);

  void put(std::size_t drone, PlannedCommand command);
  void submit(TimeNs now, std::uint64_t& next_id, FlightOutputs& out);
  void on_outcome(TimeNs now, const fabric::Outcome& outcome, std::uint64_t id, FlightOutputs& out);
  /// A `command` of a block: where it is one of ours, nothing waits for its outcome any more.
  void on_block(TimeNs now, const fabric::Transaction& tx);
  /// What waits was planned under the previous lease; numbers restart.
  void begin_lease(std::size_t drone, const std::string& organisation, std::uint64_t epoch);
  /// A ground that restarted under the same lease continues after what was flown and what may be in flight.
  void continue_behind(std::size_t drone, std::uint64_t sequence);

 private:
  using Commands = std::vector<PlannedCommand>;
  struct Waiting {
    Slot slot;
    std::optional<PlannedCommand> command{};
    std::uint64_t epoch = 0;     ///< of the lease
    std::string organisation{};  ///< whose drone it is
    std::uint64_t next_sequence = 1;
  };
  std::size_t drone_of(const PlannedCommand& command) const;
  void submit_to(const std::string& organisation, TimeNs now, std::uint64_t& next_id, FlightOutputs& out);
  void resend(Commands& refused, const fabric::Outcome& outcome);
  void withdraw(const PlannedCommand& command) { drones_[drone_of(command)].slot.withdraw(command.id); }

  std::vector<Waiting> drones_;
  PlanTiming& timing_;
  FlightTransactions& counters_;
  std::map<std::string, fabric::InFlight<Commands>> in_flight_;  ///< by organisation
};

/// The record of a plan that goes out.
TraceRecord trace_of(const FlightDrone& drone, const PlannedCommand& command, TimeNs at_ns);

}  // namespace ledgerline::ground
