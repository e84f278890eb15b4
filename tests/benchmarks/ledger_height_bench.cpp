#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/fabric/client/client.hpp"
#include "tests/benchmarks/grown_chain.hpp"
#include "tests/unit/child.hpp"

/// What a long chain costs ledgerline-node: time to start, memory, bytes; and what it does to the latency, against a
/// node with a short chain that is asked in turns.
namespace {

using namespace ledgerline;
using namespace ledgerline::grown;
namespace fs = std::filesystem;

struct Running {
  Child process;
  std::unique_ptr<fabric::Client> client;
  double start_s = 0;
  std::vector<double> medians_ms;

  void start(const std::string& program, const std::string& dir) {
    const TimeNs begin = monotonic_ns();
    if (!process.start({program, "--dir", dir, "--listen", "127.0.0.1:0"})) give_up("the node does not start");
    start_s = to_seconds(monotonic_ns() - begin);
    fabric::ClientConfig config;
    config.endpoint = nlohmann::json::parse(process.ready_line())["endpoint"];
    config.tls_ca_file = dir + organisation + "/tlsca/tlsca.org1.ledgerline-cert.pem";
    config.identity = user_of(dir);
    auto made = fabric::Client::create(std::move(config));
    if (!made) give_up(made.error().message);
    client = std::move(*made);
  }

  /// A turn of calls, one after the other; keeps their median.
  void turn(int calls) {
    std::vector<double> took_ms;
    for (int i = 0; i < calls; ++i) {
      const TimeNs begin = monotonic_ns();
      const auto outcome = client->submit_and_wait(state_of_a_drone());
      if (outcome.kind != fabric::Outcome::Kind::committed) give_up(outcome.message);
      took_ms.push_back(to_ms(monotonic_ns() - begin));
    }
    std::nth_element(took_ms.begin(), took_ms.begin() + calls / 2, took_ms.end());
    medians_ms.push_back(took_ms[static_cast<std::size_t>(calls / 2)]);
  }
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Start-up, memory and latency of ledgerline-node with a short and a long chain.\n\nExample:\n"
      "  bench_ledger_height --node build/release/bin/ledgerline-node --dir /var/tmp/height"};
  std::string program, dir;
  std::uint64_t low = 100, high = 100'000;
  int turns = 40, calls = 50;
  app.add_option("--node", program, "ledgerline-node")->required()->check(CLI::ExistingFile);
  app.add_option("--dir", dir, "Where the chains are made, and left")->required();
  app.add_option("--low", low, "Height of the short chain")->capture_default_str();
  app.add_option("--high", high, "Height of the long chain")->capture_default_str();
  app.add_option("--turns", turns, "How often the two take turns")->capture_default_str();
  app.add_option("--calls", calls, "Transactions a turn")->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  Running short_chain, long_chain;
  for (auto [running, name, height] : {std::tuple{&short_chain, "short", low}, std::tuple{&long_chain, "long", high}}) {
    const std::string where = dir + "/" + name;
    const std::uint64_t blocks = grow(where, height);
    running->start(program, where);
    fmt::print("{:>7} blocks: ready after {:.2f} s, {:.0f} MB resident, {} bytes a transaction on disk\n", blocks,
               running->start_s, running->process.resident_mb(), fs::file_size(where + "/ledger/blocks") / blocks);
  }
  // Both grow as they are asked, so the short one is short only at first.
  short_chain.turn(20);
  long_chain.turn(20);
  short_chain.medians_ms.clear();
  long_chain.medians_ms.clear();
  std::vector<double> ratios;
  for (int i = 0; i < turns; ++i) {
    Running& first = i % 2 == 0 ? short_chain : long_chain;
    Running& second = i % 2 == 0 ? long_chain : short_chain;
    first.turn(calls);
    second.turn(calls);
    ratios.push_back(long_chain.medians_ms.back() / short_chain.medians_ms.back());
  }
  std::sort(ratios.begin(), ratios.end());
  fmt::print("submit to commit status, median of {} turns of {} calls: {:.2f} ms short, {:.2f} ms long\n", turns, calls,
             median(short_chain.medians_ms), median(long_chain.medians_ms));
  fmt::print("ratio long/short, turn by turn: median {:.3f} (quartiles {:.3f} to {:.3f})\n", median(ratios),
             ratios[ratios.size() / 4], ratios[ratios.size() * 3 / 4]);
}
