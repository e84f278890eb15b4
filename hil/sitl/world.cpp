#include "hil/sitl/world.hpp"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "common/msg/ros.hpp"
#include "common/verification/roles.hpp"
#include "hil/sitl/digester.hpp"
#include "hil/sitl/ledger/ground_news.hpp"
#include "hil/sitl/ledger/ledger_audit.hpp"
#include "hil/sitl/wires/wires.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

constexpr TimeNs tick_ns = 1 * ns_per_ms;
constexpr TimeNs ground_period_ns = 50 * ns_per_ms;
constexpr TimeNs clock_period_ns = 1 * ns_per_s;  // as the agent's shell
constexpr TimeNs quiet_ns = 500 * ns_per_ms;
constexpr std::int64_t real_epoch_s = 1'767'225'600;
constexpr std::uint64_t wifi_seed = 0x77696669;
constexpr sim::Endpoint link_endpoint{0x7F000001, 40000};

// Of a far ledger more than of one that is near: what was sent last is still on its way.
TimeNs timeout_ns(const WorldConfig& config) {
  return LedgerPort::deadline_ns + (config.delays.added.none() ? 0 : 10 * ns_per_s);
}

}  // namespace

SimulatedWorld::SimulatedWorld(const WorldConfig& config)
    : config_(config),
      ledger_(node_config(config), config.delays, config.seed),
      host_(ledger_, drone_host, config.seed + 1, WayDelay::Way::back, config.delays.added.agent_share,
            timeout_ns(config)),
      operator_(ledger_, operator_name, config.seed + 2, WayDelay::Way::there, 1 - config.delays.added.agent_share,
                timeout_ns(config)),
      stoppers_(ledger_, operator_, config.seed + 3),
      sim_(sim_parameters(config), 0),
      wires_(std::make_unique<Wires>(config.seed ^ 0x73646bULL, static_cast<std::size_t>(config.drones))),
      digester_(std::make_unique<Digester>()),
      witness_(config, sim_) {
  for (LedgerPort* port : {&host_, &operator_}) port->take_blocks_of(config.blocks);
  if (config.mode == WorldConfig::Mode::local) local_.emplace(config.drones);
  Random seeds(config.seed ^ 0x6c696e6573ULL);
  for (int k = 1; k <= config.drones; ++k)
    wires_->drones.push_back({DroneNetwork(seeds, ~config.seed + static_cast<std::uint64_t>(k))});
  if (config.wifi) {
    auto wifi = *config.wifi;
    wifi.offset_ns +=
        static_cast<TimeNs>(Random(config.seed ^ wifi_seed).uniform() * static_cast<double>(wifi.day->length_ns()));
    for (Wires::Drone& drone : wires_->drones) drone.network.set_wifi(wifi);
  }
}

SimulatedWorld::~SimulatedWorld() = default;

Result<std::unique_ptr<SimulatedWorld>> SimulatedWorld::create(const WorldConfig& config) {
  if (config.drones < 1 || config.drones > max_drones)
    return Error{fmt::format("{} drones asked for; 1 to {} can fly", config.drones, max_drones)};
  std::unique_ptr<SimulatedWorld> world(new SimulatedWorld(config));
  if (auto status = world->set_up(); !status) return status.error();
  return world;
}

Status SimulatedWorld::set_up() {
  if (auto s = prepare(ledger_, config_.drones); !s) return s;
  if (config_.supervisors) {
    if (auto s = enroll_supervisors(ledger_, config_.drones); !s) return s;
  }
  host_.forget();  // what came before the processes
  operator_.forget();
  ledger_.on_asked([this](const fabric::Call& call) { witness_.asked(call); });
  ledger_.on_committed([this](const fabric::Call& call) { witness_.committed(call); });
  start_link();
  mocap_intake_.emplace([this] { return host_real_offset(); });
  if (!local_) {
    if (auto s = start_agent(); !s) return s;
  }
  if (config_.manual) mission_.emplace(config_);
  if (auto s = start_ground(); !s) return s;
  return done;
}

void SimulatedWorld::say(MissionWord word) {
  const std::string refused = mission_ && ground_ ? mission_->say(word, *ground_) : "nobody conducts missions";
  if (!refused.empty()) note(WorldEvent::Kind::fault, 0, "the mission's operator is refused: " + refused);
}

TimeNs SimulatedWorld::real_offset(Host host) const {
  return real_epoch_s * ns_per_s + clock_jump_ns_ + host_jump_ns_[static_cast<std::size_t>(host)];
}

void SimulatedWorld::say_control(Stopper who, std::size_t drone, ControlWord word) {
  stoppers_.say(now_, who, drone_name(static_cast<int>(drone) + 1), word);
}

DroneNetwork& SimulatedWorld::network(std::size_t drone) { return wires_->drones[drone].network; }

SdkFaults& SimulatedWorld::sdk() { return wires_->sdk; }

std::string SimulatedWorld::plans_text(std::size_t drone) const {
  return hil::plans_text(agent_ ? &*agent_ : nullptr, link(), drone, facts()[drone].number);
}

void SimulatedWorld::step() {
  now_ += tick_ns;
  for (std::size_t host = 0; host < host_drift_.size(); ++host)
    host_jump_ns_[host] += static_cast<TimeNs>(host_drift_[host] * static_cast<double>(tick_ns));
  if (host_suspended_) host_slept_ns_ += tick_ns;
  witness_.begin_step();
  step_sim();
  if (!ledger_stalled_) ledger_.step(now_);
  host_.step(now_);
  operator_.step(now_);
  for (auto& ended : operator_.take_outcomes()) {
    if (!stoppers_.take_outcome(now_, ended) && ground_) ground_outcomes_.push_back(std::move(ended));
  }
  stoppers_.step(now_);
  if (local_) {
    step_local();
  } else {
    step_agent();
    step_ground();
  }
  step_link();
  deliver_to_drones();
  witness_.end_step(now_, sim_, ground_.get(), link_ ? &*link_ : nullptr);
  if (!ground_done() || !witness_.all_down()) {
    quiet_since_ns_ = 0;
  } else if (quiet_since_ns_ == 0) {
    quiet_since_ns_ = now_;
  }
}

void SimulatedWorld::step_sim() {
  const auto& out = sim_.step(now_);
  step_mocap(out.poses);
  for (const auto& datagram : out.datagrams) {
    digester_->put(datagram.bytes);
    if (datagram.to.port == sim::state_port) {
      wires_->sdk.state(now_, datagram.drone - 1U, datagram.bytes);
    } else {
      wires_->sdk.answer(now_, datagram.drone - 1U, datagram.bytes);
    }
  }
  while (const auto unit = wires_->sdk.pop(now_)) {
    DroneNetwork& network = wires_->drones[unit->drone].network;
    if (unit->is_state) {
      network.push_state(now_, unit->bytes);
    } else {
      network.push(now_, DroneTraffic::answers, unit->bytes);
    }
  }
  for (std::size_t i = 0; i < facts().size(); ++i) {
    for (const auto& [at, port] :
         {std::pair(DroneTraffic::answers, link::Port::answer), std::pair(DroneTraffic::states, link::Port::state)}) {
      while (auto unit = wires_->drones[i].network.pop(now_, at)) {
        if (link_ && wires_->to_link.size() < socket_queue)
          wires_->to_link.push_back({facts()[i].number, port, std::move(unit->bytes)});
      }
    }
  }
}

void SimulatedWorld::step_mocap(const std::vector<sim::MocapPose>& poses) {
  for (const sim::MocapPose& measured : poses)
    wires_->drones[measured.drone - 1U].network.push_mocap(now_, real_offset(Host::mocap), measured);
  for (Wires::Drone& drone : wires_->drones) {
    while (auto unit = drone.network.pop(now_, DroneTraffic::mocap)) {
      digester_->put(unit->bytes);
      if ((agent_ || local_) && drone.mocap_ring.size() < mocap_ring)
        drone.mocap_ring.emplace_back(host_now(), std::move(unit->bytes));
    }
  }
}

std::vector<agent::MocapPose> SimulatedWorld::take_mocap(std::size_t drone) {
  std::vector<agent::MocapPose> poses;
  for (auto& ring = wires_->drones[drone].mocap_ring; !ring.empty(); ring.pop_front()) {
    const auto message = pose_from_cdr(ring.front().second);
    if (!message) continue;
    const auto pose =
        mocap_intake_->take({message->header.stamp_ns, ring.front().first, message->position_m, message->orientation});
    if (pose) poses.push_back(*pose);
  }
  return poses;
}

void SimulatedWorld::step_agent() {
  if (!agent_ && agent_wanted_ && host_.reachable() && !ledger_stalled_) {
    if (start_agent()) {
      note(WorldEvent::Kind::started, 0, "agent");
    } else {
      agent_.reset();  // tried again with the next step, as the shell does
    }
  }
  if (!agent_ || stopped(Process::agent)) {
    if (!agent_) {
      (void)host_.take_blocks();
      (void)host_.take_refused();
      (void)host_.take_outcomes();
      (void)host_.take_connection();
    }
    return;
  }
  if (host_now() >= next_clock_ns_) {
    next_clock_ns_ = host_now() + clock_period_ns;
    mocap_intake_->clock().refresh();
    agent_->set_real_offset(mocap_intake_->clock().offset_ns());
  }
  for (std::size_t i = 0; i < facts().size(); ++i) {
    for (const agent::MocapPose& measured : take_mocap(i))
      agent_->on_mocap(host_now(), facts()[i].number, measured, agent_out_);
  }
  for (const auto& state : take(wires_->states)) agent_->on_state(host_now(), state, agent_out_);
  for (const auto& transition : take(wires_->transitions)) agent_->on_transition(transition);
  if (const auto connected = host_.take_connection()) agent_->on_connection(host_now(), *connected);
  for (const auto& ended : host_.take_outcomes()) agent_->on_outcome(host_now(), ended.id, ended.outcome, agent_out_);
  for (const std::string& why : host_.take_contradictions())
    agent_->on_violation(host_now(), agent::IntegrityViolation::stream, why);
  for (const auto& block : host_.take_blocks()) agent_->on_block(host_now(), block, agent_out_);
  for (const auto& block : host_.take_refused()) agent_->on_refused_block(host_now(), block, agent_out_);
  if (const auto granted = agent_->await_roles(); !granted.empty()) {
    const auto read =
        verification::read_roles([&](const fabric::Call& call) { return host_.evaluate(now_, call); }, granted);
    if (read) agent_->add_roles(*read);
  }
  agent_->step(host_now(), agent_out_);
  for (const auto& word : agent_out_.violations) note(WorldEvent::Kind::untrusted, 0, word.words);
  for (auto& submit : agent_out_.submits) host_.submit(now_, submit.frame, std::move(submit.call));
  for (const auto& trace : agent_out_.traces) digester_->put(trace);
  if (link_) {
    for (const Plan& plan : agent_out_.plans) {
      witness_.handed(now_, plan);
      wires_->drones[plan.drone - 1U].network.push(now_, DroneTraffic::plans, bytes_of(plan), link_start_);
    }
    for (const Pose& pose : agent_out_.poses) put(wires_->poses, pose, pose_queue);
    if (agent_out_.heartbeat) put(wires_->heartbeats, *agent_out_.heartbeat, heartbeat_queue);
  }
  agent_out_.clear();
}

void SimulatedWorld::step_local() {
  for (std::size_t i = 0; i < facts().size(); ++i) {
    for (const agent::MocapPose& measured : take_mocap(i)) {
      if (const auto pose = local_->fused(i, measured)) put(wires_->poses, *pose, pose_queue);
    }
  }
  if (const auto heartbeat = local_->heartbeat(now_)) put(wires_->heartbeats, *heartbeat, heartbeat_queue);
  const auto states = take(wires_->states);
  wires_->transitions.clear();  // there is nobody who keeps them
  ground::FlightInputs inputs;
  inputs.states = states;
  if (!states.empty() || now_ >= next_ground_ns_) give_ground(inputs);
}

Quantiles SimulatedWorld::two_way_ms(std::size_t drone) const {
  if (local_) return local_->two_way_ms(drone);
  return agent_ ? agent_->report(facts()[drone].number).two_way.quantiles_ms() : Quantiles{};
}

void SimulatedWorld::step_ground() {
  if (!ground_ && ground_wanted_ && operator_.reachable() && !ledger_stalled_) {
    if (start_ground()) {
      note(WorldEvent::Kind::started, 0, "ground");
    } else {
      ground_.reset();
    }
  }
  if (!ground_ || stopped(Process::ground)) {
    if (!ground_) {
      (void)operator_.take_blocks();
    }
    return;
  }
  const auto outcomes = std::exchange(ground_outcomes_, {});
  give_news(outcomes, operator_.take_blocks(), [this](const ground::FlightInputs& inputs) { give_ground(inputs); });
  if (now_ >= next_ground_ns_) give_ground({});
}

void SimulatedWorld::give_ground(ground::FlightInputs inputs) {
  next_ground_ns_ = now_ + ground_period_ns;
  inputs.realtime_s = real_epoch_s + now_ / ns_per_s;
  const auto commands = std::exchange(commands_, {});
  inputs.commands = commands;
  auto out = ground_->step(now_, inputs);
  for (const ground::DroneUpdate& news : out.news) {
    if (news.state) witness_.shown(now_, news.drone, *news.state);
  }
  for (const Plan& plan : out.plans) {  // of a local flight
    local_->answered(plan.drone - 1U, now_ - plan.state_stamp_ns);
    put(wires_->plans, plan, plan_queue);
  }
  if (mission_) {
    for (ground::PilotCommand& command : mission_->step(now_, *ground_)) commands_.push_back(std::move(command));
  }
  for (auto& submission : out.submissions) operator_.submit(now_, submission.id, std::move(submission.call));
  for (const auto& trace : out.traces) digester_->put(trace);
}

void SimulatedWorld::step_link() {
  if (!link_ || stopped(Process::link)) return;
  const auto datagrams = take(wires_->to_link);
  std::vector<link::Received> received;
  received.reserve(datagrams.size());
  for (const auto& datagram : datagrams) received.push_back({datagram.drone, datagram.port, datagram.bytes});
  for (Wires::Drone& drone : wires_->drones) {
    while (auto unit = drone.network.pop(now_, DroneTraffic::plans)) {
      if (unit->tag == link_start_) put(wires_->plans, plan_of(unit->bytes), plan_queue);
    }
  }
  const auto plans = take(wires_->plans);
  const auto poses = take(wires_->poses);
  const auto heartbeats = take(wires_->heartbeats);
  const auto& out = link_->step(host_now(), {.received = received,
                                             .plans = plans,
                                             .poses = poses,
                                             .heartbeats = heartbeats,
                                             .stop_all = link_ends_ns_.has_value(),
                                             .suspended_ns = host_slept_ns_});
  std::vector<Pose> accepted;
  for (const DroneFacts& drone : facts()) {
    Pose pose = link_->pose(drone.number);
    pose.drone = drone.number;
    if (pose.stamp_ns != 0) accepted.push_back(pose);
  }
  witness_.given(accepted);
  for (const auto& send : out.to_send) {
    const std::string_view text = send.command.view();
    digester_->put(text);
    wires_->drones[send.drone - 1U].network.push(now_, DroneTraffic::to, text);
    witness_.sent(now_, send.drone, text, link_->yaw_rad(send.drone, host_now()));
  }
  if (agent_ || local_) {
    for (const StateSample& state : out.states) put(wires_->states, state, state_queue);
    for (const Transition& transition : out.transitions) put(wires_->transitions, transition, transition_queue);
  }
  for (const StateSample& state : out.states) witness_.said(state);
  for (const TraceRecord& record : out.trace) {
    digester_->put(record);
    witness_.traced(now_, record);
  }
  witness_.given(now_, host_slept_ns_, plans);
  link_stops_ = link_->local_stops();
  if (!link_ends_ns_ || !(link_->all_landed_or_commanded() || now_ >= *link_ends_ns_)) return;
  kill(Process::link);
  if (std::exchange(link_begins_again_, false)) start(Process::link);
}

void SimulatedWorld::deliver_to_drones() {
  for (std::size_t i = 0; i < facts().size(); ++i) {
    while (auto unit = wires_->drones[i].network.pop(now_, DroneTraffic::to)) {
      digester_->put(unit->bytes);
      wires_->sdk.command(now_, i, unit->bytes);
      sim_.datagram(facts()[i].number, link_endpoint, unit->bytes);
    }
  }
}

bool SimulatedWorld::over() const { return quiet_since_ns_ != 0 && now_ - quiet_since_ns_ >= quiet_ns; }

std::vector<std::string> SimulatedWorld::lost_acknowledged() {
  restart_ledger();
  std::vector<const LedgerPort*> ports{&host_, &operator_};
  for (const auto& [who, port] : stoppers_.ports()) ports.push_back(port.get());
  return not_on_ledger(ledger_, ports);
}

std::vector<std::string> SimulatedWorld::lost_transitions() const { return transition_gaps(ledger_.blocks()); }

std::uint64_t SimulatedWorld::transitions_pending() const {
  std::uint64_t pending = 0;
  if (link_) {
    for (const auto& report : link_->reports()) pending += report.transitions.kept + report.transitions.lost;
  }
  return pending;
}

crypto::Digest SimulatedWorld::digest() {
  for (const std::string& block : ledger_.blocks()) digester_->put(block);
  return digester_->result();
}

}  // namespace ledgerline::hil
