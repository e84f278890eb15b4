#pragma once
#include <string>

#include "common/rt/random.hpp"
#include "hil/world.hpp"

namespace ledgerline::hil {

/// Whether a Tello's state text has such a field.
bool known_field(const std::string& field);

/// Changes a state text ("...;tof:10;h:0;bat:100;...") as the fault says; the fault remembers what it needs. False: it
/// is not said at all.
bool misreport(TimeNs now, SensorFault& fault, Random& random, std::string& text);

}  // namespace ledgerline::hil
