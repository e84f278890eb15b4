#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/dds/dds.hpp"
#include "sim/core/parameters.hpp"

namespace ledgerline::sim {

struct ShellOptions {
  Parameters parameters;
  std::string first_address = "127.0.0.2";
  dds::ParticipantOptions dds{};  ///< of mocap
  std::string trace_file;         ///< empty: none
  std::string summary_file;       ///< empty: none
};

/// Real time: sockets, mocap on DDS, truth traced 30 times a second; until SIGINT or SIGTERM.
Status run_real_time(const ShellOptions& options);

/// As fast as possible, without sockets and DDS: all drones take off and fly circles for `seconds` of simulated time.
/// Prints one JSON object: {"drones","virtual_s","wall_s","ratio"}.
Status run_virtual(const ShellOptions& options, double seconds);

}  // namespace ledgerline::sim
