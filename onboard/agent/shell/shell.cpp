#include "onboard/agent/shell/shell.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/program/program.hpp"

namespace ledgerline::agent {
namespace {

constexpr TimeNs clock_period_ns = 1 * ns_per_s;  // real time may be slewed

}  // namespace

AgentShell::AgentShell(Parts parts)
    : settings_(std::move(parts.settings)),
      registry_(std::move(parts.registry)),
      core_(settings_.core, *registry_),
      log_(core_, parts.several ? fmt::format("channel {}: ", channel()) : ""),
      mocap_(settings_, log_.label(), std::move(parts.participant), [this] { mailbox_.wake(); }),
      client_(std::move(parts.client)),
      urgent_(std::move(parts.urgent)),
      ledger_({.settings = settings_,
               .label = log_.label(),
               .several = parts.several,
               .core = core_,
               .out = out_,
               .mailbox = mailbox_,
               .client = *client_,
               .witness = std::move(parts.witness),
               .kept = std::move(parts.kept)}) {
  if (!parts.several) return;
  heartbeat_for_ = 0;
  for (const DroneName& drone : core_.drones()) heartbeat_for_ |= AgentHeartbeat::bit_of(drone.number);
}

Status AgentShell::start(ipc::AgentEnd& end, Recorder& recorder) {
  end_ = &end;
  recorder_ = &recorder;
  core_.set_real_offset(mocap_.clock().offset_ns());
  if (auto status = mocap_.open(); !status) return status;
  ledger_.start();
  return done;
}

bool AgentShell::flies(DroneNumber drone) const {
  return std::any_of(core_.drones().begin(), core_.drones().end(),
                     [&](const DroneName& ours) { return ours.number == drone; });
}

Status AgentShell::take_inputs(bool link_woke) {
  link_woke_ = link_woke;
  if (link_woke) ++counters_.link_wakes;
  for (Event& event : mailbox_.pop_all()) {
    if (const auto* ended = std::get_if<FrameEnded>(&event)) {
      core_.on_outcome(monotonic_ns(), ended->frame, ended->outcome, out_);
      log_.outcome(ended->outcome);
    } else if (auto status = ledger_.take(event); !status) {
      return status;
    }
    step_and_act();
  }
  mocap_.take([this](DroneNumber drone, const MocapPose& pose) { core_.on_mocap(monotonic_ns(), drone, pose, out_); });
  return done;
}

void AgentShell::take_state(const StateSample& sample) {
  core_.on_state(monotonic_ns(), sample, out_);
  if (!link_woke_) ++counters_.states_without_wake;
}

void AgentShell::finish_turn() {
  step_and_act();
  run_periodic_tasks(monotonic_ns());
}

// What link waits for goes first; signing a frame takes a moment.
void AgentShell::step_and_act() {
  core_.step(monotonic_ns(), out_);
  for (const Plan& plan : out_.plans) {
    if (end_->send_plan(plan)) continue;
    ++counters_.plans_not_handed_over;
    log_.plan_lost(plan);
  }
  // A lost pose or heartbeat is made good by the next one; link watches their age.
  for (const Pose& pose : out_.poses) (void)end_->send_pose(pose);
  if (out_.heartbeat) {
    out_.heartbeat->drones = heartbeat_for_;
    (void)end_->send_heartbeat(*out_.heartbeat);
  }
  for (AgentOutputs::Submit& submit : out_.submits) {
    (submit.urgent ? urgent_ : client_)
        ->submit(std::move(submit.call), [this, frame = submit.frame](fabric::Outcome outcome) {
          mailbox_.put(FrameEnded{frame, std::move(outcome)});
        });
  }
  log_.outputs(out_);
  recorder_->add(out_.traces);
  out_.clear();
}

void AgentShell::run_periodic_tasks(TimeNs now) {
  if (due(now, next_clock_ns_, clock_period_ns)) {
    mocap_.clock().refresh();
    core_.set_real_offset(mocap_.clock().offset_ns());
    log_.lost_transitions();
  }
  if (due(now, next_checkpoint_ns_, fabric::CheckpointKeeper::usual_period_ns)) ledger_.keep_checkpoint();
}

void AgentShell::write_status(TimeNs now, std::optional<std::int64_t> certificate_days) const {
  print_status(status_line(core_, channel(), now, certificate_days));
}

std::string AgentShell::end() {
  ledger_.keep_checkpoint();
  ledger_.count(counters_);
  mocap_.count(counters_);
  return summary(core_, channel(), counters_);
}

}  // namespace ledgerline::agent
