#include "sim/shell/shell.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <cstdio>
#include <numbers>
#include <optional>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/dds/dds.hpp"
#include "common/msg/onboard.hpp"
#include "common/msg/ros.hpp"
#include "common/program/program.hpp"
#include "common/rt/trace.hpp"
#include "sim/core/sensors.hpp"
#include "sim/core/simulator.hpp"
#include "sim/shell/drone_sockets.hpp"

namespace ledgerline::sim {
namespace {

constexpr TimeNs trace_period = ns_per_s / 30;
// A late step is made up for at once; one this late is worth a word, since clients then see a drone that jumps.
constexpr TimeNs late_to_tell = 50 * ns_per_ms;

std::string drone_name(const ShellOptions& options, int number) {
  return fmt::format("tello{}", options.first_name + number - 1);
}

/// Mocap as vrpn_mocap publishes it.
class MocapOutput {
 public:
  static Result<MocapOutput> open(const ShellOptions& options) {
    auto participant = dds::Participant::create(options.dds);
    if (!participant) return participant.error();
    MocapOutput output(options);
    for (int k = 1; k <= options.parameters.drones; ++k) {
      auto publisher = dds::RawWriter::create(*participant, "/vrpn_mocap/" + drone_name(options, k) + "/pose",
                                              std::string(pose_type), {});
      if (!publisher) return publisher.error();
      output.publishers_.push_back(std::move(*publisher));
    }
    return output;
  }

  void publish(const MocapPose& pose) {
    message_.header.stamp_ns = pose.stamp_ns + (realtime_ns() - monotonic_ns());
    message_.position_m = pose.position_m;
    message_.orientation = pose.orientation;
    const auto sent = publishers_[pose.drone - 1u].publish(to_cdr(message_));
    if (!sent && !warned_) {
      spdlog::warn("mocap of {}: {}", drone_name(options_, pose.drone), sent.error().message);
      warned_ = true;
    }
  }

 private:
  explicit MocapOutput(const ShellOptions& options) : options_(options) { message_.header.frame_id = "map"; }
  ShellOptions options_;
  std::vector<dds::RawWriter> publishers_;
  PoseStamped message_;
  bool warned_ = false;
};

/// What is written down of a run: truth in the trace, and the summary.
class Record {
 public:
  Status open(const ShellOptions& options) {
    options_ = options;
    flew_.assign(static_cast<std::size_t>(options.parameters.drones), false);
    if (options.trace_file.empty()) return done;
    auto trace = TraceWriter::create(options.trace_file);
    if (!trace) return trace.error();
    trace_.emplace(std::move(*trace));
    return done;
  }

  void look(const Simulator& simulator, TimeNs now) {
    if (now < next_) return;
    next_ = now + trace_period;
    for (int k = 1; k <= simulator.drones(); ++k) {
      const Truth truth = simulator.truth(static_cast<DroneNumber>(k));
      if (truth.in_flight) flew_[static_cast<std::size_t>(k - 1)] = true;
      if (!trace_) continue;
      TraceRecord record;
      record.t_ns = now;
      record.kind = TraceKind::truth;
      record.drone = static_cast<std::uint16_t>(k);
      record.extra = truth.crashed ? 2 : truth.in_flight ? 1 : 0;
      for (std::size_t i = 0; i < 3; ++i) record.v[i] = truth.position_m[i];
      record.v[3] = truth.yaw_rad;
      trace_->add(record);
    }
  }

  Status close(const Simulator& simulator, TimeNs max_late, const DroneWire* wire) {
    if (trace_) {
      if (auto flushed = trace_->flush(); !flushed) return flushed;
      if (trace_->dropped() > 0) spdlog::warn("the trace was full: {} records are not in it", trace_->dropped());
    }
    if (options_.summary_file.empty()) return done;
    nlohmann::json drones = nlohmann::json::array();
    for (int k = 1; k <= simulator.drones(); ++k) {
      const Truth truth = simulator.truth(static_cast<DroneNumber>(k));
      const bool flew = flew_[static_cast<std::size_t>(k - 1)];
      drones.push_back({{"name", drone_name(options_, k)},
                        {"flew", flew},
                        {"landed", flew && !truth.motors_on && !truth.crashed},
                        {"crashed", truth.crashed},
                        {"battery", truth.battery}});
    }
    nlohmann::json summary{{"drones", drones}, {"max_late_ms", to_ms(max_late)}, {"unsent", wire ? wire->unsent() : 0}};
    if (wire) wire->report_to(summary);
    return write_file(options_.summary_file, summary.dump(2) + "\n");
  }

 private:
  std::optional<TraceWriter> trace_;
  ShellOptions options_;
  std::vector<bool> flew_;
  TimeNs next_ = 0;
};

void print_line(const nlohmann::json& json) {
  std::puts(json.dump().c_str());
  std::fflush(stdout);
}

}  // namespace

Status run_real_time(const ShellOptions& options) {
  const auto address = parse_ipv4(options.first_address);
  if (!address) return address.error();
  const nlohmann::json ready{
      {"ready", true}, {"drones", options.parameters.drones}, {"address", options.first_address}};
  const auto open = [&]() -> Result<std::unique_ptr<DroneWire>> {
    auto sockets = DroneSockets::open(*address, options.parameters.drones);
    if (!sockets) return sockets.error();
    spdlog::info("{} drone(s) from {}:{}, mocap {} Hz; no video is sent", options.parameters.drones,
                 options.first_address, command_port, options.parameters.mocap_hz);
    return std::unique_ptr<DroneWire>(std::make_unique<DroneSockets>(std::move(*sockets)));
  };
  return run_real_time(options, open, ready.dump());
}

Status run_real_time(const ShellOptions& options, const OpenWire& open, const std::string& ready) {
  const sigset_t waiting = catch_stop_signals_while_waiting();  // before DDS's threads, which inherit the mask
  auto made = open();
  if (!made) return made.error();
  DroneWire& wire = **made;
  std::optional<MocapOutput> mocap;
  if (options.parameters.mocap_hz > 0) {
    auto opened = MocapOutput::open(options);
    if (!opened) return opened.error();
    mocap.emplace(std::move(*opened));
  }
  Record record;
  if (auto opened = record.open(options); !opened) return opened;

  TimeNs tick = monotonic_ns();
  Simulator simulator(options.parameters, tick);
  std::puts(ready.c_str());
  std::fflush(stdout);
  TimeNs max_late = 0;
  bool logged_late = false;
  DroneWire::Received received;
  while (!stop_requested) {
    tick += ns_per_ms;
    bool due = false;
    while (!due && !stop_requested) {
      wire.wait(tick, waiting);
      const TimeNs now = monotonic_ns();
      due = now >= tick;
      while (wire.receive(received)) simulator.datagram(received.drone, received.from, received.bytes);
      const auto& output = simulator.step(now);
      for (const Outgoing& datagram : output.datagrams) wire.send(datagram);
      if (mocap)
        for (const MocapPose& pose : output.poses) mocap->publish(pose);
      if (!due) continue;
      record.look(simulator, now);
      max_late = std::max(max_late, now - tick);
      if (now - tick > late_to_tell && !logged_late) {
        spdlog::warn("the simulation ran {:.0f} ms late and caught up: this machine is too busy for real time",
                     to_ms(now - tick));
        logged_late = true;
      }
      if (now - tick > ns_per_ms) tick = now - (now - tick) % ns_per_ms;
    }
  }
  return record.close(simulator, max_late, &wire);
}

Status run_simulated_time(const ShellOptions& options, double seconds) {
  Record record;
  if (auto opened = record.open(options); !opened) return opened;
  Simulator simulator(options.parameters, 0);
  const TimeNs began = monotonic_ns();
  const TimeNs end = from_seconds(seconds);
  const auto to_all = [&](std::string_view text) {
    for (int k = 1; k <= simulator.drones(); ++k)
      simulator.datagram(static_cast<DroneNumber>(k), {1, command_port}, text);
  };
  to_all("command");
  to_all("takeoff");
  constexpr TimeNs rc_period = 50 * ns_per_ms;
  TimeNs next_rc = 0;
  for (TimeNs now = 0; now < end; now += ns_per_ms) {
    if (now >= next_rc) {
      next_rc += rc_period;
      to_all("rc 0 40 0 40");
    }
    simulator.step(now);
    record.look(simulator, now);
  }
  const double wall_s = to_seconds(monotonic_ns() - began);
  print_line(
      {{"drones", simulator.drones()}, {"simulated_s", seconds}, {"wall_s", wall_s}, {"ratio", seconds / wall_s}});
  return record.close(simulator, 0, nullptr);
}

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
  arguments.option("--pads", pads_, "mission pads on the floor: ID:X:Y[:DEGREES[:SIZE]] (SIZE in m), with commas");
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
