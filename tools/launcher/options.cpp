#include "tools/launcher/options.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <sstream>

#include "common/msg/onboard.hpp"
#include "ground/shell/course_file.hpp"
#include "onboard/link/core/settings.hpp"
#include "sim/core/parameters.hpp"
#include "tools/launcher/configs.hpp"

namespace ledgerline::fly {
namespace {

constexpr int exit_usage = 2;

std::string check_duration(const std::string& text) {
  const auto duration = parse_duration(text);
  return duration ? "" : duration.error().what;
}

// Where the simulator puts drones: rows of four.
Eigen::Vector2d start_of(int drone) {
  const sim::Parameters sim;
  return sim.spacing_m * Eigen::Vector2d((drone - 1) % sim.columns, (drone - 1) / sim.columns);
}

// The path's first point that a drone would not reach; empty: none.
std::string beyond_fence(const Options& o) {
  const link::FenceSettings fence;
  const auto least = Eigen::Vector3d::Map(fence.min_m.data()), most = Eigen::Vector3d::Map(fence.max_m.data());
  const bool own = !o.waypoints.empty();
  const auto points = own ? o.waypoints : motion::waypoints_of(o.shape, o.side_m);
  for (int k = 1; k <= o.drones; ++k) {
    for (const ground::Waypoint& point : points) {
      const Eigen::Vector2d at = start_of(k) + point.at_m;
      const Eigen::Vector3d place(at.x(), at.y(), point.height_m.value_or(height_m));
      if ((place.array() >= least.array()).all() && (place.array() <= most.array()).all()) continue;
      return fmt::format(
          "{}: tello{} would be at {:g}, {:g}, {:g} m, beyond link's fence: x {:g} to {:g}, y {:g} to {:g}, z {:g} "
          "to {:g} m",
          own ? fmt::format("{}:{}", o.course_file, point.line)
              : fmt::format("{} with --side {:g}", ground::name_of(o.shape), o.side_m),
          k, place.x(), place.y(), place.z(), least.x(), most.x(), least.y(), most.y(), least.z(), most.z());
    }
  }
  return "";
}

// What speaks against it; empty: nothing.
std::string read_flight(Options& o, const std::string& shape, const std::string& ramp) {
  if (o.ledger == "none" && o.manual) return "--shape manual goes with a ledger: its pilots speak to ground";
  if (!o.manual) {
    auto course = ground::course_from(shape);
    if (!course) return "--shape: " + course.error().what;
    o.shape = course->shape;
    o.waypoints = std::move(course->waypoints);
    if (!o.waypoints.empty()) o.course_file = std::filesystem::absolute(shape);
    if (const std::string beyond = beyond_fence(o); !beyond.empty()) return "--shape: " + beyond;
  }
  if (ramp.empty()) return "";
  if (o.manual || o.seconds > 0) return "--ramp goes with a path and its laps";
  const auto read = ground::ramp_from(ramp);
  if (!read) return "--ramp: " + read.error().what;
  o.ramp = *read;
  return "";
}

}  // namespace

Result<TimeNs> parse_duration(const std::string& text) {
  double number = 0;
  std::string unit;
  std::istringstream in(text);
  in >> number >> unit;
  const double ns = number * static_cast<double>(unit == "s" ? ns_per_s : ns_per_ms);
  const bool known = unit.empty() || unit == "ms" || unit == "s";
  if (in.bad() || !known || !(ns >= static_cast<double>(ns_per_ms)) || ns > 60.0 * ns_per_s || !in.eof()) {
    return Error{fmt::format("\"{}\" is no time from 1ms to 60s, such as 10ms, 2s or 10 (milliseconds)", text)};
  }
  return static_cast<TimeNs>(ns);
}

CommandLine parse_command_line(const std::vector<std::string>& arguments) {
  CommandLine line;
  Options& o = line.options;
  CLI::App app{
      "Flies simulated drones around a path through the ledger, and reports how well it went.\n"
      "Ctrl-C lands the drones. Exit codes: 0 every drone finished its path and landed (manual: landed, and nothing "
      "went wrong);\n"
      "1 not so; 2 bad usage.",
      "ledgerline-fly"};
  app.footer(
      "Examples:\n"
      "  fly                                 one drone, three laps of a square\n"
      "  fly --drones 3 --shape x --laps 1\n"
      "  fly --side 4 --ramp 0.5:0.1 --laps 6 --ledger none        each lap faster, with no ledger between\n"
      "  fly --shape manual                  until Ctrl-C, by any ROS 2 teleop on /tello1/cmd_vel\n"
      "  fly --ledger fabric                 peers, an orderer and chaincode of Hyperledger Fabric (needs Go)\n"
      "  fly --batch-timeout 100ms --batch-count 10 --seconds 60    a slower ledger\n"
      "  fly --json r.json --out /tmp/run    figures as JSON; traces, logs and page in /tmp/run");
  std::string shape = "square";
  std::string batch_timeout = "10ms";
  std::string storage = "disk", crypto = "libcrypto", predict = "on", ramp, max_age;
  app.add_option("--shape", shape,
                 "square, triangle, x, eight, or a CSV file of waypoints, x,y[,z[,speed]] a line;\n"
                 "manual: none, fly by /tello1/takeoff, cmd_vel and land")
      ->capture_default_str();
  app.add_option("--side", o.side_m, "Of the shape, m")->check(CLI::Range(0.5, 15.0))->capture_default_str();
  app.add_option("--predict", predict,
                 "on: commands for where the drone will be when they take effect; off: newest state, newest command")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  app.add_option("--ramp", ramp, "START:STEP, m/s: speed of the first lap, and by how much each one is faster");
  app.add_option("--max-age", max_age, "Agent and link take no command made from an older state (default: 500ms)")
      ->check(CLI::Validator(check_duration, "TIME"));
  app.add_option("--drones", o.drones, "Number of drones")
      ->check(CLI::Range(1, static_cast<int>(max_drones)))
      ->capture_default_str();
  app.add_option("--rate", o.rate_hz, "States a second of each drone")
      ->check(CLI::Range(1.0, 200.0))
      ->capture_default_str();
  app.add_option("--speed", o.speed_mps, "Along the path, m/s")->check(CLI::Range(0.05, 5.0))->capture_default_str();
  auto* laps = app.add_option("--laps", o.laps, "Laps to fly")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--seconds", o.seconds, "Fly the path this long instead of counting laps; manual: land after so long")
      ->check(CLI::Range(1.0, 86'400.0))
      ->excludes(laps);
  app.add_option("--ledger", o.ledger, "Which ledger; none: the same controller beside the driver, as a reference")
      ->check(CLI::IsMember({"embedded", "fabric", "none"}))
      ->capture_default_str();
  app.add_option("--orderers", o.orderers, "Fabric: how many orderers")
      ->check(CLI::IsMember({1, 3}))
      ->capture_default_str();
  app.add_option("--storage", storage, "Ledger: in the run's directory, or in memory and gone after the flight")
      ->check(CLI::IsMember({"disk", "tmpfs"}))
      ->capture_default_str();
  app.add_flag("--ca", o.ca, "Fabric: identities from fabric-ca, one server an organisation");
  app.add_flag("--gateway", o.gateway, "Fabric: transactions through the gateway instead of the direct path");
  app.add_flag("--majority", o.majority, "Fabric: two of the three organisations endorse; through the gateway");
  app.add_option("--crypto", crypto, "What signs and verifies in agent and ground")
      ->check(CLI::IsMember({"libcrypto", "mbedtls"}))
      ->capture_default_str();
  app.add_option("--batch-timeout", batch_timeout,
                 "Ledger: a block is cut when its oldest transaction waited this long")
      ->check(CLI::Validator(check_duration, "TIME"))
      ->capture_default_str();
  app.add_option("--batch-count", o.batch_count, "Ledger: a block is cut at this many transactions")
      ->check(CLI::Range(1, 10'000))
      ->capture_default_str();
  auto* proxy = app.add_flag("--proxy", o.proxy,
                             "Drones and ledger behind a proxy that `ledgerline hil faults OUT/faults.sock` impairs "
                             "(docs/proxy.md)");
  app.add_option("--faults", o.faults, "TOML file: what the proxy switches when")
      ->needs(proxy)
      ->check(CLI::ExistingFile);
  app.add_option("--domains", o.domains,
                 "DDS domains of the drones and of ground, such as 1,2 (default: ROS_DOMAIN_ID, else 0, for both)")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::Range(0, 232));
  app.add_option(
         "--dds", o.cyclonedds,
         "File of Cyclone DDS's own configuration; without it DDS stays on this machine, whatever CYCLONEDDS_URI "
         "says")
      ->check(CLI::ExistingFile);
  app.add_option("--seed", o.seed, "Of wind and sensor noise")->capture_default_str();
  app.add_option("--json", o.json, "Write the figures to this file, as one JSON object");
  app.add_option("--out", o.out, "Directory for traces, logs and the page (default: build/runs/TIME)");
  try {
    // CLI11 takes them in reverse order.
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& e) {
    std::ostringstream text;
    line.exit_code = app.exit(e, text, text) == 0 ? 0 : exit_usage;
    line.text = text.str();
    return line;
  }
  if (o.ledger == "none") {
    for (const char* of_ledgers :
         {"--orderers", "--storage", "--batch-timeout", "--batch-count", "--ca", "--max-age", "--crypto"}) {
      if (app.get_option(of_ledgers)->count() == 0) continue;
      line.exit_code = exit_usage;
      line.text = fmt::format("{} goes with a ledger: with --ledger none there is none\n", of_ledgers);
      return line;
    }
  }
  if (o.ca && o.ledger != "fabric") {
    line.exit_code = exit_usage;
    line.text = "--ca goes with --ledger fabric: the embedded ledger issues its identities itself\n";
    return line;
  }
  if (o.proxy && o.ledger == "none") {
    line.exit_code = exit_usage;
    line.text = "--proxy stands between drones and a ledger: it does not go with --ledger none\n";
    return line;
  }
  if ((o.gateway || o.majority) && o.ledger != "fabric") {
    line.exit_code = exit_usage;
    line.text = "--gateway and --majority go with --ledger fabric: the embedded ledger is one process\n";
    return line;
  }
  if (!o.cyclonedds.empty()) o.cyclonedds = std::filesystem::absolute(o.cyclonedds);
  o.manual = shape == "manual";
  if (o.manual && laps->count() > 0) {
    line.exit_code = exit_usage;
    line.text = "--laps goes with a path: a manual flight lasts until Ctrl-C, or for --seconds\n";
    return line;
  }
  for (const char* of_paths : {"--predict", "--side"}) {
    if (!o.manual || app.get_option(of_paths)->count() == 0) continue;
    line.exit_code = exit_usage;
    line.text = fmt::format("{} goes with a path: with --shape manual there is none\n", of_paths);
    return line;
  }
  if (const std::string wrong = read_flight(o, shape, ramp); !wrong.empty()) {
    line.exit_code = exit_usage;
    line.text = wrong + "\n";
    return line;
  }
  o.predict = predict == "on";
  if (!max_age.empty()) o.max_age_ns = *parse_duration(max_age);
  o.batch_timeout_ns = *parse_duration(batch_timeout);
  o.tmpfs = storage == "tmpfs";
  o.mbedtls = crypto == "mbedtls";
  line.fly = true;
  return line;
}

}  // namespace ledgerline::fly
