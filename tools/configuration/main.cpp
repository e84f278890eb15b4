#include <CLI/CLI.hpp>
#include <cstdio>

#include "tools/configuration/reference.hpp"

int main(int argc, char** argv) {
  using namespace ledgerline;
  std::string name;
  CLI::App app{"Prints every key of every program's config with type, unit, default, range and reason, as Markdown.",
               "ledgerline-configuration"};
  app.footer(
      "Examples:\n  ledgerline-configuration agent\n  ledgerline-configuration > docs/configuration.md\n"
      "Exit codes: 0 printed; 2 no such part");
  app.add_option("PART", name, "this part alone, such as link or \"The ledger\"");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
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
  std::fprintf(stderr, "there is no part \"%s\": %s\n", name.c_str(), known.c_str());
  return 2;
}
