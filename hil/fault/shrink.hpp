#pragma once
#include <functional>

#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// The shortest script that still fails: faults left out, laps, drones and durations made less, as long as `fails` says
/// so. Calls it at most `max_tries` times. `script` itself must fail.
Script shrink(Script script, const std::function<bool(const Script&)>& fails, int max_tries = 200);

}  // namespace ledgerline::hil
