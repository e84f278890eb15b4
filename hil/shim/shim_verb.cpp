#include "hil/shim/shim_verb.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <charconv>
#include <csignal>
#include <cstdio>
#include <ctime>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/config/config.hpp"
#include "common/msg/names.hpp"
#include "common/msg/onboard.hpp"
#include "common/program/program.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/proxy/settings.hpp"
#include "hil/shim/drone_links.hpp"
#include "hil/shim/scripted_agent.hpp"
#include "hil/sitl/digester.hpp"
#include "onboard/ipc/ipc.hpp"
#include "sim/core/parameters.hpp"
#include "sim/core/simulator.hpp"
#include "sim/shell/drone_sockets.hpp"

namespace ledgerline::hil::shim {
namespace {

/// What came of a flight by script: all that the drones were sent, link's transitions, where drones ended. One thread.
class Record {
 public:
  explicit Record(TimeNs begin_ns) : begin_ns_(begin_ns) {}

  /// What link said to a drone, as it left link.
  void sent(TimeNs now, DroneNumber drone, std::string_view bytes);

  /// CSV of at most a million of them: seconds since the beginning, drone, text.
  Status write_datagrams(const std::string& path) const;
  /// Prints a JSON object in one line, and writes it where `path` is not empty.
  Status write_summary(TimeNs now, const std::vector<Transition>& transitions, const sim::Simulator& drones,
                       const SdkFaults::Counts& sdk, const std::string& path);

 private:
  static constexpr std::uint64_t max_lines = 1'000'000;

  TimeNs begin_ns_;
  std::uint64_t count_ = 0;
  std::string lines_ = "seconds,drone,text\n";
  Digester digester_;
};

void Record::sent(TimeNs now, DroneNumber drone, std::string_view bytes) {
  constexpr std::size_t max_text = 200;
  const std::string line =
      fmt::format("{:.6f},tello{},{}\n", to_seconds(now - begin_ns_), drone, printable(bytes, max_text));
  digester_.put(line);
  if (++count_ <= max_lines) lines_ += line;
}

Status Record::write_datagrams(const std::string& path) const {
  if (count_ > max_lines)
    return Error{fmt::format("{}: {} datagrams, of which {} at most can be written", path, count_, max_lines)};
  return write_file(path, lines_);
}

Status Record::write_summary(TimeNs now, const std::vector<Transition>& transitions, const sim::Simulator& drones,
                             const SdkFaults::Counts& sdk, const std::string& path) {
  nlohmann::json summary{{"begin_ns", begin_ns_},
                         {"flown_s", to_seconds(now - begin_ns_)},
                         {"sent", count_},
                         {"sent_digest", crypto::hex(digester_.result())},
                         {"transitions", nlohmann::json::array()},
                         {"sdk", {{"answers", sdk.answers}, {"states", sdk.states}, {"no_room", sdk.no_room}}},
                         {"drones", nlohmann::json::array()}};
  for (const Transition& t : transitions) {
    summary["transitions"].push_back({{"s", to_seconds(t.stamp_ns - begin_ns_)},
                                      {"drone", fmt::format("tello{}", t.drone)},
                                      {"phase", name(t.phase)},
                                      {"mode", name(t.mode)},
                                      {"cause", name(t.cause)}});
  }
  for (std::size_t i = 0; i < sdk.struck.size(); ++i) {
    const auto kind = static_cast<SdkFault::Kind>(i);
    summary["sdk"][fmt::format("{}_{}", of_states(kind) ? "states" : "answers", name_of(kind))] = sdk.struck[i];
  }
  for (int k = 1; k <= drones.drones(); ++k) {
    const sim::Truth truth = drones.truth(static_cast<DroneNumber>(k));
    summary["drones"].push_back({{"name", fmt::format("tello{}", k)},
                                 {"position_m", truth.position_m},
                                 {"motors_on", truth.motors_on},
                                 {"crashed", truth.crashed}});
  }
  std::puts(summary.dump().c_str());
  std::fflush(stdout);
  return path.empty() ? Status(done) : write_file(path, summary.dump(2) + "\n");
}

constexpr TimeNs link_timeout_ns = 30 * ns_per_s;  // until link is there
constexpr TimeNs turn_look_ns = 200 * ns_per_ms;   // a link that stands still may be under a debugger
constexpr TimeNs look_ns = 10 * ns_per_ms;

volatile std::sig_atomic_t halted = 0;
void toggle_halt(int) { halted = halted ? 0 : 1; }

void say_ready() {
  std::puts(R"({"ready":true,"program":"ledgerline hil"})");
  std::fflush(stdout);
}

void sleep_for(TimeNs duration) {
  const timespec wait{duration / ns_per_s, duration % ns_per_s};
  (void)::nanosleep(&wait, nullptr);  // a signal ends it early, and is looked at
}

Status write_all(Record& record, const ScriptedFlight& options, TimeNs now, const ScriptedAgent& agent,
                 const sim::Simulator& drones, const SdkFaults::Counts& sdk) {
  const Status summary = record.write_summary(now, agent.transitions(), drones, sdk, options.summary_file);
  if (options.datagrams_file.empty()) return summary;
  const Status datagrams = record.write_datagrams(options.datagrams_file);
  return summary ? datagrams : summary;
}

Result<std::unique_ptr<sim::DroneWire>> open_wire(const ScriptedFlight& options,
                                                  std::optional<drone_shim::DronesEnd>& end) {
  if (!options.memory.empty()) {
    auto opened = drone_shim::DronesEnd::open(options.memory);
    if (!opened) return opened.error();
    end.emplace(std::move(*opened));
    return std::unique_ptr<sim::DroneWire>(std::make_unique<ShimWire>(*end));
  }
  const auto address = parse_ipv4(options.first_address);
  if (!address) return address.error();
  auto sockets = sim::DroneSockets::open(*address, options.parameters.drones);
  if (!sockets) return sockets.error();
  return std::unique_ptr<sim::DroneWire>(std::make_unique<sim::DroneSockets>(std::move(*sockets)));
}

/// Everything of a flight in lockstep but the pace.
class Lockstep {
 public:
  Lockstep(const ScriptedFlight& options, drone_shim::DronesEnd& end, proxy::CommandSchedule schedule)
      : end_(end),
        now_(end.memory().turns.now_ns.load(std::memory_order_relaxed)),
        drones_(options.parameters, now_),
        links_(options.parameters.drones, options.parameters.seed),
        switches_(DroneLinks::targets(options.parameters.drones)),
        faults_(std::move(schedule)),
        agent_(options.script, now_),
        record_(now_),
        begin_ns_(now_) {}

  bool over() const { return agent_.over(now_); }
  TimeNs flown_ns() const { return now_ - begin_ns_; }

  /// One millisecond, in which link makes a turn and nobody says anything: behind it link has opened its end, and
  /// nothing more that is said to it is lost.
  Status begin() {
    now_ += ns_per_ms;
    return turn();
  }

  /// One millisecond.
  Status step() {
    now_ += ns_per_ms;
    while (const auto command = faults_.pop(flown_ns())) {
      if (const Status applied = switches_.apply(*command); !applied) return applied;
      links_.set(switches_);
    }
    for (const sim::Outgoing& datagram : drones_.step(now_).datagrams) links_.from_drone(now_, datagram);
    while (const auto datagram = links_.to_client(now_)) {
      if (!send_to_client(end_, *datagram)) return Error{"link did not take what its drones said"};
    }
    if (!say()) return Error{"link did not take what agent said"};
    if (const Status made = turn(); !made) return made;
    for (drone_shim::Datagram datagram; end_.receive(datagram);) {
      record_.sent(now_, datagram.drone, datagram.view());
      links_.from_client(now_, datagram.drone, link_endpoint, datagram.view());
    }
    while (const auto sent = links_.to_drone(now_)) drones_.datagram(sent->drone, sent->from, sent->bytes);
    for (StateSample state; end_.memory().states.pop(state);) {
    }
    for (Transition transition; end_.memory().transitions.pop(transition);) agent_.add(transition);
    return done;
  }

  /// What link's publisher still carries comes first.
  Status write(const ScriptedFlight& options) {
    sleep_for(50 * ns_per_ms);
    for (Transition transition; end_.memory().transitions.pop(transition);) agent_.add(transition);
    return write_all(record_, options, now_, agent_, drones_, links_.sdk_counts());
  }

 private:
  Status turn() {
    end_.request_turn(now_);
    using Turn = drone_shim::DronesEnd::Turn;
    Turn state = Turn::in_progress;
    while (state == Turn::in_progress && !stop_requested) state = end_.wait_turn(turn_look_ns);
    if (state != Turn::made) return Error{state == Turn::no_link ? "link has ended" : "ended while link made its turn"};
    return done;
  }
  bool say() {
    const auto& said = agent_.step(now_, drones_);
    bool taken = true;
    for (const AgentHeartbeat& heartbeat : said.heartbeats) taken = end_.memory().heartbeats.push(heartbeat) && taken;
    for (const Pose& pose : said.poses) taken = end_.memory().poses.push(pose) && taken;
    for (const Plan& plan : said.plans) taken = end_.memory().plans.push(plan) && taken;
    return taken;
  }

  drone_shim::DronesEnd& end_;
  TimeNs now_;
  sim::Simulator drones_;
  DroneLinks links_;
  proxy::Switches switches_;
  proxy::CommandSchedule faults_;
  ScriptedAgent agent_;
  Record record_;
  TimeNs begin_ns_;
};

bool wait_for_link(const drone_shim::DronesEnd& end) {
  const TimeNs until = monotonic_ns() + link_timeout_ns;
  while (!end.is_link_alive() && !stop_requested && monotonic_ns() < until) sleep_for(look_ns);
  return end.is_link_alive();
}

/// So that `simulated_ns` of the clock take as long as asked for; time that the clock stood does not count.
class Pace {
 public:
  explicit Pace(double times) : times_(times) {}
  void keep(TimeNs simulated_ns) {
    const TimeNs halt_ns = monotonic_ns();
    while (halted && !stop_requested) sleep_for(look_ns);
    begin_ns_ += monotonic_ns() - halt_ns;
    if (times_ <= 0) return;
    const TimeNs due_ns = begin_ns_ + static_cast<TimeNs>(static_cast<double>(simulated_ns) / times_);
    const TimeNs left_ns = due_ns - monotonic_ns();
    if (left_ns > 0) sleep_for(left_ns);
  }

 private:
  double times_;
  TimeNs begin_ns_ = monotonic_ns();
};

/// In lockstep: waits at most 30 s for link, then moves its clock, a turn a millisecond. SIGUSR1 halts the clock, and
/// lets it go on. The same script, seed and build give the same bytes, however fast.
Status fly_in_lockstep(const ScriptedFlight& options) {
  catch_stop_signals();
  struct sigaction act {};
  act.sa_handler = toggle_halt;
  ::sigaction(SIGUSR1, &act, nullptr);
  auto faults =
      proxy::CommandSchedule::make(options.script.faults, proxy::Switches(DroneLinks::targets(options.script.drones)));
  if (!faults) return faults.error();
  auto end = drone_shim::DronesEnd::open(options.memory, true);
  if (!end) return end.error();
  say_ready();
  if (!wait_for_link(*end)) return Error{"no link came within 30 s: start it with [shim] lockstep = true"};
  Lockstep flight(options, *end, std::move(*faults));
  Pace pace(options.times);
  Status flown = flight.begin();
  while (flown && !flight.over() && !stop_requested) {
    flown = flight.step();
    pace.keep(flight.flown_ns());
  }
  const Status written = flight.write(options);
  return flown ? written : flown;
}

/// In real time: link gets its plans by iceoryx, so RouDi must run. Until the script ends, or SIGINT or SIGTERM.
Status fly_in_real_time(const ScriptedFlight& options) {
  const sigset_t waiting = catch_stop_signals_while_waiting();
  std::optional<drone_shim::DronesEnd> end;
  auto wire = open_wire(options, end);
  if (!wire) return wire.error();
  auto faulty = FaultyWire::open(std::move(*wire), options.parameters.drones, options.parameters.seed,
                                 {options.faults_socket, options.script.faults});
  if (!faulty) return faulty.error();
  FaultyWire& drones_wire = **faulty;
  if (auto connected = ipc::connect("ledgerline-hil"); !connected) return connected;
  auto opened = ipc::AgentEnd::create();
  if (!opened) return opened.error();
  ipc::AgentEnd& link = **opened;
  say_ready();
  const TimeNs give_up_ns = monotonic_ns() + link_timeout_ns;
  StateSample state;
  while (!link.receive_state(state) && !stop_requested) {
    if (monotonic_ns() > give_up_ns) return Error{"no link came within 30 s"};
    sleep_for(look_ns);
  }

  const TimeNs begin_ns = monotonic_ns();
  sim::Simulator drones(options.parameters, begin_ns);
  ScriptedAgent agent(options.script, begin_ns);
  Record record(begin_ns);
  TimeNs now = begin_ns, tick = begin_ns;
  std::uint64_t unsaid = 0;
  while (!agent.over(now) && !stop_requested) {
    if (now >= tick) tick += ns_per_ms * ((now - tick) / ns_per_ms + 1);
    drones_wire.wait(tick, waiting);
    now = monotonic_ns();
    for (sim::DroneWire::Received received; drones_wire.receive(received);) {
      record.sent(now, received.drone, received.bytes);
      drones.datagram(received.drone, received.from, received.bytes);
    }
    for (const sim::Outgoing& datagram : drones.step(now).datagrams) drones_wire.send(datagram);
    const auto& said = agent.step(now, drones);
    for (const AgentHeartbeat& heartbeat : said.heartbeats) unsaid += link.send_heartbeat(heartbeat) ? 0 : 1;
    for (const Pose& pose : said.poses) unsaid += link.send_pose(pose) ? 0 : 1;
    for (const Plan& plan : said.plans) unsaid += link.send_plan(plan) ? 0 : 1;
    while (link.receive_state(state)) {
    }
    for (Transition transition; link.receive_transition(transition);) agent.add(transition);
  }
  const Status written = write_all(record, options, now, agent, drones, drones_wire.sdk_counts());
  if (unsaid > 0) return Error{fmt::format("link's shared memory took {} plans, poses or signs of life not", unsaid)};
  return written;
}

}  // namespace

const char* const ShimVerb::about =
    "Simulated drones behind link's shim: shared memory in place of the Tello's UDP link, with the same bytes\n"
    "(docs/faults.md). Alone: in real time, for the real agent and ledger (./fly --shim). With --plans: a script "
    "stands\n"
    "in agent's place, and with --lockstep it moves link's clock as well; one JSON object is printed in the end.\n"
    "Exit code 0: ended as asked; 1: something failed; 2: bad options or script.";

ShimVerb::ShimVerb(Verb verb) : verb_(std::move(verb)) {
  drones_.add_to(verb_);
  const Option memory = verb_.option("--memory", flight_.memory, "file in /dev/shm: link's [shim] memory");
  verb_.option("--faults", flight_.faults_socket,
               "Unix socket for `ledgerline hil faults`: drone, sensor and sdk commands");
  verb_.option("--script", faults_file_, "TOML file of [[fault]]: what is switched when").existing_file();
  const Option plans =
      verb_.option("--plans", plans_, "TOML file: what agent says to link, and faults").existing_file();
  verb_.option("--udp", flight_.first_address, "of tello1, with --plans: the same over UDP, to compare")
      .needs(plans)
      .excludes(memory);
  verb_
      .option("--lockstep", lockstep_,
              "this program moves link's clock: so many times as fast as real time, or `free`; SIGUSR1 halts it")
      .needs(plans)
      .needs(memory);
  verb_.option("--datagrams", flight_.datagrams_file, "CSV file: all that the drones were sent").needs(plans);
}

Status ShimVerb::read() {
  if (const Status read = drones_.read(); !read) return read;
  if (flight_.memory.empty() && flight_.first_address.empty())
    return Error{"--memory FILE is needed (or --plans with --udp)"};
  if (!plans_.empty() && !faults_file_.empty()) return Error{"--script: with --plans its file has the [[fault]]s"};
  for (const char* option : {"--trace", "--drones", "--mocap-hz", "--config"}) {
    if (!plans_.empty() && verb_.is_given(option))
      return Error{fmt::format("{}: does nothing with --plans, whose file has the drones and whose poses are the truth",
                               option)};
  }
  if (!lockstep_.empty() && !flight_.faults_socket.empty())
    return Error{"--faults: in lockstep a script alone says what goes wrong, or it would not be the same each time"};
  if (lockstep_.empty() || lockstep_ == "free") {
    flight_.times = lockstep_.empty() ? 1 : 0;
    return done;
  }
  const auto [end, error] = std::from_chars(lockstep_.data(), lockstep_.data() + lockstep_.size(), flight_.times);
  if (error != std::errc{} || end != lockstep_.data() + lockstep_.size() || flight_.times < 0.01 ||
      flight_.times > 1000)
    return Error{"--lockstep: must be from 0.01 to 1000, or free"};
  return done;
}

int ShimVerb::run() {
  if (const Status status = read(); !status) return fail(status.error(), exit_usage);
  if (!plans_.empty()) return fly_by_script();
  Faults faults{flight_.faults_socket, {}};
  const int count = drones_.shell.parameters.drones;
  if (!faults_file_.empty()) {
    auto config = Config::load(faults_file_);
    if (!config) return fail(config.error(), exit_usage);
    faults.scheduled = proxy::read_faults(*config, DroneLinks::targets(count));
    if (const Status read = config->finish(); !read) return fail(read.error(), exit_usage);
  }
  std::optional<drone_shim::DronesEnd> end;
  const auto open = [&]() -> Result<std::unique_ptr<sim::DroneWire>> {
    auto opened = drone_shim::DronesEnd::open(flight_.memory);
    if (!opened) return opened.error();
    end.emplace(std::move(*opened));
    auto wire = FaultyWire::open(std::make_unique<ShimWire>(*end), count, drones_.shell.parameters.seed, faults);
    if (!wire) return wire.error();
    spdlog::info("{} drone(s) behind {}, mocap {} Hz", count, flight_.memory, drones_.shell.parameters.mocap_hz);
    return std::unique_ptr<sim::DroneWire>(std::move(*wire));
  };
  return exit_code(sim::run_real_time(drones_.shell, open, R"({"ready":true,"program":"ledgerline hil"})"));
}

int ShimVerb::fly_by_script() {
  auto script = load_plan_script(plans_);
  if (!script) return fail(script.error(), exit_usage);
  flight_.parameters = drones_.shell.parameters;
  flight_.parameters.drones = script->drones;
  flight_.script = std::move(*script);
  flight_.summary_file = drones_.shell.summary_file;
  return exit_code(lockstep_.empty() ? fly_in_real_time(flight_) : fly_in_lockstep(flight_));
}

}  // namespace ledgerline::hil::shim
