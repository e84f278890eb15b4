// Asks one peer itself, past any gateway, and prints its answer.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "tests/system/connect.hpp"

int main(int argc, char** argv) {
  CLI::App app{"Asks one peer itself"};
  std::string config, function, argument;
  app.add_option("--config", config, "TOML file with [ledger]: the peer is the one at its endpoint")->required();
  app.add_option("function", function)->required();
  app.add_option("argument", argument)->required();
  CLI11_PARSE(app, argc, argv);

  const auto client = ledgerline::connect(config);
  const auto answer = client->evaluate_at_peer({function, {argument}});
  if (!answer) {
    std::fprintf(stderr, "%s\n", answer.error().message.c_str());
    return 1;
  }
  std::fwrite(answer->data(), 1, answer->size(), stdout);
}
