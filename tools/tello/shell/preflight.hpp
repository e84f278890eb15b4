#pragma once
#include <string>

#include "common/base/result.hpp"
#include "tools/checks/core/drone.hpp"
#include "tools/launcher/options.hpp"

namespace ledgerline::tello {

struct PreflightOptions {
  launcher::Options flight;  ///< of a deployment of drones that are there already (options.hpp)
  std::string ledgerline;    ///< the program whose verb reads the control records of a ledger that runs already
  double listen_s = 3;       ///< to state text and poses
};

/// Asks the drones, listens to them and to motion capture, reads the ledger's records, this computer's clock: nothing
/// is flown, started for longer, or written on the ledger. What is wrong with one of them is a fact; an error: nobody
/// can look, as where another program has the port. Catches SIGINT and SIGTERM, which end it early.
Result<checks::PreflightInputs> probe_flight(const PreflightOptions& options);

}  // namespace ledgerline::tello
