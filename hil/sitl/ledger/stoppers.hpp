#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/fabric/calls/repeat.hpp"
#include "hil/sitl/ledger/ledger_port.hpp"

namespace ledgerline::hil {

/// Who speaks to the contract by a script: the operator that flies, a supervisor of the drones' organisation, an
/// outsider, who is a supervisor of another organisation, and an administrator of the operator's organisation.
enum class Stopper : std::uint8_t { operating, supervisor, outsider, administrator };
enum class ControlCommand : std::uint8_t {
  stop,
  cut,
  clear_stop,
  acquire,
  evict,
  revoke,
  request,
  hand_over,
  deny,
  claim
};

/// Those who stop drones, clear stops and take drones by a script, each as ledgerline control does: a stop is said
/// again until it is on the ledger or refused, the others over conflicts alone. An acquire is of the highest priority
/// there is, a claim of the lowest, which gets what nobody holds; it is the operator who is revoked, and the supervisor
/// to whom a drone is handed over, or denied. The operator speaks over the port that it commands by, the others each
/// over their own, which is there from their first word on. Deterministic for a seed; one thread.
class Stoppers {
 public:
  Stoppers(SimulatedLedger& ledger, LedgerPort& operating, std::uint64_t seed);

  void post(TimeNs now, Stopper who, const std::string& drone, ControlCommand word);
  /// What is due; after the ledger's step and the operator's port's.
  void step(TimeNs now);
  /// An outcome that came by the operator's port; false: not of a call made here.
  bool on_outcome(TimeNs now, const SimulatedLedger::Ended& ended);
  /// The operator's port has forgotten what was in flight.
  void forgotten(TimeNs now);
  void restart(TimeNs now);

  /// Ports of the others, for what was reported to them.
  const std::map<Stopper, std::unique_ptr<LedgerPort>>& ports() const { return ports_; }

 private:
  struct PendingCall {
    Stopper who{};
    fabric::Call call;
    fabric::Repeat repeat;
    TimeNs next_ns = 0;
    std::uint64_t id = 0;  ///< 0: not in flight
  };
  LedgerPort& port(Stopper who);
  void ended(TimeNs now, std::size_t at, const fabric::Outcome& outcome);

  SimulatedLedger& ledger_;
  LedgerPort& operating_;
  std::uint64_t seed_;
  std::map<Stopper, std::unique_ptr<LedgerPort>> ports_;
  std::vector<PendingCall> calls_;
  std::uint64_t last_id_ = std::uint64_t{1} << 62;  // ground's calls count from 1
};

}  // namespace ledgerline::hil
