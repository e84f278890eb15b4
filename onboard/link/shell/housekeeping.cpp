#include "onboard/link/shell/housekeeping.hpp"

#include <algorithm>
#include <utility>

#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/msg/names.hpp"
#include "common/program/program.hpp"
#include "onboard/link/shell/report.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs roudi_period_ns = 1 * ns_per_s;
constexpr TimeNs refresh_period_ns = 1 * ns_per_s;  // a Wi-Fi that is joined again is no loss for longer
constexpr TimeNs stops_retry_ns = 1 * ns_per_s;     // a disk that is full may have room again

}  // namespace

void Housekeeping::once(TimeNs now) {
  store_stops(now);
  for (TraceRecord record; loop_.trace().pop(record);) {
    if (trace_) trace_->add(record);
    if (record.kind == TraceKind::mode) log_mode(record);
  }
  for (StateSample state; loop_.states().pop(state);) {
    log_warnings(newest_[state.drone], state);
    newest_[state.drone] = state;
  }
  for (SerialReport reported; loop_.serials().pop(reported);) {
    log_serial(reported);
    serials_[reported.drone] = reported;
  }
  for (DroneWords said; loop_.words().pop(said);) log_words(said);
  if (settings_.status_period_ms > 0 && now >= next_status_ns_) {
    next_status_ns_ = now + settings_.status_period_ms * ns_per_ms;
    print_status(status_line(settings_.link, newest_, serials_));
  }
  if (!settings_.lockstep && now >= next_roudi_ns_) watch_roudi(now);
  if (now >= next_refresh_ns_) {
    next_refresh_ns_ = now + refresh_period_ns;
    for (const std::string& news : ends_.drones->refresh()) spdlog::warn("{}", news);
  }
  if (const std::uint64_t failed = watchdog_.failed(); failed > std::exchange(watchdog_failed_, failed))
    spdlog::warn("the service manager could not be notified that link lives, {} times so far", failed);
}

bool Housekeeping::must_restart() const {
  return !roudi_lives_ &&
         std::none_of(newest_.begin(), newest_.end(), [](const StateSample& s) { return is_in_flight(s.phase); });
}

Status Housekeeping::close() {
  if (!trace_) return done;
  if (trace_->dropped() > 0) spdlog::warn("{} trace records did not fit into {}", trace_->dropped(), settings_.trace);
  return trace_->flush();
}

void Housekeeping::log_mode(const TraceRecord& record) const {
  const auto mode = static_cast<FailsafeMode>(record.extra);
  const auto cause = static_cast<FailsafeCause>(static_cast<int>(record.v[0]));
  const auto phase = static_cast<LinkPhase>(record.id);
  // On the ground a cause only says what a take-off waits for.
  const bool calm = cause == FailsafeCause::none || !is_in_flight(phase);
  spdlog::log(calm ? spdlog::level::info : spdlog::level::warn, "{}: {}, failsafe {} ({})", drone(record.drone).name,
              name(phase), name(mode), name(cause));
}

void Housekeeping::log_warnings(const StateSample& before, const StateSample& now) const {
  const std::string& name = drone(now.drone).name;
  if (now.hot && !before.hot) {
    spdlog::warn("{}: {:.0f} degrees{}", name, now.temperature_c,
                 is_in_flight(now.phase) ? ": hotter than a Tello is in flight: land it"
                                         : " on the ground, where nothing cools it: take off soon, or switch it off");
  }
  if (now.contested && !before.contested) {
    spdlog::error(
        "{}: another client commands it as well: its state texts went away and came back with `command` twice within "
        "a minute. Is its address in the link.toml of another host, or `ledgerline tello` at work? It does not take "
        "off",
        name);
  }
  if (now.diverted && !before.diverted) {
    spdlog::warn(
        "{}: it answers, but its state texts stay away: another client may have said `command` to it, or a firewall "
        "holds back UDP 8890",
        name);
  }
}

void Housekeeping::log_serial(const SerialReport& reported) const {
  const DroneSettings& meant = drone(reported.drone);
  switch (reported.verdict) {
    case SerialCheck::Verdict::same:
      spdlog::info("{}: it is {}", meant.name, meant.serial);
      break;
    case SerialCheck::Verdict::other:
      spdlog::error("{}: {} answers, not {} as in the config: it does not take off", meant.name,
                    reported.answered.view(), meant.serial);
      break;
    case SerialCheck::Verdict::unreported:
      spdlog::warn("{}: its firmware reports no serial (sn?), so it is not checked that it is {}", meant.name,
                   meant.serial);
      break;
    case SerialCheck::Verdict::open:
    case SerialCheck::Verdict::unwanted:
      break;
  }
}

void Housekeeping::log_words(const DroneWords& said) const {
  const std::string text = printable(said.text.view());
  switch (said.kind) {
    case DroneWords::Kind::takeoff_refused:
      spdlog::error("{}: it refuses to take off: \"{}\"", drone(said.drone).name, text);
      break;
    case DroneWords::Kind::state_unreadable:
      spdlog::error(
          "{}: texts come and are not understood: \"{}\". A Tello's state text has bat, h and tof, as in "
          "`bat:87;`: another firmware, or another device at its address",
          drone(said.drone).name, text);
      break;
  }
}

const DroneSettings& Housekeeping::drone(DroneNumber number) const {
  return *std::find_if(settings_.link.drones.begin(), settings_.link.drones.end(),
                       [&](const DroneSettings& known) { return known.number == number; });
}

void Housekeeping::store_stops(TimeNs now) {
  const DroneSet stopped = loop_.local_stops();
  for (const DroneSettings& drone : settings_.link.drones) {
    if (stopped[drone.number] && !reported_stops_[drone.number])
      spdlog::warn("{}: stopped at this host: it stays down until that stop is cleared", drone.name);
    if (!stopped[drone.number] && reported_stops_[drone.number])
      spdlog::info("{}: its local stop is cleared", drone.name);
  }
  reported_stops_ = stopped;
  if (now < next_stops_ns_) return;
  if (const Status status = stops_.store(stopped); !status) {
    next_stops_ns_ = now + stops_retry_ns;
    spdlog::error("{}: a link that restarts would not know who is stopped", status.error().message);
  }
}

void Housekeeping::watch_roudi(TimeNs now) {
  next_roudi_ns_ = now + roudi_period_ns;
  const bool lives = ipc::is_roudi_alive();
  if (roudi_lives_ && !lives) {
    spdlog::error(
        "RouDi is gone: what is connected goes on, but nobody new can join; once nothing flies, link ends, to be "
        "started again behind a new RouDi");
  }
  roudi_lives_ = lives;
}

}  // namespace ledgerline::link
