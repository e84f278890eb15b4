// How long a stop takes to be on the ledger, again and again, of a drone that does not fly: it is stopped, and the stop
// cleared, for so long. Prints as JSON when (CLOCK_MONOTONIC) each began, and what it took.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "tests/system/connect.hpp"

using namespace ledgerline;

int main(int argc, char** argv) {
  CLI::App app{"Gauges stops"};
  std::string config, drone;
  double seconds = 10, pause_s = 0.1;
  app.add_option("--config", config, "TOML file with [ledger], of an operator")->required();
  app.add_option("--drone", drone, "That does not fly")->required();
  app.add_option("--seconds", seconds);
  app.add_option("--pause", pause_s, "Between two stops");
  CLI11_PARSE(app, argc, argv);
  const auto client = connect(config);
  DronesCall call;
  call.add_drones(drone);
  const auto submit = [&](const char* function) {
    return submit_until_committed(*client, {function, {call.SerializeAsString()}}) > 0;
  };
  nlohmann::json stops = nlohmann::json::array();
  int failed = 0;
  for (const TimeNs end_ns = monotonic_ns() + from_seconds(seconds); monotonic_ns() < end_ns;) {
    const TimeNs begin_ns = monotonic_ns();
    if (submit("stop")) {
      stops.push_back({{"at_ns", begin_ns}, {"ms", to_ms(monotonic_ns() - begin_ns)}});
    } else {
      ++failed;
    }
    submit("clear_stop");
    std::this_thread::sleep_for(std::chrono::duration<double>(pause_s));
  }
  std::puts(nlohmann::json{{"stops", stops}, {"failed", failed}}.dump().c_str());
}
