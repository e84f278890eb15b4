#pragma once
#include <string>

#include "common/config/config.hpp"
#include "ground/core/flight.hpp"

namespace ledgerline::ground {

struct OutputSettings {
  std::string trace;                          ///< file; empty: none
  std::string summary;                        ///< file; empty: none
  TimeNs status_period_ns = 250 * ns_per_ms;  ///< JSON lines on standard output; 0: none
};

/// Reads [flight] and [[drone]]; what is wrong comes with config.finish().
FlightConfig flight_config(Config& config);
/// Reads [output].
OutputSettings output_settings(Config& config);

/// The status line and the summary, as JSON text.
std::string status_line(const FlightCore& core);
std::string summary(const FlightCore& core);

}  // namespace ledgerline::ground
