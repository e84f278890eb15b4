#include <cstdio>

#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/configuration/config_file.hpp"

namespace {

using namespace ledgerline;

constexpr const char* about =
    "Prints every key of every program's config with type, unit, default, range and reason, as Markdown.";
constexpr const char* notes = R"(Examples:
  ledgerline configuration agent
  ledgerline configuration > docs/configuration.md
Exit codes: 0 printed; 2 no such part)";

}  // namespace

int ledgerline::command::configuration(int argc, char** argv) {
  CommandLine line("ledgerline configuration", about, notes);
  std::string name;
  line.option("PART", name, "this part alone, such as link or \"The ledger\"");
  if (const auto exit_code = line.parse(argc, argv)) return *exit_code;
  if (name.empty()) {
    std::fputs(configuration::page().c_str(), stdout);
    return 0;
  }
  std::string known;
  for (const configuration::Part& part : configuration::parts()) {
    if (part.name == name) {
      std::fputs(configuration::show(part).c_str(), stdout);
      return 0;
    }
    known += (known.empty() ? "" : ", ") + part.name;
  }
  spdlog::error("there is no part \"{}\": {}", name, known);
  return exit_usage;
}
