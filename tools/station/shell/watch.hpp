#pragma once
#include <string>

#include "common/rt/clock.hpp"

namespace ledgerline::station {

/// Prints a table, on a terminal in the place of what was there.
void print_refreshed(const std::string& text);
/// Sleeps; less when a signal asks to end.
void rest(TimeNs duration_ns);
/// "14:05:09" of the ground's clock, by this computer's.
std::string time_of_day(double t_ms, double now_ms);

}  // namespace ledgerline::station
