#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/program/service_manager.hpp"
#include "onboard/roudi/broker.hpp"
#include "onboard/roudi/host_check.hpp"

namespace ledgerline::roudi {
namespace {

constexpr const char* about =
    "Shared memory between link and agent: iceoryx' RouDi with small pools. One runs per machine.";
constexpr const char* notes = R"(Examples:
  ledgerline-roudi                 serve until SIGTERM
A line {"leaked":N} on standard output says that N chunks were lost with processes that were killed.
Exit codes: 0 stopped by a signal, 1 cannot serve or write the summary, 2 bad usage)";

constexpr long look_period_ns = 250'000'000;

/// iceoryx writes banners to standard output, from a thread of its own too: that goes to standard error from now on,
/// and results to the descriptor that this returns.
int keep_results_apart() {
  const int results = ::dup(STDOUT_FILENO);
  ::dup2(STDERR_FILENO, STDOUT_FILENO);
  return results;
}

/// Until one of the signals, which it returns. What is found out is said when it changes.
int watch_leaks(const sigset_t& signals, const Broker& broker, LeakWatch& watch, int results) {
  for (std::uint32_t said = 0;;) {
    const timespec period{0, look_period_ns};
    const int signal = ::sigtimedwait(&signals, nullptr, &period);
    if (signal > 0) return signal;
    watch.update(broker.chunks_in_use());
    if (watch.leaked() == said) continue;
    if (said == 0) {
      spdlog::warn(
          "{} chunks of shared memory stay in use, of processes that were killed or of a reader that stands still; the "
          "cure for the first: restart RouDi, link and agent while nothing flies",
          watch.leaked());
    }
    said = watch.leaked();
    ::dprintf(results, "{\"leaked\":%u}\n", said);
  }
}

std::string summary(const LeakWatch::Chunks& used, const LeakWatch& watch) {
  return nlohmann::json{{"chunks_in_use", used}, {"leaked", watch.leaked()}, {"leaked_at_most", watch.max_leaked()}}
      .dump(2);
}

int run(const std::string& summary_file) {
  outlive_readers();
  const int results = keep_results_apart();
  auto manager = ServiceManager::from_environment();
  if (!manager) return fail(manager.error());
  const sigset_t signals = block_signals();  // before any thread starts, so that only watch_leaks() sees them
  if (const std::string others = warn_of_others(group_of_process()); !others.empty())
    spdlog::warn("{}: start RouDi, link and agent as a user with a group of its own", others);
  const auto broker = Broker::start();
  if (!broker) return fail(broker.error());
  ::dprintf(results, "{\"ready\":true,\"program\":\"ledgerline-roudi\"}\n");
  if (auto status = manager->ready(); !status) spdlog::error("{}", status.error().message);

  LeakWatch watch(Broker::kept_by_publishers);
  const int signal = watch_leaks(signals, *broker, watch, results);
  const Status written = Recorder().end(summary_file, [&] { return summary(broker->chunks_in_use(), watch); });
  spdlog::info("stopped by {}", signal == SIGINT ? "SIGINT" : "SIGTERM");
  Broker::remove_names();
  return exit_code(written);
}

}  // namespace
}  // namespace ledgerline::roudi

int main(int argc, char** argv) {
  using namespace ledgerline;
  CommandLine line("ledgerline-roudi", roudi::about, roudi::notes);
  std::string summary;
  line.option("--summary", summary, "Write here at the end: chunks in use by size, and how many were lost");
  if (const auto end = line.parse(argc, argv)) return *end;
  const int code = roudi::run(summary);
  std::fflush(nullptr);
  spdlog::default_logger()->flush();
  ::_exit(code);  // iceoryx' threads still run
}
