#include <numbers>

#include "common/dds/settings/config.hpp"
#include "common/msg/onboard.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "sim/core/pads.hpp"
#include "sim/shell/shell.hpp"

namespace {

using namespace ledgerline;

constexpr const char* about =
    "Simulated Tello drones: each speaks the Tello SDK 2.0 (UDP 8889, state to 8890) on an address of its own, and is\n"
    "seen by a motion capture system (DDS, /vrpn_mocap/tello<k>/pose). No video is sent.";
constexpr const char* notes = R"(Examples:
  ledgerline-sim                                   tello1 at 127.0.0.2
  ledgerline-sim --drones 3 --seed 7               127.0.0.2 to 127.0.0.4
  ledgerline-sim --pads 1:0:0,2:1.5:0:90           two mission pads on the floor
  ledgerline-sim --drones 16 --virtual 60          as fast as possible, prints the ratio
Ends at SIGINT or SIGTERM. Exit: 0 ended as asked, 1 something failed, 2 bad usage.)";

}  // namespace

int main(int argc, char** argv) {
  sim::ShellOptions options;
  sim::Parameters& p = options.parameters;
  double virtual_s = 0, battery_percent = 100, yaw_deg = 0, light_percent = 100, floor_percent = 100;
  std::string config, pads;

  CommandLine line("sim", about, notes);
  line.option("--drones", p.drones, "how many; drone k is tello<k>")
      .within(1, static_cast<int>(max_drones))
      .shows_default();
  line.option("--seed", p.seed, "of wind and noise; same seed, same flight").shows_default();
  line.option("--address", options.first_address, "of tello1; the others count up").shows_default();
  line.option("--first-serial", p.sdk.first_serial, "last digits of what tello1 answers to sn?; the others count up")
      .within(1, 9000)
      .shows_default();
  line.option("--mocap-hz", p.mocap_hz, "poses a second on DDS; 0: none, and no DDS")
      .within(0.0, 1000.0)
      .shows_default();
  line.option("--config", config,
              "TOML file: [dds] domain, local_only or cyclonedds, and the files of DDS Security (docs/dds.md)");
  line.option("--spacing", p.spacing_m, "m between drones at the start, in rows of 4")
      .within(0.3, 100.0)
      .shows_default();
  line.option("--wind", p.wind.gust_mps, "standard deviation of gusts, m/s").within(0.0, 10.0).shows_default();
  line.option("--battery", battery_percent, "at the start, percent").within(0.0, 100.0).shows_default();
  line.option("--yaw", yaw_deg, "where the drones look when they are switched on, degrees counter-clockwise from x")
      .within(-360.0, 360.0)
      .shows_default();
  line.option("--pads", pads,
              "mission pads on the floor: ID:X:Y, ID:X:Y:YAW or ID:X:Y:YAW:SIZE (m, degrees), with commas");
  line.option("--light", light_percent, "percent; below 20 the drones' own velocity is lost")
      .within(0.0, 100.0)
      .shows_default();
  line.option("--floor", floor_percent, "what is to be seen on the floor, percent; below 20 the same")
      .within(0.0, 100.0)
      .shows_default();
  line.option("--trace", options.trace_file, "where the drones really are, 30 times a second (binary)");
  line.option("--summary", options.summary_file, "JSON at the end");
  line.option("--virtual", virtual_s, "simulate this many seconds as fast as possible, without sockets").positive();
  if (const auto end = line.parse(argc, argv)) return *end;
  p.battery.start = battery_percent / 100;
  p.start_yaw_rad = yaw_deg / 180 * std::numbers::pi;
  p.sensing.light = light_percent / 100;
  p.sensing.floor = floor_percent / 100;
  auto laid = sim::parse_pads(pads);
  if (!laid) return fail(laid.error(), exit_usage);
  p.pads = std::move(*laid);
  const auto dds = dds::participant_options_of(config, "ledgerline_sim");
  if (!dds) return fail(dds.error(), exit_usage);
  options.dds = *dds;
  return exit_code(virtual_s > 0 ? sim::run_virtual(options, virtual_s) : sim::run_real_time(options));
}
