#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/program/command_line.hpp"
#include "common/program/command_socket.hpp"
#include "common/program/program.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/histogram.hpp"
#include "ground/shell/path_file.hpp"
#include "hil/netem/recording/link_recording.hpp"
#include "hil/proxy/drone_side.hpp"
#include "hil/shim/shim_verb.hpp"
#include "hil/sitl/simulated_flight.hpp"
#include "tools/command/verbs.hpp"

namespace ledgerline::hil {
using Lap = SimulatedFlightResult::Drone::Lap;
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Lap, asked_mps, flown_mps, peak_mps, seconds, rms_m, max_m)
}  // namespace ledgerline::hil

namespace {

using namespace ledgerline;

using nlohmann::json;

int simulated_flight(const hil::SimulatedFlightConfig& config) {
  const TimeNs start = monotonic_ns();
  const auto flight = hil::fly_simulated(config);
  const double wall_s = to_seconds(monotonic_ns() - start);
  if (!flight) return fail(flight.error());
  json out{{"ok", flight->ok},
           {"why", flight->why},
           {"seed", config.seed},
           {"digest", crypto::hex(flight->digest)},
           {"flown_s", to_seconds(flight->flown_ns)},
           {"wall_s", wall_s},
           {"times_real_time", to_seconds(flight->flown_ns) / wall_s},
           {"blocks", flight->blocks},
           {"transactions", flight->transactions},
           {"drones", json::array()}};
  for (const auto& drone : flight->drones) {
    out["drones"].push_back(
        {{"id", drone.name},
         {"two_way_ms", drone.two_way_ms},
         {"age_ms", drone.age_ms},
         {"commands", {{"sent", drone.commands_sent}, {"applied", drone.commands_applied}}},
         {"cross_track_m", {{"rms", drone.cross_track_rms_m}, {"max", drone.cross_track_max_m}}},
         {"lap_s", drone.lap_s},
         {"laps", drone.laps},
         {"limit_mps", std::isfinite(drone.limit_mps) ? json(drone.limit_mps) : json()},
         {"slowed_to_mps", drone.slowed_to_mps ? json(*drone.slowed_to_mps) : json()},
         {"response",
          {{"gain", drone.response.gain}, {"lag_s", drone.response.lag_s}, {"dead_s", drone.response.dead_s}}}});
  }
  fmt::print("{}\n", out.dump(2));
  return flight->ok ? 0 : 1;
}

/// What the options of `sitl` say in words, until read_words() has put it into the config.
struct Words {
  std::string shape = "square", mode = "ledger", predict = "on", track = "on", ramp, delay = "none", side = "both";
  double max_age_s = 0, batch_timeout_s = 0;
};

void add_flight_options(Verb flight, hil::SimulatedFlightConfig& config, Words& words) {
  words.batch_timeout_s = to_seconds(config.batch_timeout_ns);
  flight.option("--drones", config.drones, "1 to 16").within(1, 16).shows_default();
  flight.option("--mode", words.mode, "ledger, or local: the same controller beside the driver, without a ledger")
      .one_of({"ledger", "local"})
      .shows_default();
  flight.option("--shape", words.shape, "square, triangle, x, eight, or a CSV file: x,y[,z[,speed]] a line")
      .shows_default();
  flight.option("--side", config.side_m, "of the shape, m").within(0.5, 15.0).shows_default();
  flight.option("--predict", words.predict, "off: the plain controller: newest state, newest command")
      .one_of({"on", "off"})
      .shows_default();
  flight.option("--track", words.track, "off: link flies plans' velocities, and holds no drone to its path")
      .one_of({"on", "off"})
      .shows_default();
  flight.option("--ramp", words.ramp,
                "START:STEP: the speed of the first lap, and by how much each one is faster, m/s");
  const Option delay =
      flight
          .option("--delay", words.delay,
                  "Two-way: none, seconds (0 to 3) beside the ledger's own, a published one (published, which is the "
                  "square's, published-triangle, published-x, published-three), or a file of seconds, one a line")
          .shows_default();
  flight
      .option("--delay-side", words.side, "agent, ground or both: between which of them and the ledger the delay lies")
      .one_of({"agent", "ground", "both"})
      .needs(delay)
      .shows_default();
  flight.option("--max-age", words.max_age_s, "s: agent and link take no older command (default: 5 with a delay)")
      .within(0.05, 60.0);
  flight.option("--model-error", config.model_error, "The simulated drone's mass, gain and lag are larger by this")
      .within(-0.5, 1.0)
      .shows_default();
  flight.option("--gust", config.gust_mps, "Standard deviation of the wind, m/s").within(0.0, 3.0).shows_default();
  flight.option("--full-scale", config.full_scale_mps, "What rc 100 means, m/s").within(0.5, 5.0).shows_default();
  flight.option("--speed", config.speed_mps, "m/s along the path").within(0.05, 5.0).shows_default();
  flight.option("--rate", config.rate_hz, "states a second").within(1.0, 200.0).shows_default();
  flight.option("--laps", config.laps, "to fly").within(1, 1000).shows_default();
  flight.option("--batch-count", config.batch_count, "transactions a block, at most").within(1, 1000).shows_default();
  flight
      .option("--batch-timeout", words.batch_timeout_s, "s: a block is cut when its oldest transaction waited so long")
      .within(0.001, 60.0)
      .shows_default();
  flight.option("--seed", config.seed, "of wind, noise and delays").shows_default();
}

Status read_words(const Words& words, hil::SimulatedFlightConfig& config) {
  auto course = ground::path_choice_from(words.shape);
  if (!course) return course.error();
  config.shape = course->shape;
  config.waypoints = std::move(course->waypoints);
  if (!words.ramp.empty()) {
    const auto read = ground::ramp_from(words.ramp);
    if (!read) return Error{"--ramp: " + read.error().message};
    config.ramp = *read;
  }
  const auto added = hil::added_delay_from(words.delay);
  if (!added) return Error{"--delay: " + added.error().message};
  config.delays.added = *added;
  config.delays.added.agent_share = words.side == "both" ? 0.5 : words.side == "agent" ? 1.0 : 0.0;
  config.mode = words.mode == "local" ? hil::WorldConfig::Mode::local : hil::WorldConfig::Mode::ledger;
  config.predict = words.predict == "on";
  config.track = words.track == "on";
  config.max_age_ns = from_seconds(words.max_age_s);
  config.batch_timeout_ns = from_seconds(words.batch_timeout_s);
  return done;
}

int run_proxy(const std::string& config, const std::string& script) {
  const auto settings = hil::proxy::read_settings(config, script);
  return settings ? exit_code(hil::proxy::run(*settings)) : fail(settings.error(), exit_usage);
}

int tell_faults(const std::string& socket, const std::string& command) {
  const auto answer = send_command(socket, command);
  if (!answer) return fail(answer.error());
  fmt::print("{}", *answer);
  return 0;
}

int print_recording(const std::string& capture, const hil::RecordingOptions& asked) {
  const auto table = hil::table_of_capture(capture, asked);
  if (!table) return fail(table.error());
  fmt::print("{}", *table);
  return 0;
}

constexpr const char* notes = R"(Examples:
  ledgerline hil sitl --drones 3 --shape x --seed 7
  ledgerline hil proxy --config proxy.toml
  ledgerline hil shim --memory /dev/shm/tello --plans plans.toml --lockstep 10
  ledgerline hil faults faults.sock 'drone tello1 to delay 200ms, loss 5%'
  ledgerline hil day flight.pcap > day.csv; ledgerline hil faults faults.sock 'drone tello1 state recorded-day day.csv')";
constexpr const char* about_sitl =
    "A whole flight as cores in one thread on a simulated clock; prints one JSON object.\n"
    "The same options give the same digest. Exit code 0: all drones finished and landed; 1: not; 2: bad options.";
constexpr const char* about_proxy =
    "Stands between Tello clients and drones (UDP), and between Fabric clients and servers (TCP), and impairs what "
    "goes\n"
    "through (docs/faults.md), until SIGINT or SIGTERM. Exit code 0: ended as asked; 1: something failed; 2: bad "
    "options\n"
    "or file.";
constexpr const char* about_faults =
    "Tells a running proxy or shim what to switch: drone NAME to|answers|state|video|from|both EFFECTS, server NAME\n"
    "to|from|both EFFECTS, server NAME cut, sensor NAME FAULT, of the shim sdk NAME FAULT, clear, list "
    "(docs/faults.md). Exit code 0: done; 1: refused or not "
    "reached;\n"
    "2: bad options.";

constexpr const char* about_day =
    "Prints loss and delay over time of a Tello's link, from a capture made at the client, as a table for the effect\n"
    "recorded-day (docs/faults.md). Exit code 0: done; 1: no such link in it, or damaged; 2: bad options.";

}  // namespace

int ledgerline::command::hil(int argc, char** argv) {
  CommandLine line(
      "ledgerline hil",
      "Ledgerline's flights in simulated time, the proxy that impairs real ones, and the shim in place of UDP", notes);
  line.renamed("virtual", "sitl");
  hil::SimulatedFlightConfig config;
  Words words;
  add_flight_options(line.verb("sitl", about_sitl), config, words);

  std::string proxy_config, script;
  Verb proxy = line.verb("proxy", about_proxy);
  proxy.option("--config", proxy_config, "TOML file: what it stands before").required();
  proxy.option("--script", script, "TOML file: what is switched when");

  hil::shim::ShimVerb shim(line.verb("shim", hil::shim::ShimVerb::about));

  std::string socket, command;
  Verb faults = line.verb("faults", about_faults);
  faults.option("SOCKET", socket, "[proxy] faults of its config").required();
  faults.option("COMMAND", command, "in quotes: 'drone tello1 to delay 200ms, loss 5%'").required();

  std::string capture, of = "states";
  hil::RecordingOptions asked;
  Verb day = line.verb("day", about_day);
  day.option("CAPTURE", capture, "pcap or pcapng, as by tcpdump -w flight.pcap 'udp port 8889 or udp port 8890'")
      .required()
      .existing_file();
  day.option("--of", of, "states: the way from the drone; answers: both ways, from commands that it answers at once")
      .one_of({"states", "answers"})
      .shows_default();
  day.option("--drone", asked.drone, "its address, where there are several");

  if (const auto end = line.parse(argc, argv)) return *end;
  if (proxy.is_given()) return run_proxy(proxy_config, script);
  if (shim.is_given()) return shim.run();
  asked.answers = of == "answers";
  if (day.is_given()) return print_recording(capture, asked);
  if (faults.is_given()) return tell_faults(socket, command);
  if (const Status read = read_words(words, config); !read) return fail(read.error(), exit_usage);
  return simulated_flight(config);
}
