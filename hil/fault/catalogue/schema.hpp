#pragma once
#include <string>

namespace ledgerline::hil {

/// JSON Schema (draft 7) of a fault script, for editors and other programs: its keys as the reader of scripts asks for
/// them, its faults, moments and rules as their tables have them. A script that parse_script() takes is valid; one that
/// is valid may still be wrong in what no schema can say, such as a drone that does not fly.
std::string script_schema();

}  // namespace ledgerline::hil
