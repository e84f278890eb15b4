#include "onboard/link/shell/link_shell.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sys/random.h>

#include <algorithm>
#include <csignal>
#include <ctime>
#include <future>
#include <optional>
#include <thread>
#include <utility>

#include "common/base/log.hpp"
#include "common/program/program.hpp"
#include "common/program/service_manager.hpp"
#include "onboard/link/core/tello/tello_text.hpp"
#include "onboard/link/shell/housekeeping.hpp"
#include "onboard/link/shell/link_loop.hpp"
#include "onboard/link/shell/persistent_state.hpp"
#include "onboard/link/shell/report.hpp"
#include "onboard/link/shell/transport/link_ends.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs housekeeping_period_ns = 10 * ns_per_ms;
constexpr int publisher_below_loop = 10;  // priorities between the two are for what a user wants there

Result<std::uint64_t> random_boot_id() {
  std::uint64_t id = 0;
  if (::getrandom(&id, sizeof id, 0) != sizeof id) return Error{"the system gave no random bytes for a boot id"};
  return id;
}

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

Result<Parts> make_parts(const ShellSettings& settings, LinkEnds& ends, int publisher_priority, bool first_start) {
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
  // Of a link that restarts the drones may be in the air: it goes on to the start that lands them.
  if (auto status = ends.connect_agent(settings, is_asked_to_end, first_start); !status) return status.error();
  auto publisher = PublisherThread::start(*ends.agent, publisher_priority, ends.shim.has_value());
  if (!publisher) return publisher.error();
  return Parts{std::move(trace), std::move(*manager), *boot_id, std::move(*publisher)};
}

// The zero of its start keeps a drone in the air for 15 s more. A link that cannot start, and is started for ever, must
// not keep it there, and one that is asked to end lands what flies.
int fail_to_start(const ShellSettings& settings, const Error& error, LinkEnds& ends, std::optional<int> starts) {
  if (!starts || *starts >= settings.link.session.many_starts || is_asked_to_end()) {
    for (const DroneSettings& drone : settings.link.drones)
      (void)ends.drones->send({drone.number, CommandText("land")});
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
  auto parts = make_parts(settings, *ends, publisher_priority, starts.value_or(1) == 1);
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
