#include <CLI/CLI.hpp>
#include <cstdio>

#include "common/base/log.hpp"
#include "common/dds/settings/config.hpp"
#include "common/msg/onboard.hpp"
#include "sim/shell/shell.hpp"

namespace {

using namespace ledgerline;

/// `file` may be empty: as if [dds] were.
Result<dds::ParticipantOptions> read_dds(const std::string& file) {
  auto config = file.empty() ? Config::parse("", "") : Config::load(file);
  if (!config) return config.error();
  const auto options = dds::participant_options(*config, "ledgerline_sim");
  if (auto status = config->finish(); !status) return status.error();
  return options;
}

}  // namespace

int main(int argc, char** argv) {
  init_log("sim");
  sim::ShellOptions options;
  sim::Parameters& p = options.parameters;
  double virtual_s = 0, battery_percent = 100;
  std::string config;

  CLI::App app{
      "Simulated Tello drones: each speaks the Tello SDK 2.0 (UDP 8889, state to 8890) on an address of its own, and "
      "is\n"
      "seen by a motion capture system (DDS, /vrpn_mocap/tello<k>/pose). No video is sent."};
  app.footer(
      "Examples:\n"
      "  ledgerline-sim                                   tello1 at 127.0.0.2\n"
      "  ledgerline-sim --drones 3 --seed 7               127.0.0.2 to 127.0.0.4\n"
      "  ledgerline-sim --drones 16 --virtual 60          as fast as possible, prints the ratio\n"
      "Ends at SIGINT or SIGTERM. Exit: 0 ended as asked, 1 something failed, 2 bad usage.");
  app.add_option("--drones", p.drones, "how many; drone k is tello<k>")
      ->check(CLI::Range(1, static_cast<int>(max_drones)))
      ->capture_default_str();
  app.add_option("--seed", p.seed, "of wind and noise; same seed, same flight")->capture_default_str();
  app.add_option("--address", options.first_address, "of tello1; the others count up")->capture_default_str();
  app.add_option("--mocap-hz", p.mocap_hz, "poses a second on DDS; 0: none, and no DDS")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--config", config,
                 "TOML file: [dds] domain, local_only or cyclonedds, and the files of DDS Security (docs/dds.md)");
  app.add_option("--spacing", p.spacing_m, "m between drones at the start, in rows of 4")
      ->check(CLI::Range(0.3, 100.0))
      ->capture_default_str();
  app.add_option("--wind", p.wind.gust_mps, "standard deviation of gusts, m/s")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  app.add_option("--battery", battery_percent, "at the start, percent")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--trace", options.trace_file, "where the drones really are, 30 times a second (binary)");
  app.add_option("--summary", options.summary_file, "JSON at the end");
  app.add_option("--virtual", virtual_s, "simulate this many seconds as fast as possible, without sockets")
      ->check(CLI::PositiveNumber);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  p.battery.start = battery_percent / 100;
  const auto dds = read_dds(config);
  if (!dds) {
    spdlog::error("{}", dds.error().what);
    return 2;
  }
  options.dds = *dds;

  const Status ended = virtual_s > 0 ? sim::run_virtual(options, virtual_s) : sim::run_real_time(options);
  if (ended) return 0;
  spdlog::error("{}", ended.error().what);
  return 1;
}
