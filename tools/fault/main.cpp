#include <vector>

#include "common/program/command_line.hpp"
#include "hil/fault/checker/rule.hpp"
#include "tools/command/verbs.hpp"
#include "tools/fault/verbs.hpp"

namespace {

using namespace ledgerline;
namespace verbs = ledgerline::hil::verbs;

std::string about() {
  return "Flies fault scripts in simulated time and says whether what must hold held.\n"
         "A script is a TOML file: a flight, its faults, and rules (docs/faults.md). Rules:\n" +
         hil::rule_help();
}

constexpr const char* notes = R"(Examples:
  ledgerline fault list                                    the scenarios that come with the program
  ledgerline fault run ledger-stall --seeds 1..30          one of them
  ledgerline fault new mine; ledgerline fault check mine.toml; ledgerline fault run mine.toml --html mine.html
  ledgerline fault run hil/scenarios --json new.json --jobs 2; ledgerline fault compare old.json new.json
  ledgerline fault random --seeds 1..10000 --jobs 2 --out broken

Exit codes: 0 all held; 1 a rule broke, a regression was found, or a file could not be written; 2 bad usage or a bad
script; 130 interrupted (Ctrl-C): files have what was flown until then.)";

}  // namespace

int ledgerline::command::fault(int argc, char** argv) {
  CommandLine line("ledgerline fault", about(), notes);
  std::vector<verbs::Act> acts;
  for (const auto add :
       {verbs::run, verbs::random, verbs::list, verbs::check, verbs::make_new, verbs::compare, verbs::schema})
    acts.push_back(add(line));
  if (const auto end = line.parse(argc, argv)) return *end;
  for (const verbs::Act& verb : acts) {
    if (verb.verb.is_given()) return verb.act();
  }
  return 0;  // not reached: one of them is required
}
