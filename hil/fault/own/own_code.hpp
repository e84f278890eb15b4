#pragma once
#include <string>
#include <vector>

#include "hil/fault/script.hpp"

// Somebody's own code in a fault run (docs/own-code.md).
namespace ledgerline::hil {

/// What is under test besides Ledgerline. Empty: nothing.
struct OwnCode {
  std::string controller;            ///< file: a plug-in in the place of ground's controller
  std::vector<std::string> program;  ///< command: a client of the SDK, or one that speaks to a drone's topics
};

/// The words of a command line, as a shell would take them: blanks part them, single and double quotes keep them
/// together, \ takes a character as it is; nothing is expanded. The error says which quote has no end.
Result<std::vector<std::string>> words_of_command(const std::string& line);

/// Where a program is that a command line names: as it is where it has a slash, else in PATH. The error says so.
Result<std::string> program_at(const std::string& name);

/// Why this script cannot be flown in simulated time: nobody is there who flies it.
Status check_sitl(const Script& script);

/// Whether this script can be flown with that code, and puts a controller into it. Errors name the script.
Status put_into(Script& script, const OwnCode& own);

}  // namespace ledgerline::hil
