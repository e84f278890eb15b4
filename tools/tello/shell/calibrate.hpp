#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"
#include "common/dds/dds.hpp"
#include "tools/checks/core/drone.hpp"
#include "tools/launcher/options.hpp"
#include "tools/tello/core/calibrate/estimate.hpp"

namespace ledgerline::tello {

struct CalibrationOptions {
  std::uint32_t address = 0;
  std::string interface;   ///< empty: wherever routes lead
  std::string pose_topic;  ///< PoseStamped on DDS; empty: none
  dds::ParticipantOptions dds;
  int repeat = 2;
};

/// Flies it (CalibrationFlight) and lands, whatever comes: what is wrong, a signal, an error of a socket. Says on the
/// log what it does. Catches SIGINT and SIGTERM. The caller has asked a person.
Result<Record> fly_calibration(const CalibrationOptions& options);

/// True where a person types yes at the terminal, or in the input.
bool has_consent();

struct PreflightOptions {
  launcher::Options flight;  ///< of a deployment of drones that are there already (options.hpp)
  std::string ledgerline;    ///< the program whose verb reads the control records of a ledger that runs already
  double listen_s = 3;       ///< to state text and poses
};

/// Asks the drones, listens to them and to motion capture, reads the ledger's records, this computer's clock: nothing
/// is flown, started for longer, or written on the ledger. What is wrong with one of them is a fact; an error: nobody
/// can look, as where another program has the port. Catches SIGINT and SIGTERM, which end it early.
Result<checks::FlightInputs> probe_flight(const PreflightOptions& options);

}  // namespace ledgerline::tello
