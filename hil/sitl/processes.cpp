#include "hil/sitl/processes.hpp"

#include <utility>

#include "common/msg/ros.hpp"
#include "common/verification/control_records.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

constexpr TimeNs ground_period_ns = 50 * ns_per_ms;
constexpr TimeNs clock_period_ns = 1 * ns_per_s;    // as the agent's shell
constexpr TimeNs landing_bound_ns = 10 * ns_per_s;  // link's ShellSettings

// Of a far ledger more than of one that is near: what was sent last is still on its way.
TimeNs timeout_ns(const WorldConfig& config) {
  return LedgerPort::deadline_ns + (config.delays.added.none() ? 0 : 10 * ns_per_s);
}

Result<Control> read_control(LedgerPort& port, TimeNs now, const std::string& drone) {
  return verification::read_control(drone, [&](const fabric::Call& call) { return port.evaluate(now, call); });
}

}  // namespace

SharedWorld::SharedWorld(const WorldConfig& world_config)
    : config(world_config),
      ledger(node_config(config), config.delays, config.seed),
      sim(sim_parameters(config), 0),
      wires(config),
      observer(config, sim) {}

std::optional<Pose> LocalLoop::fused(std::size_t drone, const agent::MocapPose& measured) {
  auto pose = fusions_[drone].add(measured);
  if (pose) pose->drone = static_cast<DroneNumber>(drone + 1);
  return pose;
}

std::optional<AgentHeartbeat> LocalLoop::heartbeat(TimeNs now) {
  constexpr TimeNs period_ns = 50 * ns_per_ms;  // as agent's
  if (now < next_heartbeat_ns_) return std::nullopt;
  next_heartbeat_ns_ = now + period_ns;
  AgentHeartbeat heartbeat;
  heartbeat.stamp_ns = now;
  heartbeat.ledger_alive = true;
  return heartbeat;
}

AgentProcess::AgentProcess(SharedWorld& world)
    : world_(world),
      port_(world.ledger, drone_host, world.config.seed + 1, OneWayDelay::Direction::back,
            world.config.delays.added.agent_share, timeout_ns(world.config)) {
  port_.set_block_source(world.config.blocks);
  mocap_.emplace([this] { return world_.clock.host_real_offset(); });
  if (world.config.mode == WorldConfig::Mode::local) local_.emplace(world.config.drones);
}

Status AgentProcess::start() {
  const TimeNs now = world_.clock.now(), host_now = world_.clock.host_now();
  core_.emplace(agent_settings(world_.config, ++world_.starts), world_.ledger.registry());
  mocap_.emplace([this] { return world_.clock.host_real_offset(); });
  core_->set_real_offset(mocap_->clock().offset_ns());
  core_->on_connection(host_now, true);
  port_.begin(checkpoint_);
  if (checkpoint_) {
    for (const Control& control : records_.controls) core_->set_control(host_now, control);
    core_->control().set_roles(records_.roles);
    return done;
  }
  std::vector<Control> controls;
  for (const DroneObservation& drone : world_.drones()) {
    auto control = read_control(port_, now, drone.name);
    if (!control) return control.error();
    core_->set_control(host_now, *control);
    controls.push_back(std::move(*control));
  }
  auto roles = verification::read_roles([&](const fabric::Call& call) { return port_.evaluate(now, call); },
                                        verification::organisations_of(controls));
  if (!roles) return roles.error();
  core_->control().set_roles(std::move(*roles));
  return done;
}

void AgentProcess::kill() {
  checkpoint_ = port_.checkpoint();
  records_ = core_->control().records();
  core_.reset();
  out_.clear();
  port_.forget();
  world_.wires.states.clear();
  world_.wires.transitions.clear();
  for (Wires::Drone& drone : world_.wires.drones) drone.mocap_ring.clear();
}

Quantiles AgentProcess::two_way_ms(std::size_t drone) const {
  if (local_) return local_->two_way_ms(drone);
  return core_ ? core_->report(world_.drones()[drone].number).two_way.quantiles_ms() : Quantiles{};
}

std::vector<agent::MocapPose> AgentProcess::pop_mocap(std::size_t drone) {
  std::vector<agent::MocapPose> poses;
  for (auto& ring = world_.wires.drones[drone].mocap_ring; !ring.empty(); ring.pop_front()) {
    const auto message = pose_from_cdr(ring.front().second);
    if (!message) continue;
    const auto pose =
        mocap_->check({message->header.stamp_ns, ring.front().first, message->position_m, message->orientation});
    if (pose) poses.push_back(*pose);
  }
  return poses;
}

bool AgentProcess::try_start() {
  if (!wanted_ || !port_.reachable() || world_.ledger_stalled) return false;
  if (!start()) {
    core_.reset();  // tried again with the next step, as the shell does
    return false;
  }
  world_.note(WorldEvent::Kind::started, 0, "agent");
  return true;
}

void AgentProcess::drop_arrivals() {
  (void)port_.pop_blocks();
  (void)port_.pop_refused();
  (void)port_.pop_outcomes();
  (void)port_.pop_connection_change();
}

void AgentProcess::step(bool stopped, std::optional<std::uint64_t> link) {
  if (!core_ && !try_start()) return drop_arrivals();
  if (stopped) return;
  const TimeNs host_now = world_.clock.host_now();
  if (host_now >= next_clock_ns_) {
    next_clock_ns_ = host_now + clock_period_ns;
    mocap_->clock().refresh();
    core_->set_real_offset(mocap_->clock().offset_ns());
  }
  receive();
  if (const auto granted = core_->control().await_roles(); !granted.empty()) {
    const auto read = verification::read_roles(
        [&](const fabric::Call& call) { return port_.evaluate(world_.clock.now(), call); }, granted);
    if (read) core_->control().add_roles(*read);
  }
  core_->step(host_now, out_);
  send(link);
  out_.clear();
}

void AgentProcess::receive() {
  const TimeNs host_now = world_.clock.host_now();
  for (std::size_t i = 0; i < world_.drones().size(); ++i) {
    for (const agent::MocapPose& measured : pop_mocap(i))
      core_->on_mocap(host_now, world_.drones()[i].number, measured, out_);
  }
  for (const auto& state : pop_all(world_.wires.states)) core_->on_state(host_now, state, out_);
  for (const auto& transition : pop_all(world_.wires.transitions)) core_->on_transition(transition);
  if (const auto connected = port_.pop_connection_change()) core_->on_connection(host_now, *connected);
  for (const auto& ended : port_.pop_outcomes()) core_->on_outcome(host_now, ended.id, ended.outcome, out_);
  for (const std::string& why : port_.pop_contradictions())
    core_->on_violation(host_now, agent::IntegrityViolation::stream, why);
  for (const auto& block : port_.pop_blocks()) core_->on_block(host_now, *block, out_);
  for (const auto& block : port_.pop_refused()) core_->on_refused_block(host_now, block, out_);
}

void AgentProcess::send(std::optional<std::uint64_t> link) {
  const TimeNs now = world_.clock.now();
  for (const auto& word : out_.violations) world_.note(WorldEvent::Kind::untrusted, 0, word.words);
  for (auto& submit : out_.submits) port_.submit(now, submit.call_number, std::move(submit.call));
  for (const auto& trace : out_.traces) world_.digester.put(trace);
  if (!link) return;
  for (const Plan& plan : out_.plans) {
    world_.observer.on_plan_handed(now, plan);
    world_.wires.drones[plan.drone - 1U].network.push(now, DroneTraffic::plans, bytes_of(plan), *link);
  }
  for (const Pose& pose : out_.poses) put(world_.wires.poses, pose, pose_queue);
  if (out_.heartbeat) put(world_.wires.heartbeats, *out_.heartbeat, heartbeat_queue);
}

std::vector<StateSample> AgentProcess::step_local() {
  Wires& wires = world_.wires;
  for (std::size_t i = 0; i < world_.drones().size(); ++i) {
    for (const agent::MocapPose& measured : pop_mocap(i)) {
      if (const auto pose = local_->fused(i, measured)) put(wires.poses, *pose, pose_queue);
    }
  }
  if (const auto heartbeat = local_->heartbeat(world_.clock.now())) put(wires.heartbeats, *heartbeat, heartbeat_queue);
  wires.transitions.clear();  // there is nobody who keeps them
  return pop_all(wires.states);
}

void AgentProcess::apply_plans(const std::vector<Plan>& plans) {
  for (const Plan& plan : plans) {
    local_->answered(plan.drone - 1U, world_.clock.now() - plan.state_stamp_ns);
    put(world_.wires.plans, plan, plan_queue);
  }
}

GroundProcess::GroundProcess(SharedWorld& world)
    : world_(world),
      port_(world.ledger, operator_name, world.config.seed + 2, OneWayDelay::Direction::there,
            1 - world.config.delays.added.agent_share, timeout_ns(world.config)),
      stoppers_(world.ledger, port_, world.config.seed + 3) {
  port_.set_block_source(world.config.blocks);
  if (world.config.manual) mission_.emplace(world.config);
}

Status GroundProcess::start() {
  core_ = std::make_unique<ground::FlightCore>(ground_config(world_.config, world_.ledger));
  port_.begin();
  for (const DroneObservation& drone : world_.drones()) {
    const auto control = read_control(port_, world_.clock.now(), drone.name);
    if (!control) return control.error();
    if (auto s = core_->set_control(control->SerializeAsString()); !s) return s;
  }
  if (mission_) mission_->ground_began();
  return done;
}

void GroundProcess::kill() {
  core_.reset();
  if (mission_) mission_->ground_ended();
  port_.forget();
  outcomes_.clear();
  stoppers_.forgotten(world_.clock.now());
}

Status GroundProcess::apply(MissionCommand word) {
  if (!mission_ || !core_) return Error{"nobody conducts missions"};
  return mission_->apply(word, *core_);
}

void GroundProcess::step_port() {
  const TimeNs now = world_.clock.now();
  port_.step(now);
  for (auto& ended : port_.pop_outcomes()) {
    if (!stoppers_.on_outcome(now, ended) && core_) outcomes_.push_back(std::move(ended));
  }
  stoppers_.step(now);
}

void GroundProcess::step(bool stopped) {
  if (!core_ && wanted_ && port_.reachable() && !world_.ledger_stalled) {
    if (start()) {
      world_.note(WorldEvent::Kind::started, 0, "ground");
    } else {
      core_.reset();
    }
  }
  if (!core_) (void)port_.pop_blocks();
  if (!core_ || stopped) return;
  const auto outcomes = std::exchange(outcomes_, {});
  apply_updates(outcomes, port_.pop_blocks(), [this](const ground::FlightInputs& inputs) { step_core(inputs); });
  if (world_.clock.now() >= next_ns_) step_core({});
}

std::vector<Plan> GroundProcess::step_local(const std::vector<StateSample>& states) {
  if (states.empty() && world_.clock.now() < next_ns_) return {};
  ground::FlightInputs inputs;
  inputs.states = states;
  return step_core(inputs);
}

std::vector<Plan> GroundProcess::step_core(ground::FlightInputs inputs) {
  const TimeNs now = world_.clock.now();
  next_ns_ = now + ground_period_ns;
  inputs.realtime_s = SimulatedLedger::real(now) / ns_per_s;
  const auto commands = std::exchange(commands_, {});
  inputs.commands = commands;
  auto out = core_->step(now, inputs);
  for (const ground::DroneUpdate& update : out.updates) {
    if (update.state) world_.observer.on_state_shown(now, update.drone, *update.state);
  }
  if (mission_) {
    for (ground::PilotCommand& command : mission_->step(now, *core_)) commands_.push_back(std::move(command));
  }
  for (auto& submission : out.submissions) port_.submit(now, submission.id, std::move(submission.call));
  for (const auto& trace : out.traces) world_.digester.put(trace);
  return std::move(out.plans);
}

void LinkProcess::start() {
  const TimeNs now = world_.clock.now();
  // Any number that differs from start to start, as the shell's random one does.
  start_ = ++world_.starts;
  std::erase_if(starts_ns_, [now](TimeNs start) { return now - start > link::starts_within_ns; });
  starts_ns_.push_back(now);
  core_.emplace(link_settings(world_.config), Random(world_.config.seed * 1000 + start_).next(),
                static_cast<int>(starts_ns_.size()), stops_);
  ends_ns_.reset();
  begins_again_ = false;
}

void LinkProcess::kill() {
  core_.reset();
  world_.wires.to_link.clear();
  world_.wires.plans.clear();
  world_.wires.poses.clear();
  world_.wires.heartbeats.clear();
  world_.observer.on_link_ended();
}

void LinkProcess::end(bool again) {
  begins_again_ = again;
  if (core_ && !ends_ns_) ends_ns_ = world_.clock.now() + landing_bound_ns;
}

bool LinkProcess::step(bool agent_listens) {
  const TimeNs now = world_.clock.now(), host_now = world_.clock.host_now();
  Wires& wires = world_.wires;
  FlightObserver& observer = world_.observer;
  const auto datagrams = pop_all(wires.to_link);
  std::vector<link::Received> received;
  received.reserve(datagrams.size());
  for (const auto& datagram : datagrams) received.push_back({datagram.drone, datagram.port, datagram.bytes});
  for (Wires::Drone& drone : wires.drones) {
    while (auto unit = drone.network.pop(now, DroneTraffic::plans)) {
      if (unit->tag == start_) put(wires.plans, plan_of(unit->bytes), plan_queue);
    }
  }
  const auto plans = pop_all(wires.plans);
  const auto poses = pop_all(wires.poses);
  const auto heartbeats = pop_all(wires.heartbeats);
  const auto& out = core_->step(host_now, {.received = received,
                                           .plans = plans,
                                           .poses = poses,
                                           .heartbeats = heartbeats,
                                           .stop_all = ends_ns_.has_value(),
                                           .suspended_ns = world_.clock.host_slept_ns()});
  observe_poses();
  for (const auto& send : out.to_send) {
    const std::string_view text = send.command.view();
    world_.digester.put(text);
    wires.drones[send.drone - 1U].network.push(now, DroneTraffic::to, text);
    observer.on_command_sent(now, send.drone, text, core_->yaw_rad(send.drone, host_now));
  }
  if (agent_listens) {
    for (const StateSample& state : out.states) put(wires.states, state, state_queue);
    for (const Transition& transition : out.transitions) put(wires.transitions, transition, transition_queue);
  }
  for (const StateSample& state : out.states) observer.on_state_reported(state);
  for (const TraceRecord& record : out.trace) {
    world_.digester.put(record);
    observer.on_trace(now, record);
  }
  observer.on_plans(now, world_.clock.host_slept_ns(), plans);
  stops_ = core_->local_stops();
  return ends_ns_ && (core_->all_landed_or_commanded() || now >= *ends_ns_);
}

void LinkProcess::observe_poses() {
  std::vector<Pose> accepted;
  for (const DroneObservation& drone : world_.drones()) {
    Pose pose = core_->pose(drone.number);
    pose.drone = drone.number;
    if (pose.stamp_ns != 0) accepted.push_back(pose);
  }
  world_.observer.on_poses(accepted);
}

}  // namespace ledgerline::hil
