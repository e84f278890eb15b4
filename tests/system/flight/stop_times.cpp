// Stops drones one after the other, each by the next of the stoppers, who are connected before. The holder, where one
// is named, fights them: it acquires all drones again as fast as the ledger lets it. Prints as JSON when
// (CLOCK_MONOTONIC) each stop was submitted, and how often it was said.
#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

#include "common/base/random.hpp"
#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "tests/system/connect.hpp"

using namespace ledgerline;

int main(int argc, char** argv) {
  CLI::App app{"Stops drones one after the other"};
  std::vector<std::string> stoppers, drones;
  std::string holder;
  double gap_s = 1;
  app.add_option("--stopper", stoppers, "TOML files with [ledger]")->required();
  app.add_option("--drone", drones)->required();
  app.add_option("--holder", holder, "TOML file with [ledger]");
  app.add_option("--gap", gap_s, "Seconds between two stops, on average");
  CLI11_PARSE(app, argc, argv);
  std::vector<std::unique_ptr<fabric::Client>> clients;
  for (const std::string& path : stoppers) {
    clients.push_back(connect(path));
    (void)clients.back()->evaluate({"get", {"control/" + drones.front()}});  // connected
  }
  std::atomic<bool> quit{false};
  int fought = 0;
  std::jthread fight;
  if (!holder.empty()) {
    fight = std::jthread([&, client = std::shared_ptr<fabric::Client>(connect(holder))] {
      LeaseCall call;
      for (const std::string& drone : drones) call.add_drones(drone);
      for (std::uint32_t priority = 2; !quit; ++priority) {
        call.set_priority(priority);
        if (client->submit_and_wait({"acquire", {call.SerializeAsString()}}).kind == fabric::Outcome::Kind::committed)
          ++fought;
      }
    });
  }
  Random random(static_cast<std::uint64_t>(monotonic_ns()));
  std::string stops;
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const double wait_s = gap_s * (0.5 + static_cast<double>(random.next() % 1000) / 1000);
    std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
    const TimeNs submitted_ns = monotonic_ns();
    DronesCall call;
    call.add_drones(drones[i]);
    const int attempts = submit_until_committed(*clients[i % clients.size()], {"stop", {call.SerializeAsString()}});
    char line[160];
    std::snprintf(line, sizeof line, R"(%s{"drone": "%s", "submitted_ns": %lld, "attempts": %d})", i == 0 ? "" : ", ",
                  drones[i].c_str(), static_cast<long long>(submitted_ns), attempts);
    stops += line;
  }
  quit = true;
  if (fight.joinable()) fight.join();
  std::printf("{\"stops\": [%s], \"fought\": %d}\n", stops.c_str(), fought);
}
