#include "tools/local/local.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "common/base/log.hpp"
#include "common/msg/ros.hpp"
#include "common/program/program.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::local {
namespace {

constexpr TimeNs landing_limit_ns = 15 * ns_per_s;
constexpr std::chrono::microseconds poll{500};  // iceoryx
constexpr TimeNs tick_ns = 20 * ns_per_ms;      // for time-outs, where no state comes
constexpr TimeNs heartbeat_period_ns = 50 * ns_per_ms;

}  // namespace

LocalShell::LocalShell(ground::FlightConfig flight, ground::OutputSettings output, dds::ParticipantPtr participant,
                       const std::atomic<bool>& quit)
    : output_(std::move(output)), core_(std::move(flight)), participant_(std::move(participant)), quit_(quit) {}

Status LocalShell::start() {
  if (auto status = recorder_.open(output_.trace); !status) return status;
  const Status connected = retry(
      "RouDi answers", {}, [this] { return quit_.load(); },
      [this] { return ipc::connect("ledgerline-local", [this] { return quit_.load(); }); });
  if (!connected) return connected;
  auto end = ipc::AgentEnd::create();
  if (!end) return end.error();
  end_ = std::move(end).value();
  return subscribe_mocap();
}

Status LocalShell::subscribe_mocap() {
  for (const ground::FlightDrone& who : core_.drones()) {
    Drone drone;
    drone.number = who.number;
    drone.ring = std::make_unique<SpscRing<agent::MocapMessage, 64>>();
    auto reader = dds::RawReader::create(
        participant_, pose_topic_of(usual_pose_topic, who.name), std::string(pose_type), {.reliable = false},
        [ring = drone.ring.get()](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
          // A pose that finds the ring full is older than those that will be taken.
          if (const auto pose = pose_from_cdr(dds::text_of(cdr)))
            (void)ring->push({pose->header.stamp_ns, monotonic_ns(), pose->position_m, pose->orientation});
        });
    if (!reader) return reader.error();
    drone.reader = std::move(reader).value();
    drones_.push_back(std::move(drone));
  }
  return done;
}

// Sim's stamps are of this host's real-time clock.
void LocalShell::forward_mocap() {
  for (Drone& drone : drones_) {
    agent::MocapMessage message{};
    while (drone.ring->pop(message)) {
      const auto measured = mocap_intake_.check(message);
      if (!measured) {
        ++poses_implausible_;
        continue;
      }
      auto pose = drone.fusion.add(*measured);
      if (!pose) continue;
      pose->drone = drone.number;
      (void)end_->send_pose(*pose);  // no chunk left: the next one comes in 10 ms
    }
  }
}

void LocalShell::receive_states(std::vector<StateSample>& states) {
  StateSample sample;
  while (end_->receive_state(sample)) {
    heartbeat_.boot_id = sample.boot_id;
    states.push_back(sample);
  }
  // Nobody keeps transitions; link need not either.
  Transition transition;
  while (end_->receive_transition(transition)) {
    const std::size_t i = std::min(transition.drone, max_drones);
    heartbeat_.boot_id = transition.boot_id;
    heartbeat_.transitions_taken[i] = heartbeat_.transitions_on_ledger[i] = transition.number;
  }
}

void LocalShell::send_heartbeat(TimeNs now_ns) {
  if (now_ns < next_heartbeat_ns_) return;
  next_heartbeat_ns_ = now_ns + heartbeat_period_ns;
  heartbeat_.stamp_ns = now_ns;
  heartbeat_.ledger_alive = true;  // there is none to be silent
  (void)end_->send_heartbeat(heartbeat_);
}

void LocalShell::step(const ground::FlightInputs& inputs) {
  ground::FlightOutputs out = core_.step(monotonic_ns(), inputs);
  for (Plan& plan : out.plans) {
    plan.verified_ns = monotonic_ns();
    if (!end_->send_plan(plan)) ++plans_lost_;
    out.traces.push_back({.t_ns = plan.verified_ns,
                          .kind = TraceKind::command_verified,
                          .drone = plan.drone,
                          .id = plan.sequence,
                          .stamp_ns = plan.state_stamp_ns});
  }
  recorder_.add(out.traces);
  for (const std::string& note : out.notes) spdlog::warn("{}", note);
}

Result<bool> LocalShell::run() {
  TimeNs leave_ns = 0, next_step_ns = 0;
  std::vector<StateSample> states;
  while (!core_.done()) {
    std::this_thread::sleep_for(poll);
    const TimeNs now_ns = monotonic_ns();
    forward_mocap();
    states.clear();
    receive_states(states);
    send_heartbeat(now_ns);
    ground::FlightInputs inputs;
    inputs.states = states;
    const bool leaving = quit_ && leave_ns == 0;
    if (leaving) {
      spdlog::info("asked to end: landing all drones");
      inputs.land = "asked to land";
      leave_ns = now_ns + landing_limit_ns;
    }
    if (!states.empty() || leaving || now_ns >= next_step_ns) {
      next_step_ns = now_ns + tick_ns;
      step(inputs);
    }
    if (leave_ns != 0 && now_ns > leave_ns) {
      spdlog::error("not all drones were seen to land within {:.0f} s", to_seconds(landing_limit_ns));
      break;
    }
    if (output_.status_period_ns == 0 || now_ns < next_status_ns_) continue;
    next_status_ns_ = now_ns + output_.status_period_ns;
    print_status(ground::status_line(core_));
  }
  if (poses_implausible_ > 0)
    spdlog::warn("{} mocap poses had stamps or orientations that are not trusted", poses_implausible_);
  if (plans_lost_ > 0) spdlog::warn("{} plans found no room in shared memory", plans_lost_);
  const Status written = recorder_.end(output_.summary, [this] {
    ground::ShellCounters counters;
    counters.pilots.resize(core_.drones().size());
    return ground::summary(core_, counters);
  });
  if (!written) return written.error();
  return core_.ok();
}

}  // namespace ledgerline::local
