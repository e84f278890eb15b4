#include "onboard/agent/shell/agent.hpp"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "common/base/log.hpp"
#include "common/rt/retry.hpp"
#include "common/rt/scheduling.hpp"

namespace ledgerline::agent {
namespace {

// Urgent events wake the loop. This bounds the wait for retries, shutdown, and older links that send no wakeup. Halved
// it costs CPU, doubled a call that failed waits longer.
constexpr TimeNs max_wait_ns = 5 * ns_per_ms;
constexpr TimeNs drain_limit_ns = 500 * ns_per_ms;
constexpr TimeNs flight_silent_ns = 1 * ns_per_s;
constexpr std::chrono::milliseconds roudi_watch_turn{100};
constexpr std::chrono::milliseconds roudi_watch_period{1000};

}  // namespace

Agent::Agent(Settings settings, std::vector<std::unique_ptr<AgentShell>> channels, const std::atomic<bool>& quit)
    : settings_(std::move(settings)), quit_(quit) {
  for (auto& channel : channels) channels_.push_back({.shell = std::move(channel)});
  for (DroneNumber drone = 1; drone <= max_drones; ++drone) {
    const auto owner =
        std::find_if(channels_.begin(), channels_.end(), [&](const Slot& slot) { return slot.shell->flies(drone); });
    if (owner != channels_.end()) of_drone_[drone] = &*owner;
  }
}

Status Agent::start() {
  auto manager = ServiceManager::from_environment();
  if (!manager) return manager.error();
  manager_.emplace(std::move(manager).value());
  if (auto status = recorder_.open(settings_.trace); !status) return status;
  if (certificates_) certificates_->start(fabric::CertificateWatch::log);
  const Status connected = retry(
      "RouDi answers", {.within_ns = settings_.start_wait_ns}, [this] { return quit_.load(); },
      [this] { return ipc::connect("ledgerline-agent", [this] { return quit_.load(); }); });
  if (!connected) return connected;
  auto end = ipc::AgentEnd::create();
  if (!end) return end.error();
  end_ = std::move(end).value();
  roudi_watch_ = std::jthread([this](const std::stop_token& stop) { watch_roudi(stop); });
  for (const Slot& slot : channels_) {
    if (auto status = slot.shell->start(*end_, recorder_); !status) return status;
  }
  return channels_.size() == 1 ? channels_.front().shell->reach(quit_) : reach_channels();
}

// Behind a restart in flight the drones of a channel that is there must not wait for one that is not.
Status Agent::reach_channels() {
  for (Slot& slot : channels_)
    slot.reaching = std::async(std::launch::async, [this, &slot] { return slot.shell->reach(quit_); });
  std::optional<Error> first;
  std::size_t waiting = channels_.size(), reached = 0;
  while (waiting > 0) {
    for (Slot& slot : channels_) {
      if (!slot.reaching.valid() || slot.reaching.wait_for(std::chrono::seconds(0)) != std::future_status::ready)
        continue;
      const Status status = slot.reaching.get();
      --waiting;
      reached += status ? 1 : 0;
      if (status) continue;
      if (!first) first = status.error();
      spdlog::error("channel {}: {}. Its drones are not flown until it is reached", slot.shell->channel(),
                    status.error().message);
    }
    if (reached > 0) begin();
    wait();
    if (auto status = turn(); !status) return status;
    if (is_begun_) run_periodic_tasks(monotonic_ns());
  }
  if (quit_ || reached == 0) return first.value_or(Error{"asked to end"});
  return done;
}

// Drones fly from here on, whatever is still waited for.
void Agent::begin() {
  if (std::exchange(is_begun_, true)) return;
  (void)enter_scheduling(Scheduling::short_slices);  // it is well enough without
  raise_priority(settings_.priority, "the main loop");
  if (auto status = manager_->ready(); !status) spdlog::error("{}", status.error().message);
}

// The wakeup is cleared before the states are taken: one that comes after that notifies the next turn.
void Agent::wait() {
  const TimeNs now = monotonic_ns();
  TimeNs until_ns = now + max_wait_ns;
  std::array<pollfd, max_drones + 1> fds{};  // each channel has a drone of its own
  std::size_t count = 0;
  fds[count++] = {.fd = end_->wake_fd(), .events = POLLIN, .revents = 0};
  for (const Slot& slot : channels_) {
    if (!slot.up()) continue;
    until_ns = std::min(until_ns, slot.shell->due_ns());
    fds[count++] = {.fd = slot.shell->wake_fd(), .events = POLLIN, .revents = 0};
  }
  const TimeNs timeout_ns = std::max<TimeNs>(until_ns - now, 0);
  const timespec timeout{.tv_sec = timeout_ns / ns_per_s, .tv_nsec = timeout_ns % ns_per_s};
  (void)::ppoll(fds.data(), count, &timeout, nullptr);  // interrupted or not: the loop looks at everything
  link_woke_ = end_->woken();
}

void Agent::receive_from_link() {
  const auto of = [this](DroneNumber drone) -> AgentShell* {
    const Slot* slot = drone <= max_drones ? of_drone_[drone] : nullptr;
    return slot && slot->up() ? slot->shell.get() : nullptr;
  };
  StateSample sample;
  while (end_->receive_state(sample)) {
    if (is_in_flight(sample.phase)) flight_heard_ns_ = monotonic_ns();
    if (AgentShell* shell = of(sample.drone)) shell->on_state(sample);
  }
  // Link keeps one that nobody takes, and sends it again.
  Transition transition;
  while (end_->receive_transition(transition)) {
    if (AgentShell* shell = of(transition.drone)) shell->on_transition(transition);
  }
}

Status Agent::turn() {
  for (const Slot& slot : channels_) {
    if (!slot.up()) continue;
    if (auto status = slot.shell->handle_events(link_woke_); !status) return status;
  }
  receive_from_link();
  for (const Slot& slot : channels_) {
    if (slot.up()) slot.shell->finish_turn();
  }
  return done;
}

// What was connected flows on without RouDi, so ending while a drone flies would only take its commands away.
bool Agent::cut_off(TimeNs now) const { return roudi_gone_ && now - flight_heard_ns_ > flight_silent_ns; }

void Agent::run_periodic_tasks(TimeNs now) {
  if (settings_.status_period_ns > 0 && advance_if_due(now, next_status_ns_, settings_.status_period_ns)) {
    const auto days = certificates_ ? std::optional(certificates_->days_left()) : std::nullopt;
    for (const Slot& slot : channels_) {
      if (slot.up()) slot.shell->write_status(now, days);  // else another thread has it
    }
  }
  if (auto status = manager_->alive(now, ++turns_); !status) spdlog::warn("{}", status.error().message);
}

Status Agent::run() {
  begin();
  while (!quit_ && !cut_off(monotonic_ns())) {
    wait();
    if (auto status = turn(); !status) return status;
    run_periodic_tasks(monotonic_ns());
  }
  drain();
  return write_summary();
}

void Agent::drain() {
  for (const Slot& slot : channels_) slot.shell->stop_submitting();
  const TimeNs until_ns = monotonic_ns() + drain_limit_ns;
  const auto busy = [](const Slot& slot) { return slot.up() && slot.shell->has_calls_in_flight(); };
  while (std::any_of(channels_.begin(), channels_.end(), busy) && monotonic_ns() < until_ns) {
    wait();
    for (const Slot& slot : channels_) {
      if (!slot.up()) continue;
      if (!slot.shell->handle_events(link_woke_)) return;  // too many blocks: the summary is still worth writing
      slot.shell->finish_turn();
    }
  }
}

Status Agent::write_summary() {
  std::vector<std::string> reported;
  for (const Slot& slot : channels_) reported.push_back(slot.shell->end());
  return recorder_.end(settings_.summary,
                       [&] { return reported.size() == 1 ? reported.front() : summary_of_all(reported); });
}

void Agent::watch_roudi(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    if (!roudi_gone_ && !ipc::is_roudi_alive()) {
      roudi_gone_ = true;
      spdlog::error(
          "RouDi is gone: what is connected goes on, but a link that restarts is not heard; once none is heard or "
          "nothing flies, agent ends, to be started again behind a new RouDi");
    }
    for (std::chrono::milliseconds waited{0}; waited < roudi_watch_period && !stop.stop_requested();
         waited += roudi_watch_turn) {
      std::this_thread::sleep_for(roudi_watch_turn);
    }
  }
}

}  // namespace ledgerline::agent
