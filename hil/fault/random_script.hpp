#pragma once
#include <cstdint>
#include <string>

#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// A script from the fault space: a flight of about 30 s with one to four faults, one in five with a death of link
/// behind which the drone is not seen, one in three by onboard odometry; only the invariants are checked. The same
/// number, the same script. `recording`: a file of delays that some of them have (hil/netem/distribution.hpp).
Script draw_script(std::uint64_t number, const std::string& recording = {});

}  // namespace ledgerline::hil
