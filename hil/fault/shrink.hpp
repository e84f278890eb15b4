#pragma once
#include <functional>

#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// A shorter script that still fails: faults left out, laps and durations made less, all drones but one left out, each
/// as long as `fails` says so, which is asked at most `max_tries` times. `script` itself must fail.
Script shrink(Script script, const std::function<bool(const Script&)>& fails, int max_tries = 200);

}  // namespace ledgerline::hil
