#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "tests/benchmarks/grown_chain.hpp"

/// Grows the chain of a ledgerline-node that does not run.
int main(int argc, char** argv) {
  CLI::App app{
      "Grows the chain in a directory of ledgerline-node.\n\nExample:\n  grow_chain --dir DIR --height 100000"};
  std::string dir;
  std::uint64_t height = 0;
  app.add_option("--dir", dir, "Of a node that does not run, or a new one")->required();
  app.add_option("--height", height, "Of the chain, afterwards")->required();
  CLI11_PARSE(app, argc, argv);
  fmt::print("{}\n", ledgerline::grown::grow(dir, height));
}
