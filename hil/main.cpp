#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <cmath>

#include "common/base/log.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/histogram_json.hpp"
#include "ground/shell/course_file.hpp"
#include "hil/proxy/fault_socket.hpp"
#include "hil/proxy/proxy.hpp"
#include "hil/virtual/virtual_flight.hpp"

namespace {

using namespace ledgerline;

using nlohmann::json;

json laps_of(const hil::VirtualFlightResult::Drone& drone) {
  json laps = json::array();
  for (const auto& lap : drone.laps) {
    laps.push_back({{"asked_mps", lap.asked_mps},
                    {"flown_mps", lap.flown_mps},
                    {"peak_mps", lap.peak_mps},
                    {"seconds", lap.seconds},
                    {"rms_m", lap.rms_m},
                    {"max_m", lap.max_m}});
  }
  return laps;
}

int virtual_flight(const hil::VirtualFlightConfig& config) {
  const TimeNs start = monotonic_ns();
  const auto flight = hil::fly_virtually(config);
  const double wall_s = to_seconds(monotonic_ns() - start);
  if (!flight) {
    spdlog::error("{}", flight.error().what);
    return 1;
  }
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
         {"laps", laps_of(drone)},
         {"limit_mps", std::isfinite(drone.limit_mps) ? json(drone.limit_mps) : json()},
         {"slowed_to_mps", drone.slowed_to_mps ? json(*drone.slowed_to_mps) : json()},
         {"response",
          {{"gain", drone.response.gain}, {"lag_s", drone.response.lag_s}, {"dead_s", drone.response.dead_s}}}});
  }
  fmt::print("{}\n", out.dump(2));
  return flight->ok ? 0 : 1;
}

Status read_texts(const std::string& shape, const std::string& ramp, const std::string& delay,
                  hil::VirtualFlightConfig& config) {
  auto course = ground::course_from(shape);
  if (!course) return course.error();
  config.shape = course->shape;
  config.waypoints = std::move(course->waypoints);
  if (!ramp.empty()) {
    const auto read = ground::ramp_from(ramp);
    if (!read) return Error{"--ramp: " + read.error().what};
    config.ramp = *read;
  }
  const auto added = hil::added_delay_from(delay);
  if (!added) return Error{"--delay: " + added.error().what};
  config.delays.added = *added;
  return done;
}

int run_proxy(const std::string& config, const std::string& script) {
  const auto settings = hil::proxy::read_settings(config, script);
  if (!settings) {
    spdlog::error("{}", settings.error().what);
    return 2;
  }
  if (const auto ran = hil::proxy::run(*settings); !ran) {
    spdlog::error("{}", ran.error().what);
    return 1;
  }
  return 0;
}

int tell_faults(const std::string& socket, const std::string& command) {
  const auto answer = hil::proxy::tell(socket, command);
  if (!answer) {
    spdlog::error("{}", answer.error().what);
    return 1;
  }
  fmt::print("{}", *answer);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  init_log("hil");
  CLI::App app{
      "Ledgerline's hardware in the loop.\n\nExamples:\n  ledgerline-hil virtual --drones 3 --shape x --seed 7\n"
      "  ledgerline-hil proxy --config proxy.toml\n"
      "  ledgerline-hil faults faults.sock 'drone tello1 to delay 200ms, loss 5%'\n"};
  app.require_subcommand(1);

  hil::VirtualFlightConfig config;
  std::string shape = "square", mode = "ledger", predict = "on", ramp, delay = "none", side = "both";
  double max_age_s = 0, batch_timeout_s = to_seconds(config.batch_timeout_ns);
  auto* flight = app.add_subcommand(
      "virtual",
      "A whole flight as cores in one thread on a virtual clock; prints one JSON object.\n"
      "The same options give the same digest. Exit code 0: all drones finished and landed; 1: not; 2: bad options.");
  flight->add_option("--drones", config.drones, "1 to 16")->check(CLI::Range(1, 16))->capture_default_str();
  flight->add_option("--mode", mode, "ledger, or local: the same controller beside the driver, without a ledger")
      ->check(CLI::IsMember({"ledger", "local"}))
      ->capture_default_str();
  flight->add_option("--shape", shape, "square, triangle, x, eight, or a CSV file: x,y[,z[,speed]] a line")
      ->capture_default_str();
  flight->add_option("--side", config.side_m, "of the shape, m")->check(CLI::Range(0.5, 15.0))->capture_default_str();
  flight->add_option("--predict", predict, "off: the plain controller: newest state, newest command")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  flight->add_option("--ramp", ramp, "START:STEP: the speed of the first lap, and by how much each one is faster, m/s");
  flight
      ->add_option("--delay", delay,
                   "Two-way: none, seconds (0 to 3) beside the ledger's own, a published one (published, which is the "
                   "square's, published-triangle, published-x, published-three), or a file of seconds, one a line")
      ->capture_default_str();
  flight->add_option("--delay-side", side, "agent, ground or both: between which of them and the ledger the delay lies")
      ->check(CLI::IsMember({"agent", "ground", "both"}))
      ->needs(flight->get_option("--delay"))
      ->capture_default_str();
  flight->add_option("--max-age", max_age_s, "s: agent and link take no older command (default: 5 with a delay)")
      ->check(CLI::Range(0.05, 60.0));
  flight->add_option("--model-error", config.model_error, "The simulated drone's mass, gain and lag are larger by this")
      ->check(CLI::Range(-0.5, 1.0))
      ->capture_default_str();
  flight->add_option("--gust", config.gust_mps, "Standard deviation of the wind, m/s")
      ->check(CLI::Range(0.0, 3.0))
      ->capture_default_str();
  flight->add_option("--full-scale", config.full_scale_mps, "What rc 100 means, m/s")
      ->check(CLI::Range(0.5, 5.0))
      ->capture_default_str();
  flight->add_option("--speed", config.speed_mps, "m/s along the path")
      ->check(CLI::Range(0.05, 5.0))
      ->capture_default_str();
  flight->add_option("--rate", config.rate_hz, "states a second")->check(CLI::Range(1.0, 200.0))->capture_default_str();
  flight->add_option("--laps", config.laps)->check(CLI::Range(1, 1000))->capture_default_str();
  flight->add_option("--batch-count", config.batch_count, "transactions a block, at most")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  flight->add_option("--batch-timeout", batch_timeout_s, "s: a block is cut when its oldest transaction waited so long")
      ->check(CLI::Range(0.001, 60.0))
      ->capture_default_str();
  flight->add_option("--seed", config.seed)->capture_default_str();

  std::string proxy_config, script;
  auto* proxy = app.add_subcommand(
      "proxy",
      "Stands between Tello clients and drones (UDP), and between Fabric clients and servers (TCP), and impairs what "
      "goes\nthrough (docs/proxy.md), until SIGINT or SIGTERM. Exit code 0: ended as asked; 1: something failed; 2: "
      "bad "
      "options or file.");
  proxy->add_option("--config", proxy_config, "TOML file: what it stands before")->required();
  proxy->add_option("--script", script, "TOML file: what is switched when");

  std::string socket, command;
  auto* faults = app.add_subcommand(
      "faults",
      "Tells a running proxy what to switch: drone NAME to|answers|state|video|from|both EFFECTS, server NAME "
      "to|from|both EFFECTS,\nserver NAME cut, clear, list (docs/proxy.md). Exit code 0: done; 1: refused or not "
      "reached; 2: bad options.");
  faults->add_option("SOCKET", socket, "[proxy] faults of its config")->required();
  faults->add_option("COMMAND", command, "in quotes: 'drone tello1 to delay 200ms, loss 5%'")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  if (proxy->parsed()) return run_proxy(proxy_config, script);
  if (faults->parsed()) return tell_faults(socket, command);
  config.mode = mode == "local" ? hil::WorldConfig::Mode::local : hil::WorldConfig::Mode::ledger;
  config.predict = predict == "on";
  config.max_age_ns = from_seconds(max_age_s);
  config.batch_timeout_ns = from_seconds(batch_timeout_s);
  if (const Status read = read_texts(shape, ramp, delay, config); !read) {
    spdlog::error("{}", read.error().what);
    return 2;
  }
  config.delays.added.agent_share = side == "both" ? 0.5 : side == "agent" ? 1.0 : 0.0;
  return virtual_flight(config);
}
