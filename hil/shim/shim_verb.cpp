#include "hil/shim/shim_verb.hpp"

#include <fmt/format.h>

#include <charconv>

#include "common/base/log.hpp"
#include "common/config/config.hpp"
#include "common/program/program.hpp"
#include "hil/proxy/settings.hpp"
#include "hil/shim/scripted/flights.hpp"

namespace ledgerline::hil::shim {

const char* const ShimVerb::about =
    "Simulated drones behind link's shim: shared memory in place of the Tello's UDP link, with the same bytes\n"
    "(docs/shim.md). Alone: in real time, for the real agent and ledger (./fly --shim). With --plans: a script stands\n"
    "in agent's place, and with --lockstep it moves link's clock as well; one JSON object is printed in the end.\n"
    "Exit code 0: ended as asked; 1: something failed; 2: bad options or script.";

ShimVerb::ShimVerb(Verb verb) : verb_(std::move(verb)) {
  drones_.add_to(verb_);
  const Option memory = verb_.option("--memory", memory_, "file in /dev/shm: link's [shim] memory");
  verb_.option("--faults", faults_socket_, "Unix socket for `ledgerline hil faults`: drone, sensor and sdk commands");
  verb_.option("--script", faults_file_, "TOML file of [[fault]]: what is switched when").existing_file();
  const Option plans =
      verb_.option("--plans", plans_, "TOML file: what agent says to link, and faults").existing_file();
  verb_.option("--udp", address_, "of tello1, with --plans: the same over UDP, to compare")
      .needs(plans)
      .excludes(memory);
  verb_
      .option("--lockstep", lockstep_,
              "this program moves link's clock: so many times as fast as real time, or `free`; SIGUSR1 halts it")
      .needs(plans)
      .needs(memory);
  verb_.option("--datagrams", datagrams_, "CSV file: all that the drones were sent").needs(plans);
}

Status ShimVerb::read() {
  if (const Status read = drones_.read(); !read) return read;
  if (memory_.empty() && address_.empty()) return Error{"--memory FILE is needed (or --plans with --udp)"};
  if (!plans_.empty() && !faults_file_.empty()) return Error{"--script: with --plans its file has the [[fault]]s"};
  for (const char* option : {"--trace", "--drones", "--mocap-hz", "--config"}) {
    if (!plans_.empty() && verb_.given(option))
      return Error{fmt::format("{}: does nothing with --plans, whose file has the drones and whose poses are the truth",
                               option)};
  }
  if (!lockstep_.empty() && !faults_socket_.empty())
    return Error{"--faults: in lockstep a script alone says what goes wrong, or it would not be the same each time"};
  if (lockstep_.empty() || lockstep_ == "free") {
    times_ = lockstep_.empty() ? 1 : 0;
    return done;
  }
  const auto [end, error] = std::from_chars(lockstep_.data(), lockstep_.data() + lockstep_.size(), times_);
  if (error != std::errc{} || end != lockstep_.data() + lockstep_.size() || times_ < 0.01 || times_ > 1000)
    return Error{"--lockstep: must be from 0.01 to 1000, or free"};
  return done;
}

int ShimVerb::run() {
  if (const Status status = read(); !status) return fail(status.error(), exit_usage);
  if (!plans_.empty()) return fly_by_script();
  Faults faults{faults_socket_, {}};
  const int count = drones_.shell.parameters.drones;
  if (!faults_file_.empty()) {
    auto config = Config::load(faults_file_);
    if (!config) return fail(config.error(), exit_usage);
    faults.scripted = proxy::read_faults(*config, DroneWays::targets(count));
    if (const Status read = config->finish(); !read) return fail(read.error(), exit_usage);
  }
  std::optional<drone_shim::DronesEnd> end;
  const auto open = [&]() -> Result<std::unique_ptr<sim::DroneWire>> {
    auto opened = drone_shim::DronesEnd::open(memory_);
    if (!opened) return opened.error();
    end.emplace(std::move(*opened));
    auto wire = BentWire::open(std::make_unique<ShimWire>(*end), count, drones_.shell.parameters.seed, faults);
    if (!wire) return wire.error();
    spdlog::info("{} drone(s) behind {}, mocap {} Hz", count, memory_, drones_.shell.parameters.mocap_hz);
    return std::unique_ptr<sim::DroneWire>(std::move(*wire));
  };
  return exit_code(sim::run_real_time(drones_.shell, open, R"({"ready":true,"program":"ledgerline-hil"})"));
}

int ShimVerb::fly_by_script() {
  auto script = load_plan_script(plans_);
  if (!script) return fail(script.error(), exit_usage);
  FlightOptions options;
  options.memory = memory_;
  options.first_address = address_;
  options.parameters = drones_.shell.parameters;
  options.parameters.drones = script->drones;
  options.script = std::move(*script);
  options.faults_socket = faults_socket_;
  options.datagrams_file = datagrams_;
  options.summary_file = drones_.shell.summary_file;
  options.times = times_;
  return exit_code(lockstep_.empty() ? fly_in_real_time(options) : fly_in_lockstep(options));
}

}  // namespace ledgerline::hil::shim
