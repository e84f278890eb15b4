#include "hil/virtual/world.hpp"

#include <fmt/format.h>

#include <cassert>
#include <cstring>
#include <deque>
#include <utility>

#include "common/msg/ros.hpp"
#include "hil/virtual/digester.hpp"
#include "hil/virtual/ledger/ledger_audit.hpp"
#include "ledgerline.pb.h"
#include "onboard/link/shell/starts.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs tick_ns = 1 * ns_per_ms;
constexpr TimeNs ground_period_ns = 50 * ns_per_ms;
constexpr TimeNs clock_period_ns = 1 * ns_per_s;  // as the agent's shell
constexpr TimeNs quiet_ns = 500 * ns_per_ms;
constexpr std::int64_t real_epoch_s = 1'767'225'600;
constexpr TimeNs landing_bound_ns = 10 * ns_per_s;  // link's ShellSettings
constexpr sim::Endpoint link_endpoint{0x7F000001, 40000};

// Lengths of iceoryx's queues (onboard/ipc/ipc.cpp), where the oldest goes, and of the agent's ring for mocap, where
// the newest goes; what a socket of 208 kB holds of datagrams of this size.
constexpr std::size_t plan_queue = 128, pose_queue = 256, beat_queue = 8, state_queue = 256, transition_queue = 256;
constexpr std::size_t mocap_ring = 64, socket_queue = 256;

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

std::string bytes_of(const Plan& plan) { return {reinterpret_cast<const char*>(&plan), sizeof plan}; }

Plan plan_of(const std::string& bytes) {
  Plan plan;
  assert(bytes.size() == sizeof plan);
  std::memcpy(&plan, bytes.data(), sizeof plan);
  return plan;
}

}  // namespace

/// What is on its way between two parts.
struct VirtualWorld::Wires {
  struct Drone {
    DroneLines lines;
    std::deque<std::pair<TimeNs, std::string>> mocap_ring{};  ///< with the time of arrival
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
      stoppers_(ledger_, operator_, config.seed + 3),
      sim_(sim_parameters(config), 0),
      wires_(std::make_unique<Wires>()),
      digester_(std::make_unique<Digester>()),
      witness_(config.drones, sim_) {
  Random seeds(config.seed ^ 0x6c696e6573ULL);
  for (int k = 1; k <= config.drones; ++k)
    wires_->drones.push_back({DroneLines(seeds, ~config.seed + static_cast<std::uint64_t>(k))});
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
  if (auto s = prepare(ledger_, config_.drones); !s) return s;
  if (config_.supervisors) {
    if (auto s = enroll_supervisors(ledger_); !s) return s;
  }
  host_.forget();  // what came before the processes
  operator_.forget();
  ledger_.on_asked([this](const fabric::Call& call) { witness_.asked(call); });
  start_link();
  if (auto s = start_agent(); !s) return s;
  if (auto s = start_ground(); !s) return s;
  return done;
}

TimeNs VirtualWorld::real_offset() const { return real_epoch_s * ns_per_s + clock_jump_ns_; }

Result<std::string> VirtualWorld::control_record_by(LedgerPort& port, const std::string& drone) {
  return control_record(drone, [&](const fabric::Call& call) { return port.evaluate(now_, call); });
}

void VirtualWorld::start_link() {
  // Any number that differs from start to start, as the shell's random one does.
  link_start_ = ++starts_;
  std::erase_if(link_starts_ns_, [this](TimeNs start) { return now_ - start > link::starts_within_ns; });
  link_starts_ns_.push_back(now_);
  link_.emplace(link_settings(config_), Random(config_.seed * 1000 + link_start_).next(),
                static_cast<int>(link_starts_ns_.size()));
  link_ends_ns_.reset();
}

Status VirtualWorld::start_agent() {
  agent_.emplace(agent_config(config_, ++starts_), ledger_.registry());
  mocap_intake_.emplace([this] { return real_offset(); });
  agent_->set_real_offset(mocap_intake_->clock().offset_ns());
  agent_->on_connection(now_, true);
  for (const DroneFacts& drone : facts()) {
    const auto record = control_record_by(host_, drone.name);
    if (!record) return record.error();
    Control control;
    if (!control.ParseFromString(*record)) return Error{drone.name + ": malformed control record"};
    agent_->set_control(now_, control);
  }
  return done;
}

Status VirtualWorld::start_ground() {
  ground_ = std::make_unique<ground::FlightCore>(ground_config(config_, ledger_));
  for (const DroneFacts& drone : facts()) {
    const auto record = control_record_by(operator_, drone.name);
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
      witness_.link_ended();
      break;
    case Process::ground:
      ground_.reset();
      operator_.forget();
      ground_outcomes_.clear();
      stoppers_.forgotten(now_);
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

void VirtualWorld::end_link() {
  if (link_ && !link_ends_ns_) link_ends_ns_ = now_ + landing_bound_ns;
}

void VirtualWorld::restart_ledger() {
  ledger_.restart(now_);
  for (LedgerPort* port : {&host_, &operator_}) port->restart(now_);
  stoppers_.restart(now_);
}

void VirtualWorld::say_stop(Stopper who, std::size_t drone, StopWord word) {
  stoppers_.say(now_, who, drone_name(static_cast<int>(drone) + 1), word);
}

DroneLines& VirtualWorld::lines(std::size_t drone) { return wires_->drones[drone].lines; }

std::string VirtualWorld::plans_text(std::size_t drone) const {
  std::string text;
  if (agent_) {
    const auto commands = agent_->report(facts()[drone].number).commands;
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

void VirtualWorld::step() {
  now_ += tick_ns;
  witness_.begin_step();
  step_sim();
  if (!ledger_stalled_) ledger_.step(now_);
  host_.step(now_);
  operator_.step(now_);
  for (auto& ended : operator_.take_outcomes()) {
    if (!stoppers_.take_outcome(now_, ended) && ground_) ground_outcomes_.push_back(std::move(ended));
  }
  stoppers_.step(now_);
  step_agent();
  step_ground();
  step_link();
  deliver_to_drones();
  witness_.end_step(sim_, ground_.get(), link_ ? &*link_ : nullptr);
  if (!ground_done() || !witness_.all_down()) {
    quiet_since_ns_ = 0;
  } else if (quiet_since_ns_ == 0) {
    quiet_since_ns_ = now_;
  }
}

void VirtualWorld::step_sim() {
  const auto& out = sim_.step(now_);
  step_mocap(out.poses);
  for (const auto& datagram : out.datagrams) {
    DroneLines& lines = wires_->drones[datagram.drone - 1U].lines;
    digester_->put(datagram.bytes);
    if (datagram.to.port == sim::state_port) {
      lines.push_state(now_, datagram.bytes);
    } else {
      lines.push(now_, LineAt::answers, datagram.bytes);
    }
  }
  for (std::size_t i = 0; i < facts().size(); ++i) {
    for (const auto& [at, port] :
         {std::pair(LineAt::answers, link::Port::answer), std::pair(LineAt::states, link::Port::state)}) {
      while (auto unit = wires_->drones[i].lines.pop(now_, at)) {
        if (link_ && wires_->to_link.size() < socket_queue)
          wires_->to_link.push_back({facts()[i].number, port, std::move(unit->bytes)});
      }
    }
  }
}

void VirtualWorld::step_mocap(const std::vector<sim::MocapPose>& poses) {
  for (const sim::MocapPose& measured : poses)
    wires_->drones[measured.drone - 1U].lines.push_mocap(now_, real_offset(), measured);
  for (Wires::Drone& drone : wires_->drones) {
    while (auto unit = drone.lines.pop(now_, LineAt::mocap)) {
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
    mocap_intake_->clock().refresh();
    agent_->set_real_offset(mocap_intake_->clock().offset_ns());
  }
  for (std::size_t i = 0; i < facts().size(); ++i) {
    for (auto& ring = wires_->drones[i].mocap_ring; !ring.empty(); ring.pop_front()) {
      const auto message = pose_from_cdr(ring.front().second);
      if (!message) continue;
      const auto pose = mocap_intake_->take(
          {message->header.stamp_ns, ring.front().first, message->position_m, message->orientation});
      if (pose) agent_->on_mocap(now_, facts()[i].number, *pose, agent_out_);
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
    for (const Plan& plan : agent_out_.plans) {
      witness_.handed(now_, plan);
      wires_->drones[plan.drone - 1U].lines.push(now_, LineAt::plans, bytes_of(plan), link_start_);
    }
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
    }
    return;
  }
  for (const auto& ended : std::exchange(ground_outcomes_, {})) {
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
  for (const ground::DroneNews& news : out.news) {
    if (news.state) witness_.shown(now_, news.drone, *news.state);
  }
  for (auto& submission : out.submissions) operator_.submit(now_, submission.id, std::move(submission.call));
  for (const auto& trace : out.traces) digester_->put(trace);
}

void VirtualWorld::step_link() {
  if (!link_ || link_stopped_) return;
  const auto datagrams = take(wires_->to_link);
  std::vector<link::Received> received;
  received.reserve(datagrams.size());
  for (const auto& datagram : datagrams) received.push_back({datagram.drone, datagram.port, datagram.bytes});
  for (Wires::Drone& drone : wires_->drones) {
    while (auto unit = drone.lines.pop(now_, LineAt::plans)) {
      if (unit->tag == link_start_) put(wires_->plans, plan_of(unit->bytes), plan_queue);
    }
  }
  const auto plans = take(wires_->plans);
  const auto poses = take(wires_->poses);
  const auto beats = take(wires_->beats);
  witness_.given(poses);
  const auto& out = link_->step(
      now_,
      {.received = received, .plans = plans, .poses = poses, .beats = beats, .stop_all = link_ends_ns_.has_value()});
  for (const auto& send : out.to_send) {
    const std::string_view text = send.command.view();
    digester_->put(text);
    wires_->drones[send.drone - 1U].lines.push(now_, LineAt::to, text);
    witness_.sent(now_, send.drone, text);
  }
  if (agent_) {
    for (const StateSample& state : out.states) put(wires_->states, state, state_queue);
    for (const Transition& transition : out.transitions) put(wires_->transitions, transition, transition_queue);
  }
  for (const StateSample& state : out.states) witness_.said(state);
  for (const TraceRecord& record : out.trace) {
    digester_->put(record);
    witness_.traced(now_, record);
  }
  witness_.given(plans);
  if (link_ends_ns_ && (link_->all_landed_or_told() || now_ >= *link_ends_ns_)) kill(Process::link);
}

void VirtualWorld::deliver_to_drones() {
  for (std::size_t i = 0; i < facts().size(); ++i) {
    while (auto unit = wires_->drones[i].lines.pop(now_, LineAt::to)) {
      digester_->put(unit->bytes);
      sim_.datagram(facts()[i].number, link_endpoint, unit->bytes);
    }
  }
}

bool VirtualWorld::over() const { return quiet_since_ns_ != 0 && now_ - quiet_since_ns_ >= quiet_ns; }

std::vector<std::string> VirtualWorld::lost_acknowledged() {
  restart_ledger();
  std::vector<std::string> lost;
  std::vector<const LedgerPort*> ports{&host_, &operator_};
  for (const auto& [who, port] : stoppers_.ports()) ports.push_back(port.get());
  for (const LedgerPort* port : ports) {
    for (const std::string& tx_id : port->acknowledged()) {
      const auto known = ledger_.find(tx_id);
      if (!known || known->code != 0) lost.push_back("transaction " + tx_id);
    }
  }
  return lost;
}

std::vector<std::string> VirtualWorld::lost_transitions() const { return transition_gaps(ledger_.blocks()); }

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
