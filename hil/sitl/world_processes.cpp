// SimulatedWorld's processes: how they begin, die and come back.
#include <utility>

#include "common/verification/roles.hpp"
#include "hil/sitl/wires/wires.hpp"
#include "hil/sitl/world.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

constexpr TimeNs landing_bound_ns = 10 * ns_per_s;  // link's ShellSettings

}  // namespace

Result<Control> SimulatedWorld::read_control(LedgerPort& port, const std::string& drone) {
  return verification::read_control(drone, [&](const fabric::Call& call) { return port.evaluate(now_, call); });
}

void SimulatedWorld::start_link() {
  // Any number that differs from start to start, as the shell's random one does.
  link_start_ = ++starts_;
  std::erase_if(link_starts_ns_, [this](TimeNs start) { return now_ - start > link::starts_within_ns; });
  link_starts_ns_.push_back(now_);
  link_.emplace(link_settings(config_), Random(config_.seed * 1000 + link_start_).next(),
                static_cast<int>(link_starts_ns_.size()), link_stops_);
  link_ends_ns_.reset();
}

Status SimulatedWorld::start_agent() {
  agent_.emplace(agent_config(config_, ++starts_), ledger_.registry());
  mocap_intake_.emplace([this] { return host_real_offset(); });
  agent_->set_real_offset(mocap_intake_->clock().offset_ns());
  agent_->on_connection(host_now(), true);
  host_.begin(agent_checkpoint_);
  if (agent_checkpoint_) {
    for (const Control& control : agent_records_.controls) agent_->set_control(host_now(), control);
    agent_->set_roles(agent_records_.roles);
    return done;
  }
  std::vector<Control> controls;
  for (const DroneFacts& drone : facts()) {
    auto control = read_control(host_, drone.name);
    if (!control) return control.error();
    agent_->set_control(host_now(), *control);
    controls.push_back(std::move(*control));
  }
  auto roles = verification::read_roles([&](const fabric::Call& call) { return host_.evaluate(now_, call); },
                                        verification::organisations_of(controls));
  if (!roles) return roles.error();
  agent_->set_roles(std::move(*roles));
  return done;
}

Status SimulatedWorld::start_ground() {
  ground_ = std::make_unique<ground::FlightCore>(ground_config(config_, ledger_));
  operator_.begin();
  for (const DroneFacts& drone : facts()) {
    const auto control = read_control(operator_, drone.name);
    if (!control) return control.error();
    if (auto s = ground_->set_control(control->SerializeAsString()); !s) return s;
  }
  if (mission_) mission_->ground_began();
  return done;
}

bool SimulatedWorld::lives(Process process) const {
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

bool SimulatedWorld::runs(Process process) const { return lives(process) && !stopped(process); }

void SimulatedWorld::kill(Process process) {
  // Also one that is not there yet, since its start waits for the ledger.
  if (process == Process::agent) agent_wanted_ = false;
  if (process == Process::ground) ground_wanted_ = false;
  if (!lives(process)) return;
  switch (process) {
    case Process::agent:
      agent_checkpoint_ = host_.checkpoint();
      agent_records_ = agent_->records();
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
      wires_->heartbeats.clear();
      witness_.link_ended();
      break;
    case Process::ground:
      ground_.reset();
      if (mission_) mission_->ground_ended();
      operator_.forget();
      ground_outcomes_.clear();
      stoppers_.forgotten(now_);
      break;
  }
  note(WorldEvent::Kind::ended, 0, name_of(process));
}

void SimulatedWorld::start(Process process) {
  if (lives(process)) return;
  if (process == Process::agent) agent_wanted_ = true;
  if (process == Process::ground) ground_wanted_ = true;
  if (process != Process::link) return;
  start_link();
  note(WorldEvent::Kind::started, 0, "link");
}

void SimulatedWorld::end_link(bool again) {
  link_begins_again_ = again;
  if (link_ && !link_ends_ns_) link_ends_ns_ = now_ + landing_bound_ns;
}

void SimulatedWorld::restart_ledger() {
  ledger_.restart(now_);
  for (LedgerPort* port : {&host_, &operator_}) port->restart(now_);
  stoppers_.restart(now_);
}

}  // namespace ledgerline::hil
