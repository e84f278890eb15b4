#include "onboard/agent/shell/shell.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "common/base/log.hpp"
#include "common/msg/ros.hpp"
#include "common/program/program.hpp"

namespace ledgerline::agent {
namespace {

constexpr TimeNs clock_period_ns = 1 * ns_per_s;  // real time may be slewed

// The narrowest of three readings: this thread may be put aside between two clocks, and mocap stamps would all move.
TimeNs real_offset() {
  TimeNs narrowest = std::numeric_limits<TimeNs>::max(), offset = 0;
  for (int i = 0; i < 3; ++i) {
    const TimeNs before = monotonic_ns(), real = realtime_ns(), after = monotonic_ns();
    if (after - before >= narrowest) continue;
    narrowest = after - before;
    offset = real - (before + narrowest / 2);
  }
  return offset;
}

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

Status AgentShell::handle_events(bool link_woke) {
  link_woke_ = link_woke;
  if (link_woke) ++counters_.link_wakes;
  for (Event& event : mailbox_.pop_all()) {
    if (const auto* ended = std::get_if<CallEnded>(&event)) {
      core_.on_outcome(monotonic_ns(), ended->call_number, ended->outcome, out_);
      log_.outcome(ended->outcome);
    } else if (auto status = ledger_.handle(event); !status) {
      return status;
    }
    step_and_act();
  }
  mocap_.receive(
      [this](DroneNumber drone, const MocapPose& pose) { core_.on_mocap(monotonic_ns(), drone, pose, out_); });
  return done;
}

void AgentShell::on_state(const StateSample& sample) {
  core_.on_state(monotonic_ns(), sample, out_);
  if (!link_woke_) ++counters_.states_without_wake;
}

void AgentShell::finish_turn() {
  step_and_act();
  run_periodic_tasks(monotonic_ns());
}

// What link waits for goes first; signing a batch takes a moment.
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
        ->submit(std::move(submit.call), [this, call_number = submit.call_number](fabric::Outcome outcome) {
          mailbox_.put(CallEnded{call_number, std::move(outcome)});
        });
  }
  log_.outputs(out_);
  recorder_->add(out_.traces);
  out_.clear();
}

void AgentShell::run_periodic_tasks(TimeNs now) {
  if (advance_if_due(now, next_clock_ns_, clock_period_ns)) {
    mocap_.clock().refresh();
    core_.set_real_offset(mocap_.clock().offset_ns());
    log_.lost_transitions();
  }
  if (advance_if_due(now, next_checkpoint_ns_, fabric::CheckpointWriter::usual_period_ns)) ledger_.store_checkpoint();
}

void AgentShell::write_status(TimeNs now, std::optional<std::int64_t> certificate_days) const {
  print_status(status_line(core_, channel(), now, certificate_days));
}

std::string AgentShell::end() {
  ledger_.store_checkpoint();
  ledger_.count(counters_);
  mocap_.count(counters_);
  return summary(core_, channel(), counters_);
}

MocapInput::MocapInput(const Settings& settings, std::string label, dds::ParticipantPtr participant,
                       std::function<void()> wake)
    : settings_(settings),
      label_(std::move(label)),
      wake_(std::move(wake)),
      intake_(real_offset, settings.mocap_stamps_are_of_this_host),
      participant_(std::move(participant)) {}

Status MocapInput::open() {
  if (settings_.mocap_topic.empty()) return done;
  // Best effort hears both kinds of writers, and a pose that was lost is not worth sending again.
  const dds::Qos qos{.reliable = false};
  std::vector<dds::ReadTopic> read;
  for (const DroneName& drone : settings_.core.drones) {
    Input input{drone.number, std::make_unique<SpscRing<MocapMessage, 64>>(), {}};
    auto reader = dds::RawReader::create(
        participant_, pose_topic_of(settings_.mocap_topic, drone.name), name(settings_.mocap_message), qos,
        [this, ring = input.ring.get(), drone = drone.name](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
          const auto pose = pose_from_message(settings_.mocap_message, dds::text_of(cdr), drone);
          if (pose && !*pose) return;  // of others alone
          if (!pose ||
              !ring->push({(*pose)->header.stamp_ns, monotonic_ns(), (*pose)->position_m, (*pose)->orientation}))
            ++lost_;
          wake_();
        });
    if (!reader) return reader.error();
    input.reader = std::move(reader).value();
    inputs_.push_back(std::move(input));
    read.push_back({pose_topic_of(settings_.mocap_topic, drone.name), name(settings_.mocap_message), qos});
  }
  auto unheard =
      dds::report_unheard(participant_, std::move(read), [label = label_](std::size_t, const std::string& why) {
        if (!why.empty()) spdlog::warn("{}{} ([mocap] type)", label, why);
      });
  if (!unheard) return unheard.error();
  unheard_ = std::move(unheard).value();
  return done;
}

void MocapInput::receive(const std::function<void(DroneNumber, const MocapPose&)>& on_pose) {
  for (Input& input : inputs_) {
    MocapMessage message{};
    while (input.ring->pop(message)) {
      if (const auto pose = intake_.check(message)) {
        on_pose(input.drone, *pose);
      } else {
        if (++implausible_ == 1)
          spdlog::warn("{}a mocap pose of drone {} is refused: {}", label_, input.drone, pose.error().message);
      }
    }
  }
}

void MocapInput::count(ShellCounters& counters) const {
  counters.mocap_implausible = implausible_;
  counters.mocap_lost = lost_;
  for (const Input& input : inputs_) counters.mocap_lost += input.reader->refused().total();
}

}  // namespace ledgerline::agent
