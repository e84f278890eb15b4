#include "sim/shell/sim_options.hpp"

#include <numbers>

#include "common/dds/settings/config.hpp"
#include "common/msg/onboard.hpp"
#include "sim/core/pads.hpp"

namespace ledgerline::sim {

void SimOptions::add_to(Arguments& arguments) {
  Parameters& p = shell.parameters;
  arguments.option("--drones", p.drones, "how many; drone k is tello<k>")
      .within(1, static_cast<int>(max_drones))
      .shows_default();
  arguments
      .option("--first-name", shell.first_name,
              "number in the first drone's name, for several simulators with drones of one ledger; addresses stay")
      .within(1, 10'000)
      .shows_default();
  arguments.option("--seed", p.seed, "of wind and noise; same seed, same flight").shows_default();
  arguments
      .option("--first-serial", p.sdk.first_serial, "last digits of what tello1 answers to sn?; the others count up")
      .within(1, 9000)
      .shows_default();
  arguments.option("--mocap-hz", p.mocap_hz, "poses a second on DDS; 0: none, and no DDS")
      .within(0.0, 1000.0)
      .shows_default();
  arguments.option("--config", config_,
                   "TOML file: [dds] domain, local_only or cyclonedds, and the files of DDS Security (docs/ros2.md)");
  arguments.option("--spacing", p.spacing_m, "m between drones at the start, in rows of 4")
      .within(0.3, 100.0)
      .shows_default();
  arguments.option("--wind", p.wind.gust_mps, "standard deviation of gusts, m/s").within(0.0, 10.0).shows_default();
  arguments.option("--battery", battery_percent_, "at the start, percent").within(0.0, 100.0).shows_default();
  arguments
      .option("--yaw", yaw_deg_, "where the drones look when they are switched on, degrees counter-clockwise from x")
      .within(-360.0, 360.0)
      .shows_default();
  arguments.option("--pads", pads_,
                   "mission pads on the floor: ID:X:Y, ID:X:Y:YAW or ID:X:Y:YAW:SIZE (m, degrees), with commas");
  arguments.option("--light", light_percent_, "percent; below 20 the drones' own velocity is lost")
      .within(0.0, 100.0)
      .shows_default();
  arguments.option("--floor", floor_percent_, "what is to be seen on the floor, percent; below 20 the same")
      .within(0.0, 100.0)
      .shows_default();
  arguments.option("--trace", shell.trace_file, "where the drones really are, 30 times a second (binary)");
  arguments.option("--summary", shell.summary_file, "JSON at the end");
}

Status SimOptions::read() {
  Parameters& p = shell.parameters;
  p.battery.start = battery_percent_ / 100;
  p.start_yaw_rad = yaw_deg_ / 180 * std::numbers::pi;
  p.sensing.light = light_percent_ / 100;
  p.sensing.floor = floor_percent_ / 100;
  auto laid = parse_pads(pads_);
  if (!laid) return laid.error();
  p.pads = std::move(*laid);
  const auto dds = dds::participant_options_of(config_, "ledgerline_sim");
  if (!dds) return dds.error();
  shell.dds = *dds;
  return done;
}

}  // namespace ledgerline::sim
