#include "hil/sitl/world.hpp"

#include <fmt/format.h>

#include <utility>

#include "common/msg/ros.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs tick_ns = 1 * ns_per_ms;
constexpr TimeNs quiet_ns = 500 * ns_per_ms;
constexpr sim::Endpoint link_endpoint{0x7F000001, 40000};

}  // namespace

SimulatedWorld::SimulatedWorld(const WorldConfig& config)
    : shared_(config), agent_(shared_), ground_(shared_), link_(shared_) {}

Result<std::unique_ptr<SimulatedWorld>> SimulatedWorld::create(const WorldConfig& config) {
  if (config.drones < 1 || config.drones > max_drones)
    return Error{fmt::format("{} drones asked for; 1 to {} can fly", config.drones, max_drones)};
  std::unique_ptr<SimulatedWorld> world(new SimulatedWorld(config));
  if (auto status = world->set_up(); !status) return status.error();
  return world;
}

Status SimulatedWorld::set_up() {
  SimulatedLedger& ledger = shared_.ledger;
  const WorldConfig& config = shared_.config;
  if (auto s = prepare(ledger, config.drones); !s) return s;
  if (config.supervisors) {
    if (auto s = enroll_supervisors(ledger, config.drones); !s) return s;
  }
  agent_.port().forget();  // what came before the processes
  ground_.port().forget();
  ledger.on_call_proposed([this](const fabric::Call& call) { shared_.observer.on_call_signed(call); });
  ledger.on_committed([this](const fabric::Call& call) { shared_.observer.on_call_committed(call); });
  link_.start();
  if (config.mode == WorldConfig::Mode::ledger) {
    if (auto s = agent_.start(); !s) return s;
  }
  return ground_.start();
}

void SimulatedWorld::post_mission_command(MissionCommand word) {
  if (const Status said = ground_.apply(word); !said)
    note(WorldEvent::Kind::fault, 0, "the mission's operator is refused: " + said.error().message);
}

void SimulatedWorld::post_control(Stopper who, std::size_t drone, ControlCommand word) {
  ground_.stoppers().post(now(), who, drone_name(static_cast<int>(drone) + 1), word);
}

void SimulatedWorld::step() {
  shared_.clock.advance(tick_ns);
  shared_.observer.begin_step();
  step_sim();
  if (!shared_.ledger_stalled) shared_.ledger.step(now());
  agent_.port().step(now());
  ground_.step_port();
  if (shared_.config.mode == WorldConfig::Mode::local) {
    agent_.apply_plans(ground_.step_local(agent_.step_local()));
  } else {
    agent_.step(stopped(Process::agent), link_.running());
    ground_.step(stopped(Process::ground));
  }
  step_link();
  deliver_to_drones();
  shared_.observer.end_step(now(), shared_.sim, ground(), link());
  if (!ground_done() || !shared_.observer.all_down()) {
    quiet_since_ns_ = 0;
  } else if (quiet_since_ns_ == 0) {
    quiet_since_ns_ = now();
  }
}

void SimulatedWorld::step_sim() {
  Wires& wires = shared_.wires;
  const auto& out = shared_.sim.step(now());
  step_mocap(out.poses);
  for (const auto& datagram : out.datagrams) {
    shared_.digester.put(datagram.bytes);
    if (datagram.to.port == state_port) {
      wires.sdk.state(now(), datagram.drone - 1U, datagram.bytes);
    } else {
      wires.sdk.answer(now(), datagram.drone - 1U, datagram.bytes);
    }
  }
  while (const auto unit = wires.sdk.pop(now())) {
    DroneNetwork& drone_network = network(unit->drone);
    if (unit->is_state) {
      drone_network.push_state(now(), unit->bytes);
    } else {
      drone_network.push(now(), DroneTraffic::answers, unit->bytes);
    }
  }
  for (std::size_t i = 0; i < drones().size(); ++i) {
    for (const auto& [at, port] :
         {std::pair(DroneTraffic::answers, link::Port::answer), std::pair(DroneTraffic::states, link::Port::state)}) {
      while (auto unit = network(i).pop(now(), at)) {
        if (link_.lives() && wires.to_link.size() < socket_queue)
          wires.to_link.push_back({drones()[i].number, port, std::move(unit->bytes)});
      }
    }
  }
}

void SimulatedWorld::step_mocap(const std::vector<sim::MocapPose>& poses) {
  for (const sim::MocapPose& measured : poses)
    network(measured.drone - 1U).push_mocap(now(), shared_.clock.real_offset(WorldClock::Host::mocap), measured);
  for (Wires::Drone& drone : shared_.wires.drones) {
    while (auto unit = drone.network.pop(now(), DroneTraffic::mocap)) {
      shared_.digester.put(unit->bytes);
      if (agent_.listens() && drone.mocap_ring.size() < mocap_ring)
        drone.mocap_ring.emplace_back(shared_.clock.host_now(), std::move(unit->bytes));
    }
  }
}

void SimulatedWorld::step_link() {
  if (!runs(Process::link) || !link_.step(agent_.listens())) return;
  kill(Process::link);
  if (link_.begins_again()) start(Process::link);
}

void SimulatedWorld::deliver_to_drones() {
  for (std::size_t i = 0; i < drones().size(); ++i) {
    while (auto unit = network(i).pop(now(), DroneTraffic::to)) {
      shared_.digester.put(unit->bytes);
      shared_.wires.sdk.command(now(), i, unit->bytes);
      shared_.sim.datagram(drones()[i].number, link_endpoint, unit->bytes);
    }
  }
}

bool SimulatedWorld::over() const { return quiet_since_ns_ != 0 && now() - quiet_since_ns_ >= quiet_ns; }

bool SimulatedWorld::lives(Process process) const {
  return process == Process::agent ? agent_.lives() : process == Process::link ? link_.lives() : ground_.lives();
}

void SimulatedWorld::kill(Process process) {
  const bool lived = lives(process);
  // Also one that is not there yet, since its start waits for the ledger.
  if (process == Process::agent) agent_.set_wanted(false);
  if (process == Process::ground) ground_.set_wanted(false);
  if (!lived) return;
  if (process == Process::agent) agent_.kill();
  if (process == Process::link) link_.kill();
  if (process == Process::ground) ground_.kill();
  note(WorldEvent::Kind::ended, 0, name_of(process));
}

void SimulatedWorld::start(Process process) {
  if (lives(process)) return;
  if (process == Process::agent) agent_.set_wanted(true);
  if (process == Process::ground) ground_.set_wanted(true);
  if (process != Process::link) return;
  link_.start();
  note(WorldEvent::Kind::started, 0, "link");
}

void SimulatedWorld::restart_ledger() {
  shared_.ledger.restart(now());
  for (const Process process : {Process::agent, Process::ground}) port(process).restart(now());
  ground_.stoppers().restart(now());
}

std::vector<std::string> SimulatedWorld::lost_acknowledged() {
  restart_ledger();
  std::vector<const LedgerPort*> ports{&agent_.port(), &ground_.port()};
  for (const auto& [who, port] : ground_.stoppers().ports()) ports.push_back(port.get());
  std::vector<std::string> lost;
  for (const LedgerPort* port : ports) {
    for (std::string& one : shared_.ledger.missing(port->acknowledged())) lost.push_back(std::move(one));
  }
  return lost;
}

std::uint64_t SimulatedWorld::transitions_pending() const {
  std::uint64_t pending = 0;
  if (link()) {
    for (const auto& report : link()->reports()) pending += report.transitions.kept + report.transitions.lost;
  }
  return pending;
}

crypto::Digest SimulatedWorld::digest() {
  for (const std::string& block : shared_.ledger.blocks()) shared_.digester.put(block);
  return shared_.digester.result();
}

}  // namespace ledgerline::hil
