#include "hil/shim/scripted/flights.hpp"

#include <fmt/format.h>

#include <csignal>
#include <cstdio>
#include <ctime>

#include "common/base/ipv4.hpp"
#include "common/base/log.hpp"
#include "common/program/stop_signals.hpp"
#include "hil/shim/scripted/record.hpp"
#include "hil/shim/scripted/scripted_agent.hpp"
#include "onboard/ipc/ipc.hpp"
#include "sim/shell/drone_sockets.hpp"

namespace ledgerline::hil::shim {
namespace {

constexpr TimeNs link_timeout_ns = 30 * ns_per_s;  // until link is there
constexpr TimeNs turn_look_ns = 200 * ns_per_ms;   // a link that stands still may be under a debugger
constexpr TimeNs look_ns = 10 * ns_per_ms;

volatile std::sig_atomic_t halted = 0;
void toggle_halt(int) { halted = halted ? 0 : 1; }

void say_ready() {
  std::puts(R"({"ready":true,"program":"ledgerline-hil"})");
  std::fflush(stdout);
}

void sleep_for(TimeNs duration) {
  const timespec wait{duration / ns_per_s, duration % ns_per_s};
  (void)::nanosleep(&wait, nullptr);  // a signal ends it early, and is looked at
}

Status write_all(Record& record, const FlightOptions& options, TimeNs now, const ScriptedAgent& agent,
                 const sim::Simulator& drones, const SdkFaults::Counts& sdk) {
  const Status summary = record.write_summary(now, agent.transitions(), drones, sdk, options.summary_file);
  if (options.datagrams_file.empty()) return summary;
  const Status datagrams = record.write_datagrams(options.datagrams_file);
  return summary ? datagrams : summary;
}

Result<std::unique_ptr<sim::DroneWire>> open_wire(const FlightOptions& options,
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
  Lockstep(const FlightOptions& options, drone_shim::DronesEnd& end, proxy::Script script)
      : end_(end),
        now_(end.memory().turns.now_ns.load(std::memory_order_relaxed)),
        drones_(options.parameters, now_),
        ways_(options.parameters.drones, options.parameters.seed),
        switches_(DroneWays::targets(options.parameters.drones)),
        faults_(std::move(script)),
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
    while (const auto command = faults_.take(flown_ns())) {
      if (const Status applied = switches_.apply(*command); !applied) return applied;
      ways_.set(switches_);
    }
    for (const sim::Outgoing& datagram : drones_.step(now_).datagrams) ways_.from_drone(now_, datagram);
    while (const auto datagram = ways_.to_client(now_)) {
      if (!give(end_, *datagram)) return Error{"link did not take what its drones said"};
    }
    if (!say()) return Error{"link did not take what agent said"};
    if (const Status made = turn(); !made) return made;
    for (drone_shim::Datagram datagram; end_.take(datagram);) {
      record_.sent(now_, datagram.drone, datagram.view());
      ways_.from_client(now_, datagram.drone, link_endpoint, datagram.view());
    }
    while (const auto sent = ways_.to_drone(now_)) drones_.datagram(sent->drone, sent->from, sent->bytes);
    for (StateSample state; end_.memory().states.pop(state);) {
    }
    for (Transition transition; end_.memory().transitions.pop(transition);) agent_.take(transition);
    return done;
  }

  /// What link's publisher still carries comes first.
  Status write(const FlightOptions& options) {
    sleep_for(50 * ns_per_ms);
    for (Transition transition; end_.memory().transitions.pop(transition);) agent_.take(transition);
    return write_all(record_, options, now_, agent_, drones_, ways_.sdk_counts());
  }

 private:
  Status turn() {
    end_.ask_turn(now_);
    using Turn = drone_shim::DronesEnd::Turn;
    Turn state = Turn::under_way;
    while (state == Turn::under_way && !stop_requested) state = end_.wait_turn(turn_look_ns);
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
  DroneWays ways_;
  proxy::Switches switches_;
  proxy::Script faults_;
  ScriptedAgent agent_;
  Record record_;
  TimeNs begin_ns_;
};

bool wait_for_link(const drone_shim::DronesEnd& end) {
  const TimeNs until = monotonic_ns() + link_timeout_ns;
  while (!end.link_lives() && !stop_requested && monotonic_ns() < until) sleep_for(look_ns);
  return end.link_lives();
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

}  // namespace

Status fly_in_lockstep(const FlightOptions& options) {
  catch_stop_signals();
  struct sigaction act {};
  act.sa_handler = toggle_halt;
  ::sigaction(SIGUSR1, &act, nullptr);
  auto faults = proxy::Script::make(options.script.faults, proxy::Switches(DroneWays::targets(options.script.drones)));
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

Status fly_in_real_time(const FlightOptions& options) {
  const sigset_t waiting = catch_stop_signals_while_waiting();
  std::optional<drone_shim::DronesEnd> end;
  auto wire = open_wire(options, end);
  if (!wire) return wire.error();
  auto bent = BentWire::open(std::move(*wire), options.parameters.drones, options.parameters.seed,
                             {options.faults_socket, options.script.faults});
  if (!bent) return bent.error();
  BentWire& drones_wire = **bent;
  if (auto connected = ipc::connect("ledgerline-hil"); !connected) return connected;
  auto opened = ipc::AgentEnd::create();
  if (!opened) return opened.error();
  ipc::AgentEnd& link = **opened;
  say_ready();
  const TimeNs give_up_ns = monotonic_ns() + link_timeout_ns;
  StateSample state;
  while (!link.take_state(state) && !stop_requested) {
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
    while (link.take_state(state)) {
    }
    for (Transition transition; link.take_transition(transition);) agent.take(transition);
  }
  const Status written = write_all(record, options, now, agent, drones, drones_wire.sdk_counts());
  if (unsaid > 0) return Error{fmt::format("link's shared memory took {} plans, poses or signs of life not", unsaid)};
  return written;
}

}  // namespace ledgerline::hil::shim
