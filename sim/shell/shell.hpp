#pragma once
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.hpp"
#include "common/dds/dds.hpp"
#include "common/program/command_line.hpp"
#include "sim/core/parameters.hpp"
#include "sim/shell/drone_sockets.hpp"

namespace ledgerline::sim {

struct ShellOptions {
  Parameters parameters;
  std::string first_address = "127.0.0.2";
  int first_name = 1;             ///< drone k is tello<first_name + k - 1>
  dds::ParticipantOptions dds{};  ///< of mocap
  std::string trace_file;         ///< empty: none
  std::string summary_file;       ///< empty: none
};

/// Real time: UDP, mocap on DDS, truth traced 30 times a second; until SIGINT or SIGTERM.
Status run_real_time(const ShellOptions& options);
/// The same over another wire, which `open` makes once the signals are blocked that threads inherit. `ready` is printed
/// as the first line.
using OpenWire = std::function<Result<std::unique_ptr<DroneWire>>()>;
Status run_real_time(const ShellOptions& options, const OpenWire& open, const std::string& ready);

/// As fast as possible, without sockets and DDS: all drones take off and fly circles for `seconds` of simulated time.
/// Prints one JSON object: {"drones","simulated_s","wall_s","ratio"}.
Status run_simulated_time(const ShellOptions& options, double seconds);

/// What a command line says of simulated drones, until read() has put it into `shell`.
class SimOptions {
 public:
  ShellOptions shell;

  /// This object must outlive the parsing.
  void add_to(Arguments& arguments);
  /// After the parsing; an error is one of usage.
  Status read();

 private:
  double battery_percent_ = 100, yaw_deg_ = 0, light_percent_ = 100, floor_percent_ = 100;
  std::string config_, pads_;
};

}  // namespace ledgerline::sim
