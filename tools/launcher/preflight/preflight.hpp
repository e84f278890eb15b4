#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "tools/launcher/options.hpp"
#include "tools/launcher/preflight/check.hpp"

namespace ledgerline::fly {

/// What a deployment says beforehand of its own drones, none of which has been heard yet. Without drones of one's own
/// there are none.
Facts facts_of(const Options& options);

/// Why the path would leave the fence from where the drones stand; empty: it does not, there is none, or a drone's
/// place is not known yet.
std::string path_beyond(const Options& options, const Facts& facts);

/// What a person checks before a deployment's own drones take off, by link's status lines and the ledger's records. One
/// thread.
class Preflight {
 public:
  /// Without drones of one's own it knows of none.
  explicit Preflight(const Options& options);

  /// A status line of link; others are ignored.
  void take(const std::string& line);
  /// The records of a ledger of others, as `ledgerline-control show --json` prints them, before the drones are
  /// acquired. `self`: who acquires them.
  Status take_records(const std::string& line, const crypto::IdentityName& self);
  /// Whether a drone has to be acquired: not where its holder lets us command it.
  bool acquires(const std::string& drone) const;
  /// The ledger gave us the leases of those.
  void acquired();
  void take_clock(const ClockFacts& clock) { facts_.clock = clock; }

  /// Link would let every drone take off.
  bool ready() const;
  /// Drones, addresses, batteries, poses, leases, the fence, the clocks and the ledger, one a line, with cures.
  std::string list() const;
  /// What is bad, and its cure, for an error; empty: ready.
  std::string missing() const;
  /// Whether the path stays within the fence from where the drones stand.
  Status path_fits() const;
  /// Whether every drone can be acquired; else who holds it, and the cure.
  Status leases_fit() const;

 private:
  Options options_;
  Facts facts_;  ///< drones in the order of the file
};

}  // namespace ledgerline::fly
