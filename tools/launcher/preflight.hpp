#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "tools/checks/core/drone.hpp"
#include "tools/launcher/options.hpp"

namespace ledgerline::launcher {

/// Where the simulator puts its drones, m in `map`.
std::vector<Eigen::Vector2d> simulated_starts(const Options& options);

/// An error names the path's first point beyond the fence, from where each drone starts.
Status check_path(const Options& options, const link::FenceSettings& fence, const std::vector<Eigen::Vector2d>& starts);

/// What a deployment says beforehand of its own drones, none of which has been heard yet. Without drones of one's own
/// there are none.
checks::PreflightInputs inputs_of(const Options& options);

/// An error: the path would leave the fence from where the drones stand. While a drone's place is not known none is
/// seen.
Status check_path(const Options& options, const checks::PreflightInputs& inputs);

/// Fills in each drone's lease from a line that `ledgerline control show --json` printed of all records; a drone that
/// is in none of them is not enrolled. `self`: who will fly. Another line is an error, and changes nothing.
Status read_records(const std::string& line, const crypto::IdentityName& self, checks::PreflightInputs& inputs);

/// What a person checks before a deployment's own drones take off, by link's status lines and the ledger's records. One
/// thread.
class Preflight {
 public:
  /// Without drones of one's own it knows of none.
  explicit Preflight(const Options& options);

  /// A status line of link; others are ignored.
  void on_status(const std::string& line);
  /// The records of a ledger of others, as `ledgerline control show --json` prints them, before the drones are
  /// acquired. `self`: who acquires them.
  Status read_records(const std::string& line, const crypto::IdentityName& self);
  /// Whether a drone has to be acquired: not where its holder lets us command it.
  bool acquires(const std::string& drone) const;
  /// Whether somebody holds it by those records: where it has to be acquired, we do.
  bool is_held(const std::string& drone) const;
  /// The ledger gave us the leases of those.
  void acquired();
  void set_clock(const checks::ClockInputs& clock) { inputs_.clock = clock; }

  /// Whether link would let every drone take off; else what is broken, and its cure.
  Status ready() const;
  /// Whether waiting may make it so: no battery becomes fuller.
  bool can_become_ready() const;
  /// Drones, addresses, batteries, poses, leases, the fence, the clocks and the ledger, one a line, with cures.
  std::string list() const;
  /// Whether the path stays within the fence from where the drones stand.
  Status path_fits() const;
  /// Whether agent and ground wait long enough for the blocks of a network of others.
  Status blocks_fit() const { return check(inputs_.blocks); }
  /// Whether every drone can be acquired; else who holds it, and the cure.
  Status leases_fit() const;

 private:
  Options options_;
  checks::PreflightInputs inputs_;  ///< drones in the order of the file
};

}  // namespace ledgerline::launcher
