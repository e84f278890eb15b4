#include "hil/world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <utility>

#include "common/msg/ros.hpp"
#include "hil/digester.hpp"
#include "hil/sensor_text.hpp"
#include "hil/words.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

constexpr TimeNs tick_ns = 1 * ns_per_ms;
constexpr TimeNs ground_period_ns = 50 * ns_per_ms;
constexpr TimeNs clock_period_ns = 1 * ns_per_s;  // as the agent's shell
constexpr TimeNs quiet_ns = 500 * ns_per_ms;
constexpr std::int64_t real_epoch_s = 1'767'225'600;
constexpr sim::Endpoint link_endpoint{0x7F000001, 40000};
constexpr double rc_full_mps = 1.0;

// Lengths of iceoryx's queues (onboard/ipc/ipc.cpp), where the oldest goes, and of the agent's ring for mocap, where
// the newest goes; what a socket of 208 kB holds of datagrams of this size.
constexpr std::size_t plan_queue = 128, pose_queue = 256, beat_queue = 8, state_queue = 256, transition_queue = 256;
constexpr std::size_t mocap_ring = 64, socket_queue = 256;

const crypto::IdentityName drone_host{"Org1MSP", "CN=User1@org1.ledgerline"};
const crypto::IdentityName operator_name{"Org2MSP", "CN=User1@org2.ledgerline"};

std::string drone_name(int number) { return fmt::format("tello{}", number); }

// iceoryx's way with a full queue.
template <typename T>
void put(std::deque<T>& queue, const T& value, std::size_t most) {
  if (queue.size() >= most) queue.pop_front();
  queue.push_back(value);
}

template <typename T>
std::vector<T> take(std::deque<T>& queue) {
  std::vector<T> all(queue.begin(), queue.end());
  queue.clear();
  return all;
}

node::CoreConfig node_config(const WorldConfig& config) {
  node::CoreConfig node;
  node.batch_count = config.batch_count;
  node.batch_timeout_ns = config.batch_timeout_ns;
  return node;
}

sim::Parameters sim_parameters(const WorldConfig& config) {
  sim::Parameters parameters;
  parameters.drones = config.drones;
  parameters.seed = config.seed;
  parameters.battery.start = config.battery;
  return parameters;
}

link::LinkSettings link_settings(const WorldConfig& config) {
  const sim::Parameters places;
  link::LinkSettings settings;
  settings.rate_hz = config.rate_hz;
  settings.playout.max_age_ns = std::max(settings.playout.max_age_ns, config.max_age_ns);
  settings.playout.max_margin_ns = 0;  // as ./fly: ground counts on plans that take over as they come
  for (int k = 1; k <= config.drones; ++k) settings.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
  const int columns = std::min(config.drones, places.columns);
  const int rows = (config.drones + places.columns - 1) / places.columns;
  settings.fence.min_m = {-config.room_m, -config.room_m, 0};
  settings.fence.max_m = {(columns - 1) * places.spacing_m + config.side_m + config.room_m,
                          (rows - 1) * places.spacing_m + config.side_m + config.room_m, 3};
  return settings;
}

agent::AgentConfig agent_config(const WorldConfig& config, std::uint64_t starts) {
  agent::AgentConfig agent;
  agent.seed = config.seed + starts;
  // A far ledger is not yet a silent one.
  agent.ledger_silent_after_ns += std::max<TimeNs>(0, config.max_age_ns - agent.check.max_age_ns);
  agent.check.max_age_ns = config.max_age_ns;
  for (int k = 1; k <= config.drones; ++k) agent.drones.push_back({static_cast<DroneNumber>(k), drone_name(k)});
  return agent;
}

ground::FlightConfig ground_config(const WorldConfig& config, VirtualLedger& ledger) {
  ground::FlightConfig ground;
  for (int k = 1; k <= config.drones; ++k) ground.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
  ground.shape = config.shape;
  ground.side_m = config.side_m;
  ground.laps = config.laps;
  ground.controller.speed_mps = config.speed_mps;
  ground.controller.predict = config.predict;
  ground.self = operator_name;
  ground.believed = ledger.shared_registry();
  return ground;
}

// enroll and acquire, as the launcher does before take-off.
Status prepare(VirtualLedger& ledger, const std::vector<DroneFacts>& drones) {
  const auto admin1 = ledger.add_client({"Org1MSP", "CN=Admin@org1.ledgerline"});
  const auto admin2 = ledger.add_client({"Org2MSP", "CN=Admin@org2.ledgerline"});
  const auto holder = ledger.add_client(operator_name);
  EnrollCall host;
  host.mutable_identity()->set_msp_id(drone_host.msp_id);
  host.mutable_identity()->set_subject(drone_host.subject);
  EnrollCall role;
  role.mutable_identity()->set_msp_id(operator_name.msp_id);
  role.mutable_identity()->set_subject(operator_name.subject);
  role.set_role(OPERATOR);
  LeaseCall lease;
  for (const DroneFacts& drone : drones) {
    host.add_drones(drone.name);
    lease.add_drones(drone.name);
  }
  if (auto s = ledger.commit_now(0, admin1, {"enroll", {host.SerializeAsString()}}); !s) return s;
  if (auto s = ledger.commit_now(0, admin2, {"enroll", {role.SerializeAsString()}}); !s) return s;
  return ledger.commit_now(0, holder, {"acquire", {lease.SerializeAsString()}});
}

}  // namespace

/// What is on its way between two parts.
struct VirtualWorld::Wires {
  struct Drone {
    std::vector<Line> lines;
    std::vector<SensorFault> sensors;
    MocapFault mocap;
    std::optional<sim::MocapPose> frozen_at;
    TimeNs next_mocap_ns = 0;
    Random noise{0};
    std::deque<std::pair<TimeNs, std::string>> mocap_ring;  ///< with the time of arrival
  };
  struct Datagram {
    DroneNumber drone = 0;
    link::Port port = link::Port::answer;
    std::string bytes;
  };
  std::vector<Drone> drones;
  std::deque<Datagram> to_link;
  std::deque<Plan> plans;
  std::deque<Pose> poses;
  std::deque<AgentBeat> beats;
  std::deque<StateSample> states;
  std::deque<Transition> transitions;
};

VirtualWorld::VirtualWorld(const WorldConfig& config)
    : config_(config),
      ledger_(node_config(config), {}, config.seed),
      host_(ledger_, drone_host, config.seed + 1),
      operator_(ledger_, operator_name, config.seed + 2),
      sim_(sim_parameters(config), 0),
      wires_(std::make_unique<Wires>()),
      digester_(std::make_unique<Digester>()) {
  Random seeds(config.seed ^ 0x6c696e6573ULL);
  for (int k = 1; k <= config.drones; ++k) {
    DroneFacts facts;
    facts.name = drone_name(k);
    facts.number = static_cast<DroneNumber>(k);
    facts_.push_back(facts);
    Wires::Drone wires;
    for (std::size_t i = 0; i < line_count; ++i) wires.lines.emplace_back(Line::Kind::datagrams, seeds.next());
    wires.noise = Random(seeds.next());
    wires_->drones.push_back(std::move(wires));
  }
}

VirtualWorld::~VirtualWorld() = default;

Result<std::unique_ptr<VirtualWorld>> VirtualWorld::create(const WorldConfig& config) {
  if (config.drones < 1 || config.drones > max_drones)
    return Error{fmt::format("{} drones asked for; 1 to {} can fly", config.drones, max_drones)};
  std::unique_ptr<VirtualWorld> world(new VirtualWorld(config));
  if (auto status = world->set_up(); !status) return status.error();
  return world;
}

Status VirtualWorld::set_up() {
  if (auto s = prepare(ledger_, facts_); !s) return s;
  host_.forget();  // what came before the processes
  operator_.forget();
  start_link();
  if (auto s = start_agent(); !s) return s;
  if (auto s = start_ground(); !s) return s;
  for (std::size_t i = 0; i < facts_.size(); ++i) {
    const sim::Truth truth = sim_.truth(facts_[i].number);
    facts_[i].start_m = {truth.position_m[0], truth.position_m[1]};
  }
  events_.clear();
  new_events_.clear();
  return done;
}

TimeNs VirtualWorld::real_offset() const { return real_epoch_s * ns_per_s + clock_jump_ns_; }

Result<std::string> VirtualWorld::control_record(LedgerPort& port, const std::string& drone) {
  QueryCall query;
  query.set_id("control/" + drone);
  auto answer = port.evaluate(now_, {"get", {query.SerializeAsString()}});
  if (!answer) return answer.error();
  Assets assets;
  if (!assets.ParseFromString(*answer) || assets.assets_size() != 1)
    return Error{"get control/" + drone + ": no record"};
  return assets.assets(0).msg_data();
}

void VirtualWorld::start_link() {
  // Any number that differs from start to start, as the shell's random one does.
  link_.emplace(link_settings(config_), Random(config_.seed * 1000 + ++starts_).next());
}

Status VirtualWorld::start_agent() {
  agent_.emplace(agent_config(config_, ++starts_), ledger_.registry());
  mocap_clock_.emplace([this] { return real_offset(); });
  agent_->set_real_offset(mocap_clock_->offset_ns());
  agent_->on_connection(now_, true);
  for (const DroneFacts& drone : facts_) {
    const auto record = control_record(host_, drone.name);
    if (!record) return record.error();
    Control control;
    if (!control.ParseFromString(*record)) return Error{drone.name + ": malformed control record"};
    agent_->set_control(control);
  }
  return done;
}

Status VirtualWorld::start_ground() {
  ground_ = std::make_unique<ground::FlightCore>(ground_config(config_, ledger_));
  for (const DroneFacts& drone : facts_) {
    const auto record = control_record(operator_, drone.name);
    if (!record) return record.error();
    if (auto s = ground_->set_control(*record); !s) return s;
  }
  return done;
}

bool VirtualWorld::lives(Process process) const {
  switch (process) {
    case Process::agent:
      return agent_.has_value();
    case Process::link:
      return link_.has_value();
    case Process::ground:
      return ground_ != nullptr;
  }
  return false;
}

bool VirtualWorld::runs(Process process) const {
  const bool stopped = process == Process::agent  ? agent_stopped_
                       : process == Process::link ? link_stopped_
                                                  : ground_stopped_;
  return lives(process) && !stopped;
}

void VirtualWorld::note(WorldEvent::Kind kind, std::size_t drone, std::string text) {
  new_events_.push_back({now_, kind, drone, 0, std::move(text)});
}

void VirtualWorld::kill(Process process) {
  // Also one that is not there yet, since its start waits for the ledger.
  if (process == Process::agent) agent_wanted_ = false;
  if (process == Process::ground) ground_wanted_ = false;
  if (!lives(process)) return;
  switch (process) {
    case Process::agent:
      agent_.reset();
      agent_out_.clear();
      host_.forget();
      wires_->states.clear();
      wires_->transitions.clear();
      for (Wires::Drone& drone : wires_->drones) drone.mocap_ring.clear();
      break;
    case Process::link:
      link_.reset();
      wires_->to_link.clear();
      wires_->plans.clear();
      wires_->poses.clear();
      wires_->beats.clear();
      for (DroneFacts& drone : facts_) {
        drone.phase = FlightPhase::disconnected;
        drone.mode = FailsafeMode::none;
        drone.cause = FailsafeCause::none;
        drone.told_until_ns = drone.plan_end_ns = 0;
      }
      break;
    case Process::ground:
      ground_.reset();
      operator_.forget();
      break;
  }
  note(WorldEvent::Kind::ended, 0, process == Process::agent ? "agent" : process == Process::link ? "link" : "ground");
}

void VirtualWorld::start(Process process) {
  if (lives(process)) return;
  switch (process) {
    case Process::agent:
      agent_wanted_ = true;
      return;
    case Process::link:
      start_link();
      note(WorldEvent::Kind::started, 0, "link");
      return;
    case Process::ground:
      ground_wanted_ = true;
      return;
  }
}

void VirtualWorld::stop(Process process, bool stopped) {
  switch (process) {
    case Process::agent:
      agent_stopped_ = stopped;
      return;
    case Process::link:
      link_stopped_ = stopped;
      return;
    case Process::ground:
      ground_stopped_ = stopped;
      return;
  }
}

void VirtualWorld::restart_ledger() {
  ledger_.restart(now_);
  for (LedgerPort* port : {&host_, &operator_}) port->restart(now_);
}

void VirtualWorld::stop_drone(std::size_t drone, bool cut) {
  DronesCall call;
  call.add_drones(facts_[drone].name);
  call.set_cut(cut);
  // Of nobody that waits: ground knows no such call.
  operator_.submit(now_, (std::uint64_t{1} << 62) + next_call_++, {"stop", {call.SerializeAsString()}});
}

void VirtualWorld::impair(LineAt at, std::size_t drone, const Impairment& impairment) {
  Line& line = wires_->drones[drone].lines[static_cast<std::size_t>(at)];
  if (text_of(line.impairment()) == text_of(impairment)) return;
  [[maybe_unused]] const Status set = line.set(impairment);
  assert(set.ok());  // datagrams take every effect
}

void VirtualWorld::set_sensor_faults(std::size_t drone, std::vector<SensorFault> faults) {
  renew(wires_->drones[drone].sensors, std::move(faults));
}

void VirtualWorld::set_mocap_fault(std::size_t drone, const MocapFault& fault) {
  wires_->drones[drone].mocap = fault;
  if (!fault.frozen) wires_->drones[drone].frozen_at.reset();
}

LineCounts VirtualWorld::line_counts(LineAt at, std::size_t drone) const {
  return wires_->drones[drone].lines[static_cast<std::size_t>(at)].counts();
}

const LedgerPort::Counts& VirtualWorld::counts(Process process) const {
  return process == Process::agent ? host_.counts() : operator_.counts();
}

std::string VirtualWorld::plans_text(std::size_t drone) const {
  std::string text;
  if (agent_) {
    const auto commands = agent_->report(facts_[drone].number).commands;
    text += fmt::format("agent: {} on the ledger, {} verified", commands.on_ledger, commands.verified);
    for (std::size_t i = 0; i < agent::refusal_count; ++i) {
      if (commands.reasons[i] > 0)
        text += fmt::format(", {} {}", commands.reasons[i], agent::refusal_name(static_cast<agent::Refusal>(i)));
    }
  }
  if (link_) {
    const link::PlanCounters plans = link_->reports()[drone].plans;
    text += fmt::format("{}link: {} received, {} applied, {} late, {} dropped", text.empty() ? "" : "; ",
                        plans.received, plans.applied, plans.late, plans.dropped);
  }
  return text;
}

ground::FlightStatus VirtualWorld::status(std::size_t drone) const {
  return ground_ ? ground_->status(drone) : ground::FlightStatus{};
}

void VirtualWorld::step() {
  now_ += tick_ns;
  events_ = std::exchange(new_events_, {});
  step_sim();
  if (!ledger_stalled_) ledger_.step(now_);
  host_.step(now_);
  operator_.step(now_);
  step_agent();
  step_ground();
  step_link();
  deliver_to_drones();
  events_.insert(events_.end(), new_events_.begin(), new_events_.end());
  new_events_.clear();
  look();
}

void VirtualWorld::step_sim() {
  const auto& out = sim_.step(now_);
  step_mocap(out.poses);
  for (const auto& datagram : out.datagrams) {
    Wires::Drone& drone = wires_->drones[datagram.drone - 1U];
    const bool state = datagram.to.port == sim::state_port;
    digester_->put(datagram.bytes);
    if (!state) {
      drone.lines[static_cast<std::size_t>(LineAt::answers)].push(now_, datagram.bytes);
      continue;
    }
    std::string bytes = datagram.bytes;
    if (misreport(now_, drone.sensors, drone.noise, bytes))
      drone.lines[static_cast<std::size_t>(LineAt::states)].push(now_, bytes);
  }
  for (std::size_t i = 0; i < facts_.size(); ++i) {
    Wires::Drone& drone = wires_->drones[i];
    for (const auto& [at, port] :
         {std::pair(LineAt::answers, link::Port::answer), std::pair(LineAt::states, link::Port::state)}) {
      while (auto unit = drone.lines[static_cast<std::size_t>(at)].pop(now_)) {
        if (link_ && wires_->to_link.size() < socket_queue)
          wires_->to_link.push_back({facts_[i].number, port, std::move(unit->bytes)});
      }
    }
  }
}

void VirtualWorld::step_mocap(const std::vector<sim::MocapPose>& poses) {
  for (const sim::MocapPose& measured : poses) {
    Wires::Drone& drone = wires_->drones[measured.drone - 1U];
    sim::MocapPose pose = measured;
    if (drone.mocap.period_ns > 0) {
      if (now_ < drone.next_mocap_ns) continue;
      drone.next_mocap_ns = now_ + drone.mocap.period_ns;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      pose.position_m[axis] += drone.mocap.offset_m[axis];
      if (drone.mocap.noise_m > 0) pose.position_m[axis] += drone.mocap.noise_m * drone.noise.normal();
    }
    if (drone.mocap.frozen) {
      if (!drone.frozen_at) drone.frozen_at = pose;
      pose.position_m = drone.frozen_at->position_m;
      pose.orientation = drone.frozen_at->orientation;
    }
    PoseStamped message;
    message.header = {real_offset() + pose.stamp_ns, "map"};
    message.position_m = pose.position_m;
    message.orientation = pose.orientation;
    drone.lines[static_cast<std::size_t>(LineAt::mocap)].push(now_, to_cdr(message));
  }
  for (Wires::Drone& drone : wires_->drones) {
    while (auto unit = drone.lines[static_cast<std::size_t>(LineAt::mocap)].pop(now_)) {
      digester_->put(unit->bytes);
      if (agent_ && drone.mocap_ring.size() < mocap_ring) drone.mocap_ring.emplace_back(now_, std::move(unit->bytes));
    }
  }
}

void VirtualWorld::step_agent() {
  if (!agent_ && agent_wanted_ && host_.reachable() && !ledger_stalled_) {
    if (start_agent()) {
      note(WorldEvent::Kind::started, 0, "agent");
    } else {
      agent_.reset();  // tried again with the next step, as the shell does
    }
  }
  if (!agent_ || agent_stopped_) {
    if (!agent_) {
      (void)host_.take_blocks();
      (void)host_.take_outcomes();
      (void)host_.take_connection();
    }
    return;
  }
  if (now_ >= next_clock_ns_) {
    next_clock_ns_ = now_ + clock_period_ns;
    mocap_clock_->refresh();
    agent_->set_real_offset(mocap_clock_->offset_ns());
  }
  for (std::size_t i = 0; i < facts_.size(); ++i) {
    for (auto& ring = wires_->drones[i].mocap_ring; !ring.empty(); ring.pop_front()) {
      // As the agent's shell does.
      const auto pose = pose_from_cdr(ring.front().second);
      if (!pose) continue;
      const auto& q = pose->orientation;
      const double norm = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
      const auto stamp = mocap_clock_->stamp(pose->header.stamp_ns, ring.front().first);
      if (!stamp || !(std::abs(norm - 1) < 0.05)) continue;
      agent_->on_mocap(now_, facts_[i].number, {*stamp, pose->position_m, yaw_from_quaternion(pose->orientation)},
                       agent_out_);
    }
  }
  for (const auto& state : take(wires_->states)) agent_->on_state(now_, state, agent_out_);
  for (const auto& transition : take(wires_->transitions)) agent_->on_transition(transition);
  if (const auto connected = host_.take_connection()) agent_->on_connection(now_, *connected);
  for (const auto& ended : host_.take_outcomes()) agent_->on_outcome(now_, ended.id, ended.outcome, agent_out_);
  for (const auto& block : host_.take_blocks()) agent_->on_block(now_, block, agent_out_);
  agent_->step(now_, agent_out_);
  for (auto& submit : agent_out_.submits) host_.submit(now_, submit.frame, std::move(submit.call));
  for (const auto& trace : agent_out_.traces) digester_->put(trace);
  if (link_) {
    for (const Plan& plan : agent_out_.plans) put(wires_->plans, plan, plan_queue);
    for (const Pose& pose : agent_out_.poses) put(wires_->poses, pose, pose_queue);
    if (agent_out_.beat) put(wires_->beats, *agent_out_.beat, beat_queue);
  }
  agent_out_.clear();
}

void VirtualWorld::step_ground() {
  if (!ground_ && ground_wanted_ && operator_.reachable() && !ledger_stalled_) {
    if (start_ground()) {
      note(WorldEvent::Kind::started, 0, "ground");
    } else {
      ground_.reset();
    }
  }
  if (!ground_ || ground_stopped_) {
    if (!ground_) {
      (void)operator_.take_blocks();
      (void)operator_.take_outcomes();
    }
    return;
  }
  for (const auto& ended : operator_.take_outcomes()) {
    ground::FlightInputs inputs;
    inputs.outcome = &ended.outcome;
    inputs.outcome_id = ended.id;
    give_ground(inputs);
  }
  const auto blocks = operator_.take_blocks();
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ground::FlightInputs inputs;
    inputs.block = &blocks[i];
    inputs.more = i + 1 < blocks.size();
    give_ground(inputs);
  }
  if (now_ >= next_ground_ns_) give_ground({});
}

void VirtualWorld::give_ground(ground::FlightInputs inputs) {
  next_ground_ns_ = now_ + ground_period_ns;
  inputs.realtime_s = real_epoch_s + now_ / ns_per_s;
  auto out = ground_->step(now_, inputs);
  for (auto& submission : out.submissions) operator_.submit(now_, submission.id, std::move(submission.call));
  for (const auto& trace : out.traces) digester_->put(trace);
}

void VirtualWorld::step_link() {
  if (!link_ || link_stopped_) return;
  const auto datagrams = take(wires_->to_link);
  std::vector<link::Received> received;
  received.reserve(datagrams.size());
  for (const auto& datagram : datagrams) received.push_back({datagram.drone, datagram.port, datagram.bytes});
  const auto plans = take(wires_->plans);
  const auto poses = take(wires_->poses);
  const auto beats = take(wires_->beats);
  for (const Pose& pose : poses) facts_[pose.drone - 1U].pose = pose;
  const auto& out =
      link_->step(now_, {.received = received, .plans = plans, .poses = poses, .beats = beats, .stop_all = false});
  for (const auto& send : out.to_send) {
    DroneFacts& facts = facts_[send.drone - 1U];
    const std::string_view text = send.command.view();
    digester_->put(text);
    wires_->drones[send.drone - 1U].lines[static_cast<std::size_t>(LineAt::to)].push(now_, text);
    const auto words = words_of(text);
    if (words.empty() || words[0] != "rc") {
      events_.push_back({now_, WorldEvent::Kind::sent, send.drone - 1U, 0, std::string(text)});
      continue;
    }
    std::array<double, 4> sticks{};
    bool good = words.size() == 5;
    for (std::size_t i = 0; good && i < 4; ++i) {
      const auto value = parse_number(words[i + 1]);
      good = value && std::abs(*value) <= 100;
      if (good) sticks[i] = *value / 100 * rc_full_mps;
    }
    if (!good) events_.push_back({now_, WorldEvent::Kind::bad_rc, send.drone - 1U, 0, std::string(text)});
    facts.told_mps = std::hypot(sticks[0], sticks[1], sticks[2]);
    facts.told_ns = now_;
  }
  if (agent_) {
    for (const StateSample& state : out.states) put(wires_->states, state, state_queue);
    for (const Transition& transition : out.transitions) put(wires_->transitions, transition, transition_queue);
  }
  take_link_traces(out);
  for (const Plan& plan : plans) {
    if (plan.action != PlanAction::fly || plan.count == 0 || plan.count > max_setpoints) continue;
    const link::PlayoutSettings settings;
    const TimeNs last = plan.setpoints[plan.count - 1].at_ns;
    const TimeNs hold = plan.count == 1 ? settings.default_hold_ns
                                        : std::min(last - plan.setpoints[plan.count - 2].at_ns, settings.max_hold_ns);
    DroneFacts& facts = facts_[plan.drone - 1U];
    facts.told_until_ns = std::max(facts.told_until_ns, last + hold);
  }
  for (DroneFacts& facts : facts_) {
    if (facts.told_until_ns != 0) facts.plan_end_ns = facts.told_until_ns + link_->margin_ns(facts.number);
  }
}

void VirtualWorld::take_link_traces(const link::LinkOutputs& out) {
  for (const TraceRecord& record : out.trace) {
    digester_->put(record);
    DroneFacts& facts = facts_[record.drone - 1U];
    if (record.kind == TraceKind::mode) {
      facts.phase = static_cast<FlightPhase>(record.id);
      facts.mode = static_cast<FailsafeMode>(record.extra);
      facts.cause = static_cast<FailsafeCause>(static_cast<int>(record.v[0]));
      events_.push_back({now_, WorldEvent::Kind::mode, record.drone - 1U, 0, {}});
    } else if (record.kind == TraceKind::command_applied) {
      events_.push_back(
          {now_, WorldEvent::Kind::applied, record.drone - 1U, to_seconds(record.t_ns - record.stamp_ns), {}});
    }
  }
}

void VirtualWorld::deliver_to_drones() {
  for (std::size_t i = 0; i < facts_.size(); ++i) {
    while (auto unit = wires_->drones[i].lines[static_cast<std::size_t>(LineAt::to)].pop(now_)) {
      digester_->put(unit->bytes);
      sim_.datagram(facts_[i].number, link_endpoint, unit->bytes);
    }
  }
}

void VirtualWorld::look() {
  bool quiet = ground_done();
  for (std::size_t i = 0; i < facts_.size(); ++i) {
    DroneFacts& facts = facts_[i];
    facts.truth = sim_.truth(facts.number);
    facts.off_path_m.reset();
    if (ground_) {
      const auto status = ground_->status(i);
      facts.ground_phase = status.phase;
      facts.finished = status.finished;
      facts.lap = status.lap;
      if (status.phase == ground::DronePhase::path) {
        const ground::Path path(config_.shape, {status.origin_m[0], status.origin_m[1]}, config_.side_m);
        facts.off_path_m = path.distance_m({facts.truth.position_m[0], facts.truth.position_m[1]});
      }
    }
    const bool down = !facts.truth.in_flight && facts.truth.position_m[2] < on_ground_m;  // not still falling
    quiet = quiet && down && !in_flight(facts.phase);
  }
  if (!quiet) {
    quiet_since_ns_ = 0;
  } else if (quiet_since_ns_ == 0) {
    quiet_since_ns_ = now_;
  }
}

bool VirtualWorld::over() const { return quiet_since_ns_ != 0 && now_ - quiet_since_ns_ >= quiet_ns; }

std::vector<std::string> VirtualWorld::lost_acknowledged() const {
  std::vector<std::string> lost;
  std::map<std::string, int> in_blocks;
  for (const std::string& bytes : ledger_.blocks()) {
    const auto block = fabric::decode_block(bytes);
    if (!block) {
      lost.push_back("a block cannot be read: " + block.error().what);
      continue;
    }
    for (const auto& tx : block->transactions) in_blocks[tx.tx_id] = tx.code;
  }
  for (const LedgerPort* port : {&host_, &operator_}) {
    for (const std::string& tx_id : port->acknowledged()) {
      const auto found = in_blocks.find(tx_id);
      if (found == in_blocks.end() || found->second != 0) lost.push_back("transaction " + tx_id);
    }
  }
  return lost;
}

std::vector<std::string> VirtualWorld::lost_transitions() const {
  std::map<std::pair<std::string, std::uint64_t>, std::uint64_t> newest;  // by drone and boot
  std::vector<std::string> lost;
  for (const std::string& bytes : ledger_.blocks()) {
    const auto block = fabric::decode_block(bytes);
    if (!block) continue;
    for (const auto& tx : block->transactions) {
      SetCall set;
      if (tx.code != 0 || tx.event_name != "set" || !set.ParseFromString(tx.event_payload)) continue;
      for (const Asset& asset : set.assets()) {
        const auto slash = asset.id().find("/failsafe");
        if (slash == std::string::npos) continue;
        const auto transitions = transitions_from_cdr(asset.msg_data());
        if (!transitions) {
          lost.push_back(asset.id() + " cannot be read");
          continue;
        }
        for (const Transition& t : *transitions) {
          std::uint64_t& last = newest[{asset.id().substr(0, slash), t.boot_id}];
          if (t.number > last + 1)
            lost.push_back(fmt::format("{}: transition {} after {}", asset.id(), t.number, last));
          last = std::max(last, t.number);
        }
      }
    }
  }
  return lost;
}

std::uint64_t VirtualWorld::transitions_pending() const {
  std::uint64_t pending = 0;
  if (link_) {
    for (const auto& report : link_->reports()) pending += report.transitions.kept + report.transitions.lost;
  }
  return pending;
}

crypto::Digest VirtualWorld::digest() {
  for (const std::string& block : ledger_.blocks()) digester_->put(block);
  return digester_->result();
}

}  // namespace ledgerline::hil
