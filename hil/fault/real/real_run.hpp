#pragma once
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/run/run.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

struct RealOptions {
  std::string programs;   ///< directory of the programs
  std::string directory;  ///< of this flight, made here: its run, metrics and logs
  RealStack stack;
  OwnCode own{};                            ///< a plug-in, or the program that flies a manual flight or one by the SDK
  const std::atomic<bool>* stop = nullptr;  ///< becomes true: the flight is ended before its time; none: it is not
  bool should_stop() const { return stop && *stop; }
};

/// Makes a flight's folder, in which none of these may be there already: they are of another flight.
Status make_flight_folder(const std::string& folder, const std::vector<std::string>& must_not_be_there);

/// Flies a script with the real processes, `ledgerline fly --proxy` (of an SDK client: fly_by_sdk), in real time,
/// and checks it by their traces. A moment comes up to a second late: that is how long traces are
/// buffered. It promises a verdict, not bytes; digest and counts of the ledger are not in the result. Errors: what
/// check_real() says, and whatever kept it from being flown or from doing what the script says. One at a time on a
/// machine; the calling thread starts the programs.
Result<RunResult> run_really(const Script& script, std::uint64_t seed, const RealOptions& options);

}  // namespace ledgerline::hil
