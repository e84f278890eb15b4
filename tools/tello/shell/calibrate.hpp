#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"
#include "common/dds/dds.hpp"
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

}  // namespace ledgerline::tello
