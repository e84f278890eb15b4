#pragma once
#include <string>

#include "hil/fault/own/own_code.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/run/run.hpp"

namespace ledgerline::hil {

struct RealOptions {
  std::string programs;   ///< directory of the programs
  std::string directory;  ///< of this flight, made here: its run, figures and logs
  RealStack stack;
  OwnCode own{};  ///< a plug-in, or the program that flies a manual flight or one by the SDK
};

/// Flies a script with the real processes, `ledgerline-fly --proxy` (of an SDK client: hil/fault/own/sdk_flight.hpp),
/// in real time, and checks it by their traces. A moment comes up to a second late: that is how long traces are
/// buffered. It promises a verdict, not bytes; digest and counts of the ledger are not in the result. Errors: what
/// check_real() says, and whatever kept it from being flown or from doing what the script says. One at a time on a
/// machine; the calling thread starts the programs.
Result<RunResult> run_really(const Script& script, std::uint64_t seed, const RealOptions& options);

}  // namespace ledgerline::hil
