#pragma once
#include <string>

#include "common/program/command_line.hpp"
#include "sim/shell/shell.hpp"

namespace ledgerline::sim {

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
