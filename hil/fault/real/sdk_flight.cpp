#include "hil/fault/real/sdk_flight.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/base/file.hpp"
#include "common/process/children.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/real/real_faults.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/netem/text_parse.hpp"
#include "sim/core/sensors.hpp"

namespace ledgerline::hil {
namespace {

/// The error says what of a fault would have to be done to something that is not there.
Status check_fault_by_sdk(const Fault& fault, int drones) {
  if (auto real = fault.acts.check_real(fault, {}); !real) return real;
  const RealActs acts = acts_at_begin(fault, {fault}, drones, {});
  for (const std::string& command : acts.proxy) {
    if (command.starts_with("server")) return Error{"there is no ledger in a flight by the SDK"};
  }
  if (!acts.programs.empty() || !acts.parts.empty() || !acts.control.empty() || acts.fill_disk)
    return Error{"there is no link, agent, ground or ledger in a flight by the SDK"};
  return done;
}

}  // namespace

std::vector<NotReal> not_by_sdk(const Script& script) {
  std::vector<NotReal> reasons;
  const WorldConfig usual, &flight = script.flight;
  const struct {
    bool set;
    const char *key, *why;
  } settings[] = {
      {flight.rate_hz != usual.rate_hz, "flight.rate_hz", "it is link's"},
      {!flight.predict, "flight.predict", "it is ground's"},
      {flight.max_age_ns != usual.max_age_ns, "flight.max_age", "it is of commands through a ledger"},
      {flight.idle_evict_ns != usual.idle_evict_ns, "flight.idle_evict", "it is agent's"},
      {flight.blocks != usual.blocks, "flight.blocks", "there is no ledger"},
      {flight.pose != usual.pose, "flight.pose", "it is link's; an SDK client knows what the drone reports"},
      {flight.on_untrusted_ledger != usual.on_untrusted_ledger, "flight.on_untrusted_ledger", "it is link's"},
      {flight.batch_count != usual.batch_count, "flight.batch_count", "there is no ledger"},
      {flight.batch_timeout_ns != usual.batch_timeout_ns, "flight.batch_timeout", "there is no ledger"},
      {flight.drawn_tello, "flight.tello", "ledgerline-sim is the usual Tello"},
      {flight.wifi.has_value(), "flight.wifi", "a fault's recorded-day does it"},
      {!flight.keeps_rc, "flight.keeps_rc", "ledgerline-sim is the usual Tello"},
      {!flight.command_counts, "flight.command_counts", "ledgerline-sim is the usual Tello"},
  };
  for (const auto& [set, key, why] : settings) {
    if (set) reasons.push_back({key, why});
  }
  for (std::size_t i = 0; i < script.faults.size(); ++i) {
    const Fault& fault = script.faults[i];
    if (const Status by_sdk = check_fault_by_sdk(fault, flight.drones); !by_sdk)
      reasons.push_back(
          {fmt::format("fault.{}.what", i), fmt::format("\"{}\": {}", fault.text, by_sdk.error().message)});
    if (fault.trigger.kind == Trigger::Kind::landing)
      reasons.push_back({fmt::format("fault.{}.at", i), "link says when it lands; use `landed`, or a time"});
  }
  for (const Rule& rule : script.must) {
    const std::string_view why =
        rule.kind->needs_link ? "link says that, and there is none in a flight by the SDK" : rule.kind->not_real;
    if (!why.empty()) reasons.push_back({"must", fmt::format("\"{}\": {}", rule.text, why)});
  }
  return reasons;
}

Status check_sdk(const Script& script) {
  std::vector<std::string> lines;
  for (const NotReal& reason : not_by_sdk(script)) lines.push_back(fmt::format("{}: {}", reason.key, reason.what));
  if (lines.empty()) return done;
  return Error{fmt::format("{} cannot be flown by an SDK client:\n  {}", script.name, fmt::join(lines, "\n  "))};
}

namespace {

namespace fs = std::filesystem;

constexpr TimeNs network_timeout_ns = 10 * ns_per_s, network_look_ns = 5 * ns_per_ms;
constexpr const char* sky_end = "10.77.2.1";  // the cable's ends
constexpr const char* client_end = "10.77.1.1";
constexpr const char* clients_network = "192.168.10.0/24";  // of the proxy's fronts: there is no way around it
constexpr const char* advice =
    "an SDK client gets a network of its own, which takes root, if only of a user namespace: run this as root, or "
    "below "
    "`unshare -Urn`";

std::string network_of(const std::string& file) {
  std::error_code error;
  return fs::read_symlink(file, error).string();
}

/// Two networks with a cable between them: `sky`, with addresses of its own, and `client`, which reaches those and has
/// nothing else: a program there may bind any port. They are children that hold a network namespace each, and end with
/// `children`, which must outlive this. One thread.
class TwoNetworks {
 public:
  explicit TwoNetworks(Children& children) : children_(children) {}
  /// The error says what is missing: rights, or ip, unshare and nsenter.
  Status open(const std::vector<std::string>& sky_addresses, const std::string& directory);
  /// Words that start a command in one of them.
  std::vector<std::string> in_sky() const { return enter(sky); }
  std::vector<std::string> in_client() const { return enter(client); }

 private:
  static inline const std::string sky = "sky", client = "client";
  Status find_tools();
  Status hold(const std::string& name, const std::string& directory);
  Status set_up(const std::string& name, const std::string& lines, const std::string& directory);
  std::vector<std::string> enter(const std::string& name) const;
  std::string file_of(const std::string& name) const;

  Children& children_;
  std::string unshare_{}, nsenter_{}, sleep_{}, sh_{};  ///< where they are
};

std::string TwoNetworks::file_of(const std::string& name) const {
  return fmt::format("/proc/{}/ns/net", children_.pid(name));
}

std::vector<std::string> TwoNetworks::enter(const std::string& name) const {
  return {nsenter_, "--net=" + file_of(name)};
}

Status TwoNetworks::find_tools() {
  for (const auto& [name, at] :
       {std::pair("unshare", &unshare_), {"nsenter", &nsenter_}, {"sleep", &sleep_}, {"sh", &sh_}}) {
    auto found = program_at(name);
    if (!found) return found.error();
    *at = std::move(*found);
  }
  const auto ip = program_at("ip");  // the shell finds it by itself
  return ip ? Status(done) : ip.error();
}

Status TwoNetworks::hold(const std::string& name, const std::string& directory) {
  if (auto started = children_.start(
          {name, {unshare_, "-n", sleep_, "infinity"}, fmt::format("{}/{}.log", directory, name), SIGKILL});
      !started)
    return started;
  const std::string mine = network_of("/proc/self/ns/net");
  for (const TimeNs until = monotonic_ns() + network_timeout_ns; monotonic_ns() < until;) {
    if (!children_.is_running(name)) return Error{fmt::format("{}: {}", advice, children_.log_tail(name, 2))};
    const std::string its = network_of(file_of(name));
    if (!its.empty() && its != mine) return done;
    children_.poll(network_look_ns);
  }
  return Error{advice};
}

Status TwoNetworks::set_up(const std::string& name, const std::string& lines, const std::string& directory) {
  const std::string task = "ip-" + name;
  std::vector<std::string> command = enter(name);
  command.insert(command.end(), {sh_, "-euc", lines});
  if (auto started = children_.start({task, std::move(command), fmt::format("{}/{}.log", directory, task), SIGKILL});
      !started)
    return started;
  const TimeNs until = monotonic_ns() + network_timeout_ns;
  while (children_.is_running(task) && monotonic_ns() < until) children_.poll(network_look_ns);
  if (children_.has_succeeded(task)) return done;
  return Error{fmt::format("{}: {}", advice, children_.log_tail(task, 3))};
}

Status TwoNetworks::open(const std::vector<std::string>& sky_addresses, const std::string& directory) {
  if (auto found = find_tools(); !found) return found;
  for (const std::string& name : {sky, client}) {
    if (auto held = hold(name, directory); !held) return held;
  }
  std::string lines = "ip link set lo up\n";
  for (const std::string& address : sky_addresses) lines += fmt::format("ip addr add {}/32 dev lo\n", address);
  lines += fmt::format(
      "ip link add client type veth peer name eth0 netns {0}\nip addr add {1}/32 dev client\nip link set client up\n"
      "ip route add {2}/32 dev client\n",
      children_.pid(client), sky_end, client_end);
  if (auto set = set_up(sky, lines, directory); !set) return set;
  return set_up(client,
                fmt::format("ip link set lo up\nip addr add {0}/32 dev eth0\nip link set eth0 up\n"
                            "ip route add {1}/32 dev eth0\nip route add {2} via {1} dev eth0 onlink\n",
                            client_end, sky_end, clients_network),
                directory);
}

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
  Status start(const std::string& name, const std::vector<std::string>& arguments);
  Status start_all();
  Status watch();
  Result<Recording> recording() const;

  const Script& script_;
  std::uint64_t seed_;
  RealOptions options_;
  std::string run_;
  LiveObservation live_;
  RealFaults faults_;
  OwnProgram program_;
  std::set<std::string> ready_;
  Children children_{{[this](const std::string& name, const std::string& line) {
    if (name == OwnProgram::name) {
      program_.add_line(line);
    } else if (line.find("\"ready\"") != std::string::npos) {
      ready_.insert(name);
    } else {
      faults_.add_line(name, line);
    }
  }}};
  TwoNetworks networks_;
  bool over_ = true;
};

/// In the sky; waits until it serves.
Status SdkFlight::start(const std::string& name, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = networks_.in_sky();
  command.insert(command.end(), arguments.begin(), arguments.end());
  const std::string log = fmt::format("{}/{}.log", run_, name);
  if (auto started = children_.start({name, std::move(command), log, SIGTERM}); !started) return started;
  const TimeNs until = monotonic_ns() + ready_timeout_ns;
  while (children_.is_running(name) && !ready_.contains(name) && monotonic_ns() < until) children_.poll(sdk_watch_ns);
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
  std::vector<std::string> sim{options_.programs + "/ledgerline-sim", "--trace", run_ + "/sim.trace", "--summary",
                               run_ + "/sim.summary.json"};
  const std::string drones = fmt::format("--drones {} --address {} --mocap-hz 0 --seed {} --battery {:g} --yaw {:g}",
                                         flight.drones, drone_address(1), seed_, 100 * flight.battery, flight.yaw_deg);
  for (const std::string_view word : words_of(drones)) sim.emplace_back(word);
  if (!flight.pads.empty()) sim.insert(sim.end(), {"--pads", sim::pads_text(flight.pads)});
  if (auto started = start("sim", sim); !started) return started;
  if (auto written = write_file(run_ + "/hil-proxy.toml", config); !written) return written;
  if (auto started =
          start("hil-proxy", {options_.programs + "/ledgerline", "hil", "proxy", "--config", run_ + "/hil-proxy.toml"});
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
    if (options_.should_stop()) return Error{"interrupted"};
    for (const char* name : {"sim", "hil-proxy"}) {
      if (!children_.is_running(name))
        return Error{fmt::format("{} {}: {}", name, children_.how_it_ended(name), children_.log_tail(name, 3))};
    }
    if (live_.begin_ns() == 0 && now < start_until) continue;
    if (live_.begin_ns() == 0) return Error{run_ + "/sim.trace says nothing: nobody could check this flight"};
    if (auto stepped = faults_.step(now); !stepped) return stepped;
    if (!program_.is_running() && ended_ns == 0) ended_ns = now;
    const bool down = std::all_of(live_.drones().begin(), live_.drones().end(),
                                  [](const DroneObservation& drone) { return on_ground(drone.truth); });
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
  if (recording.why.empty() && !children_.has_succeeded(OwnProgram::name))
    recording.why = "the program " + children_.how_it_ended(OwnProgram::name);
  recording.ok = recording.why.empty();
  return recording;
}

Result<RunResult> SdkFlight::fly() {
  if (auto made = make_flight_folder(run_, {run_}); !made) return made.error();
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
