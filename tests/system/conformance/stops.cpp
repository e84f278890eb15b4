// Stops against everybody: those who stop, each once, while a holder stops and clears its stop and a rival takes and
// gives back the lease, each as fast as the ledger lets it. Prints as JSON what became of each stop.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <mutex>
#include <thread>

#include "common/fabric/calls/repeat.hpp"
#include "ledgerline.pb.h"
#include "tests/system/connect.hpp"

using namespace ledgerline;

namespace {

fabric::Call call_of(const std::string& function, const std::string& drone, std::uint32_t priority = 0) {
  LeaseCall call;
  call.add_drones(drone);
  if (function == "acquire") call.set_priority(priority);
  return {function, {call.SerializeAsString()}};
}

struct Said {
  int attempts = 0;
  std::uint64_t blocks = 0;  ///< from the newest block that was seen when it was first endorsed and sent to be ordered
  double ms = 0;
  bool on_ledger = false;
};

/// When each block was seen: any thread.
class Heights {
 public:
  void seen(std::uint64_t number) {
    const std::lock_guard lock(mutex_);
    blocks_.emplace_back(monotonic_ns(), number);
  }
  std::uint64_t at(TimeNs ns) const {
    const std::lock_guard lock(mutex_);
    const auto behind = std::upper_bound(blocks_.begin(), blocks_.end(), std::pair(ns, UINT64_MAX));
    return behind == blocks_.begin() ? blocks_.at(0).second : std::prev(behind)->second;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::pair<TimeNs, std::uint64_t>> blocks_;
};

Said stop(fabric::Client& client, const std::string& drone, const Heights& heights, std::uint64_t seed) {
  Said said;
  const TimeNs begun_ns = monotonic_ns();
  TimeNs first_ns = 0;
  fabric::Repeat repeat({}, seed, begun_ns);
  while (true) {
    const fabric::Outcome outcome = client.submit_and_wait(call_of("stop", drone));
    if (first_ns == 0) first_ns = outcome.endorsed_ns != 0 ? outcome.endorsed_ns : begun_ns;
    const auto next = repeat.ended(monotonic_ns(), outcome);
    if (next == fabric::Repeat::Next::again) {
      std::this_thread::sleep_for(std::chrono::nanoseconds(std::max<TimeNs>(0, repeat.at_ns() - monotonic_ns())));
      continue;
    }
    said.on_ledger = next == fabric::Repeat::Next::on_ledger;
    said.attempts = repeat.attempts();
    said.blocks = outcome.block - heights.at(first_ns);
    said.ms = to_ms(monotonic_ns() - begun_ns);
    if (!said.on_ledger) std::fprintf(stderr, "stop: %s\n", outcome.message.c_str());
    return said;
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Stops against everybody"};
  std::vector<std::string> stoppers;
  std::string holder, rival, drone;
  app.add_option("--stopper", stoppers, "TOML files with [ledger]")->required();
  app.add_option("--holder", holder)->required();
  app.add_option("--rival", rival)->required();
  app.add_option("--drone", drone)->required();
  CLI11_PARSE(app, argc, argv);

  Heights heights;
  std::atomic<bool> connected{false}, quit{false};
  std::atomic<int> disturbances{0};
  const auto watcher = connect(holder);
  const auto stream =
      watcher->blocks(std::nullopt, {[&](const fabric::Block& block, std::string_view) { heights.seen(block.number); },
                                     [&](bool up, const std::string&) { connected = up; }});
  const auto disturb = [&](const std::string& path, std::vector<std::string> functions) {
    return std::jthread([&, functions, client = std::shared_ptr<fabric::Client>(connect(path))] {
      for (std::uint32_t turn = 1; !quit; ++turn) {
        const auto outcome = client->submit_and_wait(call_of(functions[turn % functions.size()], drone, turn));
        if (outcome.kind == fabric::Outcome::Kind::committed) ++disturbances;
      }
    });
  };
  std::vector<std::jthread> threads;
  threads.push_back(disturb(holder, {"stop", "clear_stop"}));
  threads.push_back(disturb(rival, {"acquire", "release"}));
  while (!connected || disturbances < 10) std::this_thread::sleep_for(std::chrono::milliseconds(5));

  std::vector<std::unique_ptr<fabric::Client>> clients;
  for (const std::string& path : stoppers) clients.push_back(connect(path));
  std::vector<Said> all(stoppers.size());
  {
    std::vector<std::jthread> stopping;
    for (std::size_t i = 0; i < stoppers.size(); ++i)
      stopping.emplace_back([&, i] { all[i] = stop(*clients[i], drone, heights, i + 1); });
  }
  quit = true;
  threads.clear();
  std::string text;
  for (const Said& said : all)
    text += fmt::format("{}{{\"on_ledger\": {}, \"attempts\": {}, \"blocks\": {}, \"ms\": {:.1f}}}",
                        text.empty() ? "" : ", ", said.on_ledger, said.attempts, said.blocks, said.ms);
  fmt::print("{{\"stops\": [{}], \"disturbances\": {}}}\n", text, disturbances.load());
}
