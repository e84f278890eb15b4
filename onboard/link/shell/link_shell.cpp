
#include <fmt/format.h>
#include <pthread.h>
#include <sys/random.h>

#include <algorithm>
#include <csignal>
#include <ctime>
#include <future>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/msg/names.hpp"
#include "common/program/program.hpp"
#include "common/program/service_manager.hpp"
#include "onboard/link/core/tello/tello_text.hpp"
#include "onboard/link/shell/link_loop.hpp"
#include "onboard/link/shell/persistent_state.hpp"
#include "onboard/link/shell/transport/link_ends.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs housekeeping_period_ns = 10 * ns_per_ms;
constexpr TimeNs roudi_period_ns = 1 * ns_per_s;
constexpr TimeNs refresh_period_ns = 1 * ns_per_s;  // a Wi-Fi that is joined again is no loss for longer
constexpr TimeNs stops_retry_ns = 1 * ns_per_s;     // a disk that is full may have room again
constexpr int publisher_below_loop = 10;            // priorities between the two are for what a user wants there

Result<std::uint64_t> random_boot_id() {
  std::uint64_t id = 0;
  if (::getrandom(&id, sizeof id, 0) != sizeof id) return Error{"the system gave no random bytes for a boot id"};
  return id;
}

// One status line (JSON) from the newest sample of each drone.
std::string status_line(const LinkSettings& settings, const std::array<StateSample, max_drones + 1>& newest) {
  nlohmann::json drones = nlohmann::json::array();
  for (const DroneSettings& drone : settings.drones) {
    const StateSample& state = newest[drone.number];
    const nlohmann::json pose_age_ms =
        state.pose_stamp_ns > 0 ? nlohmann::json(to_ms(state.stamp_ns - state.pose_stamp_ns)) : nlohmann::json();
    drones.push_back({{"name", drone.name},
                      {"phase", name(state.phase)},
                      {"mode", name(state.mode)},
                      {"cause", name(state.cause)},
                      {"battery", state.battery},
                      {"temperature_c", state.temperature_c},
                      {"position", state.position_m},
                      {"pose_age_ms", pose_age_ms},
                      {"applied", state.plans_applied},
                      {"dropped", state.plans_dropped},
                      {"late", state.plans_late}});
  }
  return nlohmann::json{{"link", {{"drones", drones}}}}.dump();
}

nlohmann::json to_json(const DroneReport& report, std::uint64_t states_lost) {
  nlohmann::json reasons = nlohmann::json::object();
  for (std::size_t i = 1; i < report.plans.dropped_by.size(); ++i) {
    if (report.plans.dropped_by[i] > 0) reasons[name(static_cast<DropReason>(i))] = report.plans.dropped_by[i];
  }
  return {{"name", report.name},
          {"states_sampled", report.states_sampled},
          {"states_lost", states_lost},
          {"commands_received", report.plans.received},
          {"commands_applied", report.plans.applied},
          {"commands_late", report.plans.late},
          {"commands_dropped", report.plans.dropped},
          {"drop_reasons", reasons},
          {"transitions",
           {{"made", report.transitions.made},
            {"on_ledger", report.transitions.on_ledger},
            {"lost", report.transitions.lost},
            {"kept", report.transitions.kept}}},
          {"age_ms", report.age_ms},
          {"landed", report.landed},
          {"phase", name(report.phase)}};
}

nlohmann::json to_json(const LoopMetrics& loop) {
  const auto late_us = [&](double quantile) { return loop.lateness.quantile(quantile) / ns_per_us; };
  return {{"cycles", loop.cycles},
          {"overruns", loop.overruns},
          {"lateness_us",
           {{"p50", late_us(0.5)},
            {"p95", late_us(0.95)},
            {"p99", late_us(0.99)},
            {"p99_9", late_us(0.999)},
            {"max", loop.lateness.max() / ns_per_us}}},
          {"sends_failed", loop.sends_failed},
          {"trace_lost", loop.trace_lost}};
}

Status write_summary(const std::string& path, const LinkCore& core, const LoopMetrics& loop,
                     const PublisherThread& publisher, bool realtime) {
  nlohmann::json drones = nlohmann::json::array();
  for (const DroneReport& report : core.reports()) drones.push_back(to_json(report, publisher.lost(report.number)));
  const nlohmann::json summary{{"drones", drones}, {"loop", to_json(loop)}, {"realtime", realtime}};
  return write_file(path, summary.dump(2) + "\n");
}

// The thread that may block, beside the loop.
class Housekeeping {
 public:
  Housekeeping(const ShellSettings& settings, LinkLoop& loop, std::optional<TraceWriter> trace,
               const WatchdogThread& watchdog, LocalStopsFile& stops, LinkEnds& ends)
      : settings_(settings), loop_(loop), trace_(std::move(trace)), watchdog_(watchdog), stops_(stops), ends_(ends) {}

  void once(TimeNs now) {
    store_stops(now);
    for (TraceRecord record; loop_.trace().pop(record);) {
      if (trace_) trace_->add(record);
      if (record.kind == TraceKind::mode) log_mode(record);
    }
    for (StateSample state; loop_.states().pop(state);) {
      log_warnings(newest_[state.drone], state);
      newest_[state.drone] = state;
    }
    for (SerialReport reported; loop_.serials().pop(reported);) log_serial(reported);
    for (DroneWords said; loop_.words().pop(said);) log_words(said);
    if (settings_.status_period_ms > 0 && now >= next_status_ns_) {
      next_status_ns_ = now + settings_.status_period_ms * ns_per_ms;
      print_status(status_line(settings_.link, newest_));
    }
    if (!settings_.lockstep && now >= next_roudi_ns_) watch_roudi(now);
    if (now >= next_refresh_ns_) {
      next_refresh_ns_ = now + refresh_period_ns;
      for (const std::string& news : ends_.drones->refresh()) spdlog::warn("{}", news);
    }
    if (const std::uint64_t failed = watchdog_.failed(); failed > std::exchange(watchdog_failed_, failed))
      spdlog::warn("the service manager could not be notified that link lives, {} times so far", failed);
  }

  /// RouDi is not the one that link is connected to any more, and nothing flies: only a new start connects it again.
  bool must_restart() const {
    return !roudi_lives_ &&
           std::none_of(newest_.begin(), newest_.end(), [](const StateSample& s) { return in_flight(s.phase); });
  }

  Status close() {
    if (!trace_) return done;
    if (trace_->dropped() > 0) spdlog::warn("{} trace records did not fit into {}", trace_->dropped(), settings_.trace);
    return trace_->flush();
  }

 private:
  void log_mode(const TraceRecord& record) const {
    const auto mode = static_cast<FailsafeMode>(record.extra);
    const auto cause = static_cast<FailsafeCause>(static_cast<int>(record.v[0]));
    const auto phase = static_cast<FlightPhase>(record.id);
    // On the ground a cause only says what a take-off waits for.
    const bool calm = cause == FailsafeCause::none || !in_flight(phase);
    spdlog::log(calm ? spdlog::level::info : spdlog::level::warn, "{}: {}, failsafe {} ({})", drone(record.drone).name,
                name(phase), name(mode), name(cause));
  }

  void log_warnings(const StateSample& before, const StateSample& now) const {
    const std::string& name = drone(now.drone).name;
    if (now.hot && !before.hot) {
      spdlog::warn("{}: {:.0f} degrees{}", name, now.temperature_c,
                   in_flight(now.phase) ? ": hotter than a Tello is in flight: land it"
                                        : " on the ground, where nothing cools it: take off soon, or switch it off");
    }
    if (now.contested && !before.contested) {
      spdlog::error(
          "{}: another client commands it as well: its state texts went away and came back with `command` twice within "
          "a "
          "minute. Is its address in the link.toml of another host, or `ledgerline tello` at work? It does not take "
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

  void log_serial(const SerialReport& reported) const {
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

  void log_words(const DroneWords& said) const {
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

  // The loop speaks of no others.
  const DroneSettings& drone(DroneNumber number) const {
    return *std::find_if(settings_.link.drones.begin(), settings_.link.drones.end(),
                         [&](const DroneSettings& known) { return known.number == number; });
  }

  void store_stops(TimeNs now) {
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

  void watch_roudi(TimeNs now) {
    next_roudi_ns_ = now + roudi_period_ns;
    const bool lives = ipc::is_roudi_alive();
    if (roudi_lives_ && !lives) {
      spdlog::error(
          "RouDi is gone: what is connected goes on, but nobody new can join; once nothing flies, link ends, to be "
          "started again behind a new RouDi");
    }
    roudi_lives_ = lives;
  }

  const ShellSettings& settings_;
  LinkLoop& loop_;
  std::optional<TraceWriter> trace_;
  const WatchdogThread& watchdog_;
  std::uint64_t watchdog_failed_ = 0;
  LocalStopsFile& stops_;
  LinkEnds& ends_;
  DroneSet reported_stops_;
  TimeNs next_stops_ns_ = 0;
  std::array<StateSample, max_drones + 1> newest_{};
  TimeNs next_status_ns_ = 0;
  TimeNs next_roudi_ns_ = 0;
  TimeNs next_refresh_ns_ = 0;
  bool roudi_lives_ = true;
};

// SIGUSR1 is blocked in every thread; this one picks it up, or waits a turn at most: then false.
bool wait_for_clear(const sigset_t& clear) {
  const timespec turn{0, housekeeping_period_ns};
  return ::sigtimedwait(&clear, nullptr, &turn) == SIGUSR1;
}

// Who cannot know which drones are stopped stops all of them.
DroneSet previous_stops(const ShellSettings& settings, LocalStopsFile& file) {
  auto stopped = file.read();
  if (stopped) return *stopped;
  spdlog::error("{}: every drone counts as stopped at this host, until that is cleared", stopped.error().message);
  DroneSet all;
  for (const DroneSettings& drone : settings.link.drones) all.set(drone.number);
  return all;
}

// How often it was started recently; none: nobody remembers, which is no reason not to fly.
std::optional<int> recent_starts(const ShellSettings& settings) {
  if (settings.starts.empty()) return std::nullopt;
  const auto starts = record_start(settings.starts, monotonic_ns());
  if (!starts) {
    spdlog::error("{}: a link that dies repeatedly would keep its drones in the air", starts.error().message);
    return std::nullopt;
  }
  if (*starts >= settings.link.session.many_starts)
    spdlog::error("{} starts within {:.0f} s: the drones are commanded to land first", *starts,
                  to_seconds(starts_within_ns));
  return *starts;
}

bool is_asked_to_end() {
  sigset_t pending;
  ::sigpending(&pending);
  return sigismember(&pending, SIGTERM) == 1 || sigismember(&pending, SIGINT) == 1;
}

/// What is made before the loop, all of which may fail.
struct Parts {
  std::optional<TraceWriter> trace;
  ServiceManager manager;
  std::uint64_t boot_id = 0;
  std::unique_ptr<PublisherThread> publisher;
};

Result<Parts> make_parts(const ShellSettings& settings, LinkEnds& ends, int publisher_priority) {
  std::optional<TraceWriter> trace;
  if (!settings.trace.empty()) {
    auto writer = TraceWriter::create(settings.trace);
    if (!writer) return writer.error();
    trace = std::move(*writer);
  }
  auto manager = ServiceManager::from_environment();
  if (!manager) return manager.error();
  const auto boot_id = random_boot_id();
  if (!boot_id) return boot_id.error();
  if (auto status = ends.connect_agent(settings, is_asked_to_end); !status) return status.error();
  auto publisher = PublisherThread::start(*ends.agent, publisher_priority, ends.shim.has_value());
  if (!publisher) return publisher.error();
  return Parts{std::move(trace), std::move(*manager), *boot_id, std::move(*publisher)};
}

// The zero of its start keeps a drone in the air for 15 s more. A link that cannot start, and is started for ever, must
// not keep it there, and one that is asked to end lands what flies.
int fail_to_start(const ShellSettings& settings, const Error& error, LinkEnds& ends, std::optional<int> starts) {
  if (!starts || *starts >= settings.link.session.many_starts || is_asked_to_end()) {
    for (const DroneSettings& drone : settings.link.drones)
      (void)ends.drones->send({drone.number, command_text("land")});
  }
  return fail(error);
}

void warn_of_lost_links(const LinkCore& core) {
  for (const DroneReport& report : core.reports()) {
    if (!report.heard)
      spdlog::warn("{}: no state ever came from it; it was commanded to land without state", report.name);
  }
  if (!core.all_on_ground_or_unheard())
    spdlog::error("not every drone was seen on the ground; a Tello lands by itself 15 s after the last command");
}

void report_transitions(const LinkCore& core) {
  for (const DroneReport& report : core.reports()) {
    const TransitionLog::Counters& t = report.transitions;
    if (t.lost > 0)
      spdlog::error("{}: {} transitions of the failsafe are lost, agent was away too long", report.name, t.lost);
    if (t.kept > 0)
      spdlog::warn("{}: {} transitions of the failsafe were not on the ledger yet, as far as agent reported",
                   report.name, t.kept);
  }
}

}  // namespace

int run_link(const ShellSettings& settings) {
  outlive_readers();
  catch_stop_signals_of_service();
  const sigset_t ending = block_signals({SIGTERM, SIGINT, SIGHUP}), clear = block_signals({SIGUSR1});
  // Before all that may wait or fail: files, RouDi, threads.
  auto ends = LinkEnds::open_drones(settings);
  if (!ends) return fail(ends.error());
  const std::optional<int> starts = recent_starts(settings);
  const int publisher_priority = settings.priority > 0 ? std::max(settings.priority - publisher_below_loop, 1) : 0;
  auto parts = make_parts(settings, *ends, publisher_priority);
  if (!parts) return fail_to_start(settings, parts.error(), *ends, starts);

  LocalStopsFile stops(settings.local_stops, settings.link.drones);
  auto core =
      std::make_unique<LinkCore>(settings.link, parts->boot_id, starts.value_or(1), previous_stops(settings, stops));
  auto loop =
      std::make_unique<LinkLoop>(settings, *core, *ends->agent, *parts->publisher, *ends->drones, stop_requested);

  std::promise<RealTime> entered;
  auto real_time_result = entered.get_future();
  std::thread thread([&] {
    ::pthread_setname_np(::pthread_self(), "loop");
    entered.set_value(enter_real_time(settings.priority, settings.cpu));
    loop->run(*ends->clock(settings));
  });
  // In this thread alone, and their handler notifies the loop: this one may wait for a disk, or for who reads its log.
  ::pthread_sigmask(SIG_UNBLOCK, &ending, nullptr);
  const RealTime real_time = real_time_result.get();
  for (const std::string& notice : real_time.notices) spdlog::warn("{}", notice);
  print_line(fmt::format(R"({{"ready":true,"program":"ledgerline-link","drones":{}}})", settings.link.drones.size()));
  if (auto status = parts->manager.ready(); !status) spdlog::error("{}", status.error().message);
  // By the loop's own turns: a loop that hangs is not spoken for.
  const WatchdogThread watchdog(
      parts->manager, [&loop] { return loop->turns(); }, publisher_priority);
  Housekeeping housekeeping(settings, *loop, std::move(parts->trace), watchdog, stops, *ends);

  for (bool reported = false; !loop->ended();) {
    if (wait_for_clear(clear)) {
      loop->clear_local_stops();
      spdlog::info("asked to clear the local stops");
    }
    if (stop_requests > 0 && !std::exchange(reported, true))
      spdlog::info("asked to stop: what flies lands first, for at most {:.0f} s",
                   to_seconds(settings.landing_bound_ns));
    housekeeping.once(monotonic_ns());
    if (housekeeping.must_restart()) stop_requested = true;
  }
  thread.join();
  core->finish();
  housekeeping.once(monotonic_ns());
  warn_of_lost_links(*core);
  report_transitions(*core);
  if (auto status = housekeeping.close(); !status) return fail(status.error());
  if (!settings.summary.empty()) {
    if (auto status = write_summary(settings.summary, *core, loop->metrics(), *parts->publisher, real_time.all());
        !status)
      return fail(status.error());
  }
  return core->all_on_ground_or_unheard() ? 0 : 1;
}

}  // namespace ledgerline::link
