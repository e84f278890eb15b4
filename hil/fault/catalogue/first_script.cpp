#include "hil/fault/catalogue/first_script.hpp"

#include <fmt/format.h>

namespace ledgerline::hil {
namespace {

constexpr const char* first_script_text = R"(# One flight, what goes wrong in it, and what must hold.
#   ledgerline fault check {0}.toml                        what is wrong with this file, by line
#   ledgerline fault run {0}.toml                          one flight; --seeds 1..30 --jobs 2: thirty
#   ledgerline fault list faults                           what can go wrong; `list rules`: what can be demanded
# An editor that knows schemas: `ledgerline fault schema > fault.schema.json`, and this as the first line here:
#   #:schema ./fault.schema.json

title = "{0}: the ledger orders nothing for 3 s; the drone holds, then flies on"

# Each a sentence that the run must keep; what every run must keep besides needs no words.
must = [
  "finishes",
  "hold is seen",
  "resumes within 2 s",
  "nothing acknowledged is lost",
]

# What differs from the usual flight: one drone, a square of 1.5 m a side at 0.5 m/s.
[flight]
speed_mps = 0.8
laps = 2

# As many of these as wanted. `at`: a time of the run, or takeoff, flying, path, "lap 2", "height 0.5", landing, landed,
# each with "+ 2s" behind it if wanted. Without `for` it lasts to the end.
[[fault]]
what = "ledger stall"
at = "path + 3s"
for = "3s"

#[[fault]]
#what = "drone tello1 to delay gamma 50ms 20ms, loss 5%"
#at = "takeoff"
)";

}  // namespace

std::string first_script(const std::string& name) { return fmt::format(fmt::runtime(first_script_text), name); }

}  // namespace ledgerline::hil
