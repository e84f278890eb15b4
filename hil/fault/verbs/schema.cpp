// ledgerline fault schema: what a script may be, for editors.
#include "hil/fault/kinds/fault.hpp"

#include <cstdio>

#include "hil/fault/verbs/verbs.hpp"

namespace ledgerline::hil::verbs {

Act schema(CommandLine& line) {
  Verb verb = line.verb(
      "schema", "Prints the JSON schema of a script, for editors: `#:schema ./FILE` in its first line names it");
  return {verb, [] {
            std::fputs(script_schema().c_str(), stdout);
            return 0;
          }};
}

}  // namespace ledgerline::hil::verbs
