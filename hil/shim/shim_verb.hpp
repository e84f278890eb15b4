#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/program/command_line.hpp"
#include "sim/shell/sim_options.hpp"

namespace ledgerline::hil::shim {

/// `ledgerline hil shim`: its options, and what they do. Must outlive the parsing.
class ShimVerb {
 public:
  static const char* const about;

  explicit ShimVerb(Verb verb);
  bool is_given() const { return verb_.is_given(); }
  /// The exit code.
  int run();

 private:
  Status read();
  int fly_by_script();

  Verb verb_;
  sim::SimOptions drones_;
  std::string memory_, address_, plans_, faults_file_, faults_socket_, datagrams_, lockstep_;
  double times_ = 1;
};

}  // namespace ledgerline::hil::shim
