#pragma once
#include <cstdint>

#include "hil/fault/run/result.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// Flies a script in simulated time and checks it. The same script and seed give the same result, digest included. An
/// error is one of the set-up. Many threads may do this at once, each its own run.
Result<RunResult> run_script(const Script& script, std::uint64_t seed);

}  // namespace ledgerline::hil
