// Two operators fight over a drone: in turn each takes its lease with a higher priority, at a steady rate. Prints as
// JSON when (CLOCK_MONOTONIC) that was committed, and how often it was not.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <thread>

#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "tests/system/connect.hpp"

using namespace ledgerline;

int main(int argc, char** argv) {
  CLI::App app{"Two operators fight over a drone"};
  std::vector<std::string> configs;
  std::string drone;
  double hz = 10, seconds = 10;
  app.add_option("--config", configs, "TOML files with [ledger], one per operator")->required()->expected(2);
  app.add_option("--drone", drone)->required();
  app.add_option("--hz", hz, "Changes of the lease a second");
  app.add_option("--seconds", seconds);
  CLI11_PARSE(app, argc, argv);
  std::vector<std::unique_ptr<fabric::Client>> operators;
  for (const std::string& path : configs) operators.push_back(connect(path));
  std::string committed_ns;
  int others = 0;
  auto at = std::chrono::steady_clock::now();
  for (int i = 1; i <= static_cast<int>(hz * seconds); ++i) {
    at += std::chrono::microseconds(static_cast<int>(1e6 / hz));
    std::this_thread::sleep_until(at);
    LeaseCall call;
    call.add_drones(drone);
    call.set_priority(static_cast<std::uint32_t>(i + 1));
    const auto outcome =
        operators[static_cast<std::size_t>(i % 2)]->submit_and_wait({"acquire", {call.SerializeAsString()}});
    if (outcome.kind == fabric::Outcome::Kind::committed) {
      committed_ns += (committed_ns.empty() ? "" : ", ") + std::to_string(monotonic_ns());
    } else {
      ++others;
      std::fprintf(stderr, "%s\n", outcome.message.c_str());
    }
  }
  std::printf("{\"committed_ns\": [%s], \"others\": %d}\n", committed_ns.c_str(), others);
}
