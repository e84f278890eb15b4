#include "hil/fault/own/sdk_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <set>

#include "common/base/file.hpp"
#include "hil/fault/own/own_program.hpp"
#include "hil/fault/own/sdk_script.hpp"
#include "hil/fault/own/two_networks.hpp"
#include "hil/fault/real/live_facts.hpp"
#include "hil/fault/real/real_faults.hpp"
#include "hil/fault/real/replay.hpp"
#include "sim/core/pads.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs sdk_watch_ns = 20 * ns_per_ms;
constexpr TimeNs ready_timeout_ns = 30 * ns_per_s;
constexpr TimeNs landing_timeout_ns = 25 * ns_per_s;  // a Tello that hears nothing lands after 15 s
constexpr TimeNs sdk_end_timeout_ns = 10 * ns_per_s;
constexpr const char* proxy_source = "10.77.4.1";

std::string drone_address(int number) { return fmt::format("10.77.0.{}", number + 1); }
std::string client_address(int number) { return fmt::format("192.168.10.{}", number); }

class SdkFlight {
 public:
  SdkFlight(const Script& script, std::uint64_t seed, const RealOptions& options)
      : script_(script),
        seed_(seed),
        options_(options),
        run_(options.directory + "/run"),
        live_(run_, script),
        faults_(script, {options.programs, options.directory, run_, "sim", {}}, live_, children_),
        program_(children_, options.own.program, options.directory),
        networks_(children_) {}

  Result<RunResult> fly();

 private:
  Status make_directory() const;
  Status start(const std::string& name, const std::vector<std::string>& arguments);
  Status start_all();
  Status watch();
  Result<Recording> recording() const;

  const Script& script_;
  std::uint64_t seed_;
  RealOptions options_;
  std::string run_;
  LiveFacts live_;
  RealFaults faults_;
  OwnProgram program_;
  std::set<std::string> ready_;
  Children children_{{[this](const std::string& name, const std::string& line) {
    if (name == OwnProgram::name) {
      program_.take_line(line);
    } else if (line.find("\"ready\"") != std::string::npos) {
      ready_.insert(name);
    } else {
      faults_.take_line(name, line);
    }
  }}};
  TwoNetworks networks_;
  bool over_ = true;
};

Status SdkFlight::make_directory() const {
  std::error_code error;
  if (fs::exists(run_, error))
    return Error{fmt::format("{} is of another flight: remove it, or give --out another folder", run_)};
  fs::create_directories(run_, error);
  if (error) return Error{fmt::format("cannot make {}: {}", run_, error.message())};
  return done;
}

/// In the sky; waits until it serves.
Status SdkFlight::start(const std::string& name, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = networks_.in_sky();
  command.insert(command.end(), arguments.begin(), arguments.end());
  const std::string log = fmt::format("{}/{}.log", run_, name);
  if (auto started = children_.start({name, std::move(command), log, SIGTERM}); !started) return started;
  const TimeNs until = monotonic_ns() + ready_timeout_ns;
  while (children_.running(name) && !ready_.contains(name) && monotonic_ns() < until) children_.poll(sdk_watch_ns);
  if (ready_.contains(name)) return done;
  return Error{fmt::format("{} does not serve: {}", name, children_.log_tail(name, 3))};
}

Status SdkFlight::start_all() {
  const WorldConfig& flight = script_.flight;
  std::vector<std::string> addresses{proxy_source};
  std::string fronts,
      config = fmt::format("[proxy]\nseed = {}\nfaults = \"{}\"\nsummary = \"{}\"\nsource = \"{}\"\n", seed_,
                           run_ + "/faults.sock", run_ + "/hil-proxy.summary.json", proxy_source);
  for (int k = 1; k <= flight.drones; ++k) {
    addresses.insert(addresses.end(), {drone_address(k), client_address(k)});
    fronts += (k > 1 ? "," : "") + client_address(k);
    config += fmt::format("\n[[drone]]\nname = \"{}\"\nlisten = \"{}\"\naddress = \"{}\"\n", drone_name(k),
                          client_address(k), drone_address(k));
  }
  if (auto opened = networks_.open(addresses, run_); !opened) return opened;
  std::vector<std::string> sim{options_.programs + "/ledgerline-sim",
                               "--drones",
                               std::to_string(flight.drones),
                               "--address",
                               drone_address(1),
                               "--mocap-hz",
                               "0",
                               "--seed",
                               std::to_string(seed_),
                               "--battery",
                               fmt::format("{:g}", 100 * flight.battery),
                               "--yaw",
                               fmt::format("{:g}", flight.yaw_deg),
                               "--trace",
                               run_ + "/sim.trace",
                               "--summary",
                               run_ + "/sim.summary.json"};
  if (!flight.pads.empty()) sim.insert(sim.end(), {"--pads", sim::pads_text(flight.pads)});
  if (auto started = start("sim", sim); !started) return started;
  if (auto written = write_file(run_ + "/hil-proxy.toml", config); !written) return written;
  if (auto started =
          start("hil-proxy", {options_.programs + "/ledgerline-hil", "proxy", "--config", run_ + "/hil-proxy.toml"});
      !started)
    return started;
  return program_.start(networks_.in_client(), {"TELLO_ADDRESSES=" + fronts});
}

Status SdkFlight::watch() {
  TimeNs ended_ns = 0;
  const TimeNs start_until = monotonic_ns() + ready_timeout_ns;
  for (;;) {
    children_.poll(sdk_watch_ns);
    live_.read();
    const TimeNs now = monotonic_ns();
    for (const char* name : {"sim", "hil-proxy"}) {
      if (!children_.running(name))
        return Error{fmt::format("{} {}: {}", name, children_.how_it_ended(name), children_.log_tail(name, 3))};
    }
    if (live_.begin_ns() == 0 && now < start_until) continue;
    if (live_.begin_ns() == 0) return Error{run_ + "/sim.trace says nothing: nobody could check this flight"};
    if (auto stepped = faults_.step(now); !stepped) return stepped;
    if (!program_.running() && ended_ns == 0) ended_ns = now;
    const bool down = std::all_of(live_.facts().begin(), live_.facts().end(),
                                  [](const DroneFacts& drone) { return on_ground(drone.truth); });
    // What the traces show is up to a second old.
    if (ended_ns != 0 && now - ended_ns > 2 * ns_per_s && (down || now - ended_ns > landing_timeout_ns)) return done;
    if (ended_ns == 0 && now - live_.begin_ns() > script_.limit_ns) {
      over_ = false;
      return done;
    }
  }
}

Result<Recording> SdkFlight::recording() const {
  Recording recording;
  auto truth = read_trace(run_ + "/sim.trace");
  if (!truth) return truth.error();
  recording.sim = std::move(*truth);
  recording.has_link = false;
  recording.begin_ns = live_.begin_ns();
  if (!recording.sim.empty()) recording.end_ns = recording.sim.back().t_ns;
  recording.over = over_;
  recording.faults = faults_.begun();
  std::set<int> flew;
  for (const TraceRecord& r : recording.sim) {
    if (r.kind == TraceKind::truth && r.extra == 1) flew.insert(r.drone);
  }
  for (int k = 1; k <= script_.flight.drones && recording.why.empty(); ++k) {
    if (!flew.contains(k)) recording.why = drone_name(k) + " never took off";
  }
  if (recording.why.empty() && !children_.ended_well(OwnProgram::name))
    recording.why = "the program " + children_.how_it_ended(OwnProgram::name);
  recording.ok = recording.why.empty();
  return recording;
}

Result<RunResult> SdkFlight::fly() {
  if (auto made = make_directory(); !made) return made.error();
  if (auto started = start_all(); !started) return started.error();
  if (auto watched = watch(); !watched) return watched.error();
  program_.end();
  faults_.end();
  for (const char* name : {"hil-proxy", "sim"}) children_.stop(name, sdk_end_timeout_ns);
  const auto recorded = recording();
  if (!recorded) return recorded.error();
  RunResult result = check_recording(script_, seed_, *recorded);
  result.verdicts.push_back(program_.verdict(result.flown_ns));
  return result;
}

}  // namespace

Result<RunResult> fly_by_sdk(const Script& script, std::uint64_t seed, const RealOptions& options) {
  if (options.own.program.empty())
    return Error{fmt::format("{}: flight.kind = \"sdk\" is flown by a program of yours: give --program", script.name)};
  if (auto possible = check_sdk(script); !possible) return possible.error();
  return SdkFlight(script, seed, options).fly();
}

}  // namespace ledgerline::hil
