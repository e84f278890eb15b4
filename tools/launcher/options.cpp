#include "tools/launcher/options.hpp"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>
#include <set>
#include <sstream>

#include "common/msg/onboard.hpp"
#include "common/msg/ros_releases.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "ground/shell/path_file.hpp"
#include "onboard/link/core/settings.hpp"
#include "sim/core/sensors.hpp"
#include "tools/deployment/deployment.hpp"
#include "tools/launcher/configs.hpp"
#include "tools/launcher/machine.hpp"
#include "tools/launcher/page_access.hpp"
#include "tools/launcher/preflight.hpp"

namespace ledgerline::launcher {
namespace {

std::string check_duration(const std::string& text) {
  const auto duration = parse_duration(text);
  return duration ? "" : duration.error().message;
}

constexpr const char* help_about =
    "Flies simulated drones, or a deployment's own, around a path through the ledger, and reports how well it went.\n"
    "Ctrl-C lands the drones.";
constexpr const char* help_notes = R"(Examples:
  ledgerline fly                            one drone, three laps of a square
  ledgerline fly --drones 3 --shape manual --watch        by a page: keyboard, gamepad, touch, and a button that stops all
  ledgerline fly --ledger fabric            Hyperledger Fabric's own peers and orderer (needs Go)
  ledgerline fly --deployment real.toml     your own drones, with their fence (docs/fly.md)
Exit codes: 0 every drone finished its path and landed (manual: landed, and nothing went wrong); 1 not so; 2 bad usage.)";

/// Options whose words become values of another type, in take().
struct Words {
  std::string shape = "square", predict = "on", ramp, max_age, pads;
  std::vector<std::string> tasks;
  std::string deployment, ledger = name_of(Ledger::embedded), storage = "disk", batch_timeout = "10ms";
};

void add_path_options(CommandLine& line, Options& o, Words& words) {
  line.option("--shape", words.shape,
              "square, triangle, x, eight, or a CSV file of waypoints, x,y[,z[,speed]] a line;\n"
              "manual: none, fly by /tello1/takeoff, cmd_vel and land")
      .shows_default();
  line.option("--side", o.side_m, "Of the shape, m").within(0.5, 15.0).shows_default();
  line.option("--predict", words.predict,
              "on: commands for where the drone will be when they take effect; off: newest state, newest command")
      .one_of({"on", "off"})
      .shows_default()
      .in_help_all();
  line.option(
          "--task", words.tasks,
          "What one drone flies instead: \"tello2 shape=SHAPE_OR_FILE side=M speed=MPS laps=N\", of which any may be\n"
          "left out; once for each drone")
      .one_at_a_time()
      .in_help_all();
  line.option("--controller", o.controller,
              "A shared library that steers along the path in the place of ground's own controller (docs/faults.md)")
      .existing_file()
      .utf8_path()
      .in_help_all();
  line.option("--ramp", words.ramp, "START:STEP, m/s: speed of the first lap, and by how much each one is faster")
      .in_help_all();
  line.option("--pose", o.pose,
              "Who says where the drones are: motion capture, each drone's own velocities and heights, or these while\n"
              "motion capture is missing; none: nobody, with --shape manual")
      .one_of({"mocap", "tello", "mocap+tello", "none"})
      .shows_default();
  line.option("--pads", words.pads,
              "Mission pads on the simulated floor, and drones that fly by onboard odometry and these:\n"
              "ID:X:Y[:DEGREES[:SIZE]], in m and counter-clockwise from x, with commas between")
      .checked_by("PADS",
                  [](const std::string& text) {
                    const auto pads = sim::parse_pads(text);
                    return pads ? std::string() : pads.error().message;
                  })
      .in_help_all();
  line.option("--max-age", words.max_age, "Agent and link take no command made from an older state (default: 500ms)")
      .checked_by("TIME", check_duration)
      .in_help_all();
  line.option("--rate", o.rate_hz, "States a second of each drone").within(1.0, 200.0).shows_default().in_help_all();
  line.option("--speed", o.speed_mps, "Along the path, m/s").within(0.05, 5.0).shows_default();
  const Option laps = line.option("--laps", o.laps, "Laps to fly").within(1, 1000).shows_default();
  line.option("--seconds", o.seconds, "Fly the path this long instead of counting laps; manual: land after so long")
      .within(1.0, 86'400.0)
      .excludes(laps);
}

/// What flies through which ledger: each by itself, or all of it by a file.
void add_deployment_options(CommandLine& line, Options& o, Words& words) {
  const Option drones =
      line.option("--drones", o.drones, "Number of drones").within(1, static_cast<int>(max_drones)).shows_default();
  const Option ledger =
      line.option("--ledger", words.ledger, "Which ledger; none: the same controller beside the driver, as a reference")
          .one_of({deployment::ledger_kinds.begin(), deployment::ledger_kinds.end()})
          .shows_default();
  const Option orderers =
      line.option("--orderers", o.orderers, "Fabric: how many orderers").one_of({1, 3}).shows_default().in_help_all();
  line.option("--deployment", words.deployment,
              "deployment.toml: simulated drones and their ledger on this host (docs/three-machines.md), or without "
              "[[host]]\n"
              "drones that are there already, real ones, and their fence (docs/fly.md)")
      .existing_file()
      .utf8_path()
      .excludes(drones)
      .excludes(ledger)
      .excludes(orderers);
}

void add_ledger_options(CommandLine& line, Options& o, Words& words) {
  line.option("--storage", words.storage, "Ledger: in the run's directory, or in memory and gone after the flight")
      .one_of({"disk", "tmpfs"})
      .shows_default()
      .in_help_all();
  line.flag("--ca", o.ca, "Fabric: identities from fabric-ca, one server an organisation").in_help_all();
  line.flag("--gateway", o.gateway, "Transactions through the ledger's gateway instead of the direct path")
      .in_help_all();
  line.flag("--endorser", o.endorser,
            "Fabric: the drones' organisation endorses by an endorser of its own, and by its peer where that is gone")
      .in_help_all();
  line.flag("--endorser-within", o.endorser_within,
            "The same within agent, which holds that key then, and serves ground; the embedded ledger's way without "
            "--gateway")
      .in_help_all();
  line.option("--blocks", o.blocks,
              "Whose blocks agent and ground take: the own peer's, or an orderer's as soon as they are validated")
      .one_of({"peer", "ordered"})
      .shows_default()
      .in_help_all();
  line.option("--batch-timeout", words.batch_timeout,
              "Ledger: a block is cut when its oldest transaction waited this long")
      .checked_by("TIME", check_duration)
      .shows_default()
      .in_help_all();
  line.option("--batch-count", o.batch_count, "Ledger: a block is cut at this many transactions")
      .within(1, 10'000)
      .shows_default()
      .in_help_all();
}

void add_run_options(CommandLine& line, Options& o) {
  const Option proxy = line.flag("--proxy", o.proxy,
                                 "Drones and ledger behind a proxy that `ledgerline hil faults OUT/faults.sock` "
                                 "impairs (docs/faults.md)")
                           .in_help_all();
  line.option("--faults", o.faults, "TOML file: what the proxy switches when")
      .needs(proxy)
      .existing_file()
      .in_help_all();
  line.flag("--shim", o.shim,
            "Drones behind shared memory in place of UDP; `ledgerline hil faults OUT/shim.sock` impairs them "
            "(docs/faults.md)")
      .in_help_all();
  const Option watch = line.flag(
      "--watch", o.watch,
      "Ground serves a page to look on, to fly by hand and to stop all; its address is printed (docs/station.md)");
  line.flag(
          "--fault-switches", o.fault_switches,
          "The page has switches that delay or stall the ledger, silence a drone, lose its commands (docs/station.md)")
      .needs(watch);
  line.option(
          "--listen", o.listen,
          "Serve the page to other devices, too: ADDRESS of this computer, or ADDRESS:PORT. TLS with a certificate\n"
          "made for it; a QR code leads a phone there (docs/station.md)")
      .needs(watch)
      .checked_by("ADDRESS", [](const std::string& text) {
        const auto listen = listen_address_from(text);
        if (!listen) return listen.error().message;
        return free_port(listen->address) > 0 ? "" : text + " is no address of this computer (`ip address` lists them)";
      });
  line.flag("--open", o.open, "Open the page in the browser, where there is xdg-open").needs(watch);
  const Option operators =
      line.option("--operators", o.operators,
                  "Who sign in at the page with keys of their own, such as alice,bob; their pass phrases are printed. "
                  "Without,\n"
                  "ground's own identity signs all")
          .comma_list()
          .needs(watch)
          .checked_by("NAMES", [](const std::string& name) {
            return is_operator_name(name) ? std::string() : "a name is 1 to 32 characters of a-z and 0-9";
          });
  line.option("--approvals", o.approvals,
              "How many operators must approve a mission before it starts; 2: its author needs a second one")
      .one_of({1, 2})
      .needs(operators)
      .shows_default()
      .in_help_all();
  line.option("--domains", o.domains,
              "DDS domains of the drones and of ground, such as 1,2 (default: ROS_DOMAIN_ID, else 0, for both)")
      .comma_list(2)
      .within(0, 232)
      .in_help_all();
  const auto dds_file =
      line.option(
              "--dds", o.cyclonedds,
              "File of Cyclone DDS's own configuration; without it DDS stays on this machine, whatever CYCLONEDDS_URI "
              "says")
          .existing_file()
          .utf8_path()
          .in_help_all();
  line.option("--ros-release", o.ros_release,
              "ROS 2's release on this machine: how its nodes are met here and how ours are announced (default: "
              "ROS_DISTRO's form)")
      .one_of(ros_releases())
      .excludes(dds_file)
      .in_help_all();
  line.option("--seed", o.seed, "Of wind and sensor noise").shows_default();
  line.option("--json", o.json, "Write the figures to this file, as one JSON object");
  line.option("--out", o.out, "Directory for traces, logs and the page (default: build/runs/TIME)").utf8_path();
}

std::size_t different(const std::vector<std::string>& names) {
  return std::set<std::string>(names.begin(), names.end()).size();
}

/// An error: options that do not go together.
Status check_together(const CommandLine& line, const Options& o) {
  constexpr const char* of_a_ledger = "goes with a ledger: with --ledger none there is none";
  constexpr const char* of_a_path = "goes with a path: with --shape manual there is none";
  constexpr const char* of_others = "stands in the [ledger] of the deployment's files, or is the network's own affair";
  const bool others = is_of_others(o);
  const bool ledger = o.ledger != Ledger::none, fabric = o.ledger == Ledger::fabric;
  const struct {
    const char* option;
    bool fits;
    const char* why;
  } rules[] = {
      {"--orderers", ledger, of_a_ledger},
      {"--storage", ledger, of_a_ledger},
      {"--batch-timeout", ledger, of_a_ledger},
      {"--batch-count", ledger, of_a_ledger},
      {"--ca", ledger, of_a_ledger},
      {"--max-age", ledger, of_a_ledger},
      {"--blocks", ledger && !o.gateway, "goes with a ledger and the direct path, which knows its orderers"},
      {"--ca", fabric, "goes with --ledger fabric: the embedded ledger issues its identities itself"},
      {"--proxy", ledger, "stands between drones and a ledger: it does not go with --ledger none"},
      {"--fault-switches", !o.own, "are of the proxy before simulated drones: a deployment's own have none"},
      {"--fault-switches", !o.shim, "are of the proxy on the drones' UDP: behind --shim there is none"},
      {"--watch", ledger, "shows what ground sees: with --ledger none there is no ground"},
      {"--watch", !others, "stands as [service] in the ground.toml of the deployment"},
      {"--operators", o.manual, "goes with --shape manual: a path is flown by ground's own lease"},
      {"--operators", !o.ca,
       "are issued here, and with --ca by servers: see docs/station.md for identities of your own"},
      {"--approvals", different(o.operators) >= static_cast<std::size_t>(o.approvals),
       "2 needs two different --operators: nobody else approves"},
      {"--endorser", fabric && !o.gateway,
       "goes with --ledger fabric and the direct path: on the embedded ledger agent endorses"},
      {"--endorser-within", ledger && !o.gateway && !o.endorser,
       "goes with a ledger and the direct path, in place of --endorser"},
      {"--storage", !others, of_others},
      {"--blocks", !others, of_others},
      {"--ca", !others, of_others},
      {"--gateway", !others, of_others},
      {"--endorser", !others, of_others},
      {"--endorser-within", !others, of_others},
      {"--proxy", !o.own, "stands between simulated drones and a ledger: a deployment's own drones have none"},
      {"--shim", !o.own, "stands before simulated drones: a deployment has its own"},
      {"--seed", !o.own, "is the simulator's, and none is started for a deployment's own drones"},
      {"--pose", !o.own && o.pads.empty(), "goes with simulated drones, and not with --pads, which says it too"},
      {"--pads", !o.own, "lie on the simulator's floor: a deployment names its own as [[pad]]"},
      {"--gateway", ledger, of_a_ledger},
      {"--laps", !o.manual, "goes with a path: a manual flight lasts until Ctrl-C, or for --seconds"},
      {"--predict", !o.manual, of_a_path},
      {"--side", !o.manual, of_a_path},
      {"--shape", ledger || !o.manual, "manual goes with a ledger: its pilots speak to ground"},
      {"--controller", !o.manual, of_a_path},
      {"--task", !o.manual, of_a_path},
      {"--task", !o.own, "goes with simulated drones: a deployment's own all fly its [flight]"},
      {"--predict", o.controller.empty(), "is of ground's own controller, and --controller takes its place"},
      {"--ramp", o.controller.empty(), "is of ground's own controller, and --controller takes its place"},
      {"--ramp", !o.manual && o.seconds == 0, "goes with a path and its laps"},
  };
  for (const auto& [option, fits, why] : rules) {
    if (!fits && line.is_given(option)) return Error{fmt::format("{} {}", option, why)};
  }
  if (pose_of(o) == "none" && !o.manual)
    return Error{"a path needs poses: without (--pose none, or a deployment's pose.source) the shape is manual"};
  return done;
}

/// One word of --task.
Status apply_task_word(const std::string& word, DroneTask& task, std::vector<std::string>& notes) {
  const auto equals = word.find('=');
  const std::string key = word.substr(0, equals), value = equals == std::string::npos ? "" : word.substr(equals + 1);
  if (key == "shape") {
    auto course = ground::path_choice_from(value);
    if (!course) return course.error();
    task.course.shape = course->shape;
    task.course.waypoints = std::move(course->waypoints);
    if (task.course.waypoints.empty()) return task.file.clear(), done;
    if (std::string problem = utf8_path_problem(value); !problem.empty()) return Error{std::move(problem)};
    task.file = std::filesystem::absolute(value).string();
    if (!course->note.empty()) notes.push_back(std::move(course->note));
    return done;
  }
  double number = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  const bool whole = error == std::errc() && end == value.data() + value.size();
  const auto within = [&](double least, double most) { return whole && number >= least && number <= most; };
  if (key == "side" && within(0.5, 15)) {
    task.course.side_m = number;
  } else if (key == "speed" && within(0.05, 5)) {
    task.course.speed_mps = number;
  } else if (key == "laps" && within(1, 1000) && number == static_cast<int>(number)) {
    task.course.laps = static_cast<int>(number);
  } else {
    return Error{
        fmt::format("\"{}\" is none of shape=SHAPE_OR_FILE, side=0.5 to 15, speed=0.05 to 5, laps=1 to 1000", word)};
  }
  return done;
}

/// Behind the flight's own path.
Status apply_tasks(const Words& words, Options& o) {
  for (const std::string& text : words.tasks) {
    std::istringstream in(text);
    std::string name, word;
    in >> name;
    int drone = 1;
    while (drone <= o.drones && drone_name(o, drone) != name) ++drone;
    if (drone > o.drones) return Error{fmt::format("--task: \"{}\" names none of the {} drones", text, o.drones)};
    DroneTask task = task_of(o, drone);
    while (in >> word) {
      if (auto taken = apply_task_word(word, task, o.notes); !taken) return Error{"--task: " + taken.error().message};
    }
    o.tasks[drone] = std::move(task);
  }
  return done;
}

/// Reads what the path is, its file too.
Status apply_path(const Words& words, Options& o) {
  if (o.manual) return done;
  auto course = ground::path_choice_from(words.shape, {"manual"});
  if (!course) return Error{"--shape: " + course.error().message};
  o.shape = course->shape;
  o.waypoints = std::move(course->waypoints);
  if (!o.waypoints.empty()) {
    if (const std::string problem = utf8_path_problem(words.shape); !problem.empty())
      return Error{"--shape: " + problem};
    o.course_file = std::filesystem::absolute(words.shape);
    if (!course->note.empty()) o.notes.push_back(std::move(course->note));
  }
  if (auto taken = apply_tasks(words, o); !taken) return taken;
  // Own drones stand where their poses say, before take-off.
  if (!o.own) {
    const Status fits = check_path(o, link::FenceSettings{}, simulated_starts(o));
    if (!fits) return Error{"--shape: " + fits.error().message};
  }
  if (words.ramp.empty()) return done;
  const auto ramp = ground::ramp_from(words.ramp);
  if (!ramp) return Error{"--ramp: " + ramp.error().message};
  o.ramp = *ramp;
  return done;
}

/// An option that is given counts more than the deployment's [flight].
Status apply_deployment(const CommandLine& line, Words& words, Options& o) {
  if (words.deployment.empty()) return done;
  auto config = Config::load(words.deployment);
  if (!config) return Error{"--deployment: " + config.error().message};
  if (!deployment::is_of_own_drones(*config)) {
    const auto host = deployment::read_one_host(*config);
    if (!host) return Error{"--deployment: " + host.error().message};
    o.drones = host->drones;
    words.ledger = deployment::name_of(host->ledger);
    o.orderers = host->orderers;
    return done;
  }
  auto own = deployment::read_own_drones(*config, words.deployment);
  if (!own) return Error{"--deployment: " + own.error().message};
  o.drones = static_cast<int>(own->drones.size());
  words.ledger = deployment::name_of(own->ledger);
  const deployment::OwnFlight& flight = own->flight;
  if (!line.is_given("--shape")) words.shape = flight.shape;
  if (!line.is_given("--side")) o.side_m = flight.side_m;
  if (!line.is_given("--speed")) o.speed_mps = flight.speed_mps;
  if (!line.is_given("--laps")) o.laps = flight.laps;
  o.own = std::move(*own);
  return done;
}

void take(const Words& words, Options& o) {
  o.manual = words.shape == "manual";
  o.predict = words.predict == "on";
  o.proxy = o.proxy || o.fault_switches;
  if (!words.pads.empty()) {
    o.pads = *sim::parse_pads(words.pads);
    o.pose = "pads";
  }
  if (!words.max_age.empty()) o.max_age_ns = *parse_duration(words.max_age);
  o.ledger = deployment::ledger_kind_of(words.ledger);
  o.endorser_within = o.endorser_within || (o.ledger == Ledger::embedded && !o.gateway);
  o.tmpfs = words.storage == "tmpfs";
  if (!o.controller.empty()) o.controller = std::filesystem::absolute(o.controller);
  o.batch_timeout_ns = *parse_duration(words.batch_timeout);
  if (!o.cyclonedds.empty()) o.cyclonedds = std::filesystem::absolute(o.cyclonedds);
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

ParsedOptions parse_command_line(const std::vector<std::string>& arguments) {
  ParsedOptions asked;
  Options& o = asked.options;
  Words words;
  CommandLine line("ledgerline fly", help_about, help_notes);
  add_path_options(line, o, words);
  add_deployment_options(line, o, words);
  add_ledger_options(line, o, words);
  add_run_options(line, o);
  if (const auto end = line.read(arguments)) {
    asked.exit_code = end->exit_code;
    asked.text = end->text;
    return asked;
  }
  Status taken = apply_deployment(line, words, o);
  take(words, o);
  if (taken) taken = check_together(line, o);
  if (taken) taken = apply_path(words, o);
  asked.fly = taken.ok();
  if (!asked.fly) {
    asked.exit_code = exit_usage;
    asked.text = taken.error().message + "\n";
  }
  return asked;
}

}  // namespace ledgerline::launcher
